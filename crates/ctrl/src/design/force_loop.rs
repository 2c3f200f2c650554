//! Actuators, force sensors and surroundings of a parallel robot as one linear model \[McDaid, eq. 8.14-8.46\], for any leg Jacobian.
//!
//! Each of n drives is a motor, a belt, a screw with its rod, and a force sensor; the sensors push the m coordinates of the task.
//! State `[task, rods, motors, their rates]`, 2·(m + 2n) of them, then n currents behind a lag, then n filtered forces: 22, 26 and 30 for
//! the ankle robot. Misprints of the chapter are corrected: belt (8.21), `s²` (8.15), sensor stiffness (8.17), damping (8.28), state
//! (8.35), `1/(K_t·K_a)` in the feedback (8.36).

use alloc::vec::Vec;

use nalgebra::DMatrix;

use super::discretise::zero_order_hold;
use super::error::{DesignError, inverse, must_be, must_be_positive};
use super::margin::{critical_gain, spectral_radius};
use super::mu::StateSpace;

/// One drive: motor, belt, ball screw, rod, force sensor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DriveTrain {
    /// Torque constant of the motor `[N·m/A]`.
    pub torque_constant: f64,
    /// Inertia of the rotor `[kg·m²]`.
    pub rotor_inertia: f64,
    /// Viscous friction of the motor `[N·m·s/rad]`.
    pub motor_viscous: f64,
    /// Turns of the motor per turn of the screw.
    pub ratio: f64,
    /// Radius of the pulley on the screw `[m]`.
    pub screw_radius: f64,
    /// Stiffness of one side of the belt `[N/m]`.
    pub belt_stiffness: f64,
    /// Damping of one side of the belt `[N·s/m]`.
    pub belt_damping: f64,
    /// Advance of the rod per turn of the screw `[m]`.
    pub pitch: f64,
    /// Inertia of the screw `[kg·m²]`.
    pub screw_inertia: f64,
    /// Viscous friction of the screw `[N·m·s/rad]`.
    pub screw_viscous: f64,
    /// Mass of the rod `[kg]`.
    pub rod_mass: f64,
    /// Viscous friction of the rod `[N·s/m]`.
    pub rod_viscous: f64,
    /// Mass of the force sensor `[kg]`.
    pub sensor_mass: f64,
    /// Stiffness of the force sensor and the joint behind it `[N/m]`.
    pub sensor_stiffness: f64,
    /// Damping of the force sensor `[N·s/m]`.
    pub sensor_damping: f64,
    /// Time constant of the current's lag `[s]`.
    pub current_lag: f64,
}

impl DriveTrain {
    /// The ankle robot's actuator. Pitch and ratio are printed; the chapter gives nothing else, and the rest is chosen so that uniform gains
    /// become unstable about where the paper's do (10 for P, 16 for PD).
    pub const ANKLE: Self = Self {
        torque_constant: 0.05,
        rotor_inertia: 2.0e-5,
        motor_viscous: 4.0e-4,
        ratio: 5.0,
        screw_radius: 0.030,
        belt_stiffness: 6.0e4,
        belt_damping: 6.0,
        pitch: 0.003_175,
        screw_inertia: 2.0e-6,
        screw_viscous: 1.0e-5,
        rod_mass: 0.6,
        rod_viscous: 200.0,
        sensor_mass: 0.3,
        sensor_stiffness: 2.0e6,
        sensor_damping: 300.0,
        current_lag: 1.0e-3,
    };

    /// Angle of the screw per advance of the rod `[rad/m]`.
    #[must_use]
    pub fn screw_gear(&self) -> f64 {
        2.0 * core::f64::consts::PI / self.pitch
    }

    /// Force at the rod per current in the motor, `K_t·K_a` `[N/A]`.
    #[must_use]
    pub fn force_constant(&self) -> f64 {
        self.torque_constant * self.ratio * self.screw_gear()
    }

    /// Mass that the rotor seems to have at the rod, `K_a²·J_m` `[kg]`.
    #[must_use]
    pub fn apparent_mass(&self) -> f64 {
        let gear = self.ratio * self.screw_gear();
        gear * gear * self.rotor_inertia
    }

    fn check(&self) -> Result<(), DesignError> {
        let positive = [
            ("torque constant [N·m/A]", self.torque_constant),
            ("rotor inertia [kg·m²]", self.rotor_inertia),
            ("ratio", self.ratio),
            ("screw radius [m]", self.screw_radius),
            ("pitch [m]", self.pitch),
            ("rod mass [kg]", self.rod_mass),
            ("current lag [s]", self.current_lag),
        ];
        positive.into_iter().try_for_each(|(what, value)| must_be_positive(what, value))?;
        let others = [
            ("motor friction [N·m·s/rad]", self.motor_viscous),
            ("belt stiffness [N/m]", self.belt_stiffness),
            ("belt damping [N·s/m]", self.belt_damping),
            ("screw inertia [kg·m²]", self.screw_inertia),
            ("screw friction [N·m·s/rad]", self.screw_viscous),
            ("rod friction [N·s/m]", self.rod_viscous),
            ("sensor mass [kg]", self.sensor_mass),
            ("sensor stiffness [N/m]", self.sensor_stiffness),
            ("sensor damping [N·s/m]", self.sensor_damping),
        ];
        let bad = others.into_iter().find(|(_, value)| !(value.is_finite() && *value >= 0.0));
        bad.map_or(Ok(()), |(what, value)| Err(DesignError::Value { what, value, limit: "must be finite and >= 0" }))
    }
}

/// What the drives push against, in the m coordinates of the task.
#[derive(Debug, Clone, PartialEq)]
pub struct Surroundings {
    /// Inertia of platform and patient, `M_e` `[kg | kg·m²]`.
    pub inertia: DMatrix<f64>,
    /// Damping, `B_e` `[N·s/m | N·m·s/rad]`.
    pub damping: DMatrix<f64>,
    /// Stiffness, `K_e` `[N/m | N·m/rad]`.
    pub stiffness: DMatrix<f64>,
}

/// How the force is sampled and filtered: `F* = F + k_d/dt·(F − F_last)` \[McDaid, eq. 8.33\].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sampling {
    /// Sample time `[s]`.
    pub dt: f64,
    /// Derivative time `k_d` `[s]`; zero feeds back the force as it is measured.
    pub derivative: f64,
}

/// Uncertainty of the surroundings: `M_e + R·w_m·δ·Rᵀ`, `(I + w_b·Δ_b)·B_e`, `(I + w_k·Δ_k)·K_e` \[McDaid, eq. 8.39-8.41\].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Weights {
    /// Of each principal inertia `[kg | kg·m²]`.
    pub inertia: f64,
    /// Of the damping, relative.
    pub damping: f64,
    /// Of the stiffness, relative.
    pub stiffness: f64,
}

/// Which gains are raised in search of the limit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Direction {
    /// All of them together.
    Uniform,
    /// One direction, the others at zero; from 0 along falling singular values, then the internal forces.
    Along(usize),
}

/// The linear model at one pose.
#[derive(Debug, Clone, PartialEq)]
pub struct ForceLoop {
    train: DriveTrain,
    around: Surroundings,
    sampling: Sampling,
    J: DMatrix<f64>,
    /// Continuous A, its inputs `[current, friction on the rods, effort on the task]`, forces as outputs.
    plant: [DMatrix<f64>; 3],
    /// Inertia of the task with the sensors.
    task: DMatrix<f64>,
    /// Sampled with lag and filter, same inputs (currents are commands): A, B, and the force C before the filter.
    sampled: [DMatrix<f64>; 2],
    force: DMatrix<f64>,
    /// Directions of the effective mass, largest first, then internal forces, as columns; and its singular values `[kg]`.
    directions: (DMatrix<f64>, Vec<f64>),
}

fn put(target: &mut DMatrix<f64>, at: (usize, usize), block: &DMatrix<f64>) {
    target.view_mut(at, block.shape()).copy_from(block);
}

/// Singular values of `(J⁺)ᵀ·M·J⁺` and its directions as columns, largest first, then those that the task does not feel.
fn directions(J: &DMatrix<f64>, M: &DMatrix<f64>) -> Result<(DMatrix<f64>, Vec<f64>), DesignError> {
    let (n, m) = J.shape();
    let square = inverse("J'J", &(J.transpose() * J))?;
    let pinv = square * J.transpose();
    let eigen = (pinv.transpose() * M * pinv).symmetric_eigen();
    let mut order: Vec<usize> = (0..n).collect();
    order.sort_by(|&a, &b| eigen.eigenvalues[b].total_cmp(&eigen.eigenvalues[a]));
    let W = DMatrix::from_fn(n, n, |i, j| eigen.eigenvectors[(i, order[j])]);
    Ok((W, order.iter().take(m).map(|&k| eigen.eigenvalues[k]).collect()))
}

impl ForceLoop {
    /// The model of drives `train` behind the leg Jacobian `J` (n × m, rates of the legs over rates of the task) against `around`.
    ///
    /// # Errors
    /// Dimensions that do not fit, numbers that are none or out of range, a J of less than full column rank.
    pub fn try_new(train: DriveTrain, around: Surroundings, J: DMatrix<f64>, sampling: Sampling) -> Result<Self, DesignError> {
        train.check()?;
        let (n, m) = J.shape();
        must_be("J", &J, n, m)?;
        for (what, X) in [("inertia", &around.inertia), ("damping", &around.damping), ("stiffness", &around.stiffness)] {
            must_be(what, X, m, m)?;
        }
        must_be_positive("sample time [s]", sampling.dt)?;
        if !(sampling.derivative.is_finite() && sampling.derivative >= 0.0) {
            let value = sampling.derivative;
            return Err(DesignError::Value { what: "derivative time [s]", value, limit: "must be finite and >= 0" });
        }
        let (plant, task) = three_masses(&train, &around, &J)?;
        let directions = directions(&J, &around.inertia)?;
        let mut out =
            Self { train, around, sampling, J, plant, task, sampled: Default::default(), force: DMatrix::zeros(n, 0), directions };
        let (A, B, C) = out.with_current(&DMatrix::zeros(2 * (m + 2 * n), 0));
        (out.sampled, out.force) = (out.with_filter(&A, &B, &C)?, C);
        Ok(out)
    }

    /// The continuous model without lag, 2·(m + 2n) states: inputs currents `[A]`, friction on the rods `[N]`, efforts on the task
    /// `[N | N·m]`; outputs the sensors' forces `[N]`.
    ///
    /// # Errors
    /// Never, for a model that was made.
    pub fn plant(&self) -> Result<StateSpace, DesignError> {
        let [A, B, C] = &self.plant;
        Ok(StateSpace::try_new([A.clone(), B.clone(), C.clone(), DMatrix::zeros(C.nrows(), B.ncols())], None)?)
    }

    /// The same with n currents that follow their commands with a lag.
    ///
    /// # Errors
    /// Never, for a model that was made.
    pub fn lagged(&self) -> Result<StateSpace, DesignError> {
        let (A, B, C) = self.with_current(&DMatrix::zeros(self.plant[0].nrows(), 0));
        let D = DMatrix::zeros(C.nrows(), B.ncols());
        Ok(StateSpace::try_new([A, B, C, D], None)?)
    }

    /// Sampled, with n filtered forces as further states and as outputs `[N]`; inputs as of [`Self::plant`], currents as commands.
    ///
    /// # Errors
    /// Never, for a model that was made.
    pub fn open_loop(&self) -> Result<StateSpace, DesignError> {
        let [A, B] = self.sampled.clone();
        let (N, n) = (A.nrows(), self.J.nrows());
        let C = DMatrix::from_fn(n, N, |i, j| if j + n == N + i { 1.0 } else { 0.0 });
        let D = DMatrix::zeros(n, B.ncols());
        Ok(StateSpace::try_new([A, B, C, D], Some(self.sampling.dt))?)
    }

    /// The loop closed by `i = ((I + K)·F_cmd − K·F*)/(K_t·K_a)`: inputs commanded forces, friction on the rods `[N]`, efforts on the task
    /// `[N | N·m]`; outputs the sensors' forces `[N]`.
    ///
    /// # Errors
    /// A K of the wrong size or with numbers that are none.
    pub fn closed_loop(&self, K: &DMatrix<f64>) -> Result<StateSpace, DesignError> {
        let n = self.J.nrows();
        let A = self.closed(K)?;
        let mut B = self.sampled[1].clone();
        let reference = B.columns(0, n) * (DMatrix::identity(n, n) + K) / self.train.force_constant();
        put(&mut B, (0, 0), &reference);
        let mut C = DMatrix::zeros(n, A.nrows());
        put(&mut C, (0, 0), &self.force);
        let D = DMatrix::zeros(n, B.ncols());
        Ok(StateSpace::try_new([A, B, C, D], Some(self.sampling.dt))?)
    }

    /// Largest modulus of the closed loop's poles; stable below one.
    ///
    /// # Errors
    /// A K of the wrong size or with numbers that are none.
    pub fn spectral_radius(&self, K: &DMatrix<f64>) -> Result<f64, DesignError> {
        Ok(spectral_radius(&self.closed(K)?))
    }

    /// The largest gain that the loop bears; infinite above 10⁵.
    ///
    /// # Errors
    /// A direction that is not there, a loop that is unstable without feedback.
    pub fn critical_gain(&self, direction: Direction) -> Result<f64, DesignError> {
        let n = self.J.nrows();
        if let Direction::Along(k) = direction
            && k >= n
        {
            return Err(DesignError::Value { what: "direction", value: k as f64, limit: "must be below the number of drives" });
        }
        critical_gain(0.0, |gain| {
            let K = self.gain(|k| if direction == Direction::Uniform || direction == Direction::Along(k) { gain } else { 0.0 });
            self.closed(&K)
        })
    }

    /// Singular values of the effective mass `(J⁺)ᵀ·M_e·J⁺` `[kg]`, largest first; one per coordinate of the task.
    #[must_use]
    pub fn effective_masses(&self) -> &[f64] {
        &self.directions.1
    }

    /// `K = W·diag(k)·Wᵀ` with the directions W of the effective mass; `k(i)` from 0 along falling singular values, then internal forces
    /// \[McDaid, eq. 8.48\].
    #[must_use]
    pub fn gain(&self, k: impl Fn(usize) -> f64) -> DMatrix<f64> {
        let W = &self.directions.0;
        W * DMatrix::from_fn(W.ncols(), W.ncols(), |i, j| if i == j { k(i) } else { 0.0 }) * W.transpose()
    }

    /// The closed loop with its uncertainty pulled out, M of a structured singular value: blocks m real scalars, full m × m, full m × m.
    /// `R` turns the principal axes of the uncertain inertia into those of the task.
    ///
    /// # Errors
    /// Matrices of the wrong size, weights that are none.
    pub fn uncertain(&self, K: &DMatrix<f64>, R: &DMatrix<f64>, weights: Weights) -> Result<StateSpace, DesignError> {
        let (n, m) = self.J.shape();
        must_be("R", R, m, m)?;
        let (half, I) = (m + 2 * n, DMatrix::<f64>::identity(m, m));
        let mut spread = DMatrix::zeros(m, 3 * m);
        put(&mut spread, (0, 0), &(R * weights.inertia));
        put(&mut spread, (0, m), &(&I * weights.damping));
        put(&mut spread, (0, 2 * m), &(&I * weights.stiffness));
        let push = -(inverse("task inertia", &self.task)? * spread);
        let mut more = DMatrix::zeros(2 * half, 3 * m);
        put(&mut more, (half, 0), &push);
        let (A, B, C) = self.with_current(&more);
        let [mut Az, Bz] = self.with_filter(&A, &B, &C)?;
        self.feed_back(&mut Az, &Bz, K)?;
        let mut Z = DMatrix::zeros(3 * m, Az.nrows());
        put(&mut Z, (0, 0), &(R.transpose() * A.rows(half, m)));
        put(&mut Z, (m, half), &self.around.damping);
        put(&mut Z, (2 * m, 0), &self.around.stiffness);
        let mut D = DMatrix::zeros(3 * m, 3 * m);
        put(&mut D, (0, 0), &(R.transpose() * push));
        let inputs = Bz.columns(Bz.ncols() - 3 * m, 3 * m).into_owned();
        Ok(StateSpace::try_new([Az, inputs, Z, D], Some(self.sampling.dt))?)
    }

    /// Leg Jacobian, rates of the legs over rates of the task.
    #[must_use]
    pub fn jacobian(&self) -> &DMatrix<f64> {
        &self.J
    }

    /// The drives.
    #[must_use]
    pub fn train(&self) -> &DriveTrain {
        &self.train
    }

    fn with_current(&self, more: &DMatrix<f64>) -> (DMatrix<f64>, DMatrix<f64>, DMatrix<f64>) {
        let [A, B, C] = &self.plant;
        let (N, n, inputs) = (A.nrows(), self.J.nrows(), B.ncols() + more.ncols());
        let rate = DMatrix::identity(n, n) / self.train.current_lag;
        let mut A26 = DMatrix::zeros(N + n, N + n);
        put(&mut A26, (0, 0), A);
        put(&mut A26, (0, N), &B.columns(0, n).into_owned());
        put(&mut A26, (N, N), &-&rate);
        let mut B26 = DMatrix::zeros(N + n, inputs);
        put(&mut B26, (N, 0), &rate);
        put(&mut B26, (0, n), &B.columns(n, B.ncols() - n).into_owned());
        put(&mut B26, (0, B.ncols()), more);
        let mut C26 = DMatrix::zeros(n, N + n);
        put(&mut C26, (0, 0), C);
        (A26, B26, C26)
    }

    /// Sampled, with the filtered force as further states \[McDaid, eq. 8.35\].
    fn with_filter(&self, A: &DMatrix<f64>, B: &DMatrix<f64>, C: &DMatrix<f64>) -> Result<[DMatrix<f64>; 2], DesignError> {
        let [Az, Bz] = zero_order_hold(A, B, self.sampling.dt)?;
        let (N, n, share) = (A.nrows(), C.nrows(), self.sampling.derivative / self.sampling.dt);
        let mut A30 = DMatrix::zeros(N + n, N + n);
        put(&mut A30, (N, 0), &(C * &Az * (1.0 + share) - C * share));
        put(&mut A30, (0, 0), &Az);
        let mut B30 = DMatrix::zeros(N + n, B.ncols());
        put(&mut B30, (N, 0), &(C * &Bz * (1.0 + share)));
        put(&mut B30, (0, 0), &Bz);
        Ok([A30, B30])
    }

    fn closed(&self, K: &DMatrix<f64>) -> Result<DMatrix<f64>, DesignError> {
        let [mut A, B] = self.sampled.clone();
        self.feed_back(&mut A, &B, K)?;
        Ok(A)
    }

    fn feed_back(&self, A: &mut DMatrix<f64>, B: &DMatrix<f64>, K: &DMatrix<f64>) -> Result<(), DesignError> {
        let n = self.J.nrows();
        must_be("K", K, n, n)?;
        let first = A.ncols() - n;
        let fed = A.columns(first, n) - B.columns(0, n) * K / self.train.force_constant();
        put(A, (0, first), &fed);
        Ok(())
    }
}

/// A, inputs and force output of the three-mass model, and the inertia of the task with the sensors.
fn three_masses(t: &DriveTrain, around: &Surroundings, J: &DMatrix<f64>) -> Result<([DMatrix<f64>; 3], DMatrix<f64>), DesignError> {
    let (n, m) = J.shape();
    let (half, gear, motor_radius) = (m + 2 * n, t.screw_gear(), t.screw_radius / t.ratio);
    let I = DMatrix::<f64>::identity(n, n);
    let task = &around.inertia + J.transpose() * J * t.sensor_mass;
    // Stiffness and damping share their pattern: sensor, belt, and what stands against the world.
    let pattern = |sensor: f64, belt: f64, rod: f64, motor: f64, task: &DMatrix<f64>| {
        let mut K = DMatrix::zeros(half, half);
        put(&mut K, (0, 0), &(task + J.transpose() * J * sensor));
        put(&mut K, (0, m), &(J.transpose() * -sensor));
        put(&mut K, (m, 0), &(J * -sensor));
        put(&mut K, (m, m), &(&I * (sensor + rod + 2.0 * gear * gear * t.screw_radius * t.screw_radius * belt)));
        let across = &I * (-2.0 * gear * motor_radius * t.screw_radius * belt);
        put(&mut K, (m, m + n), &across);
        put(&mut K, (m + n, m), &across);
        put(&mut K, (m + n, m + n), &(&I * (motor + 2.0 * motor_radius * motor_radius * belt)));
        K
    };
    let K = pattern(t.sensor_stiffness, t.belt_stiffness, 0.0, 0.0, &around.stiffness);
    let rod = t.rod_viscous + gear * gear * t.screw_viscous;
    let B = pattern(t.sensor_damping, t.belt_damping, rod, t.motor_viscous, &around.damping);
    let mut Mi = DMatrix::zeros(half, half);
    put(&mut Mi, (0, 0), &inverse("task inertia", &task)?);
    let rod_mass = t.rod_mass + gear * gear * t.screw_inertia;
    put(&mut Mi, (m, m), &(&I / rod_mass));
    put(&mut Mi, (m + n, m + n), &(&I / t.rotor_inertia));
    let mut A = DMatrix::zeros(2 * half, 2 * half);
    A.view_mut((0, half), (half, half)).fill_with_identity();
    put(&mut A, (half, 0), &-(&Mi * K));
    put(&mut A, (half, half), &-(&Mi * B));
    let mut inputs = DMatrix::zeros(2 * half, 2 * n + m);
    put(&mut inputs, (half + m + n, 0), &(&I * (t.torque_constant / t.rotor_inertia)));
    put(&mut inputs, (half + m, n), &(&I / -rod_mass));
    put(&mut inputs, (half, 2 * n), &Mi.view((0, 0), (m, m)).into_owned());
    let mut force = DMatrix::zeros(n, 2 * half);
    for (at, gain) in [(0, t.sensor_stiffness), (half, t.sensor_damping)] {
        put(&mut force, (0, at), &(J * -gain));
        put(&mut force, (0, at + m), &(&I * gain));
    }
    Ok(([A, inputs, force], task))
}
