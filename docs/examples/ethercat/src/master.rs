//! All that knows the library ethercrab: drives found, told what to exchange, brought to operation; one cycle.

use core::time::Duration;
use std::thread;

use async_io::block_on;
use ethercrab::error::Error;
use ethercrab::subdevice_group::{Op, PreOp};
use ethercrab::{
    DefaultLock, MainDevice, MainDeviceConfig, PduRx, PduStorage, PduTx, SubDevice, SubDeviceGroup, SubDeviceRef, Timeouts,
    std::ethercat_now,
};

use crate::bus::{Master, Turn};
use crate::image::{Entry, INPUT_BYTES, INPUTS, OUTPUT_BYTES, OUTPUTS};

/// Most drives on the bus: a power of two, ethercrab says.
const MOST: usize = 16;

/// Room for the process image of as many `[byte]`.
const IMAGE: usize = MOST * (OUTPUT_BYTES + INPUT_BYTES);

/// Frames that may be under way, and the data of one `[byte]`.
const FRAMES: usize = 16;
const FRAME_BYTES: usize = PduStorage::element_size(1100);

/// Cycles within which the drives must follow: they want process data before they do.
const CYCLES_TO_OPERATION: u32 = 5000;

/// Cyclic synchronous torque (6060h).
const TORQUE_MODE: u8 = 10;

/// Why there is no master.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum MasterError {
    /// What ethercrab says.
    #[error("EtherCAT: {0:?}")]
    Bus(Error),
    /// Another number of devices than the driver is for.
    #[error("{found} devices on the bus (must be {expected})")]
    Count {
        /// On the bus.
        found: usize,
        /// Of the driver.
        expected: usize,
    },
    /// A device that is no drive of the profile.
    #[error("device {place} ({name}): profile {found} (must be 402)")]
    Profile {
        /// Place on the bus, from zero.
        place: usize,
        /// Its name.
        name: String,
        /// Low word of object 1000h.
        found: u32,
    },
    /// A drive that exchanges other lengths than it was told.
    #[error("device {place} ({name}): {inputs} bytes in, {outputs} out (must be 12 and 5)")]
    Lengths {
        /// Place on the bus, from zero.
        place: usize,
        /// Its name.
        name: String,
        /// What it sends `[byte]`.
        inputs: usize,
        /// What it takes `[byte]`.
        outputs: usize,
    },
    /// Drives that do not follow though they are cycled.
    #[error("not every drive reaches operation")]
    NotOperational,
    /// The system gives no memory or no thread.
    #[error("no thread to carry frames: {0}")]
    Thread(std::io::Error),
    /// The memory for frames is in use: ethercrab wants it for itself.
    #[error("no memory for frames")]
    Memory,
}

impl From<Error> for MasterError {
    fn from(error: Error) -> Self {
        Self::Bus(error)
    }
}

/// Drives in operation on an `EtherCAT`.
pub struct EtherCat {
    main: MainDevice<'static>,
    group: SubDeviceGroup<MOST, IMAGE, DefaultLock, Op>,
}

impl EtherCat {
    /// Brings `n` drives to operation. `carry` runs in a thread of its own and takes frames to the bus and back, as
    /// [`ethercrab::std::tx_rx_task`] does; a frame that is not back within `patience` is lost.
    ///
    /// # Errors
    /// Not `n` devices, or one that is no drive of the profile, refuses what it is told, or does not follow.
    pub fn try_new<F>(carry: F, n: usize, patience: Duration) -> Result<Self, MasterError>
    where
        F: FnOnce(PduTx<'static>, PduRx<'static>) + Send + 'static,
    {
        // Once in the life of the process: a bus that is lost for good ends the driver, and whoever watches it starts it anew.
        let storage: &'static PduStorage<FRAMES, FRAME_BYTES> = Box::leak(Box::new(PduStorage::new()));
        let (tx, rx, pdus) = storage.try_split().map_err(|()| MasterError::Memory)?;
        thread::Builder::new().name("frames".to_string()).spawn(move || carry(tx, rx)).map_err(MasterError::Thread)?;
        let main = MainDevice::new(pdus, Timeouts { pdu: patience, ..Timeouts::default() }, MainDeviceConfig::default());
        let group = block_on(brought_up(&main, n))?;
        let mut master = Self { main, group };
        master.check_lengths()?;
        // Without torque or voltage, until all of them follow.
        let (outputs, mut inputs) = (vec![[0; OUTPUT_BYTES]; n], vec![[0; INPUT_BYTES]; n]);
        let is_up = (0..CYCLES_TO_OPERATION).any(|_| master.cycle(&outputs, &mut inputs).is_some_and(|turn| turn.is_operational));
        if is_up { Ok(master) } else { Err(MasterError::NotOperational) }
    }

    fn check_lengths(&self) -> Result<(), MasterError> {
        for (place, drive) in self.group.iter(&self.main).enumerate() {
            let (inputs, outputs) = (drive.inputs_raw().len(), drive.outputs_raw().len());
            if (inputs, outputs) != (INPUT_BYTES, OUTPUT_BYTES) {
                return Err(MasterError::Lengths { place, name: drive.name().to_string(), inputs, outputs });
            }
        }
        Ok(())
    }
}

// ANCHOR: up
/// Finds the drives, says what they shall exchange, and asks them to follow.
async fn brought_up(main: &MainDevice<'static>, n: usize) -> Result<SubDeviceGroup<MOST, IMAGE, DefaultLock, Op>, MasterError> {
    let group: SubDeviceGroup<MOST, IMAGE, DefaultLock, PreOp> = main.init_single_group::<MOST, IMAGE>(ethercat_now).await?;
    if group.len() != n {
        return Err(MasterError::Count { found: group.len(), expected: n });
    }
    for (place, drive) in group.iter(main).enumerate() {
        let found = drive.sdo_read::<u32>(0x1000, 0).await? & 0xffff;
        if found != 402 {
            return Err(MasterError::Profile { place, name: drive.name().to_string(), found });
        }
        exchange(&drive, [0x1c12, 0x1600], &OUTPUTS).await?;
        exchange(&drive, [0x1c13, 0x1a00], &INPUTS).await?;
        drive.sdo_write(0x6060, 0, TORQUE_MODE).await?;
    }
    // Not `into_op`: it waits for drives that wait for process data.
    Ok(group.into_safe_op(main).await?.request_into_op(main).await?)
}

/// Tells a drive to exchange these objects: they are listed in the one object, and the other says that this list counts.
async fn exchange(drive: &SubDeviceRef<'_, &SubDevice>, [assignment, list]: [u16; 2], entries: &[Entry]) -> Result<(), Error> {
    // A list that counts cannot be changed.
    drive.sdo_write(assignment, 0, 0_u8).await?;
    drive.sdo_write(list, 0, 0_u8).await?;
    for ((index, bits), place) in entries.iter().zip(1_u8..) {
        drive.sdo_write(list, place, u32::from(*index) << 16 | u32::from(*bits)).await?;
    }
    drive.sdo_write(list, 0, u8::try_from(entries.len()).unwrap_or(0)).await?;
    drive.sdo_write(assignment, 1, list).await?;
    drive.sdo_write(assignment, 0, 1_u8).await
}
// ANCHOR_END

// ANCHOR: cycle
impl Master for EtherCat {
    fn cycle(&mut self, outputs: &[[u8; OUTPUT_BYTES]], inputs: &mut [[u8; INPUT_BYTES]]) -> Option<Turn> {
        for (k, bytes) in outputs.iter().enumerate() {
            self.group.subdevice(&self.main, k).ok()?.outputs_raw_mut().get_mut(..OUTPUT_BYTES)?.copy_from_slice(bytes);
        }
        // The library waits for no longer than it was told; this is the driver's thread, not the daemon's loop.
        let turn = block_on(self.group.tx_rx(&self.main)).ok()?;
        for (k, bytes) in inputs.iter_mut().enumerate() {
            bytes.copy_from_slice(self.group.subdevice(&self.main, k).ok()?.inputs_raw().get(..INPUT_BYTES)?);
        }
        Some(Turn { working_counter: turn.working_counter, is_operational: turn.all_op() })
    }
}
// ANCHOR_END
