//! A whole daemon loop on a simulated robot, driven by a clock that moves only when told to.

use core::sync::atomic::Ordering;

use pkm_ctrl::Running;
use pkm_daemon::config::{DaemonConfig, Settings};
use pkm_daemon::machine::{Machine, Parts, Tick};
use pkm_daemon::supervisor::{Lines, LoopEnds, lines};
use pkm_daemon::weigher::Weigher;
use pkm_daemon::{Grid, Motion, Order, OrderKind, Refusal, Wanted};
use pkm_dyn::effects::Robot;
use pkm_dyn::urdf::parse;
use pkm_hal::cycle::ring::{RingSink, RingSource, ring};
use pkm_hal::{
    Backend, Clock, CycleRecord, CycleSource, FaultyHal, Injection, Limiter, MAX_AXES, ManualClock, Phase, Transition, Watchdog,
    WatchdogLimits,
};
use pkm_sim::{Paced, Plant, PlantKind, SimBackend, SimOptions};

/// The shipped example, with a motion given in code in place of a file.
pub(crate) const CONFIG: &str = include_str!("../../docs/examples/daemon.toml");

/// Its controller.
pub(crate) const CONTROLLER: &str = include_str!("../../docs/examples/controllers/computed_torque_200hz.toml");

/// The robot as a HAL: what a driver would be.
pub(crate) type GuardedBy<C> = Watchdog<Limiter<Paced<Box<dyn Plant>, C>>, C>;

/// The same, in a time that moves only when told to.
pub(crate) type Guarded<'c> = GuardedBy<&'c ManualClock>;

/// A shipped robot.
pub(crate) fn robot(name: &str) -> Robot {
    let robot = pkm_robots::find(name).expect("a shipped robot");
    parse(robot.toml, robot.urdf, [robot.toml_name, robot.urdf_name]).expect("shipped robots load").robot
}

/// Numbers of the shipped example.
pub(crate) fn settings(robot: &Robot) -> Settings {
    DaemonConfig::parse(CONFIG, "daemon.toml").expect("the example").settings(&robot.model, 200.0).expect("the example fits")
}

/// The example's controller, at rest.
pub(crate) fn controller(robot: &Robot) -> Box<dyn Running> {
    pkm_ctrl::config::parse(CONTROLLER, "controller.toml", robot).expect("the example's controller")
}

/// The simulated robot, standing at `start`, behind limits and a watchdog of its own.
pub(crate) fn guarded<C: Clock + Copy>(robot: &Robot, settings: &Settings, start: &[f64], clock: C) -> GuardedBy<C> {
    let plant = PlantKind::Reduced.build(robot, 1, start, &vec![0.0; start.len()]).expect("it closes");
    let period_ns = settings.limits.period_ns;
    // Steps of half a millisecond at most.
    let substeps = u32::try_from(period_ns.div_ceil(500_000)).expect("a short period");
    let options = SimOptions { period_ns, substeps, encoder_resolution: 1e-6, encoder_noise: 1e-6, ..SimOptions::default() };
    let device = Paced::try_new(SimBackend::of_robot(plant, robot, &options).expect("three drives"), clock, period_ns).expect("a state");
    behind_limits(device, settings, clock)
}

/// A device behind limits and a watchdog of its own.
pub(crate) fn behind_limits<B: Backend, C: Clock>(device: B, settings: &Settings, clock: C) -> Watchdog<Limiter<B>, C> {
    let watched = WatchdogLimits {
        late_ns: settings.limits.gate.late_ns,
        stale_ns: settings.limits.gate.stale_ns,
        ahead_ns: settings.limits.period_ns,
        horizon_ns: 2 * settings.limits.valid_for_ns,
    };
    let device = Limiter::try_new(device, &settings.axes).expect("sensible limits");
    Watchdog::try_new(device, clock, watched, settings.limits.safe).expect("a bounded action")
}

/// Up and down on a cosine, all drives alike, for `length` `[s]`.
pub(crate) struct Wave {
    pub(crate) centre: [f64; MAX_AXES],
    pub(crate) height: f64,
    pub(crate) length: Option<f64>,
}

impl Motion for Wave {
    fn duration_s(&self) -> Option<f64> {
        self.length
    }

    fn at(&mut self, t: f64, wanted: &mut Wanted) {
        let w = core::f64::consts::PI;
        let (sin, cos) = (pkm_dyn::math::sin(w * t), pkm_dyn::math::cos(w * t));
        for k in 0..3 {
            wanted.q[k] = self.centre[k] + 0.5 * self.height * (1.0 - cos);
            wanted.v[k] = 0.5 * self.height * w * sin;
            wanted.a[k] = 0.5 * self.height * w * w * cos;
        }
    }
}

/// A loop with everything around it.
pub(crate) struct Rig<'c, B> {
    pub(crate) machine: Machine<B, RingSink>,
    pub(crate) lines: Lines<RingSource>,
    pub(crate) clock: &'c ManualClock,
    pub(crate) robot: Robot,
    pub(crate) settings: Settings,
    pub(crate) grid: Grid,
    pub(crate) transitions: Vec<Transition>,
    pub(crate) records: Vec<CycleRecord>,
    pub(crate) is_supervised: bool,
    is_overrun: bool,
    last_id: u64,
}

impl<'c, B: Backend> Rig<'c, B> {
    pub(crate) fn new(hal: B, robot: Robot, settings: Settings, clock: &'c ManualClock) -> Self {
        let (sink, source) = ring(4096);
        let (lines, LoopEnds { orders, answers, transitions, heartbeat }) = lines(source);
        let weigher = Weigher::new(robot.model.clone());
        let (limits, wrench) = (settings.limits.clone(), settings.wrench);
        let machine = Machine::new(Parts { hal, sink, weigher, wrench, limits, orders, answers, transitions, heartbeat });
        let grid = Grid::new(clock.now_ns() + settings.limits.period_ns, settings.limits.period_ns);
        Self {
            machine,
            lines,
            clock,
            robot,
            settings,
            grid,
            transitions: Vec::new(),
            records: Vec::new(),
            is_supervised: true,
            is_overrun: false,
            last_id: 0,
        }
    }

    /// One period that takes `busy_ns`, and begins `late_ns` late.
    pub(crate) fn period_of(&mut self, late_ns: u64, busy_ns: u64) {
        let until = self.grid.beat().planned_ns.saturating_sub(self.clock.now_ns());
        self.clock.advance(until + late_ns);
        let now_ns = self.clock.now_ns();
        if self.is_supervised {
            self.lines.heartbeat.store(now_ns, Ordering::Relaxed);
        }
        let tick = Tick { beat: self.grid.woken(now_ns), woken_ns: now_ns, is_overrun: self.is_overrun };
        self.machine.step(&tick, self.clock);
        self.clock.advance(busy_ns);
        self.is_overrun = self.grid.done(self.clock.now_ns());
    }

    /// What came out of the loop.
    pub(crate) fn collect(&mut self) {
        while let Ok(transition) = self.lines.transitions.pop() {
            self.transitions.push(transition);
        }
        while let Some(record) = self.lines.records.take() {
            self.records.push(record);
        }
    }

    pub(crate) fn periods(&mut self, n: usize) {
        for _ in 0..n {
            self.period_of(0, 0);
            self.collect();
        }
    }

    /// Gives an order and lets one period pass; the loop's answer.
    pub(crate) fn order(&mut self, order: Order) -> Result<(), Refusal> {
        self.last_id += 1;
        self.lines.orders.push(Order { id: self.last_id, ..order }).expect("there is room");
        self.periods(1);
        let answer = self.lines.answers.pop().expect("an order is answered in its period");
        assert_eq!(answer.id, self.last_id);
        answer.outcome
    }

    pub(crate) fn plain(&mut self, kind: OrderKind) -> Result<(), Refusal> {
        self.order(Order::plain(kind, 0))
    }

    pub(crate) fn arm(&mut self) -> Result<(), Refusal> {
        let controller = Some(controller(&self.robot));
        let nonce = 1000 + self.last_id;
        self.order(Order { nonce, controller, ..Order::plain(OrderKind::Arm, 0) })
    }

    pub(crate) fn start(&mut self, length: Option<f64>) -> Result<(), Refusal> {
        let mut centre = [0.0; MAX_AXES];
        centre[..3].fill(0.15);
        let motion: Option<Box<dyn Motion>> = Some(Box::new(Wave { centre, height: 0.05, length }));
        self.order(Order { motion, ..Order::plain(OrderKind::Start, 0) })
    }

    /// Armed, at home, playing a motion that does not end.
    pub(crate) fn playing(&mut self) {
        self.periods(3);
        self.arm().expect("it is ready");
        self.until(Phase::Holding, 2000);
        // Until efforts no longer lead over from nothing.
        self.periods(150);
        self.start(None).expect("it holds");
        self.periods(200);
        assert_eq!(self.machine.phase(), Phase::Position);
    }

    /// Lets periods pass until a phase is reached; how many.
    pub(crate) fn until(&mut self, phase: Phase, most: usize) -> usize {
        for n in 0..most {
            if self.machine.phase() == phase {
                return n;
            }
            self.periods(1);
        }
        panic!("{phase:?} is not reached in {most} periods: {:?}", self.transitions.last());
    }

    pub(crate) fn last(&self) -> &CycleRecord {
        self.records.last().expect("a period has passed")
    }
}

/// A rig on the 3-PRS with faults of a script between loop and robot.
pub(crate) fn rig<'c, 's>(script: &'s [Injection], clock: &'c ManualClock) -> Rig<'c, FaultyHal<'s, Guarded<'c>>> {
    let robot = robot("prs3");
    let settings = settings(&robot);
    let hal = guarded(&robot, &settings, &[0.14, 0.15, 0.16], clock);
    Rig::new(FaultyHal::new(hal, script), robot, settings, clock)
}
