//! Axes: a range and round numbers in it.

use pkm_dyn::math::{log10, powf};

use crate::format::{fixed, short, significant};

/// The range of one direction of a plot, with its ticks.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Axis {
    /// Value at the lower end.
    pub(crate) lower: f64,
    /// Value at the upper end.
    pub(crate) upper: f64,
    /// Distance between ticks.
    step: f64,
    /// What lies along the axis: the values themselves or their decimal logarithms, in which the ends and the step are then counted.
    scale: Scale,
}

/// How values lie along an axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Scale {
    /// In proportion.
    Linear,
    /// By decades; what is not positive has no place.
    Log,
}

/// Most ticks of a logarithmic axis.
const DECADES_MAX: f64 = 8.0;

/// The round step (1, 2 or 5 times a power of ten) that puts `n` ticks into `span` most closely.
fn nice_step(span: f64, n: f64) -> f64 {
    let raw = span / n;
    let decade = powf(10.0, log10(raw).floor());
    match raw / decade {
        m if m <= 1.41 => decade,
        m if m <= 3.16 => 2.0 * decade,
        m if m <= 7.07 => 5.0 * decade,
        _ => 10.0 * decade,
    }
}

impl Axis {
    /// Axis over the finite `values`, widened by the share `pad` on both sides, with about `n` ticks; none without a finite value.
    pub(crate) fn over(values: impl Iterator<Item = f64>, pad: f64, n: f64) -> Option<Self> {
        let (lower, upper) =
            values.filter(|v| v.is_finite()).fold((f64::INFINITY, f64::NEG_INFINITY), |(lower, upper), v| (lower.min(v), upper.max(v)));
        if lower > upper {
            return None;
        }
        // A constant still needs room around it, and a span below rounding has no ticks of its own.
        let magnitude = lower.abs().max(upper.abs());
        let (lower, upper) = match upper - lower {
            span if span > 1.0e-9 * magnitude => (lower - pad * span, upper + pad * span),
            _ if magnitude > 0.0 => (lower - 0.1 * magnitude, upper + 0.1 * magnitude),
            _ => (-1.0, 1.0),
        };
        let step = nice_step(upper - lower, n);
        (step.is_finite() && step > 0.0).then_some(Self { lower, upper, step, scale: Scale::Linear })
    }

    /// Axis over the positive finite `values` by decades; none without one.
    pub(crate) fn decades(values: impl Iterator<Item = f64>) -> Option<Self> {
        let logs = values.filter(|v| *v > 0.0 && v.is_finite()).map(log10);
        let (lower, upper) = logs.fold((f64::INFINITY, f64::NEG_INFINITY), |(lower, upper), v| (lower.min(v), upper.max(v)));
        if lower > upper {
            return None;
        }
        // At least one decade, so that there is a tick to read.
        let (lower, upper) = if upper - lower < 1.0 { (lower.floor(), (lower.floor() + 1.0).max(upper)) } else { (lower, upper) };
        let step = ((upper - lower) / DECADES_MAX).ceil().max(1.0);
        Some(Self { lower, upper, step, scale: Scale::Log })
    }

    /// Axis from `lower` to `upper` exactly; none unless both are finite and in order.
    pub(crate) fn between(lower: f64, upper: f64, n: f64) -> Option<Self> {
        let step = nice_step(upper - lower, n);
        (lower < upper && step.is_finite() && step > 0.0).then_some(Self { lower, upper, step, scale: Scale::Linear })
    }

    /// Position of `value` along the axis, 0 at the lower and 1 at the upper end.
    pub(crate) fn fraction(&self, value: f64) -> f64 {
        let along = match self.scale {
            Scale::Linear => value,
            Scale::Log if value > 0.0 => log10(value),
            Scale::Log => f64::NAN,
        };
        (along - self.lower) / (self.upper - self.lower)
    }

    /// Round numbers inside the range.
    pub(crate) fn ticks(&self) -> Vec<f64> {
        let first = (self.lower / self.step).ceil();
        // A recording of 19.998 s still shows its 20.
        let slack = 2.0e-3 * (self.upper - self.lower);
        let ticks = (0..32).map(|i| (first + f64::from(i)) * self.step).take_while(|t| *t <= self.upper + slack);
        match self.scale {
            Scale::Linear => ticks.collect(),
            Scale::Log => ticks.map(|t| powf(10.0, t)).collect(),
        }
    }

    /// A tick as text, with the decimals the step asks for.
    pub(crate) fn label(&self, tick: f64) -> String {
        if self.scale == Scale::Log {
            return if (1.0e-3..1.0e5).contains(&tick) { short(tick) } else { significant(tick, 1) };
        }
        let magnitude = self.lower.abs().max(self.upper.abs());
        if !(1.0e-4..1.0e10).contains(&magnitude) {
            return if tick.abs() < 0.5 * self.step { "0".to_owned() } else { significant(tick, 2) };
        }
        let decimals = (0..9).find(|d| powf(10.0, f64::from(-d)) <= self.step * 1.000_001).unwrap_or(9);
        fixed(tick, decimals)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn labels(lower: f64, upper: f64) -> Vec<String> {
        let axis = Axis::over([lower, upper].into_iter(), 0.0, 5.0).unwrap();
        axis.ticks().into_iter().map(|t| axis.label(t)).collect()
    }

    #[test]
    fn ticks_are_round_numbers() {
        assert_eq!(labels(0.0, 20.0), ["0", "5", "10", "15", "20"]);
        assert_eq!(labels(-0.13, 0.13), ["-0.10", "-0.05", "0.00", "0.05", "0.10"]);
        assert_eq!(labels(0.0, 1.0), ["0.0", "0.2", "0.4", "0.6", "0.8", "1.0"]);
        assert_eq!(labels(-300.0, 420.0), ["-200", "0", "200", "400"]);
        assert_eq!(labels(0.0, 4.0e-6), ["0", "1.0e-6", "2.0e-6", "3.0e-6", "4.0e-6"]);
    }

    #[test]
    fn decades_are_ticks_of_a_logarithmic_axis() {
        let axis = Axis::decades([0.05, 3.0e3, -1.0, 0.0, f64::INFINITY].into_iter()).unwrap();
        assert_eq!(axis.ticks().into_iter().map(|t| axis.label(t)).collect::<Vec<_>>(), ["0.1", "1", "10", "100", "1000"]);
        assert!((axis.fraction(0.05)).abs() < 1e-12 && (axis.fraction(3.0e3) - 1.0).abs() < 1e-12);
        assert!(axis.fraction(0.0).is_nan() && Axis::decades([0.0].into_iter()).is_none());
        assert!(Axis::decades([1e-200, 1e200].into_iter()).unwrap().ticks().len() <= 9);
        assert!(!Axis::decades([2.0, 3.0].into_iter()).unwrap().ticks().is_empty());
    }

    #[test]
    fn degenerate_ranges_have_an_axis_or_none() {
        assert!(Axis::over([f64::NAN].into_iter(), 0.0, 5.0).is_none());
        assert!(Axis::over([-f64::MAX, f64::MAX].into_iter(), 0.05, 5.0).is_none());
        for v in [0.0, 7.0, -1.0e-300, 1.0e12] {
            if let Some(axis) = Axis::over([v].into_iter(), 0.05, 5.0) {
                assert!(axis.lower < axis.upper && axis.fraction(v).is_finite() && axis.ticks().len() < 32, "{v}");
            }
        }
    }
}
