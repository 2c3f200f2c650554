//! What is done to recordings before they are identified from, as arguments.

use clap::ValueEnum;
use pkm_ident::preprocess::differentiation::Derivative;
use pkm_ident::preprocess::{Clock, Preprocess};

use crate::diagnosis::positive;

/// Arguments about preprocessing.
#[derive(Debug, clap::Args)]
pub(super) struct Preparation {
    /// Replace samples further than this many robust standard deviations from the median around them.
    #[arg(long, value_name = "SD", value_parser = positive, help_heading = "Preprocessing")]
    outliers: Option<f64>,
    /// Thin to the rate nearest above this one, behind a zero-phase filter.
    #[arg(long, value_name = "HZ", value_parser = positive, help_heading = "Preprocessing")]
    rate: Option<f64>,
    /// Average over this period of a periodic motion.
    #[arg(long, value_name = "SECONDS", value_parser = positive, help_heading = "Preprocessing")]
    period: Option<f64>,
    /// Efforts are stamped this much too late (negative: too early).
    #[arg(long, value_name = "SECONDS", allow_negative_numbers = true, conflicts_with = "find_late", value_parser = finite, help_heading = "Preprocessing")]
    late: Option<f64>,
    /// Estimate how late efforts are, to this much to either side.
    #[arg(long, value_name = "SECONDS", value_parser = positive, help_heading = "Preprocessing")]
    find_late: Option<f64>,
    /// How velocities and accelerations come from positions.
    #[arg(long, value_name = "WAY", default_value = "filtered", help_heading = "Preprocessing")]
    derivative: DerivativeName,
}

/// A way of differentiating as a word on the command line.
#[derive(Debug, Clone, Copy)]
struct DerivativeName(Derivative);

impl ValueEnum for DerivativeName {
    fn value_variants<'a>() -> &'a [Self] {
        const ALL: [DerivativeName; Derivative::ALL.len()] = {
            let mut all = [DerivativeName(Derivative::Filtered); Derivative::ALL.len()];
            let mut i = 0;
            while i < all.len() {
                all[i] = DerivativeName(Derivative::ALL[i]);
                i += 1;
            }
            all
        };
        &ALL
    }

    fn to_possible_value(&self) -> Option<clap::builder::PossibleValue> {
        Some(clap::builder::PossibleValue::new(self.0.name()))
    }
}

fn finite(text: &str) -> Result<f64, String> {
    text.parse::<f64>().ok().filter(|x| x.is_finite()).ok_or_else(|| "must be a finite number".to_string())
}

impl Preparation {
    /// The steps that are asked for.
    pub(super) fn steps(&self) -> Preprocess {
        let clock = match (self.late, self.find_late) {
            (_, Some(most)) => Clock::Estimated(most),
            (Some(late), None) => Clock::Late(late),
            (None, None) => Clock::Stamped,
        };
        Preprocess { outliers: self.outliers, rate_hz: self.rate, period_s: self.period, clock }
    }

    /// How positions are differentiated.
    pub(super) fn derivative(&self) -> Derivative {
        self.derivative.0
    }
}
