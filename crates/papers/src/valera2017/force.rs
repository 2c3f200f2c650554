//! Section 5: hybrid force/position control (15) around the controller-observer (13)-(14), with a foot on the platform, and the
//! active-resistive exercise of two stages.

use pkm_ctrl::exercise::{Channel, Exercise, ExerciseConfig, Phase, Script, Wave};
use pkm_ctrl::force::{ForcePidConfig, Hybrid, HybridConfig, PlatformTask, TaskMap};
use pkm_ctrl::observer::{CommandedAcceleration, Discretisation};
use pkm_ctrl::{Command, ComputedTorque, ComputedTorqueConfig, Controller, Input};
use pkm_dyn::loops::Output;
use pkm_dyn::math;
use pkm_dyn::model::FrameOnBody;
use pkm_dyn::spatial::Pose;
use pkm_sim::{Plant, ReducedPlant};

use crate::chance::Chance;
use crate::error::PaperError;
use crate::robot::shipped;
use crate::row::{Gate, Line, Plot, Row};
use crate::series::rms;
use crate::valera2017::position::L_M;

/// Control period `[s]`, and steps of the plant in it.
const TS: f64 = 0.01;
const FINE: usize = 5;

/// Force reference of the exercise `[N]`, `[rad/s]`.
const AMPLITUDE: f64 = 60.0;
const W: f64 = core::f64::consts::FRAC_PI_2;

/// Height of the sliders at which the exercise takes place `[m]`.
const HEIGHT: f64 = 0.144;

/// Stiffness `[N/m]` and damping `[N·s/m]` of the foot.
const FOOT: [f64; 2] = [5000.0, 50.0];

/// Half a newton of noise in the load cell.
const CELL: f64 = 0.5;

/// Length of the first stage, and how much of the second is simulated `[s]`.
const STAGES_S: [f64; 2] = [9.0, 16.0];

type Inner = ComputedTorque<3, CommandedAcceleration<3>>;

/// Height, turn about x and turn about y of the platform's centre.
fn task() -> Result<PlatformTask<3>, PaperError> {
    let model = shipped("prs3")?.robot.model;
    let missing = || PaperError::Robot { name: "prs3", reason: "no link platform".to_string() };
    let platform = Output::named(&model, "platform").ok_or_else(missing)?;
    let centre = platform.frame.pose.compose(&Pose::from_xyz_rpy([-L_M / math::sqrt(3.0), 0.0, 0.0], [0.0; 3]));
    let centre = Output { name: "centre".into(), frame: FrameOnBody { body: platform.frame.body, pose: centre } };
    Ok(PlatformTask::try_new(model, centre, [2, 3, 4], 0.3)?)
}

/// The controller-observer (13)-(14), error dynamics of 20/s, observer of 20/s.
fn inner() -> Result<Inner, PaperError> {
    let observer = CommandedAcceleration::try_new([20.0; 3], Discretisation::Euler)?;
    let config = ComputedTorqueConfig { creep: 2e-3, ..ComputedTorqueConfig::with_bandwidth(20.0, [1500.0; 3]) };
    Ok(ComputedTorque::try_new(shipped("prs3")?.robot, observer, config)?)
}

fn pid() -> ForcePidConfig<3> {
    ForcePidConfig {
        kp: [2.5e-3, 0.0, 0.0],
        ki: [8e-3, 0.0, 0.0],
        kd: [0.0; 3],
        output_limit: [0.1; 3],
        rate_limit: [4.0; 3],
        filter_s: 0.02,
        dt: TS,
    }
}

/// The robot, and a foot strapped to its platform's centre.
struct World {
    plant: ReducedPlant,
    map: PlatformTask<3>,
    state: <PlatformTask<3> as TaskMap<3, 3>>::State,
    /// Stiffness `[N/m]`, damping `[N·s/m]`, height at rest `[m]`.
    foot: [f64; 3],
    force: f64,
    chance: Chance,
}

impl World {
    fn new(height: f64) -> Result<Self, PaperError> {
        let plant = ReducedPlant::try_new(shipped("prs3")?.robot, &[height; 3])?;
        let map = task()?;
        let state = TaskMap::<3, 3>::at_rest(&map);
        Ok(Self { plant, map, state, foot: [0.0; 3], force: 0.0, chance: Chance::new(3) })
    }

    fn q(&self) -> [f64; 3] {
        core::array::from_fn(|k| self.plant.position()[k])
    }

    /// Height `[m]`, turns about x and y `[rad]`.
    fn pose(&mut self) -> Result<[f64; 3], PaperError> {
        let q = self.q();
        self.map.at(&mut self.state, &q).map(|task| task.x).ok_or_else(lost)
    }

    fn input(&mut self) -> Input<3> {
        let cell = self.force + self.chance.between(-CELL, CELL);
        Input { wrench_meas: [0.0, 0.0, cell, 0.0, 0.0, 0.0], ..Input::standing(self.q(), TS) }
    }

    fn step(&mut self, tau: &[f64; 3]) -> Result<(), PaperError> {
        for _ in 0..FINE {
            let q = self.q();
            let here = self.map.at(&mut self.state, &q).ok_or_else(lost)?;
            let v = here.of_drives(&core::array::from_fn(|k| self.plant.velocity()[k]));
            let [k, d, z] = self.foot;
            self.force = -k * (here.x[0] - z) - d * v[0];
            let push = here.efforts(&[self.force, 0.0, 0.0]);
            let tau: [f64; 3] = core::array::from_fn(|i| tau[i] + push[i]);
            self.plant.step(&tau, TS / FINE as f64)?;
        }
        Ok(())
    }
}

fn lost() -> PaperError {
    PaperError::Other { what: "hybrid control", reason: "the platform left its workspace".to_string() }
}

fn sound(command: &Command<3>, t: f64) -> Result<(), PaperError> {
    let health = &command.health;
    if health.is_faulted || health.is_saturated {
        return Err(PaperError::Other { what: "hybrid control", reason: format!("faulted or saturated at {t} s") });
    }
    Ok(())
}

/// What a run with a force reference shows.
struct Run {
    /// Time `[s]`, wanted and measured force `[N]`, turns about x and y `[rad]`.
    rows: Vec<[f64; 5]>,
}

impl Run {
    fn force_error(&self, from_s: f64) -> f64 {
        rms(&self.rows.iter().filter(|r| r[0] > from_s).map(|r| r[2] - r[1]).collect::<Vec<_>>())
    }

    fn tilt(&self) -> f64 {
        self.rows.iter().fold(0.0, |top, r| top.max(r[3].abs()).max(r[4].abs()))
    }
}

/// Hybrid control (15): a sine of force in z, level in pitch and roll, standing on the foot.
fn hybrid() -> Result<Run, PaperError> {
    let config = HybridConfig { selection: [1.0, 0.0, 0.0], pid: pid(), travel: [0.08; 3], margin: 1e-3 };
    let controller = Hybrid::try_new(task()?, inner()?, config)?;
    let mut state = controller.at_rest();
    let mut world = World::new(HEIGHT)?;
    world.foot = [FOOT[0], FOOT[1], world.pose()?[0]];
    let mut rows = Vec::new();
    for k in 0..1600 {
        let t = TS * f64::from(k);
        let mut input = world.input();
        input.q_ref = [HEIGHT; 3];
        // The robot presses with the sine: the environment presses back.
        let wanted = -AMPLITUDE * math::sin(W * t);
        input.wrench_ref[2] = wanted;
        let command = controller.step(&mut state, &input);
        sound(&command, t)?;
        world.step(&command.tau)?;
        let [_, rx, ry] = world.pose()?;
        rows.push([t, wanted, world.force, rx, ry]);
    }
    Ok(Run { rows })
}

/// The exercise of two stages: to the height in 9 s, then force; the run, the height missed at the end of the first stage `[m]` and the
/// largest change of an effort from one period to the next within 1.5 s of the change `[N]`.
fn exercise() -> Result<(Run, [f64; 2]), PaperError> {
    let [low, high] = [World::new(0.10)?.pose()?[0], World::new(HEIGHT)?.pose()?[0]];
    let flat = Channel::Position(Wave::constant(0.0));
    let phases = [
        Phase { duration_s: STAGES_S[0], ramp_s: 6.0, channels: [Channel::Position(Wave::constant(high)), flat, flat] },
        Phase { duration_s: 81.0, ramp_s: 1.0, channels: [Channel::Force(Wave { mean: 0.0, amplitude: AMPLITUDE, w: W }), flat, flat] },
    ];
    let script = Script::try_new(&phases)?;
    let config = ExerciseConfig { script, pid: pid(), lower: [low - 0.05, -0.2, -0.2], upper: [high + 0.08, 0.2, 0.2] };
    let controller = Exercise::try_new(task()?, inner()?, config)?;
    let mut state = controller.at_rest();
    let mut world = World::new(0.10)?;
    // The foot is strapped on shortly before the first stage ends.
    world.foot = [0.0, FOOT[1], high];
    let (mut rows, mut missed, mut jump, mut last) = (Vec::new(), 0.0, 0.0_f64, [0.0; 3]);
    for k in 0..2500 {
        let t = TS * f64::from(k);
        if k == 850 {
            let z = world.pose()?[0];
            missed = (z - high).abs();
            world.foot = [FOOT[0], FOOT[1], z];
        }
        let input = world.input();
        let command = controller.step(&mut state, &input);
        sound(&command, t)?;
        if (t - STAGES_S[0]).abs() < 1.5 {
            jump = (0..3).fold(jump, |top, i| top.max((command.tau[i] - last[i]).abs()));
        }
        last = command.tau;
        world.step(&command.tau)?;
        let wanted = if t < STAGES_S[0] { 0.0 } else { -AMPLITUDE * math::sin(W * (t - STAGES_S[0])) };
        let [_, rx, ry] = world.pose()?;
        rows.push([t, wanted, world.force, rx, ry]);
    }
    Ok((Run { rows }, [missed, jump]))
}

/// Rows and the picture of Figures 12 to 14.
pub(super) fn rows(progress: &mut dyn FnMut(f64)) -> Result<(Vec<Row>, Plot), PaperError> {
    let standing = hybrid()?;
    progress(0.4);
    let (staged, [missed, jump]) = exercise()?;
    progress(1.0);
    let why = "the paper prints curves and \"very good\": the limits are our own, 10 % of the amplitude and half a degree; the foot is a \
               spring of 5 kN/m with a load cell of 0.5 N";
    let own =
        |place: &'static str, what: &str, ours: f64, most: f64| Row::new(place, what, ours, None, Gate::AtMost(most)).conclusion_only(why);
    let rows = vec![
        own("eq. 15", "hybrid control, 60 N at pi/2 rad/s: rms of the force's error, N", standing.force_error(4.0), 0.1 * AMPLITUDE),
        own("eq. 15", "hybrid control: largest pitch or roll, deg", standing.tilt().to_degrees(), 0.5),
        own("Figure 13", "exercise of two stages: rms of the force's error, N", staged.force_error(12.0), 0.1 * AMPLITUDE),
        own("Figure 13", "exercise of two stages: largest pitch or roll, deg", staged.tilt().to_degrees(), 0.5),
        Row::new("Figure 14", "height missed at the end of the first stage, mm", 1e3 * missed, None, Gate::Told),
        Row::new("Figure 13", "largest change of an effort in 10 ms about the change of stages, N", jump, None, Gate::Told),
    ];
    let line = |label: &str, column: usize| Line {
        label: label.to_string(),
        points: staged.rows.iter().step_by(2).map(|r| (r[0], r[column])).collect(),
    };
    let plot = Plot {
        title: "Force of the exercise of two stages (Figure 13)".to_string(),
        x_label: "time, s".to_string(),
        y_label: "force of the foot on the platform, N".to_string(),
        lines: vec![line("wanted", 1), line("measured", 2)],
    };
    Ok((rows, plot))
}
