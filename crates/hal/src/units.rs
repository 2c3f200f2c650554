//! Raw numbers of devices as types of their own, and how they become SI.

use crate::backend::HalError;

/// A position counter's reading.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default)]
pub struct EncoderTicks(pub i32);

/// What a tick of a counter is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EncoderScale {
    /// Width of a tick `[m | rad]`; negative when the counter runs against the axis.
    tick: f64,
    /// Position at count zero `[m | rad]`.
    zero: f64,
}

impl EncoderScale {
    /// Ticks of width `tick` and position `zero` at count zero, both `[m | rad]`.
    ///
    /// # Errors
    /// A width of zero, or a number that is none.
    pub const fn try_new(tick: f64, zero: f64) -> Result<Self, HalError> {
        if !tick.is_finite() || tick.abs() < f64::MIN_POSITIVE {
            return Err(HalError::Config { axis: 0, what: "width of a tick", value: tick, limit: "must be finite and not 0" });
        }
        if !zero.is_finite() {
            return Err(HalError::Config { axis: 0, what: "zero of the encoder", value: zero, limit: "must be finite" });
        }
        Ok(Self { tick, zero })
    }

    /// Width of a tick `[m | rad]`.
    #[must_use]
    pub const fn tick(&self) -> f64 {
        self.tick
    }
}

impl EncoderTicks {
    /// The position it stands for `[m | rad]`.
    #[must_use]
    pub fn position(self, scale: &EncoderScale) -> f64 {
        scale.zero + scale.tick * f64::from(self.0)
    }

    /// The nearest tick to a position `[m | rad]`; halves away from zero, at the end of the range the last one.
    #[must_use]
    pub fn of_position(q: f64, scale: &EncoderScale) -> Self {
        Self(nearest((q - scale.zero) / scale.tick))
    }

    /// Ticks passed since an `earlier` reading, across a wrap of the counter: right while less than half its range was passed.
    #[must_use]
    pub const fn since(self, earlier: Self) -> i32 {
        self.0.wrapping_sub(earlier.0)
    }
}

/// A counter of fewer bits than 64, followed across its wraps.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct UnwrappedTicks {
    bits: u32,
    last: u32,
    total: i64,
}

impl UnwrappedTicks {
    /// A counter of `bits` bits (1 to 32) that reads `first` and stands for as many ticks, taken as signed.
    #[must_use]
    pub const fn new(bits: u32, first: u32) -> Self {
        let bits = if bits == 0 { 1 } else { bits };
        let bits = if bits > 32 { 32 } else { bits };
        Self { bits, last: first, total: Self::signed(first, bits) }
    }

    /// The low `bits` of `x` as a signed number.
    const fn signed(x: u32, bits: u32) -> i64 {
        let shift = 32 - bits;
        ((x << shift).cast_signed() >> shift) as i64
    }

    /// Takes the next reading and returns the ticks in total; between two of them less than half the range may pass.
    pub const fn follow(&mut self, reading: u32) -> i64 {
        self.total = self.total.wrapping_add(Self::signed(reading.wrapping_sub(self.last), self.bits));
        self.last = reading;
        self.total
    }
}

/// What is written to a converter from numbers to volts or amperes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default)]
pub struct DacCode(pub u16);

/// What a converter makes of its codes: evenly from `low` at code 0 to `high` at the last.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DacScale {
    low: f64,
    high: f64,
    last: u16,
}

impl DacScale {
    /// A converter of `bits` bits whose codes run from `low` to `high`, in the unit of what it drives.
    ///
    /// # Errors
    /// No bits or more than 16, or ends that are no range.
    pub fn try_new(bits: u32, low: f64, high: f64) -> Result<Self, HalError> {
        if !(1..=16).contains(&bits) {
            return Err(HalError::Config { axis: 0, what: "bits of the converter", value: f64::from(bits), limit: "1 to 16" });
        }
        if !(low.is_finite() && high.is_finite() && low < high && (high - low).is_finite()) {
            return Err(HalError::Config {
                axis: 0,
                what: "upper end of the converter",
                value: high,
                limit: "finite, above the lower end",
            });
        }
        Ok(Self { low, high, last: u16::MAX >> (16 - bits) })
    }

    /// Width of a code.
    #[must_use]
    pub fn step(&self) -> f64 {
        (self.high - self.low) / f64::from(self.last)
    }

    /// The nearest code to `value`; at the ends of the range the last one, and zero for what is no number.
    #[must_use]
    pub fn code(&self, value: f64) -> DacCode {
        let code = nearest((if value.is_finite() { value } else { 0.0 } - self.low) / self.step());
        DacCode(u16::try_from(code.clamp(0, i32::from(self.last))).unwrap_or(0))
    }

    /// What it makes of `code`.
    #[must_use]
    pub fn value(&self, code: DacCode) -> f64 {
        // Exact at both ends.
        let share = f64::from(code.0.min(self.last)) / f64::from(self.last);
        self.low * (1.0 - share) + self.high * share
    }
}

/// The nearest whole number, halves away from zero; 0 for what is no number. `core` has no rounding of its own.
#[expect(clippy::cast_possible_truncation, reason = "a cast from floating point stops at the ends of the range")]
fn nearest(x: f64) -> i32 {
    let whole = x as i32;
    let rest = x - f64::from(whole);
    if rest >= 0.5 {
        whole.saturating_add(1)
    } else if rest <= -0.5 {
        whole.saturating_sub(1)
    } else {
        whole
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_and_positions_convert_both_ways() {
        let scale = EncoderScale::try_new(-1e-5, 0.25).unwrap();
        for ticks in [i32::MIN, -7, 0, 12_345, i32::MAX] {
            assert_eq!(EncoderTicks::of_position(EncoderTicks(ticks).position(&scale), &scale), EncoderTicks(ticks));
        }
        assert!((EncoderTicks(100).position(&scale) - 0.249).abs() < 1e-15);
        assert_eq!(EncoderTicks::of_position(f64::NAN, &scale), EncoderTicks(0));
        assert_eq!(EncoderTicks::of_position(-f64::INFINITY, &scale), EncoderTicks(i32::MAX));
        assert!(EncoderScale::try_new(0.0, 0.0).is_err() && EncoderScale::try_new(1.0, f64::NAN).is_err());
    }

    #[test]
    fn a_counter_that_wraps_goes_on() {
        assert_eq!(EncoderTicks(i32::MIN + 2).since(EncoderTicks(i32::MAX - 2)), 5);
        let mut ticks = UnwrappedTicks::new(16, 0xFFFE);
        let totals = [0xFFFF, 0x0003, 0x7000, 0xE000, 0x5000].map(|reading| ticks.follow(reading));
        assert_eq!(totals, [-1, 3, 0x7000, 0xE000, 0x15000]);
        assert_eq!(ticks.follow(0x3000), 0x13000);
    }

    #[test]
    fn a_code_is_the_nearest_and_ends_are_exact() {
        let scale = DacScale::try_new(12, -10.0, 10.0).unwrap();
        assert_eq!((scale.code(-11.0), scale.code(10.0), scale.code(1e300)), (DacCode(0), DacCode(4095), DacCode(4095)));
        assert_eq!((scale.value(DacCode(0)).to_bits(), scale.value(DacCode(4095)).to_bits()), ((-10.0_f64).to_bits(), 10.0_f64.to_bits()));
        for k in 0..1000 {
            let x = -10.0 + 0.02 * f64::from(k);
            assert!((scale.value(scale.code(x)) - x).abs() <= 0.5 * scale.step() + 1e-12);
        }
        assert_eq!(scale.code(f64::NAN), scale.code(0.0));
        assert!(DacScale::try_new(17, 0.0, 1.0).is_err() && DacScale::try_new(8, 1.0, 1.0).is_err());
    }
}
