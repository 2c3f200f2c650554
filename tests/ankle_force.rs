//! McDaid's ankle robot under force control: the linear model of drives and ankle, its critical gains, the identities of the gain matrices,
//! and the controller of the loop on that model.

#![expect(non_snake_case, reason = "matrices carry the capital letters of the literature")]

#[path = "mu/ankle.rs"]
mod ankle;

use ankle::{DT, K_D, PROPOSED, force_loop, jacobian, surroundings};
use nalgebra::{DMatrix, DVector};
use pkm_ctrl::design::force_loop::{Direction, DriveTrain, ForceLoop, Sampling, Weights};
use pkm_ctrl::design::margin::spectral_radius;
use pkm_ctrl::design::schedule::{Sample, fit};
use pkm_ctrl::force::gains::{Decoupling, Forward, Square, decoupling, directional, room};
use pkm_ctrl::force::{ActuatorForce, ActuatorForceConfig, ForceLaw, GainCurve, LinearTask, PlatformTask, Task, TaskMap};
use pkm_ctrl::{Controller, Input};
use pkm_dyn::math;
use pkm_tests::Draw;

fn diagonal(values: &[f64]) -> DMatrix<f64> {
    DMatrix::from_diagonal(&DVector::from_row_slice(values))
}

fn matrix<const N: usize>(rows: &Square<N>) -> DMatrix<f64> {
    DMatrix::from_fn(N, N, |i, j| rows[i][j])
}

/// The legs at an orientation as a task: forces of the environment are moments about the ankle.
fn legs(t: [f64; 3]) -> LinearTask<4, 3> {
    let J = jacobian(t);
    let rows = core::array::from_fn(|i| core::array::from_fn(|k| J[(i, k)]));
    LinearTask::try_new([0.0; 4], [0.0; 3], rows, [3, 4, 5]).expect("a Jacobian of full rank")
}

// ---- the model

#[test]
fn the_model_has_22_26_and_30_states_and_the_computed_trace() {
    let model = force_loop([0.0; 3], K_D);
    let sizes = [model.plant(), model.lagged(), model.open_loop()].map(|s| s.expect("a system").matrices()[0].nrows());
    assert_eq!(sizes, [22, 26, 30]);
    let open = model.open_loop().expect("a system");
    let trace: f64 = (0..26).map(|i| open.matrices()[0][(i, i)]).sum();
    assert!((trace - 11.636_549_336_756).abs() < 1e-9, "{trace:.12}");
    let slowest = model.lagged().expect("a system").stability().expect("states").1;
    assert!((slowest - 0.035).abs() < 5e-4, "{slowest}");
    let train = DriveTrain::ANKLE;
    assert!((train.apparent_mass() - 1958.0).abs() < 0.5 && (train.force_constant() / 0.05 - 9894.8).abs() < 0.1);
    for (found, want) in model.effective_masses().iter().zip([93.919, 20.152, 2.413]) {
        assert!((found - want).abs() < 6e-4, "{found}");
    }
}

/// [McDaid] Table 8.5, with the gains that this set of parameters makes of it.
#[test]
fn uniform_gains_of_10_and_16_are_unstable_and_both_proposed_ones_stable() {
    let table =
        [([10.0; 4], 0.0, 1.001_813), ([16.0; 4], K_D, 1.000_476), (PROPOSED, K_D, 0.995_433), ([14.0, 18.0, 60.0, 14.0], K_D, 0.998_571)];
    for (k, derivative, want) in table {
        let model = force_loop([0.0; 3], derivative);
        let found = model.spectral_radius(&model.gain(|i| k[i])).expect("a gain");
        assert!((found - want).abs() < 1e-6, "{k:?}: {found:.7}, {want}");
    }
}

#[test]
fn critical_gains_are_the_computed_ones() {
    let critical = |derivative: f64, direction| force_loop([0.0; 3], derivative).critical_gain(direction).expect("stable without feedback");
    assert!((critical(0.0, Direction::Uniform) - 8.80).abs() < 5e-3);
    assert!((critical(K_D, Direction::Uniform) - 15.50).abs() < 5e-3);
    for (derivative, want) in [(K_D, [15.5, 22.6, 113.0, 18.5]), (0.0, [8.8, 16.2, 158.0, 11.0])] {
        let found = [0, 1, 2, 3].map(|k| critical(derivative, Direction::Along(k)));
        for (found, want) in found.iter().zip(want) {
            assert!((found - want).abs() < 0.006 * want, "{found} {want}");
        }
        assert!(found[2] > found[1] && found[1] > found[0].max(found[3]), "{found:?}");
    }
    assert!(force_loop([0.0; 3], K_D).critical_gain(Direction::Along(4)).is_err());
}

/// Orientations `[deg]`, effective masses, critical gains with PD.
const ORIENTATIONS: [([f64; 3], [f64; 3], [f64; 4]); 3] = [
    ([20.0, 0.0, 0.0], [67.7, 13.3, 2.62], [16.3, 27.8, 102.8, 18.5]),
    ([0.0, 15.0, 0.0], [208.6, 14.8, 2.43], [16.2, 26.0, 112.1, 18.5]),
    ([0.0, 0.0, 20.0], [39.4, 16.6, 2.48], [17.2, 25.1, 109.5, 18.5]),
];

#[test]
fn critical_gains_change_with_the_orientation_as_computed_and_a_schedule_stays_below_them() {
    let mut samples = [Vec::new(), Vec::new()];
    for (degrees, masses, gains) in ORIENTATIONS {
        let model = force_loop(degrees.map(f64::to_radians), K_D);
        for k in 0..4 {
            let found = model.critical_gain(Direction::Along(k)).expect("stable without feedback");
            assert!((found - gains[k]).abs() < 0.06, "{degrees:?} {k}: {found}");
            if k < 3 {
                let mass = model.effective_masses()[k];
                assert!((mass - masses[k]).abs() < 0.06, "{degrees:?} {k}: {mass}");
                if let Some(i) = k.checked_sub(1) {
                    samples[i].push(Sample { value: mass, critical: found });
                }
            }
        }
    }
    // The second and third direction get curves, the first and the internal force constants: the paper's structure.
    let curves = samples.map(|s| GainCurve::try_new(&fit(&s, 3, 0.6).expect("a schedule")).expect("breakpoints that rise"));
    for degrees in [[0.0; 3], [-20.0, 0.0, 0.0], [20.0, 15.0, 0.0], [10.0, -10.0, 10.0]] {
        let model = force_loop(degrees.map(f64::to_radians), K_D);
        let masses = model.effective_masses().to_vec();
        let k = [5.0, curves[0].at(masses[1]), curves[1].at(masses[2]), 10.0];
        assert!(k[1] > 10.0 && k[2] > 50.0, "{k:?}");
        let radius = model.spectral_radius(&model.gain(|i| k[i])).expect("a gain");
        assert!(radius < 1.0, "{degrees:?} {k:?}: {radius}");
    }
}

#[test]
fn commanded_forces_are_met_in_every_direction() {
    let model = force_loop([0.0; 3], K_D);
    let closed = model.closed_loop(&model.gain(|i| PROPOSED[i])).expect("a system");
    let [A, B, C, _] = closed.matrices();
    let settled = (DMatrix::identity(30, 30) - A).lu().solve(&B.columns(0, 4).into_owned()).expect("no pole at one");
    // Against the ankle's springs the force is what is commanded, whatever the gains.
    assert!((C * settled - DMatrix::identity(4, 4)).norm() < 1e-7);
}

#[test]
fn the_system_of_the_robustness_analysis_has_the_poles_of_the_loop() {
    let t = [0.1, -0.05, 0.2];
    let model = force_loop(t, K_D);
    let K = model.gain(|i| PROPOSED[i]);
    let weights = Weights { inertia: 0.002, damping: 0.1, stiffness: 0.1 };
    let pulled_out = model.uncertain(&K, &ankle::rotation(t), weights).expect("a system");
    let found = spectral_radius(pulled_out.matrices()[0]);
    assert!((found - model.spectral_radius(&K).expect("a gain")).abs() < 1e-9, "{found}");
    // A stiffness that is a tenth larger is the full block 0.1·I closed around its channel: the same poles as a loop built with it.
    let mut stiffer = surroundings();
    stiffer.stiffness *= 1.1;
    let sampling = Sampling { dt: DT, derivative: K_D };
    let built = ForceLoop::try_new(DriveTrain::ANKLE, stiffer, jacobian(t), sampling).expect("a model");
    // Sampled between zero-order holds the two differ by what the hold leaves out.
    let [A, B, C, _] = pulled_out.matrices();
    let closed = A + B.columns(6, 3) * C.rows(6, 3);
    assert!((spectral_radius(&closed) - built.spectral_radius(&K).expect("a gain")).abs() < 2e-4);
}

// ---- gain matrices

struct Drawn {
    J: DMatrix<f64>,
    M: DMatrix<f64>,
    rows: [[f64; 3]; 3],
    m_a: f64,
    D: DMatrix<f64>,
    /// Direct solution of the equations of motion for the force: `(D⁻¹ + feedback)·F = …`.
    v0: DVector<f64>,
    pinv: DMatrix<f64>,
}

fn drawn() -> Drawn {
    let J = jacobian([10.0, 5.0, -4.0].map(f64::to_radians));
    let M = diagonal(&[0.06, 0.03, 0.07]).add_scalar(0.002);
    let m_a = DriveTrain::ANKLE.apparent_mass();
    let inverse = M.clone().try_inverse().expect("a mass matrix");
    let D = (DMatrix::identity(4, 4) + &J * inverse * J.transpose() * m_a).try_inverse().expect("positive definite");
    let pinv = (J.transpose() * &J).try_inverse().expect("full column rank") * J.transpose();
    let null = DMatrix::identity(4, 4) - &J * &pinv;
    let v0 = null.column(0).into_owned().normalize();
    let rows = core::array::from_fn(|i| core::array::from_fn(|j| M[(i, j)]));
    Drawn { J, M, rows, m_a, D, v0, pinv }
}

fn observer(numbers: Decoupling) -> [DMatrix<f64>; 2] {
    let d = drawn();
    let t = [10.0, 5.0, -4.0].map(f64::to_radians);
    let task = legs(t).at(&mut (), &[0.0; 4]).expect("a task");
    let inverse = d.M.clone().try_inverse().expect("a mass matrix");
    let rows = core::array::from_fn(|i| core::array::from_fn(|j| inverse[(i, j)]));
    decoupling(&mut room(4), &task, &rows, &numbers).expect("numbers").map(|X| matrix(&X))
}

/// [McDaid] (8.5)-(8.12): forces from a direct solution of the equations of motion.
#[test]
fn identities_of_the_decoupling_observer_hold() {
    let d = drawn();
    let mut draw = Draw::new(5);
    let mut vector = |n: usize, size: f64| DVector::from_vec(draw.vector(n, -size..size));
    let (effort, moments, drag, commanded) = (vector(4, 50.0), vector(3, 3.0), vector(4, 10.0), vector(4, 50.0));
    let I = DMatrix::<f64>::identity(4, 4);
    let inverse = d.M.clone().try_inverse().expect("a mass matrix");
    let left = &I + &d.J * &inverse * d.J.transpose() * d.m_a;
    let push = &d.J * &inverse * &moments * d.m_a;
    // (8.5), friction and the drives' own drag with a plus inside the bracket.
    let direct = left.clone().lu().solve(&(&effort + &push - &drag)).expect("regular");
    let equation = &d.D * &effort + (&I - &d.D) * d.pinv.transpose() * &moments - &d.D * &drag;
    assert!((&direct - &equation).norm() < 1e-10, "{:e} of {:e}", (&direct - &equation).norm(), direct.norm());
    assert!((&d.D * &d.v0 - &d.v0).norm() < 1e-12 && (d.J.transpose() * d.pinv.transpose() - DMatrix::identity(3, 3)).norm() < 1e-12);
    // (8.9) with the law of (8.8): disturbances are left with 1 − K_f, not 1 + K_f.
    let share = 0.8;
    let [G, H] = observer(Decoupling { share, power: 1.0, null_share: 0.0, apparent_mass: d.m_a, forward: Forward::Moving });
    assert!((&G - left.clone() / (1.0 - share)).norm() < 1e-10 * G.norm() && (&H - &left * 4.0).norm() < 1e-10 * H.norm());
    let closed = (&left + &H).lu().solve(&(&G * &commanded + &push - &drag)).expect("regular");
    let equation = &commanded + ((&I - &d.D) * d.pinv.transpose() * &moments - &d.D * &drag) * (1.0 - share);
    assert!((closed - equation).norm() < 1e-10);
    // (8.12): the inertia that the patient feels, and that the observer makes it nearly the platform's own.
    let felt = &d.M + d.J.transpose() * (&I + &H).lu().solve(&d.J).expect("regular") * d.m_a;
    let svd = d.J.clone().svd(true, true);
    let V = svd.v_t.expect("V").transpose();
    let S = DMatrix::from_diagonal(&svd.singular_values.map(|s| 1.0 / (s * s)));
    let h = share / (1.0 - share);
    let inner = &V * S * V.transpose() * ((1.0 + h) / d.m_a) + &inverse * h;
    assert!((&felt - (&d.M + inner.try_inverse().expect("regular"))).norm() < 1e-12);
    let condition = |X: &DMatrix<f64>| {
        let s = X.singular_values();
        s.max() / s.min()
    };
    let plain = &d.M + d.J.transpose() * &d.J * (d.m_a / (1.0 + h));
    assert!((condition(&d.M) - 2.28).abs() < 0.02 && (condition(&felt) - 2.26).abs() < 0.02, "{} {}", condition(&d.M), condition(&felt));
    assert!((condition(&plain) - 17.6).abs() < 0.1, "{}", condition(&plain));
}

/// [McDaid] (8.13), the null-space term of the feed-forward corrected.
#[test]
fn the_internal_force_has_gain_one_and_partial_decoupling_keeps_the_static_force() {
    let d = drawn();
    let left = d.D.clone().try_inverse().expect("regular");
    for (power, null_share) in [(1.0, 0.7), (0.5, 0.0), (0.0, 0.7), (0.5, 0.9)] {
        let [G, H] = observer(Decoupling { share: 0.8, power, null_share, apparent_mass: d.m_a, forward: Forward::Moving });
        let static_gain = (&left + &H).lu().solve(&G).expect("regular");
        assert!((&static_gain - DMatrix::identity(4, 4)).norm() < 1e-10, "{power} {null_share}");
        let [held, same] = observer(Decoupling { share: 0.8, power, null_share, apparent_mass: d.m_a, forward: Forward::Holding });
        assert!((&held - &same - DMatrix::identity(4, 4)).norm() < 1e-9 * H.norm() && (same - &H).norm() < 1e-12 * H.norm());
        let along = (d.v0.transpose() * &H * &d.v0)[(0, 0)];
        assert!((along - (4.0 + null_share / (1.0 - null_share))).abs() < 1e-9, "{along}");
        // H is the power: H² is D⁻¹ for n = 1/2, up to the shares.
        if null_share.abs() < 1e-12 {
            assert!((&H * &H / 16.0 - &left).norm() < 1e-9 * left.norm());
        }
    }
}

#[test]
fn directional_gains_are_those_of_the_desk() {
    for (degrees, ..) in ORIENTATIONS {
        let t = degrees.map(f64::to_radians);
        let task = legs(t).at(&mut (), &[0.0; 4]).expect("a task");
        let curves = [5.0, 18.0, 60.0].map(GainCurve::constant);
        let inertia = core::array::from_fn(|i| core::array::from_fn(|j| surroundings().inertia[(i, j)]));
        let K = matrix(&directional(&mut room(4), &task, &inertia, &curves, 10.0).expect("numbers"));
        let desk = force_loop(t, K_D).gain(|i| PROPOSED[i]);
        assert!((&K - &desk).norm() < 1e-10 * desk.norm(), "{degrees:?}\n{K}{desk}");
    }
    assert!(spectral_radius(&matrix(&drawn().rows)) < 0.1);
}

/// The shipped robot's model gives the gains that its closed-form Jacobian does.
#[test]
fn a_task_of_the_robots_model_is_the_closed_form() {
    let shipped = pkm_robots::find("ups4").expect("a shipped robot");
    let model = pkm_dyn::urdf::parse(shipped.toml, shipped.urdf, [shipped.toml_name, shipped.urdf_name]).expect("it reads").bare;
    let output = pkm_dyn::loops::Output::evident(&model).expect("a platform");
    let map: PlatformTask<3> = PlatformTask::try_new(model, output, [3, 4, 5], 1.0).expect("three freedoms");
    let mut state = TaskMap::<4, 3>::at_rest(&map);
    for degrees in [[0.0; 3], [10.0, 5.0, -4.0], [-20.0, 10.0, 15.0]] {
        let t = degrees.map(f64::to_radians);
        let q: [f64; 4] = map.drives(&mut state, &t).expect("within reach");
        let task: Task<4, 3> = map.at(&mut state, &q).expect("the loops close");
        let J = jacobian(t);
        let found = DMatrix::from_fn(4, 3, |i, k| task.inverse_jacobian[i][k]);
        assert!((0..3).all(|k| (task.x[k] - t[k]).abs() < 1e-9) && (&found - &J).norm() < 1e-9, "{degrees:?}\n{found}{J}");
        let least = J.singular_values().min();
        assert!((task.margin - least).abs() < 1e-9, "{} {least}", task.margin);
        let back = DMatrix::from_fn(3, 4, |k, i| task.jacobian[k][i]);
        assert!((back - J.pseudo_inverse(1e-12).expect("a Jacobian")).norm() < 1e-7);
    }
}

// ---- the controller in the loop

/// Currents by [`ActuatorForce`] on the sampled model, Coulomb friction on the rods between samples of a tenth.
struct Twin {
    A: DMatrix<f64>,
    B: DMatrix<f64>,
    C: DMatrix<f64>,
    x: DVector<f64>,
    coulomb: f64,
}

/// Steps of the plant per control period.
const FINE: usize = 20;

impl Twin {
    fn new(coulomb: f64) -> Self {
        let plant = force_loop([0.0; 3], K_D).lagged().expect("a system");
        let fine = pkm_ctrl::design::discretise::discretise(&plant, DT / FINE as f64, pkm_ctrl::design::discretise::Hold::ZeroOrder);
        let fine = fine.expect("sampled");
        let [A, B, C, _] = fine.matrices();
        Self { A: A.clone(), B: B.clone(), C: C.clone(), x: DVector::zeros(26), coulomb }
    }

    fn force(&self) -> [f64; 4] {
        let F = &self.C * &self.x;
        core::array::from_fn(|k| F[k])
    }

    /// One control period under motor forces `tau` `[N]` and moments on the foot `[N·m]`.
    fn step(&mut self, tau: &[f64; 4], moment: [f64; 3]) {
        let mut u = DVector::zeros(11);
        for _ in 0..FINE {
            for k in 0..4 {
                u[k] = tau[k] / DriveTrain::ANKLE.force_constant();
                // The rods' speeds; friction comes in within a tenth of a millimetre per second.
                u[4 + k] = self.coulomb * math::tanh(self.x[14 + k] / 1e-4);
            }
            moment.iter().enumerate().for_each(|(k, m)| u[8 + k] = *m);
            self.x = &self.A * &self.x + &self.B * &u;
        }
    }
}

fn controller(k: [f64; 4]) -> ActuatorForce<4, 3, LinearTask<4, 3>> {
    let inertia = core::array::from_fn(|i| core::array::from_fn(|j| surroundings().inertia[(i, j)]));
    let law = ForceLaw::Directional { curves: [k[0], k[1], k[2]].map(GainCurve::constant), null: k[3] };
    let config = ActuatorForceConfig { law, inertia, derivative: K_D, tau_limit: [2000.0; 4], dt: DT };
    ActuatorForce::try_new(legs([0.0; 3]), config).expect("numbers in range")
}

struct Run {
    /// Root mean square of the drives' force errors `[N]`.
    force: [f64; 4],
    /// Of the moments' errors `[N·m]`.
    moment: [f64; 3],
    /// Largest turn of the foot about x `[rad]`.
    reach: f64,
}

/// Ten seconds of a foot that moves in all directions, most in flexion, while forces are commanded: `user` is the largest moment `[N·m]`,
/// `pace` how fast it changes against one turn in two seconds.
fn run(k: [f64; 4], commanded: [f64; 4], coulomb: f64, [user, pace]: [f64; 2]) -> Run {
    let (controller, mut twin, J) = (controller(k), Twin::new(coulomb), jacobian([0.0; 3]));
    let mut state = controller.at_rest();
    let (mut force, mut moment, mut reach, mut count) = ([0.0; 4], [0.0; 3], 0.0_f64, 0.0);
    for k in 0..5000 {
        let t = DT * f64::from(k);
        let p = pace * t;
        let push = [math::sin(3.0 * p), 0.4 * math::sin(4.1 * p + 0.5), 0.3 * math::sin(2.3 * p + 1.0)].map(|m| user * m);
        let measured = twin.force();
        // Brought in slowly: a step of all of it would ask for more than the drives have.
        let commanded = commanded.map(|f| f * (t / 1.5).min(1.0));
        let input = Input { tau_meas: measured, tau_ff: commanded, ..Input::standing([0.0; 4], DT) };
        let command = controller.step(&mut state, &input);
        assert!(!command.health.is_faulted && !command.health.is_saturated, "{command:?} at {t}, forces {measured:?}");
        twin.step(&command.tau, push);
        if t > 2.0 {
            let error = DVector::from_fn(4, |i, _| measured[i] - commanded[i]);
            let along = J.transpose() * &error;
            (0..4).for_each(|i| force[i] += error[i] * error[i]);
            (0..3).for_each(|i| moment[i] += along[i] * along[i]);
            reach = reach.max(twin.x[0].abs());
            count += 1.0;
        }
    }
    let rms = |sum: f64| math::sqrt(sum / count);
    Run { force: force.map(rms), moment: moment.map(rms), reach }
}

/// Acceptance 6: back-driving with commanded internal force only, uniform 5 against the proposed gains.
#[test]
fn the_proposed_gains_let_the_foot_move_the_robot_with_smaller_force_errors() {
    let internal = drawn_internal(60.0);
    let uniform = run([5.0; 4], internal, 20.0, [5.0, 1.0]);
    let proposed = run(PROPOSED, internal, 20.0, [5.0, 1.0]);
    println!("uniform 5: {:.2?} N, {:.3?} N·m, reach {:.3} rad", uniform.force, uniform.moment, uniform.reach);
    println!("proposed:  {:.2?} N, {:.3?} N·m, reach {:.3} rad", proposed.force, proposed.moment, proposed.reach);
    let better = (0..4).filter(|&k| proposed.force[k] < 0.7 * uniform.force[k]).count();
    assert!(better >= 2, "{:?} {:?}", proposed.force, uniform.force);
    assert!(proposed.moment[0] < uniform.moment[0] && proposed.moment[1] < uniform.moment[1]);
    // The gain of the first direction is 5 in both, and that is the one which the z moment feels.
    assert!((proposed.moment[2] / uniform.moment[2] - 1.0).abs() < 0.25, "{:?} {:?}", proposed.moment, uniform.moment);
    assert!(proposed.reach > uniform.reach, "the robot is easier to move");
}

/// Forces of `size` `[N]` along the direction that moves nothing.
fn drawn_internal(size: f64) -> [f64; 4] {
    let J = jacobian([0.0; 3]);
    let pinv = J.clone().pseudo_inverse(1e-12).expect("a Jacobian");
    let null = DMatrix::<f64>::identity(4, 4) - J * pinv;
    let v0 = null.column(0).normalize();
    core::array::from_fn(|k| size * v0[k])
}

/// Acceptance 7: a commanded moment is held while the foot moves slowly. What friction leaves of it does not depend on the moment.
#[test]
fn the_moment_error_is_the_same_at_every_commanded_moment_and_friction_has_a_share_in_it() {
    let pinv = jacobian([0.0; 3]).pseudo_inverse(1e-12).expect("a Jacobian");
    let error = |level: f64, coulomb: f64| {
        let F = pinv.transpose() * DVector::from_vec(vec![level, 0.0, 0.0]);
        let internal = drawn_internal(60.0);
        run(PROPOSED, core::array::from_fn(|k| internal[k] + F[k]), coulomb, [6.0, 0.1]).moment[0]
    };
    let errors = [4.0, 8.0, 12.0].map(|level| error(level, 20.0));
    let (without, tenfold) = (error(8.0, 0.0), error(8.0, 200.0));
    println!(
        "x moment error {errors:.4?} N·m rms at 4, 8 and 12 N·m; {without:.4} without Coulomb friction, {tenfold:.4} with 200 N of it"
    );
    let (least, most) = errors.iter().fold((f64::INFINITY, 0.0_f64), |(l, m), e| (l.min(*e), m.max(*e)));
    assert!(most < 1.02 * least, "{errors:?}");
    // The loop divides friction by one and its gain: 20 N in each rod are felt as two tenths of a newton metre, not as the paper's 1.5.
    assert!(least > 1.15 * without && most < 2.0 * without && tenfold > 2.0 * most, "{errors:?} {without} {tenfold}");
}
