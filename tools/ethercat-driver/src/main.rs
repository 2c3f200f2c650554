//! `ethercat-driver INTERFACE DIRECTORY`: three CiA 402 drives on EtherCAT, offered to the `pkm daemon` whose `directory` that is.
//!
//! What is of one robot stands in constants below. Limits and safe action must be those of the daemon.toml: both sides apply them.

use std::error::Error;
use std::path::Path;

use ethercat_driver::{INPUT, INPUT_OBJECTS, Image, OUTPUT, OUTPUT_OBJECTS, Wire};
use ethercrab::std::{ethercat_now, tx_rx_task};
use ethercrab::subdevice_group::Op;
use ethercrab::{MainDevice, MainDeviceConfig, PduStorage, SubDeviceGroup, Timeouts};
use futures_lite::future::block_on;
use pkm_hal::backends::cia402::{Cia402, DriveScale};
use pkm_hal::backends::iceoryx2::{Place, Role, SharedDriver};
use pkm_hal::units::EncoderScale;
use pkm_hal::{AxisLimits, Clock, HalError, Limiter, MAX_AXES, SafeAction, SafeKind, SystemClock, Watchdog, WatchdogLimits};
use rustix::thread::{ClockId, Timespec, clock_nanosleep_absolute};

/// Drives, in the order of the bus, which is the order of the actuators in robot.toml.
const N: usize = 3;

/// Cycle of the bus: half of a daemon's period or less, so that a command waits for no more than that `[ns]`.
const CYCLE_NS: u64 = 500_000;

/// Period of the daemon `[ns]`.
const PERIOD_NS: u64 = 1_000_000;

/// Width of a tick `[m]`, position at count zero `[m]`, effort at rated torque `[N]`: of each drive, measured, not guessed.
const SCALES: [(f64, f64, f64); N] = [(1e-6, 0.15, 800.0), (1e-6, 0.15, 800.0), (-1e-6, 0.15, -800.0)];

/// What the drives may be asked for.
const LIMITS: AxisLimits =
    AxisLimits { lower: 0.0, upper: 0.3, velocity: 0.35, position_gain: 50.0, velocity_gain: 2000.0, ..AxisLimits::of_effort(1400.0) };

/// Room for the process image `[bytes]`.
const IMAGE: usize = 256;

static STORAGE: PduStorage<16, { PduStorage::element_size(1100) }> = PduStorage::new();

type Group = SubDeviceGroup<N, IMAGE, Op>;

/// The drives in operation.
struct EtherCat<'m> {
    main: &'m MainDevice<'m>,
    group: Group,
}

/// Read and written by one frame, a drive adds three to its working counter (ETG.1000.4): so every drive took part or it shows.
const COUNTER: u16 = 3 * N as u16;

impl Wire for EtherCat<'_> {
    fn cycle(&mut self, outputs: &[u8], inputs: &mut [u8]) -> Result<(), HalError> {
        for (drive, bytes) in self.group.iter(self.main).zip(outputs.chunks_exact(OUTPUT)) {
            drive.outputs_raw_mut().copy_from_slice(bytes);
        }
        let response = block_on(self.group.tx_rx(self.main)).map_err(|_| HalError::Gone { code: 1 })?;
        if response.working_counter != COUNTER {
            return Err(HalError::Gone { code: 2 });
        }
        for (drive, bytes) in self.group.iter(self.main).zip(inputs.chunks_exact_mut(INPUT)) {
            bytes.copy_from_slice(&drive.inputs_raw());
        }
        Ok(())
    }
}

/// Finds the drives, maps their process data, brings the bus to operation. The drives themselves stay without voltage.
async fn operate<'m>(main: &'m MainDevice<'m>) -> Result<EtherCat<'m>, Box<dyn Error>> {
    let mut group = main.init_single_group::<N, IMAGE>(ethercat_now).await?;
    if group.len() != N {
        return Err(format!("{} devices on the bus (must be {N} drives)", group.len()).into());
    }
    for drive in group.iter_mut(main) {
        for (assigned, mapping, objects) in [(0x1c12, 0x1600, &OUTPUT_OBJECTS[..]), (0x1c13, 0x1a00, &INPUT_OBJECTS[..])] {
            // A mapping is changed while it is empty, and so is what it is assigned to.
            drive.sdo_write(assigned, 0, 0u8).await?;
            drive.sdo_write(mapping, 0, 0u8).await?;
            for (sub, object) in (1u8..).zip(objects) {
                drive.sdo_write(mapping, sub, *object).await?;
            }
            drive.sdo_write(mapping, 0, objects.len() as u8).await?;
            drive.sdo_write(assigned, 1, mapping).await?;
            drive.sdo_write(assigned, 0, 1u8).await?;
        }
    }
    let group = group.into_op(main).await?;
    for drive in group.iter(main) {
        let (outputs, inputs) = (drive.outputs_raw().len(), drive.inputs_raw().len());
        if (outputs, inputs) != (OUTPUT, INPUT) {
            return Err(format!("{}: {outputs} and {inputs} bytes (must be {OUTPUT} and {INPUT})", drive.name()).into());
        }
    }
    Ok(EtherCat { main, group })
}

fn sleep_until(at_ns: u64) {
    let at = Timespec { tv_sec: (at_ns / 1_000_000_000) as i64, tv_nsec: (at_ns % 1_000_000_000) as i64 };
    while clock_nanosleep_absolute(ClockId::Monotonic, &at).is_err() && SystemClock.now_ns() < at_ns {}
}

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [interface, directory] = arguments.as_slice() else { return Err("usage: ethercat-driver INTERFACE DIRECTORY".into()) };
    let place = Place::try_new(Path::new(directory))?;
    // Before the bus is touched: a second driver is sent away.
    let lock = place.lock(Role::Driver)?;
    let (tx, rx, pdu_loop) = STORAGE.try_split().map_err(|()| "the storage is split once")?;
    let task = tx_rx_task(interface, tx, rx)?;
    std::thread::spawn(move || block_on(task));
    let main = MainDevice::new(pdu_loop, Timeouts::default(), MainDeviceConfig::default());
    let wire = block_on(operate(&main))?;
    let mut scales = Vec::new();
    for (tick, zero, rated_effort) in SCALES {
        scales.push(DriveScale { encoder: EncoderScale::try_new(tick, zero)?, rated_effort });
    }
    let scales: [DriveScale; N] = scales.try_into().map_err(|_| "one scale for each drive")?;
    let device = Cia402::try_new(Image::<_, _, N>::new(wire, SystemClock), scales)?;
    let action = SafeAction { damping: [2000.0; MAX_AXES], stiffness: [20_000.0; MAX_AXES], effort: [1400.0; MAX_AXES], ..SafeAction::new(SafeKind::Hold) };
    let mut robot = Watchdog::try_new(Limiter::try_new(device, &[LIMITS; N])?, SystemClock, WatchdogLimits::of_period(PERIOD_NS), action)?;
    let mut driver = SharedDriver::try_new(&place, lock)?;
    let mut next_ns = SystemClock.now_ns();
    loop {
        next_ns = (next_ns + CYCLE_NS).max(SystemClock.now_ns());
        sleep_until(next_ns);
        // A state that cannot be had is told by the age of the last one: the daemon stops, and so does the watchdog here.
        let _ = driver.serve(&mut robot);
    }
}
