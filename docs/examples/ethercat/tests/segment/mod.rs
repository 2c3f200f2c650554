//! Drives on an `EtherCAT` made of numbers: frames in, frames out, by ETG.1000.4 (datagrams, registers, FMMUs, sync managers), ETG.1000.6
//! (mailbox, CAN application protocol, states) and ETG.2010 (what a device says of itself in its EEPROM). It knows nothing of the driver.

mod device;
mod sii;

use alloc::sync::Arc;
use core::future::poll_fn;
use core::task::Poll;
use std::sync::{Mutex, PoisonError};

use async_io::block_on;
use ethercrab::{PduRx, PduTx};

pub(crate) use device::Device;

/// Devices in a row, and the cable to them.
pub(crate) struct Segment {
    pub(crate) devices: Vec<Device>,
    pub(crate) is_cable_out: bool,
}

/// A segment that a test and the thread that carries frames share.
pub(crate) type Shared = Arc<Mutex<Segment>>;

/// `n` drives fresh from the box.
pub(crate) fn drives(n: usize) -> Shared {
    Arc::new(Mutex::new(Segment { devices: (0..n).map(|_| Device::new()).collect(), is_cable_out: false }))
}

/// Looks at a segment, or changes it.
pub(crate) fn with<T>(segment: &Shared, look: impl FnOnce(&mut Segment) -> T) -> T {
    look(&mut segment.lock().unwrap_or_else(PoisonError::into_inner))
}

/// What takes frames to a segment and back, in place of a network card.
pub(crate) fn carry(segment: &Shared) -> impl FnOnce(PduTx<'static>, PduRx<'static>) + Send + 'static {
    let segment = Arc::clone(segment);
    move |mut tx, mut rx| {
        block_on(poll_fn(|context| -> Poll<()> {
            tx.replace_waker(context.waker());
            while let Some(frame) = tx.next_sendable_frame() {
                let mut back = None;
                frame
                    .send_blocking(|bytes| {
                        back = with(&segment, |segment| segment.pass(bytes));
                        Ok(bytes.len())
                    })
                    .unwrap();
                if let Some(back) = back {
                    // A frame that was given up in the meantime is nobody's.
                    let _ = rx.receive_frame(&back);
                }
            }
            if tx.should_exit() { Poll::Ready(()) } else { Poll::Pending }
        }));
    }
}

/// Lengths of the heads of Ethernet, `EtherCAT` and a datagram.
const ETHERNET: usize = 14;
const ETHERCAT: usize = 2;
const DATAGRAM: usize = 10;

impl Segment {
    /// A frame through all devices and back; `None` where it does not come back.
    fn pass(&mut self, frame: &[u8]) -> Option<Vec<u8>> {
        if self.is_cable_out {
            return None;
        }
        assert_eq!(frame[12..14], [0x88, 0xa4], "EtherCAT's number among protocols");
        let mut frame = frame.to_vec();
        // The first device marks what it has seen.
        frame[6] |= 2;
        let length = usize::from(u16::from_le_bytes([frame[14], frame[15]]) & 0x07ff);
        let (mut at, end) = (ETHERNET + ETHERCAT, ETHERNET + ETHERCAT + length);
        while at < end {
            let size = usize::from(u16::from_le_bytes([frame[at + 6], frame[at + 7]]) & 0x07ff);
            let next = at + DATAGRAM + size + 2;
            for device in &mut self.devices {
                device.pass(&mut frame[at..next]);
            }
            at = next;
        }
        Some(frame)
    }
}
