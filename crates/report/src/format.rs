//! Numbers as a reader wants them: as many digits as they are worth, never `NaN` or `inf`.

use pkm_diagnose::verdict::Estimate;

/// Stands where a number is missing.
pub(crate) const MISSING: &str = "–";

/// Digits worth printing at most: beyond this a 95 % interval is a rounding artefact.
const DIGITS_MAX: i32 = 6;

/// Decimal exponent of `x` after rounding to `digits` significant digits; none for zero and for what is no number.
fn exponent(x: f64, digits: i32) -> Option<i32> {
    if !x.is_finite() || x == 0.0 {
        return None;
    }
    let decimals = usize::try_from(digits - 1).unwrap_or(0);
    format!("{x:.decimals$e}").split_once('e').and_then(|(_, e)| e.parse().ok())
}

/// `x` with `decimals` digits after the point (none below zero), without a negative zero.
pub(crate) fn fixed(x: f64, decimals: i32) -> String {
    if !x.is_finite() {
        return MISSING.to_owned();
    }
    let decimals = usize::try_from(decimals.min(12)).unwrap_or(0);
    let text = format!("{x:.decimals$}");
    if text.starts_with('-') && text.chars().all(|c| matches!(c, '-' | '0' | '.')) { text[1..].to_owned() } else { text }
}

/// `x` in scientific notation with `digits` significant digits.
fn scientific(x: f64, digits: i32) -> String {
    let decimals = usize::try_from(digits - 1).unwrap_or(0);
    if x.is_finite() { format!("{x:.decimals$e}") } else { MISSING.to_owned() }
}

/// Whether a number of this decimal exponent reads better in scientific notation.
const fn is_extreme(exponent: i32) -> bool {
    exponent < -3 || exponent >= 6
}

/// `x` with `digits` significant digits.
pub(crate) fn significant(x: f64, digits: i32) -> String {
    match exponent(x, digits) {
        None => fixed(x, 0),
        Some(e) if is_extreme(e) => scientific(x, digits),
        Some(e) => fixed(x, digits - 1 - e),
    }
}

/// A fraction as a percentage, e.g. `41.2 %`.
pub(crate) fn percent(fraction: f64) -> String {
    let value = 100.0 * fraction;
    if !value.is_finite() {
        return MISSING.to_owned();
    }
    let text = match value.abs() {
        a if a >= 99.95 => fixed(value, 0),
        a if a >= 0.995 => fixed(value, 1),
        _ => significant(value, 2),
    };
    format!("{text} %")
}

/// `x` with at most two significant digits and no trailing zeros, e.g. a p-value or a cut-off frequency.
pub(crate) fn short(x: f64) -> String {
    let text = significant(x, 2);
    if text.contains('.') && !text.contains('e') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text }
}

/// A probability as a whole percentage that never claims certainty.
pub(crate) fn confidence(p: f64) -> String {
    match p {
        p if !p.is_finite() => MISSING.to_owned(),
        p if p > 0.99 => "> 99 %".to_owned(),
        p if p < 0.01 => "< 1 %".to_owned(),
        p => format!("{} %", fixed(100.0 * p, 0)),
    }
}

/// An estimate and the ends of its interval, rounded alike.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Rounded {
    /// Best value.
    pub(crate) value: String,
    /// Lower end of the 95 % interval.
    pub(crate) lower: String,
    /// Upper end of the 95 % interval.
    pub(crate) upper: String,
}

/// Rounds an estimate to two significant digits of its interval's half-width, or one where that one says enough (3.5 and above).
pub(crate) fn rounded(estimate: &Estimate) -> Rounded {
    let [lower, upper] = estimate.ci95;
    let largest = [estimate.value, lower, upper].into_iter().filter(|x| x.is_finite()).fold(0.0, |a: f64, x| a.max(x.abs()));
    let of_value = exponent(largest, 3).unwrap_or(0);
    let half = 0.5 * (upper - lower);
    // Scaled so that 3.5 counts as the start of the next decade.
    let of_half = exponent(half * (10.0 / 3.5), 3).unwrap_or(of_value - 2);
    let digits = (of_value - of_half + 2).clamp(2, DIGITS_MAX);
    let show = |x: f64| if is_extreme(of_value) && x != 0.0 { scientific(x, digits) } else { fixed(x, digits - 1 - of_value) };
    Rounded { value: show(estimate.value), lower: show(lower), upper: show(upper) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn significant_digits_survive_rounding_up() {
        assert_eq!(significant(9.996, 3), "10.0");
        assert_eq!(significant(0.0123456, 3), "0.0123");
        assert_eq!(significant(21345.6, 3), "21346");
        assert_eq!(significant(3.14e-5, 2), "3.1e-5");
        assert_eq!(significant(-2.5e7, 2), "-2.5e7");
        assert_eq!(significant(0.0, 3), "0");
    }

    #[test]
    fn what_is_no_number_is_a_dash() {
        for x in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            assert_eq!(significant(x, 3), MISSING);
            assert_eq!(percent(x), MISSING);
            assert_eq!(confidence(x), MISSING);
            let all = rounded(&Estimate { value: x, ci95: [x, 1.0], unit: String::new() });
            assert_eq!(all.value, MISSING);
        }
    }

    #[test]
    fn percentages_read_well() {
        assert_eq!(percent(0.4123), "41.2 %");
        assert_eq!(percent(0.071), "7.1 %");
        assert_eq!(percent(0.00456), "0.46 %");
        assert_eq!(percent(2.5), "250 %");
        assert_eq!(percent(0.0), "0 %");
        assert_eq!([short(0.005), short(0.05), short(1.0)], ["0.005", "0.05", "1"]);
    }

    #[test]
    fn interval_sets_the_digits_of_the_value() {
        let show = |value, ci95| {
            let r = rounded(&Estimate { value, ci95, unit: String::new() });
            format!("{} {} {}", r.value, r.lower, r.upper)
        };
        assert_eq!(show(21.3456, [20.1234, 22.4321]), "21.3 20.1 22.4");
        assert_eq!(show(0.012341, [0.01231, 0.01238]), "0.01234 0.01231 0.01238");
        assert_eq!(show(1234.5, [1100.0, 1400.0]), "1234 1100 1400");
        assert_eq!(show(3.2e-6, [2.9e-6, 3.5e-6]), "3.20e-6 2.90e-6 3.50e-6");
        assert_eq!(show(5.0, [5.0, 5.0]), "5.000 5.000 5.000");
        assert_eq!(show(-0.0001, [-2.0, 2.0]), "0.0 -2.0 2.0");
    }
}
