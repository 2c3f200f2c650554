//! Limits around a controller on a mass that moves: nothing passes an end at any speed, and every limit says where it acted.

use pkm_ctrl::force::{ExplicitForce, ExplicitForceConfig, ForcePidConfig, LinearTask};
use pkm_ctrl::limits::{LimitsConfig, Safe, TaskBox};
use pkm_ctrl::{Acted, Command, Controller, Fault, FaultCode, Health, Input, Limit, Limited, PdGravity, PdGravityConfig};

const DT: f64 = 0.005;
const MASS: f64 = 2.0;

/// Pushes with the wanted effort, whatever happens, beyond the model's: the worst controller there is.
struct Push([f64; 2]);

impl Controller<2> for Push {
    type State = ();

    fn at_rest(&self) {}

    fn step(&self, (): &mut (), input: &Input<2>) -> Command<2> {
        Command { tau: [0, 1].map(|k| self.0[k] + input.tau_ff[k]), health: Health::default() }
    }
}

fn config() -> LimitsConfig<2> {
    LimitsConfig {
        q_lower: [-0.2, -0.1],
        q_upper: [0.3, 0.1],
        q_tolerance: 1e-3,
        deceleration: [10.0; 2],
        brake: [25.0; 2],
        v_limit: [1.0; 2],
        tau_limit: [60.0; 2],
        tau_rate: [1e9; 2],
        wrench_yield: [50.0; 6],
        wrench_limit: [100.0; 6],
        dt: DT,
        dt_limit: 5.0 * DT,
        repeats: 0,
        safe: Safe::Weight,
    }
}

/// Two masses on a slope that pulls with 5 N, moved exactly under a constant effort.
#[derive(Clone, Copy)]
struct Masses {
    q: [f64; 2],
    v: [f64; 2],
}

const SLOPE: f64 = 5.0;

impl Masses {
    fn step(&mut self, tau: &[f64; 2]) {
        for (k, tau) in tau.iter().enumerate() {
            let a = (tau - SLOPE) / MASS;
            self.q[k] += self.v[k] * DT + 0.5 * a * DT * DT;
            self.v[k] += a * DT;
        }
    }

    fn input(&self) -> Input<2> {
        Input { tau_ff: [SLOPE; 2], ..Input::standing(self.q, DT) }
    }
}

#[test]
fn no_speed_passes_an_end_and_the_way_back_is_free() {
    for push in [0.0, 3.0, 20.0, 40.0] {
        for speed in 0..=20 {
            for side in [1.0, -1.0] {
                let v = side * 0.05 * f64::from(speed);
                let limited = Limited::try_new(Push([side * push; 2]), config()).expect("numbers in range");
                let (mut state, mut masses) = (limited.at_rest(), Masses { q: [0.05, 0.0], v: [v, 0.3 * v] });
                let mut acted = Acted::default();
                for _ in 0..2000 {
                    let command = limited.step(&mut state, &masses.input());
                    assert!(!command.health.is_faulted, "push {push}, speed {v}: {:?}", command.health.fault);
                    acted = acted.and(command.health.acted);
                    masses.step(&command.tau);
                    for k in 0..2 {
                        assert!(masses.q[k] <= config().q_upper[k] + 1e-12 && masses.q[k] >= config().q_lower[k] - 1e-12, "{:?}", masses.q);
                    }
                }
                if push > 0.0 {
                    let end = if side > 0.0 { config().q_upper[0] } else { config().q_lower[0] };
                    assert!((masses.q[0] - end).abs() < 0.03, "it comes near: {} of {end} with {push}", masses.q[0]);
                    assert!(acted.at(Limit::Position, 0) && acted.at(Limit::Position, 1));
                }
                let back = Limited::try_new(Push([-side * 8.0; 2]), config()).expect("numbers in range");
                let (mut state, at) = (back.at_rest(), masses.q[0]);
                for _ in 0..40 {
                    let command = back.step(&mut state, &masses.input());
                    masses.step(&command.tau);
                }
                assert!(side * (at - masses.q[0]) > 0.01, "inward motion is allowed");
            }
        }
    }
}

#[test]
fn a_drive_is_not_pushed_beyond_its_speed() {
    let wide = LimitsConfig { q_lower: [-1e3; 2], q_upper: [1e3; 2], ..config() };
    let limited = Limited::try_new(Push([40.0, -15.0]), wide).expect("numbers in range");
    let (mut state, mut masses, mut acted) = (limited.at_rest(), Masses { q: [0.0; 2], v: [0.0; 2] }, Acted::default());
    for _ in 0..2000 {
        let command = limited.step(&mut state, &masses.input());
        acted = acted.and(command.health.acted);
        masses.step(&command.tau);
        assert!(masses.v.iter().all(|v| v.abs() < 1.15), "{:?}", masses.v);
    }
    assert!(masses.v[0] > 0.95 && masses.v[1] < -0.95, "{:?}", masses.v);
    assert!(acted.at(Limit::Velocity, 0) && acted.at(Limit::Velocity, 1));
    masses.v = [1.7, 0.0];
    let _ = limited.step(&mut state, &masses.input());
    masses.step(&[SLOPE; 2]);
    let command = limited.step(&mut state, &masses.input());
    let fault = command.health.fault.expect("too fast");
    assert!(fault.code == FaultCode::Velocity && fault.drive == 0 && (fault.value - 1.7).abs() < 0.01, "{fault}");
}

#[test]
fn efforts_and_their_rates_are_limited_drive_by_drive() {
    let slow = LimitsConfig { tau_rate: [1000.0, 1e9], ..config() };
    let limited = Limited::try_new(Push([40.0, 90.0]), slow).expect("numbers in range");
    let (mut state, masses) = (limited.at_rest(), Masses { q: [0.0; 2], v: [0.0; 2] });
    let command = limited.step(&mut state, &masses.input());
    assert!((command.tau[0] - (SLOPE + 1000.0 * DT)).abs() < 1e-12 && (command.tau[1] - 60.0).abs() < 1e-12, "{:?}", command.tau);
    assert!(command.health.acted.iter().eq([(Limit::Effort, 1), (Limit::EffortRate, 0)]), "{:?}", command.health.acted);
    assert!(command.health.is_saturated);
    let mut last = command.tau[0];
    for _ in 0..20 {
        let tau = limited.step(&mut state, &masses.input()).tau[0];
        assert!(tau - last <= 1000.0 * DT + 1e-12);
        last = tau;
    }
    assert!((last - 45.0).abs() < 1e-12);
}

fn position() -> PdGravity<2> {
    let config = PdGravityConfig { kp: [200.0; 2], kd: [20.0; 2], tau_limit: [60.0; 2], dt: DT, filter_s: 0.0 };
    PdGravity::try_new(config).expect("numbers in range")
}

#[test]
fn what_is_no_number_or_no_time_is_named_latched_and_answered_safely() {
    type Spoil = fn(&mut Input<2>);
    let cases: [(FaultCode, usize, Spoil); 9] = [
        (FaultCode::PositionNotFinite, 1, |i| i.q_meas[1] = f64::NAN),
        (FaultCode::EffortNotFinite, 0, |i| i.tau_meas[0] = f64::INFINITY),
        (FaultCode::WrenchNotFinite, 4, |i| i.wrench_meas[4] = f64::NAN),
        (FaultCode::ReferenceNotFinite, 1, |i| i.q_ref[1] = f64::NEG_INFINITY),
        (FaultCode::ReferenceNotFinite, 0, |i| i.tau_ff[0] = f64::NAN),
        (FaultCode::Late, 0, |i| i.dt = f64::NAN),
        (FaultCode::Late, 0, |i| i.dt = 6.0 * DT),
        (FaultCode::Late, 0, |i| i.dt = 0.0),
        (FaultCode::Position, 1, |i| i.q_meas[1] = 0.15),
    ];
    for (code, drive, spoil) in cases {
        let limited = Limited::try_new(position(), config()).expect("numbers in range");
        let mut state = limited.at_rest();
        let calm = Masses { q: [0.0; 2], v: [0.0; 2] }.input();
        assert!(!limited.step(&mut state, &calm).health.is_faulted);
        let mut input = calm;
        spoil(&mut input);
        let command = limited.step(&mut state, &input);
        let fault = command.health.fault.expect("a fault");
        assert_eq!((fault.code, fault.drive, command.tau), (code, drive, [SLOPE; 2]), "{fault}");
        let after = limited.step(&mut state, &calm);
        assert!(after.health.is_faulted && after.health.fault.is_some_and(|f| f.code == code) && after.tau == [SLOPE; 2]);
        assert!(state.fault().is_some_and(|f| f.to_string().starts_with("fault ")));
    }
}

#[test]
fn frozen_measurements_are_noticed_and_moving_ones_are_not() {
    let frozen = LimitsConfig { repeats: 5, ..config() };
    let limited = Limited::try_new(position(), frozen).expect("numbers in range");
    let mut state = limited.at_rest();
    for k in 0..50 {
        let noisy = Masses { q: [1e-9 * f64::from(k % 7 + 1), 0.0], v: [0.0; 2] };
        assert!(!limited.step(&mut state, &noisy.input()).health.is_faulted);
    }
    let still = Masses { q: [0.0; 2], v: [0.0; 2] }.input();
    let steps = (1..20).find(|_| limited.step(&mut state, &still).health.is_faulted);
    assert_eq!(steps, Some(7), "the first is new, five repeats are allowed");
    assert!(matches!(state.fault(), Some(Fault { code: FaultCode::Frozen, .. })));
}

#[test]
fn a_push_of_the_environment_makes_the_robot_yield_and_a_harder_one_stops_it() {
    let limited = Limited::try_new(position(), config()).expect("numbers in range");
    let mut state = limited.at_rest();
    let mut input = Masses { q: [0.0; 2], v: [0.0; 2] }.input();
    input.q_ref = [0.1, 0.05];
    assert!(limited.step(&mut state, &input).tau[0] > SLOPE + 10.0);
    input.wrench_meas[2] = -70.0;
    let command = limited.step(&mut state, &input);
    assert!(command.tau.iter().all(|tau| (tau - SLOPE).abs() < 1e-12), "no push towards the reference: {:?}", command.tau);
    assert!(command.health.acted.at(Limit::Wrench, 2) && !command.health.is_faulted);
    input.wrench_meas[2] = -170.0;
    let fault = limited.step(&mut state, &input).health.fault.expect("too hard");
    assert_eq!(fault, Fault { code: FaultCode::Wrench, drive: 2, value: -170.0, limit: 100.0 });
}

#[test]
fn references_outside_the_workspace_or_near_a_singularity_are_not_followed_but_the_way_in_is() {
    // One drive is x, the other x + y/2, so that y is held by half: a margin that the box asks for or does not.
    let map = LinearTask::try_new([0.0; 2], [0.0; 2], [[1.0, 0.0], [1.0, 0.5]], [0, 1]).expect("full rank");
    let space = |margin| TaskBox::try_new(map, [-0.05; 2], [0.05; 2], margin).expect("a box");
    let limited = Limited::within(position(), space(0.1), config()).expect("numbers in range");
    let mut state = limited.at_rest();
    let mut at = |q_ref: [f64; 2]| {
        let mut input = Masses { q: [0.0; 2], v: [0.0; 2] }.input();
        input.q_ref = q_ref;
        let command = limited.step(&mut state, &input);
        ((command.tau[0] - SLOPE) / 200.0, command.health.acted.any(Limit::Workspace))
    };
    let close = |(x, acted): (f64, bool), want: f64, has: bool| assert!((x - want).abs() < 1e-12 && acted == has, "{x} {acted}");
    close(at([0.04, 0.04]), 0.04, false);
    close(at([0.08, 0.08]), 0.04, true);
    close(at([0.045, 0.045]), 0.045, false);
    let mut outside = limited.at_rest();
    let mut input = Masses { q: [0.09, 0.09], v: [0.0; 2] }.input();
    for (q_ref, followed) in [(0.09, 0.09), (0.08, 0.08), (0.085, 0.08), (0.03, 0.03)] {
        input.q_ref = [q_ref; 2];
        let command = limited.step(&mut outside, &input);
        assert!((command.tau[0] - SLOPE - 200.0 * (followed - 0.09)).abs() < 1e-9, "{q_ref}: {:?}", command.tau);
    }
    let near = Limited::within(position(), space(10.0), config()).expect("numbers in range");
    let command = near.step(&mut near.at_rest(), &Masses { q: [0.0; 2], v: [0.0; 2] }.input());
    assert!(command.health.acted.any(Limit::Singularity));
}

/// Answers with what it is told.
struct Says(f64, bool);

impl Controller<2> for Says {
    type State = ();

    fn at_rest(&self) {}

    fn step(&self, (): &mut (), _: &Input<2>) -> Command<2> {
        Command { tau: [1.0, self.0], health: Health { is_faulted: self.1, ..Health::default() } }
    }
}

#[test]
fn a_controller_that_fails_is_stopped() {
    let calm = Masses { q: [0.0; 2], v: [0.0; 2] }.input();
    let damped = LimitsConfig { safe: Safe::Damped([30.0; 2]), ..config() };
    for (inner, code) in [(Says(f64::NAN, false), FaultCode::CommandNotFinite), (Says(1.0, true), FaultCode::Controller)] {
        let limited = Limited::try_new(inner, damped).expect("numbers in range");
        let mut state = limited.at_rest();
        let fault = limited.step(&mut state, &calm).health.fault.expect("a fault");
        assert_eq!(fault.code, code);
        let mut moving = calm;
        moving.q_meas = [0.2 * DT, 0.0];
        // Resistance of 30 N·s/m at 0.2 m/s, the weight carried.
        let tau = limited.step(&mut state, &moving).tau;
        assert!((tau[0] - (SLOPE - 6.0)).abs() < 1e-9 && (tau[1] - SLOPE).abs() < 1e-12, "{tau:?}");
    }
    let ramp = LimitsConfig { safe: Safe::Ramp([100.0; 2]), ..config() };
    let limited = Limited::try_new(Push([20.0; 2]), ramp).expect("numbers in range");
    let mut state = limited.at_rest();
    let _ = limited.step(&mut state, &calm);
    let mut late = calm;
    late.dt = 1.0;
    let falling: Vec<f64> = (0..60).map(|k| limited.step(&mut state, if k == 0 { &late } else { &calm }).tau[0]).collect();
    assert!(falling.windows(2).all(|w| w[1] <= w[0]) && falling[59].abs() < 1e-12 && falling[0] > 20.0, "{falling:?}");
}

/// Steps of a drive at these positions, each with the time since the last measured one, until a fault.
fn measured(seen: &[(f64, f64)]) -> Option<(usize, Fault)> {
    let limited = Limited::try_new(position(), config()).expect("numbers in range");
    let mut state = limited.at_rest();
    seen.iter().enumerate().find_map(|(step, &(q, q_dt))| {
        let input = Input { q_dt, ..Masses { q: [q, 0.0], v: [0.0; 2] }.input() };
        limited.step(&mut state, &input).health.fault.map(|fault| (step, fault))
    })
}

#[test]
fn positions_that_are_far_apart_in_time_are_no_speed() {
    // At 0.8 m/s of 1 m/s: a driver that shows nothing for seven periods, whose positions are carried on for three of them.
    let way = 0.8 * DT;
    let held = [(0.0, DT), (way, DT), (2.0 * way, 0.0), (3.0 * way, 0.0), (4.0 * way, 0.0), (4.0 * way, 0.0), (4.0 * way, 0.0)];
    let then = |q_dt: f64| [&held[..], &[(8.0 * way, q_dt), (9.0 * way, DT)]].concat();
    assert_eq!(measured(&then(7.0 * DT)), None);
    // The same way in one period is 5.6 m/s.
    let (step, fault) = measured(&then(DT)).expect("too fast");
    assert!(step == 7 && fault.code == FaultCode::Velocity && (fault.value - 5.6).abs() < 1e-9, "{fault}");
    // Two states of one period: what is measured between them is a tick of the encoder, and a period's way is none.
    assert_eq!(measured(&[(0.0, DT), (way, DT), (way + 1e-5, 1e-9), (2.0 * way, DT)]), None);
}

#[test]
fn no_stamp_hides_a_jump() {
    // 8 mm in 5 ms are 1.6 m/s: new as ever, newer than it can be by next to nothing, with the stamp of the one before, carried on.
    for q_dt in [DT, 1e-9, 0.0] {
        let (step, fault) = measured(&[(0.0, DT), (0.0, DT), (1.6 * DT, q_dt)]).expect("a jump");
        assert!(step == 2 && fault.code == FaultCode::Velocity && (fault.value - 1.6).abs() < 1e-9, "{q_dt}: {fault}");
    }
    // In two periods without a new state, and then with one: over the time that it says.
    let late = measured(&[(0.0, DT), (0.0, DT), (0.0, 0.0), (3.2 * DT, 2.0 * DT)]).expect("a jump");
    assert!(late.0 == 3 && (late.1.value - 1.6).abs() < 1e-9, "{}", late.1);
    for q_dt in [f64::NAN, f64::INFINITY, -DT] {
        let (step, fault) = measured(&[(0.0, DT), (1.6 * DT, q_dt)]).expect("no time");
        assert!(step == 1 && fault.code == FaultCode::Late, "{q_dt}: {fault}");
    }
}

/// Sent to the safe command by what arrives in step `at`, standing at 0.25 and 0.08 `[m]`, the efforts from there on.
fn after_a_fault(at: usize, spoil: impl Fn(&mut Input<2>)) -> Vec<[f64; 2]> {
    let damped = LimitsConfig { safe: Safe::Damped([30.0; 2]), ..config() };
    let limited = Limited::try_new(position(), damped).expect("numbers in range");
    let (mut state, calm) = (limited.at_rest(), Masses { q: [0.25, 0.08], v: [0.0; 2] }.input());
    let mut efforts = Vec::new();
    for step in 0..at + 4 {
        let mut input = calm;
        if step == at {
            spoil(&mut input);
        }
        let command = limited.step(&mut state, &input);
        assert_eq!(command.health.is_faulted, step >= at, "step {step}: {:?}", command.health.fault);
        if step >= at {
            efforts.push(command.tau);
        }
    }
    efforts
}

#[test]
fn a_fault_in_the_first_step_carries_the_weight_and_pushes_nothing() {
    let spoils: [fn(&mut Input<2>); 3] = [|i| i.dt = 1.0, |i| i.tau_meas[1] = f64::NAN, |i| i.wrench_meas[0] = 1e3];
    for spoil in spoils {
        for tau in after_a_fault(0, spoil) {
            assert!(tau.iter().all(|t| (t - SLOPE).abs() < 1e-12), "{tau:?}");
        }
    }
    // The position is no number at first, and then one far from zero.
    for tau in after_a_fault(0, |i| i.q_meas = [f64::NAN; 2]) {
        assert!(tau.iter().all(|t| (t - SLOPE).abs() < 1e-12), "{tau:?}");
    }
}

#[test]
fn an_encoder_that_jumps_there_and_back_is_damped_as_the_fastest_motion_is() {
    let efforts = after_a_fault(3, |i| i.q_meas[0] -= 0.4);
    // 30 N·s/m at 1 m/s, against the jump and then against the way back; a jump of 0.4 m in 5 ms would be 2400 N.
    let want = [SLOPE + 30.0, SLOPE - 30.0, SLOPE, SLOPE];
    assert!(efforts.iter().zip(want).all(|(tau, want)| (tau[0] - want).abs() < 1e-9 && (tau[1] - SLOPE).abs() < 1e-12), "{efforts:?}");
}

#[test]
fn a_controller_that_follows_no_reference_cannot_be_led_by_one() {
    let force = || {
        let pid = ForcePidConfig {
            kp: [0.1; 2],
            ki: [0.0; 2],
            kd: [0.0; 2],
            output_limit: [9.0; 2],
            rate_limit: [9.0; 2],
            filter_s: 0.0,
            dt: DT,
        };
        ExplicitForce::try_new(ExplicitForceConfig { pid, tau_limit: [60.0; 2] }).expect("numbers in range")
    };
    let free = LimitsConfig { wrench_yield: [f64::INFINITY; 6], ..config() };
    let map = LinearTask::try_new([0.0; 2], [0.0; 2], [[1.0, 0.0], [0.0, 1.0]], [0, 1]).expect("full rank");
    let space = || TaskBox::try_new(map, [-0.05; 2], [0.05; 2], 0.0).expect("a box");
    assert!(Limited::try_new(force(), free).is_ok() && Limited::within(position(), space(), free).is_ok());
    assert_eq!(Limited::try_new(force(), config()).expect_err("it would not yield").what, "wrench_yield");
    assert_eq!(Limited::within(force(), space(), free).expect_err("it would not stay inside").what, "workspace");
    let inside = Limited::try_new(force(), free).expect("numbers in range");
    assert!(Limited::try_new(inside, config()).is_err(), "limits do not make it follow");
}

#[test]
fn boxes_that_are_none_are_refused() {
    let map = LinearTask::try_new([0.0], [0.0], [[1.0]], [0]).expect("full rank");
    assert!(TaskBox::try_new(map, [-1.0], [1.0], 0.0).is_ok());
    for (lower, upper, margin) in
        [(1.0, 1.0, 0.0), (f64::NAN, 1.0, 0.0), (-1.0, f64::INFINITY, 0.0), (-1.0, 1.0, -0.1), (-1.0, 1.0, f64::NAN)]
    {
        assert!(TaskBox::try_new(map, [lower], [upper], margin).is_err(), "{lower} {upper} {margin}");
    }
}

#[test]
fn unusable_limits_are_refused() {
    for bad in [
        LimitsConfig { q_lower: [0.3, 0.0], ..config() },
        LimitsConfig { deceleration: [f64::NAN, 1.0], ..config() },
        LimitsConfig { tau_limit: [f64::INFINITY; 2], ..config() },
        LimitsConfig { brake: [0.0; 2], ..config() },
        LimitsConfig { brake: [f64::INFINITY; 2], ..config() },
        LimitsConfig { brake: [f64::INFINITY; 2], q_lower: [f64::NEG_INFINITY; 2], q_upper: [f64::INFINITY; 2], ..config() },
        LimitsConfig { dt: f64::INFINITY, ..config() },
        LimitsConfig { wrench_limit: [0.0; 6], ..config() },
        LimitsConfig { safe: Safe::Ramp([-1.0; 2]), ..config() },
    ] {
        assert!(Limited::try_new(position(), bad).is_err(), "{bad:?}");
    }
}
