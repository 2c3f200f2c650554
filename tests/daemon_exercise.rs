//! An exercise on a limb, from the order to the hold after it: the phases of its script in order, the plate where they want it, and all of it
//! once more to the bit.

#[allow(dead_code, reason = "shared: no test uses all of it")]
#[path = "daemon/rig.rs"]
mod rig;

#[path = "daemon/limb.rs"]
mod limb;

use limb::{LIMB, robot};
use nalgebra::Vector3;
use pkm_daemon::{Order, OrderKind};
use pkm_dyn::loops::{assemble, solve_positions};
use pkm_dyn::{Data, Model, math};
use pkm_hal::{Cause, CycleRecord, ManualClock, Phase, Transition};
use rig::{Rig, controller};

/// Where arming leads `[m]`: the home of the example.
const HOME: f64 = 0.15;

/// Length of the script: 2 s higher, 2 s lower and turned, 4 s with a force `[s]`.
const LENGTH_S: f64 = 8.0;

/// Force on the limb in the last phase `[N]`.
const FORCE: f64 = 15.0;

/// How much higher and lower `[m]`, and turned about x `[rad]`.
const HIGHER: f64 = 0.02;
const LOWER: f64 = -0.01;
const TURN: f64 = 0.04;

/// The script, around a plate that stands at `z` `[m]` at home.
fn law(z: f64) -> String {
    let (high, low) = (z + HIGHER, z + LOWER);
    format!(
        "\
law = \"exercise\"
rate_hz = 200.0
lower = [{:?}, -0.3, -0.3]
upper = [{:?}, 0.3, 0.3]
[task]
kind = \"platform\"
link = \"platform\"
components = [\"z\", \"rx\", \"ry\"]
length = 0.3
[force]
kp = 4e-3
output_limit = 0.05
[inner]
law = \"computed_torque\"
bandwidth = 40.0
[inner.observer]
kind = \"commanded_acceleration\"
bandwidth = 80.0
[limits]
dt_limit = inf
[[phase]]
duration_s = 2.0
ramp_s = 1.0
channels = [{{ kind = \"position\", mean = {high:?} }}, {{ kind = \"position\" }}, {{ kind = \"position\" }}]
[[phase]]
duration_s = 2.0
ramp_s = 1.0
channels = [{{ kind = \"position\", mean = {low:?} }}, {{ kind = \"position\", mean = {TURN:?} }}, {{ kind = \"position\" }}]
[[phase]]
duration_s = 4.0
ramp_s = 0.5
channels = [{{ kind = \"force\", mean = {FORCE:?} }}, {{ kind = \"position\", mean = {TURN:?} }}, {{ kind = \"position\" }}]
",
        z - 0.1,
        z + 0.1
    )
}

/// Height of the plate `[m]` and its turn about x `[rad]` with the drives at `q`.
fn plate(model: &Model, q: &[f64]) -> [f64; 2] {
    let mut data = Data::new(model);
    assert!(assemble(model, &mut data).is_closed && solve_positions(model, &mut data, q).is_closed);
    let link = model.links.iter().find(|link| link.name == "platform").expect("the plate");
    let pose = link.body.map_or(link.pose, |body| data.pose_wb[body].compose(&link.pose));
    let normal = pose.rotation * Vector3::z();
    [pose.translation.z, math::atan2(-normal.y, normal.z)]
}

/// What a session leaves.
struct Session {
    records: Vec<CycleRecord>,
    transitions: Vec<Transition>,
    model: Model,
}

/// Armed, at home, the exercise for so long `[s]`, and a second after it.
fn session(length_s: Option<f64>, stop_after: Option<usize>) -> Session {
    let clock = ManualClock::new(0);
    let robot = robot("");
    let settings = limb::settings(&robot, 300.0);
    let hal = limb::guarded(&self::robot(LIMB), &settings, &clock);
    let mut rig = Rig::new(hal, robot, settings, &clock);
    rig.periods(3);
    rig.arm().expect("it is ready");
    rig.until(Phase::Holding, 400);
    rig.periods(200);
    let [z, _] = plate(&rig.robot.model, &[HOME; 3]);
    let run = pkm_ctrl::config::parse(&law(z), "exercise.toml", &rig.robot).expect("a law");
    let hold = Some(controller(&rig.robot));
    let phase = Phase::Exercise;
    rig.order(Order { controller: Some(run), hold, phase, length_s, ..Order::plain(OrderKind::Start, 0) }).expect("it holds");
    if let Some(periods) = stop_after {
        rig.periods(periods);
        rig.plain(OrderKind::Stop).expect("it runs");
    }
    rig.until(Phase::Holding, 4000);
    rig.periods(200);
    Session { records: rig.records, transitions: rig.transitions, model: rig.robot.model }
}

#[test]
fn phases_come_in_order_motion_and_force_follow_them_and_it_ends_in_holding() {
    let Session { records, transitions, model } = session(Some(LENGTH_S), None);
    let told: Vec<_> = transitions.iter().map(|t| (t.from, t.to, t.cause)).collect();
    let want = [
        (Phase::Off, Phase::Ready, Cause::RobotThere),
        (Phase::Ready, Phase::Homing, Cause::Order),
        (Phase::Homing, Phase::Holding, Cause::Arrived),
        (Phase::Holding, Phase::Exercise, Cause::Order),
        (Phase::Exercise, Phase::Holding, Cause::Arrived),
    ];
    assert_eq!(told, want);
    let begin = records.iter().position(|r| r.phase == Phase::Exercise.code()).expect("it runs");
    let run = records.iter().filter(|r| r.phase == Phase::Exercise.code()).count();
    assert!((1598..=1600).contains(&run), "8 s at 200 Hz: {run} periods");
    // So many milliseconds into it.
    let at = |ms: usize| &records[begin + ms / 5 - 1];
    let [z, _] = plate(&model, &[HOME; 3]);
    // Half of a ramp is half of its way, whatever even curve it is; what dry friction leaves of a place is a millimetre or two.
    let stations =
        [(20, 0.0, 0.0), (500, 0.5 * HIGHER, 0.0), (2000, HIGHER, 0.0), (2500, 0.5 * (HIGHER + LOWER), 0.5 * TURN), (4000, LOWER, TURN)];
    for (ms, up, turn) in stations {
        let t = 1e-3 * ms as f64;
        let [height, about_x] = plate(&model, &at(ms).state.q[..3]);
        assert!((height - z - up).abs() < 2.5e-3, "{t} s: {height} of {}", z + up);
        assert!((about_x - turn).abs() < 0.01, "{t} s: {about_x} of {turn}");
        assert!((at(ms).motion_time[0] - t).abs() < 0.011, "{t} s: {}", at(ms).motion_time[0]);
    }
    // The last second with a force: the limb feels it, evenly; the turn stays.
    for ms in (7000..8000).step_by(5) {
        let record = at(ms);
        assert!((-record.wrench[2] - FORCE).abs() < 1.5, "{} N", -record.wrench[2]);
    }
    let end = at(7990);
    assert!((plate(&model, &end.state.q[..3])[1] - TURN).abs() < 0.01);
    // Before the force phase the limb is drawn down, not pushed: the sign changes with the phase.
    assert!(-at(4000).wrench[2] < 0.0, "{} N", -at(4000).wrench[2]);
    // What comes after stays where it ended.
    let last = records.last().expect("periods");
    assert_eq!(last.phase, Phase::Holding.code());
    assert!((0..3).all(|k| (last.state.q[k] - end.state.q[k]).abs() < 2e-3), "{:?} {:?}", &last.state.q[..3], &end.state.q[..3]);
}

#[test]
fn a_second_run_sends_the_same_commands_to_the_bit() {
    let [first, second] = [session(Some(LENGTH_S), None), session(Some(LENGTH_S), None)];
    assert_eq!(first.transitions, second.transitions);
    assert!(first.records.len() > 2000);
    let differing = first.records.iter().zip(&second.records).position(|(a, b)| a.to_bytes() != b.to_bytes());
    assert_eq!((first.records.len(), differing), (second.records.len(), None));
}

#[test]
fn an_exercise_without_a_length_goes_on_until_it_is_stopped_and_holds_at_once() {
    // Two seconds longer than its script: the last phase goes on.
    let Session { records, transitions, .. } = session(None, Some(2000));
    let run = records.iter().filter(|r| r.phase == Phase::Exercise.code()).count();
    assert_eq!(run, 2001, "until the period that takes the order");
    assert_eq!(transitions.last().map(|t| (t.from, t.to, t.cause)), Some((Phase::Exercise, Phase::Holding, Cause::Order)));
}
