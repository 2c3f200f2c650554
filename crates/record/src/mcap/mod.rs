//! MCAP, the native format: profile `ros2`, schemas `ros2msg`, messages in CDR, so that ROS 2 tools read it as it is.
//!
//! Reading never hands an unchecked length to anybody: `scan` walks the records and gives the mcap crate single chunks of checked size.

mod align;
mod bytes;
pub(crate) mod cdr;
pub(crate) mod columns;
mod read;
mod scan;
pub(crate) mod schema;
mod series;
mod write;

pub(crate) use read::{read, read_attachments, read_controls};
pub(crate) use write::write;

/// First and last bytes of every MCAP file.
pub(crate) const MAGIC: &[u8] = ::mcap::MAGIC;

/// Name of the metadata record that holds the recording's keys.
pub(crate) const RECORD: &str = "pkm";

/// Above this a time in nanoseconds has no exact `f64`.
const EXACT: u64 = 1 << 53;

/// A stamp `[ns]` as the recording's time `[s]`, the `f64` nearest to it.
fn seconds(stamp_ns: i64) -> f64 {
    if stamp_ns.unsigned_abs() <= EXACT {
        // One rounding only: 12.34 s comes back as the f64 that prints as 12.34.
        return stamp_ns as f64 / 1e9;
    }
    stamp_ns.div_euclid(1_000_000_000) as f64 + stamp_ns.rem_euclid(1_000_000_000) as f64 / 1e9
}

/// A time `[s]` as a stamp `[ns]`; none outside ±2³¹ s.
fn stamp_ns(t: f64) -> Option<i64> {
    const LIMIT: f64 = 2_147_483_648.0;
    if !(-LIMIT..LIMIT).contains(&t) {
        return None;
    }
    let whole = t.floor();
    #[expect(clippy::cast_possible_truncation, reason = "both are whole and within i64: |t| < 2^31 was checked")]
    let (sec, nanosec) = (whole as i64, ((t - whole) * 1e9).round() as i64);
    Some(sec * 1_000_000_000 + nanosec)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn decimal_times_come_back_to_the_bit() {
        for k in 0..200_000_u32 {
            for t in [f64::from(k) / 1000.0, -f64::from(k) / 1000.0, 1.7e9 + f64::from(k) / 1000.0] {
                let back = seconds(stamp_ns(t).unwrap());
                assert_eq!(back.to_bits(), (t + 0.0).to_bits(), "{t}");
            }
        }
    }

    #[test]
    fn times_beyond_a_stamp_have_none() {
        for t in [f64::NAN, f64::INFINITY, 2_147_483_648.0, -1e300] {
            assert_eq!(stamp_ns(t), None);
        }
    }
}
