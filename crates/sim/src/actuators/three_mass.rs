//! A screw drive that is not rigid: motor, belt and screw, rod, and the spring of a force cell between rod and load [McDaid, sec. 8.4].
//!
//! Motor angle and current are carried as their equivalents at the rod, `x_m = θ_m·r_m/(r_s·G_s)` `[m]` and `f = K_t·K_a·i` `[N]` with
//! `K_a = G_s·r_s/r_m` `[rad/m]` and `G_s` `[rad/m]` the screw's turn per travel. The model of the chapter then reads
//!
//! ```text
//! m_m·x_m'' + b_m·x_m' + b_b·(x_m' − x_r') + k_b·(x_m − x_r) = f          m_m = J_m·K_a²,      b_m = K_a²·b_motor
//! m_r·x_r'' + b_r·x_r' + b_b·(x_r' − x_m') + k_b·(x_r − x_m) = −y − F     m_r = m_rod + G_s²·J_s,  b_r = b_rod + G_s²·b_s
//! y = k_f·(x_r − l) + b_f·(x_r' − l')                                     k_b = 2·(r_s·G_s)²·k_belt,  b_b likewise
//! τ·f' + f = f_cmd
//! ```
//!
//! with `l` the load's position, `y` the force on the load and `F` Coulomb friction of the rod. (The signs of `F` in (8.5) and of the belt's
//! terms in (8.21) are misprinted there.)

use nalgebra::{SMatrix, SVector};

use crate::error::SimError;

/// Numbers of the drive, as they stand on data sheets.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ThreeMassParameters {
    /// Inertia of the motor with its pulley `[kg·m²]`.
    pub motor_inertia: f64,
    /// Viscous friction of the motor `[N·m·s/rad]`.
    pub motor_viscous: f64,
    /// Radius of the motor's pulley `[m]`.
    pub motor_pulley: f64,
    /// Inertia of the screw with its pulley `[kg·m²]`.
    pub screw_inertia: f64,
    /// Viscous friction of the screw `[N·m·s/rad]`.
    pub screw_viscous: f64,
    /// Radius of the screw's pulley `[m]`.
    pub screw_pulley: f64,
    /// Turn of the screw per travel `[rad/m]`: 2π over the pitch.
    pub screw_ratio: f64,
    /// Stiffness of one side of the belt `[N/m]`.
    pub belt_stiffness: f64,
    /// Damping of one side of the belt `[N·s/m]`.
    pub belt_damping: f64,
    /// Mass of the rod `[kg]`.
    pub rod_mass: f64,
    /// Viscous friction of the rod `[N·s/m]`.
    pub rod_viscous: f64,
    /// Coulomb friction of the rod `[N]`.
    pub rod_coulomb: f64,
    /// Stiffness of force cell and joint `[N/m]`.
    pub cell_stiffness: f64,
    /// Damping of force cell and joint `[N·s/m]`.
    pub cell_damping: f64,
    /// Time constant of the current loop `[s]`.
    pub current_lag: f64,
}

impl ThreeMassParameters {
    /// The drive of the 4-UPS ankle robot. Pitch and ratio are the chapter's; what it leaves out is assumed such that uniform gains become
    /// unstable where Table 8.5 says they do.
    pub const ANKLE: Self = Self {
        motor_inertia: 2e-5,
        motor_viscous: 4e-4,
        motor_pulley: 0.006,
        screw_inertia: 2e-6,
        screw_viscous: 1e-5,
        screw_pulley: 0.030,
        screw_ratio: 2.0 * core::f64::consts::PI / 3.175e-3,
        belt_stiffness: 6e4,
        belt_damping: 6.0,
        rod_mass: 0.6,
        rod_viscous: 200.0,
        rod_coulomb: 0.0,
        cell_stiffness: 2e6,
        cell_damping: 300.0,
        current_lag: 1e-3,
    };

    /// Turn of the motor per travel of the rod `[rad/m]`.
    #[must_use]
    pub fn motor_ratio(&self) -> f64 {
        self.screw_ratio * self.screw_pulley / self.motor_pulley
    }

    fn check(&self) -> Result<(), SimError> {
        let positive = [
            ("motor inertia", self.motor_inertia),
            ("motor pulley", self.motor_pulley),
            ("screw pulley", self.screw_pulley),
            ("screw ratio", self.screw_ratio),
            ("belt stiffness", self.belt_stiffness),
            ("rod mass", self.rod_mass),
            ("cell stiffness", self.cell_stiffness),
            ("current lag", self.current_lag),
        ];
        let others = [
            ("motor friction", self.motor_viscous),
            ("screw inertia", self.screw_inertia),
            ("screw friction", self.screw_viscous),
            ("belt damping", self.belt_damping),
            ("rod friction", self.rod_viscous),
            ("rod Coulomb friction", self.rod_coulomb),
            ("cell damping", self.cell_damping),
        ];
        for (what, value) in positive {
            if !(value.is_finite() && value > 0.0) {
                return Err(SimError::Scenario { what, value, limit: "must be finite and positive" });
            }
        }
        for (what, value) in others {
            if !(value.is_finite() && value >= 0.0) {
                return Err(SimError::Scenario { what, value, limit: "must be finite and not negative" });
            }
        }
        Ok(())
    }
}

/// Order of the state, and of what is constant over a step or changes evenly.
const X_M: usize = 0;
const X_R: usize = 1;
const V_M: usize = 2;
const V_R: usize = 3;
const F: usize = 4;
/// Integral of the force on the load, over its stiffness `[m·s]`.
const AREA: usize = 5;
const F_CMD: usize = 6;
const LOAD: usize = 7;
const V_LOAD: usize = 8;
const RUB: usize = 9;
const N: usize = 10;

/// The drive in motion.
#[derive(Debug, Clone)]
pub struct ThreeMass {
    parameters: ThreeMassParameters,
    /// Velocities are carried over this, so that the matrix is well scaled `[1/s]`.
    scale: f64,
    rates: SMatrix<f64, N, N>,
    /// Step that the maps are for, the map, and the one of a rod that stands.
    h: f64,
    map: SMatrix<f64, N, N>,
    standing: SMatrix<f64, N, N>,
    state: SVector<f64, N>,
}

impl ThreeMass {
    /// The drive at rest with the load at `load` `[m]`, no force in it.
    ///
    /// # Errors
    /// A parameter that is negative or none, or zero where something must be.
    pub fn try_new(parameters: ThreeMassParameters, load: f64) -> Result<Self, SimError> {
        parameters.check()?;
        let (scale, rates) = rates(&parameters);
        let mut state = SVector::zeros();
        (state[X_M], state[X_R], state[LOAD]) = (load, load, load);
        let unit = SMatrix::identity();
        Ok(Self { parameters, scale, rates, h: 0.0, map: unit, standing: unit, state })
    }

    /// Brings it to rest with the load at `load` `[m]` and the force `force` `[N]` on it.
    pub fn settle(&mut self, force: f64, load: f64) {
        let rod = load + force / self.parameters.cell_stiffness;
        self.state = SVector::zeros();
        (self.state[X_R], self.state[X_M]) = (rod, rod + force / Rod::of(&self.parameters).k_b);
        (self.state[LOAD], self.state[F], self.state[F_CMD]) = (load, force, force);
    }

    /// Lets `h` `[s]` pass under a wanted force `[N]` while the load moves evenly from where it was to `load` `[m]`; returns the mean force
    /// on the load meanwhile `[N]`.
    ///
    /// Exact but for dry friction: a rod that comes to rest, or is torn loose, does so at the end of a step.
    pub fn advance(&mut self, force_cmd: f64, load: f64, h: f64) -> f64 {
        if (h - self.h).abs() > 0.0 {
            self.tune(h);
        }
        let x = &mut self.state;
        (x[F_CMD], x[V_LOAD], x[AREA], x[RUB]) = (force_cmd, (load - x[LOAD]) / (h * self.scale), 0.0, 0.0);
        self.state = if self.parameters.rod_coulomb > 0.0 { self.rubbed() } else { self.map * self.state };
        self.state[LOAD] = load;
        self.parameters.cell_stiffness * self.state[AREA] / h
    }

    fn tune(&mut self, h: f64) {
        let mut locked = self.rates;
        locked.row_mut(X_R).fill(0.0);
        locked.row_mut(V_R).fill(0.0);
        (self.h, self.map, self.standing) = (h, exponential(&(self.rates * h)), exponential(&(locked * h)));
    }

    /// The next state with dry friction on the rod.
    fn rubbed(&self) -> SVector<f64, N> {
        let level = self.parameters.rod_coulomb;
        let mut direction = pkm_dyn::math::sign(self.state[V_R]);
        if direction.abs() < 0.5 {
            let stands = self.standing * self.state;
            // What friction must take up for the rod to stand.
            let needed = -self.rates.row(V_R).dot(&stands.transpose()) / self.rates[(V_R, RUB)];
            if needed.abs() <= level {
                return stands;
            }
            direction = pkm_dyn::math::sign(needed);
        }
        let slides = self.map * (self.state + SVector::ith(RUB, level * direction));
        let mut next = slides;
        if slides[V_R] * direction <= 0.0 {
            next[V_R] = 0.0;
        }
        next
    }

    /// Position of the rod `[m]`.
    #[must_use]
    pub fn rod(&self) -> f64 {
        self.state[X_R]
    }

    /// Velocity of the rod `[m/s]`.
    #[must_use]
    pub fn rod_velocity(&self) -> f64 {
        self.state[V_R] * self.scale
    }

    /// Angle of the motor `[rad]`, zero where the rod's position is.
    #[must_use]
    pub fn motor_angle(&self) -> f64 {
        self.state[X_M] * self.parameters.motor_ratio()
    }

    /// Force on the load now `[N]`, the load moving at `load_velocity` `[m/s]`.
    #[must_use]
    pub fn force(&self, load_velocity: f64) -> f64 {
        let ThreeMassParameters { cell_stiffness, cell_damping, .. } = self.parameters;
        cell_stiffness * (self.state[X_R] - self.state[LOAD]) + cell_damping * (self.rod_velocity() - load_velocity)
    }

    /// Energy in masses and springs, the load's own left out `[J]`.
    #[must_use]
    pub fn energy(&self) -> f64 {
        let Rod { m_m, m_r, k_b, .. } = Rod::of(&self.parameters);
        let (x, s) = (&self.state, self.scale);
        let (belt, cell) = (x[X_M] - x[X_R], x[X_R] - x[LOAD]);
        let moving = m_m * x[V_M] * x[V_M] * s * s + m_r * x[V_R] * x[V_R] * s * s;
        0.5 * (moving + k_b * belt * belt + self.parameters.cell_stiffness * cell * cell)
    }
}

/// Everything seen at the rod.
struct Rod {
    m_m: f64,
    b_m: f64,
    m_r: f64,
    b_r: f64,
    k_b: f64,
    b_b: f64,
}

impl Rod {
    fn of(p: &ThreeMassParameters) -> Self {
        let (ka, gs) = (p.motor_ratio(), p.screw_ratio);
        let belt = 2.0 * (p.screw_pulley * gs) * (p.screw_pulley * gs);
        Self {
            m_m: p.motor_inertia * ka * ka,
            b_m: p.motor_viscous * ka * ka,
            m_r: p.rod_mass + gs * gs * p.screw_inertia,
            b_r: p.rod_viscous + gs * gs * p.screw_viscous,
            k_b: belt * p.belt_stiffness,
            b_b: belt * p.belt_damping,
        }
    }
}

/// Scale of velocities, and the matrix of the rates.
fn rates(p: &ThreeMassParameters) -> (f64, SMatrix<f64, N, N>) {
    let Rod { m_m, b_m, m_r, b_r, k_b, b_b } = Rod::of(p);
    let (kf, bf) = (p.cell_stiffness, p.cell_damping);
    let s = pkm_dyn::math::sqrt((k_b + kf) / m_r);
    let mut a = SMatrix::zeros();
    (a[(X_M, V_M)], a[(X_R, V_R)], a[(LOAD, V_LOAD)]) = (s, s, s);
    let motor = [(X_M, -k_b), (X_R, k_b), (V_M, -(b_m + b_b) * s), (V_R, b_b * s), (F, 1.0)];
    let cell = [(X_R, kf), (LOAD, -kf), (V_R, bf * s), (V_LOAD, -bf * s)];
    let rod = [(X_M, k_b), (X_R, -k_b), (V_M, b_b * s), (V_R, -(b_r + b_b) * s), (RUB, -1.0)];
    for (j, effort) in motor {
        a[(V_M, j)] += effort / (m_m * s);
    }
    for (j, effort) in rod {
        a[(V_R, j)] += effort / (m_r * s);
    }
    for (j, effort) in cell {
        a[(V_R, j)] -= effort / (m_r * s);
        a[(AREA, j)] += effort / kf;
    }
    (a[(F, F)], a[(F, F_CMD)]) = (-1.0 / p.current_lag, 1.0 / p.current_lag);
    (s, a)
}

/// `e^A`: Taylor's series of `A/2^k`, squared k times.
fn exponential(a: &SMatrix<f64, N, N>) -> SMatrix<f64, N, N> {
    let norm = (0..N).map(|j| a.column(j).iter().map(|x| x.abs()).sum::<f64>()).fold(0.0, f64::max);
    let (mut scaled, mut halvings) = (*a, 0);
    let mut left = norm;
    while left > 0.5 && halvings < 1000 {
        (left, halvings) = (0.5 * left, halvings + 1);
        scaled *= 0.5;
    }
    // The first term left out is 0.5^17/17!, below the last bit.
    let mut out = SMatrix::identity();
    for k in (1..=16).rev() {
        out = SMatrix::identity() + scaled * out / f64::from(k);
    }
    for _ in 0..halvings {
        out = out * out;
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_exponential_of_a_turn_and_of_a_decay_are_theirs() {
        let mut a = SMatrix::zeros();
        (a[(0, 1)], a[(1, 0)], a[(4, 4)], a[(5, 6)]) = (-30.0, 30.0, -7.0, 2.5);
        let e = exponential(&a);
        let (s, c) = pkm_dyn::math::sin_cos(30.0);
        assert!((e[(0, 0)] - c).abs() < 1e-13 && (e[(1, 0)] - s).abs() < 1e-13);
        assert!((e[(4, 4)] / pkm_dyn::math::exp(-7.0) - 1.0).abs() < 1e-13 && (e[(5, 6)] - 2.5).abs() < 1e-14);
    }

    #[test]
    fn at_rest_the_wanted_force_is_the_force_on_a_locked_load_and_a_free_one_feels_none() {
        let mut drive = ThreeMass::try_new(ThreeMassParameters::ANKLE, 0.3).unwrap();
        let mut mean = 0.0;
        for _ in 0..20_000 {
            mean = drive.advance(40.0, 0.3, 5e-4);
        }
        assert!((mean - 40.0).abs() < 1e-6 && (drive.force(0.0) - 40.0).abs() < 1e-6, "{mean}");
        let mut idle = ThreeMass::try_new(ThreeMassParameters::ANKLE, 0.3).unwrap();
        assert!(idle.advance(0.0, 0.3, 5e-4).abs() < 1e-9 && (idle.rod() - 0.3).abs() < 1e-15);
    }

    #[test]
    fn settled_under_a_force_it_stays_where_it_is() {
        let mut drive = ThreeMass::try_new(ThreeMassParameters::ANKLE, 0.0).unwrap();
        drive.settle(40.0, 0.1);
        let rod = drive.rod();
        for _ in 0..200 {
            assert!((drive.advance(40.0, 0.1, 5e-4) - 40.0).abs() < 1e-6);
        }
        assert!((drive.rod() - rod).abs() < 1e-12 && (rod - 0.1 - 40.0 / 2e6).abs() < 1e-12);
    }

    #[test]
    fn steps_of_any_length_lead_to_the_same_state() {
        let at = |h: f64, n: u32| {
            let mut drive = ThreeMass::try_new(ThreeMassParameters::ANKLE, 0.0).unwrap();
            let area: f64 = (1..=n).map(|k| h * drive.advance(25.0, 1e-3 * h * f64::from(k), h)).sum();
            [area, drive.rod(), drive.rod_velocity(), drive.motor_angle()]
        };
        let (coarse, fine) = (at(2e-3, 10), at(1e-4, 200));
        for (coarse, fine) in coarse.iter().zip(fine) {
            assert!((coarse - fine).abs() < 1e-10 * fine.abs().max(1e-3), "{coarse} {fine}");
        }
    }

    #[test]
    fn energy_falls_when_nothing_is_fed_in_and_dry_friction_holds_the_rod_still() {
        let rubbing = ThreeMassParameters { rod_coulomb: 15.0, ..ThreeMassParameters::ANKLE };
        let mut drive = ThreeMass::try_new(rubbing, 0.0).unwrap();
        let mut ramped = |from: f64, to: f64| {
            for k in 1..=8000 {
                drive.advance(from + (to - from) * f64::from(k) / 8000.0, 0.0, 5e-4);
            }
            (drive.rod(), drive.rod_velocity().abs())
        };
        assert_eq!(ramped(0.0, 14.9), (0.0, 0.0), "14.9 N do not move a rod that 15 N hold");
        assert!(ramped(14.9, 15.2).0 > 0.0, "15.2 N do");
        // A force that grows slowly pushes the rod along, against friction of its level.
        let mut drive = ThreeMass::try_new(rubbing, 0.0).unwrap();
        let force = (1..=20_000).map(|k| drive.advance(60.0 * f64::from(k) / 20_000.0, 0.0, 5e-4)).last().unwrap_or(0.0);
        assert!((force - 45.0).abs() < 0.5, "{force} N are left of 60 N");
        let mut drive = ThreeMass::try_new(ThreeMassParameters::ANKLE, 0.0).unwrap();
        for _ in 0..100 {
            drive.advance(60.0, 0.0, 5e-4);
        }
        // The current dies with its lag; after that nothing is fed in.
        for _ in 0..200 {
            drive.advance(0.0, 0.0, 5e-4);
        }
        let mut last = drive.energy();
        for _ in 0..2000 {
            drive.advance(0.0, 0.0, 5e-4);
            let energy = drive.energy();
            assert!(energy <= last * (1.0 + 1e-12) + 1e-15, "{energy} J after {last} J");
            last = energy;
        }
    }

    #[test]
    fn parameters_that_no_drive_has_are_refused() {
        let ankle = ThreeMassParameters::ANKLE;
        for bad in [
            ThreeMassParameters { motor_inertia: 0.0, ..ankle },
            ThreeMassParameters { cell_stiffness: f64::NAN, ..ankle },
            ThreeMassParameters { rod_coulomb: -1.0, ..ankle },
        ] {
            assert!(ThreeMass::try_new(bad, 0.0).is_err());
        }
    }
}
