//! Estimators. Each takes the rows as triangular factors or as blocks, and gives values: an estimate with what it cost, never an error.

pub mod feasible;
pub mod instrumental;
pub mod least_squares;
pub mod robust;
pub mod weighted;

/// How parameters are estimated.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Method {
    /// Physically consistent: every link keeps a mass distribution, friction and rotors are not negative, and what the recordings do not
    /// show stays near the nominal robot.
    Sdp,
    /// Ordinary least squares on the base parameters.
    Ols,
    /// Weighted by the noise of each drive.
    Wls,
    /// Iteratively reweighted, Huber's weights: large residuals count linearly.
    Huber,
    /// Iteratively reweighted, bisquare weights: very large residuals do not count.
    Bisquare,
    /// Total least squares: columns are noisy, too.
    Tls,
    /// Weighted least squares on those base parameters that the recordings determine and that a physical robot can have.
    Relevant,
    /// Ridge towards the nominal robot, its weight by cross-validation.
    Ridge,
    /// Instrumental variables along the simulated motion: noise in the columns does no harm. Needs a simulation.
    Iv,
}

impl Method {
    /// All methods, those that need a simulation last.
    pub const EVERY: [Self; 9] = {
        let [a, b, c, d, e, f, g, h] = Self::ALL;
        [a, b, c, d, e, f, g, h, Self::Iv]
    };

    /// All methods that need nothing but recordings, the recommended first.
    pub const ALL: [Self; 8] = [Self::Sdp, Self::Wls, Self::Relevant, Self::Ols, Self::Huber, Self::Bisquare, Self::Tls, Self::Ridge];

    /// Name, as on the command line.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Sdp => "sdp",
            Self::Ols => "ols",
            Self::Wls => "wls",
            Self::Relevant => "relevant",
            Self::Huber => "huber",
            Self::Bisquare => "bisquare",
            Self::Tls => "tls",
            Self::Ridge => "ridge",
            Self::Iv => "iv",
        }
    }
}
