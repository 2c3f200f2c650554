//! What passes between a loop and its robot: frames of fixed layout, SI units, plain numbers only.
//!
//! A frame is made of 64-bit words and pairs of 32-bit words, so `repr(C)` leaves no gap in it: two programs that share memory, or a
//! recorder, see the same bytes. Layout is a constant; both ends compare it before they believe a number.

mod codes;

use crate::backend::HalError;
use crate::checksum::crc32;

pub use codes::{Mode, Signal, status};

/// Most axes a frame has room for.
pub const MAX_AXES: usize = 16;

/// Most further sensors a frame has room for.
pub const MAX_SENSORS: usize = 16;

/// Raised when the meaning of a field changes and its name does not.
pub(crate) const VERSION: u64 = 1;

/// A field of a frame as little-endian bytes.
pub(crate) trait Word: Copy {
    fn put(self, out: &mut [u8]);
    fn take(bytes: &[u8]) -> Self;
}

impl Word for u64 {
    fn put(self, out: &mut [u8]) {
        out.copy_from_slice(&self.to_le_bytes());
    }

    fn take(bytes: &[u8]) -> Self {
        bytes.iter().rev().fold(0, |word, byte| word << 8 | Self::from(*byte))
    }
}

impl Word for u32 {
    fn put(self, out: &mut [u8]) {
        out.copy_from_slice(&self.to_le_bytes());
    }

    fn take(bytes: &[u8]) -> Self {
        bytes.iter().rev().fold(0, |word, byte| word << 8 | Self::from(*byte))
    }
}

impl<const N: usize> Word for [f64; N] {
    fn put(self, out: &mut [u8]) {
        for (x, bytes) in self.iter().zip(out.chunks_exact_mut(8)) {
            x.to_bits().put(bytes);
        }
    }

    fn take(bytes: &[u8]) -> Self {
        let mut out = [0.0; N];
        for (x, bytes) in out.iter_mut().zip(bytes.chunks_exact(8)) {
            *x = f64::from_bits(u64::take(bytes));
        }
        out
    }
}

/// A struct of words, its layout, and its bytes, from one list of fields; `$inside` are layouts of frames among the fields.
macro_rules! words {
    ($(#[$meta:meta])* $name:ident [$inside:expr] { $($(#[$about:meta])* $field:ident: $type:ty, $unit:literal;)* }) => {
        $(#[$meta])*
        #[repr(C)]
        #[derive(Debug, Clone, Copy, PartialEq)]
        pub struct $name {
            $($(#[$about])* pub $field: $type,)*
        }

        impl $name {
            /// Names, types and units of the fields, in order.
            pub const FIELDS: &'static str =
                concat!(stringify!($name), $("; ", stringify!($field), ": ", stringify!($type), " [", $unit, "]"),*);

            /// Hash of [`Self::FIELDS`], of the room for axes and sensors, and of the contract's version.
            pub const LAYOUT: u64 = $crate::checksum::fnv1a(
                $crate::checksum::FNV_START
                    ^ $inside
                    ^ (($crate::frame::MAX_AXES as u64) << 32 | ($crate::frame::MAX_SENSORS as u64) << 16 | $crate::frame::VERSION),
                Self::FIELDS,
            );

            /// Length in bytes.
            pub const BYTES: usize = 0 $(+ size_of::<$type>())*;

            /// It as little-endian bytes, in the order of its fields.
            #[must_use]
            pub fn to_bytes(&self) -> [u8; Self::BYTES] {
                let mut out = [0; Self::BYTES];
                let mut at = 0;
                $(
                    $crate::frame::Word::put(self.$field, &mut out[at..at + size_of::<$type>()]);
                    at += size_of::<$type>();
                )*
                debug_assert_eq!(at, Self::BYTES);
                out
            }

            /// What these bytes say, believed as they are; a frame is to be checked next.
            #[must_use]
            pub fn from_bytes(bytes: &[u8; Self::BYTES]) -> Self {
                let mut at = 0;
                let mut next = |length: usize| {
                    at += length;
                    &bytes[at - length..at]
                };
                Self { $($field: <$type as $crate::frame::Word>::take(next(size_of::<$type>())),)* }
            }
        }

        impl $crate::frame::Word for $name {
            fn put(self, out: &mut [u8]) {
                out.copy_from_slice(&self.to_bytes());
            }

            fn take(bytes: &[u8]) -> Self {
                let mut whole = [0; Self::BYTES];
                whole.copy_from_slice(bytes);
                Self::from_bytes(&whole)
            }
        }

        // No gaps: what is in memory is what `to_bytes` writes.
        const _: () = assert!(size_of::<$name>() == $name::BYTES);
    };
}

pub(crate) use words;

/// The checksum of a frame, which is its last word.
macro_rules! sealed {
    ($name:ident) => {
        impl $name {
            /// The frame with the checksum of its contents.
            #[must_use]
            pub fn sealed(mut self) -> Self {
                self.checksum = self.expected_checksum();
                self
            }

            /// CRC-32 of all bytes but the checksum's own, which come last.
            fn expected_checksum(&self) -> u64 {
                u64::from(crc32(&self.to_bytes()[..Self::BYTES - 8]))
            }

            fn check_seal(&self) -> Result<(), HalError> {
                if self.layout != Self::LAYOUT {
                    return Err(HalError::Layout { found: self.layout, expected: Self::LAYOUT });
                }
                if self.checksum != self.expected_checksum() {
                    return Err(HalError::Checksum { sequence: self.sequence });
                }
                Ok(())
            }
        }
    };
}

sealed!(StateFrame);
sealed!(CommandFrame);

words! {
    /// What the robot reports: one sample of every signal at one moment.
    StateFrame [0] {
        /// [`Self::LAYOUT`] of the program that wrote it.
        layout: u64, "hash";
        /// Nonce of the session whose command was accepted last; 0 when none was.
        nonce: u64, "1";
        /// Number of the sample: one more for every one taken, lost ones included.
        sequence: u64, "1";
        /// When it was taken, on the monotonic clock `[ns]`.
        stamp_ns: u64, "ns";
        /// Sequence of the command that was accepted last; 0 when none was.
        command_sequence: u64, "1";
        /// Number of axes.
        n_axes: u32, "1";
        /// Number of further sensors.
        n_sensors: u32, "1";
        /// Bit `i`: `q[i]` was measured.
        valid_q: u32, "bits";
        /// Bit `i`: `v[i]` was measured.
        valid_v: u32, "bits";
        /// Bit `i`: `tau[i]` was measured.
        valid_tau: u32, "bits";
        /// Bit `i`: `sensor[i]` was measured.
        valid_sensor: u32, "bits";
        /// Bits of [`status`].
        status: u32, "bits";
        /// Bit `i`: drive `i` reports a fault.
        drive_fault: u32, "bits";
        /// Positions `[m | rad]`.
        q: [f64; MAX_AXES], "m | rad";
        /// Velocities `[m/s | rad/s]`.
        v: [f64; MAX_AXES], "m/s | rad/s";
        /// Efforts of the drives `[N | N·m]`.
        tau: [f64; MAX_AXES], "N | N.m";
        /// Further sensors: force cells and the like, each in its own SI unit.
        sensor: [f64; MAX_SENSORS], "SI";
        /// CRC-32 of everything before it.
        checksum: u64, "crc32";
    }
}

words! {
    /// What is asked of the robot until `valid_until_ns`, and not longer.
    CommandFrame [0] {
        /// [`Self::LAYOUT`] of the program that wrote it.
        layout: u64, "hash";
        /// Nonce of the session it belongs to.
        nonce: u64, "1";
        /// Number of the command: greater than that of any before it in its session.
        sequence: u64, "1";
        /// When it was written, on the monotonic clock `[ns]`.
        stamp_ns: u64, "ns";
        /// When it expires: after this moment the robot applies its safe action `[ns]`.
        valid_until_ns: u64, "ns";
        /// Sequence of the state it answers.
        state_sequence: u64, "1";
        /// Number of axes.
        n_axes: u32, "1";
        /// Code of a [`Mode`].
        mode: u32, "code";
        /// Efforts of the drives `[N | N·m]`.
        tau: [f64; MAX_AXES], "N | N.m";
        /// CRC-32 of everything before it.
        checksum: u64, "crc32";
    }
}

/// One bit for each of the first `n` places.
#[must_use]
pub const fn first_bits(n: usize) -> u32 {
    if n >= 32 { u32::MAX } else { (1 << n) - 1 }
}

impl StateFrame {
    /// A frame of `n_axes` axes and `n_sensors` sensors (at most [`MAX_AXES`] and [`MAX_SENSORS`]), all zero and nothing valid.
    #[must_use]
    pub const fn new(n_axes: usize, n_sensors: usize) -> Self {
        Self {
            layout: Self::LAYOUT,
            nonce: 0,
            sequence: 0,
            stamp_ns: 0,
            command_sequence: 0,
            n_axes: count(n_axes, MAX_AXES),
            n_sensors: count(n_sensors, MAX_SENSORS),
            valid_q: 0,
            valid_v: 0,
            valid_tau: 0,
            valid_sensor: 0,
            status: 0,
            drive_fault: 0,
            q: [0.0; MAX_AXES],
            v: [0.0; MAX_AXES],
            tau: [0.0; MAX_AXES],
            sensor: [0.0; MAX_SENSORS],
            checksum: 0,
        }
    }

    /// The values of a signal, room included.
    #[must_use]
    pub fn values(&self, signal: Signal) -> &[f64] {
        match signal {
            Signal::Position => &self.q,
            Signal::Velocity => &self.v,
            Signal::Effort => &self.tau,
            Signal::Sensor => &self.sensor,
        }
    }

    /// The same, to be changed.
    pub fn values_mut(&mut self, signal: Signal) -> &mut [f64] {
        match signal {
            Signal::Position => &mut self.q,
            Signal::Velocity => &mut self.v,
            Signal::Effort => &mut self.tau,
            Signal::Sensor => &mut self.sensor,
        }
    }

    /// Which values of a signal were measured, one bit each.
    #[must_use]
    pub const fn valid(&self, signal: Signal) -> u32 {
        match signal {
            Signal::Position => self.valid_q,
            Signal::Velocity => self.valid_v,
            Signal::Effort => self.valid_tau,
            Signal::Sensor => self.valid_sensor,
        }
    }

    /// The value of a signal at `i`, if it was measured.
    #[must_use]
    pub fn measured(&self, signal: Signal, i: usize) -> Option<f64> {
        let is_valid = i < 32 && self.valid(signal) >> i & 1 == 1;
        if is_valid { self.values(signal).get(i).copied() } else { None }
    }

    /// Whether the frame may be believed: layout, checksum, counts, and that every value said to be measured is a number.
    ///
    /// # Errors
    /// What is wrong, and where.
    pub fn check(&self) -> Result<(), HalError> {
        self.check_seal()?;
        let counts = [(self.n_axes, MAX_AXES), (self.n_sensors, MAX_SENSORS)];
        if let Some(&(found, most)) = counts.iter().find(|(found, most)| *found as usize > *most) {
            return Err(HalError::Axes { found, expected: count(most, most) });
        }
        for signal in Signal::ALL {
            let n = if signal == Signal::Sensor { self.n_sensors } else { self.n_axes };
            if self.valid(signal) & !first_bits(n as usize) != 0 {
                return Err(HalError::Axes { found: 32 - self.valid(signal).leading_zeros(), expected: n });
            }
            let not_finite = |i: &usize| self.measured(signal, *i).is_some_and(|x| !x.is_finite());
            if let Some(index) = (0..n as usize).find(not_finite) {
                return Err(HalError::NotFinite { signal: signal.name(), index });
            }
        }
        Ok(())
    }
}

impl CommandFrame {
    /// A command of `n_axes` axes (at most [`MAX_AXES`]) without efforts, already expired.
    #[must_use]
    pub const fn new(n_axes: usize, mode: Mode) -> Self {
        Self {
            layout: Self::LAYOUT,
            nonce: 0,
            sequence: 0,
            stamp_ns: 0,
            valid_until_ns: 0,
            state_sequence: 0,
            n_axes: count(n_axes, MAX_AXES),
            mode: mode.code(),
            tau: [0.0; MAX_AXES],
            checksum: 0,
        }
    }

    /// Whether the command may be believed by a robot of `n_axes` axes: layout, checksum, count, mode, efforts that are numbers.
    ///
    /// # Errors
    /// What is wrong, and where.
    pub fn check(&self, n_axes: usize) -> Result<Mode, HalError> {
        self.check_seal()?;
        if self.n_axes as usize != n_axes {
            return Err(HalError::Axes { found: self.n_axes, expected: count(n_axes, MAX_AXES) });
        }
        if let Some(index) = self.tau.iter().position(|x| !x.is_finite()) {
            return Err(HalError::NotFinite { signal: "tau", index });
        }
        Mode::of(self.mode).ok_or(HalError::Mode { code: self.mode })
    }
}

/// A count as it stands in a frame, no more than there is room for.
#[expect(clippy::cast_possible_truncation, reason = "at most the room of a frame")]
const fn count(n: usize, most: usize) -> u32 {
    if n < most { n as u32 } else { most as u32 }
}

#[cfg(test)]
mod tests;
