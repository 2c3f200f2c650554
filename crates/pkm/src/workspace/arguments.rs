//! Words of the command line: `x=-0.2:0.2:41`, `ry=5deg`, `leg1=38`.

use core::str::FromStr;

/// More values on one axis than any picture shows.
const MAX_VALUES: usize = 2000;

/// `AXIS=FROM:TO:N`.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Range {
    pub(crate) name: String,
    pub(crate) values: Vec<f64>,
}

/// `NAME=VALUE`.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Value {
    pub(crate) name: String,
    pub(crate) value: f64,
}

/// `DEG` or `NAME=DEG`; the angle in rad.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Cone {
    pub(crate) name: Option<String>,
    pub(crate) angle: f64,
}

fn number(text: &str) -> Result<f64, String> {
    let (digits, factor) = match text {
        t if t.ends_with("deg") => (&t[..t.len() - 3], 1.0_f64.to_radians()),
        t if t.ends_with("mm") => (&t[..t.len() - 2], 1e-3),
        t => (t, 1.0),
    };
    let value: f64 = digits.parse().map_err(|_| format!("{text:?} is not a number (m or rad; `30deg` and `12mm` are understood)"))?;
    if value.is_finite() { Ok(value * factor) } else { Err(format!("{text:?} must be finite")) }
}

fn named(text: &str) -> Result<(String, &str), String> {
    let (name, rest) = text.split_once('=').ok_or_else(|| format!("{text:?} has no name before a `=`"))?;
    Ok((name.to_string(), rest))
}

impl FromStr for Range {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (name, rest) = named(text)?;
        let [from, to, n] = rest.split(':').collect::<Vec<_>>()[..] else {
            return Err(format!("{text:?} is not AXIS=FROM:TO:N"));
        };
        let (from, to) = (number(from)?, number(to)?);
        let n: usize = n.parse().map_err(|_| format!("{n:?} is not a number of values"))?;
        if !(1..=MAX_VALUES).contains(&n) || n == 1 && from.total_cmp(&to).is_ne() || n > 1 && from >= to {
            return Err(format!("{text:?}: FROM must be below TO, and N from 2 to {MAX_VALUES} (or FROM = TO and N = 1)"));
        }
        Ok(Self { name, values: spread(from, to, n) })
    }
}

/// `n` values at equal distances, both ends included.
pub(super) fn spread(from: f64, to: f64, n: usize) -> Vec<f64> {
    (0..n).map(|i| if i + 1 == n { to } else { from + (to - from) * i as f64 / (n - 1) as f64 }).collect()
}

impl FromStr for Value {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (name, rest) = named(text)?;
        Ok(Self { name, value: number(rest)? })
    }
}

impl FromStr for Cone {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (name, rest) = match named(text) {
            Ok((name, rest)) => (Some(name), rest),
            Err(_) => (None, text),
        };
        let degrees = number(rest.trim_end_matches("deg"))?;
        if (0.0..=180.0).contains(&degrees) {
            Ok(Self { name, angle: degrees.to_radians() })
        } else {
            Err(format!("{degrees} degrees (must be between 0 and 180)"))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranges_and_values_are_read() {
        assert_eq!("x=-0.2:0.2:3".parse(), Ok(Range { name: "x".to_string(), values: vec![-0.2, 0.0, 0.2] }));
        assert_eq!("z=500mm:0.7:2".parse(), Ok(Range { name: "z".to_string(), values: vec![0.5, 0.7] }));
        assert_eq!("q1=90deg".parse::<Value>().map(|v| v.value), Ok(core::f64::consts::FRAC_PI_2));
        assert_eq!("leg1=180".parse::<Cone>(), Ok(Cone { name: Some("leg1".to_string()), angle: core::f64::consts::PI }));
        assert_eq!("45deg".parse::<Cone>().map(|c| c.angle), Ok(core::f64::consts::FRAC_PI_4));
        for bad in ["x", "x=1:2", "x=1:0:5", "x=0:1:1", "x=0:nan:4", "x=0:1:9999999", "x=0:1:-1"] {
            assert!(bad.parse::<Range>().is_err(), "{bad}");
        }
        assert!("300".parse::<Cone>().is_err() && "x=inf".parse::<Value>().is_err());
    }
}
