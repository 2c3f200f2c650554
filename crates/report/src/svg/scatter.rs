//! Dots, and a curve where dots over one variable are one.

use super::{Frame, decimate};

/// Dots at the points; one path with round line ends, which stay round however the picture is stretched.
pub(crate) fn dots(frame: &Frame, points: impl Iterator<Item = (f64, f64)>, class: &str) -> String {
    let mut d = String::new();
    let mut previous = None;
    for (u, v) in points.filter_map(|(x, y)| frame.place(x, y)) {
        match previous {
            None => put!(d, "M{u} {v}h0"),
            Some((a, b)) => put!(d, "m{} {}h0", u - a, v - b),
        }
        previous = Some((u, v));
    }
    format!(r#"<path class="dots {class}" d="{d}"/>"#)
}

/// How often a curve may cross its own range before dots show it better.
const CROSSINGS_MAX: f64 = 6.0;

/// The samples in order of `x` when `y` is a function of it; none when it is not, as with hysteresis.
pub(crate) fn curve(x: &[f64], y: &[f64], n_max: usize) -> Option<Vec<(f64, f64)>> {
    let mut points: Vec<(f64, f64)> = x.iter().copied().zip(y.iter().copied()).filter(|(a, b)| a.is_finite() && b.is_finite()).collect();
    points.sort_by(|a, b| a.0.total_cmp(&b.0));
    let (lower, upper) = points.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, u), p| (l.min(p.1), u.max(p.1)));
    let travel: f64 = points.windows(2).map(|w| (w[1].1 - w[0].1).abs()).sum();
    if points.len() < 8 || travel > CROSSINGS_MAX * (upper - lower) {
        return None;
    }
    let (x, y): (Vec<f64>, Vec<f64>) = points.into_iter().unzip();
    Some(decimate(&x, &y, n_max))
}

#[cfg(test)]
mod tests {
    use super::super::Axis;
    use super::*;

    #[test]
    fn dots_skip_what_is_no_number() {
        let axis = || Axis::over([0.0, 10.0].into_iter(), 0.0, 5.0).unwrap();
        let all = dots(&Frame { x: axis(), y: axis() }, [(1.0, 1.0), (f64::NAN, 2.0), (2.0, 2.0)].into_iter(), "c");
        assert_eq!(all.matches("h0").count(), 2);
        assert!(!all.contains("NaN"));
    }

    #[test]
    fn friction_is_a_curve_and_hysteresis_is_not() {
        let x: Vec<f64> = (0..500).map(|i| f64::from((i * 7) % 500) - 250.0).collect();
        let friction: Vec<f64> = x.iter().map(|v| v.signum() * 3.0).collect();
        assert!(curve(&x, &friction, 100).is_some_and(|c| c.windows(2).all(|w| w[0].0 <= w[1].0)));
        let hysteresis: Vec<f64> = (0..500).map(|i| if i % 2 == 0 { 1.0 } else { -1.0 }).collect();
        assert!(curve(&x, &hysteresis, 100).is_none());
    }
}
