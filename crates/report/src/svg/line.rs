//! Lines, thinned so that no extreme is lost.

use super::Frame;
use super::plot::whole;

/// At most `n_max` points of the line, keeping the smallest and largest value of every stretch and both ends.
pub(crate) fn decimate(x: &[f64], y: &[f64], n_max: usize) -> Vec<(f64, f64)> {
    let points: Vec<(f64, f64)> = x.iter().copied().zip(y.iter().copied()).collect();
    let n_max = n_max.max(4);
    if points.len() <= n_max {
        return points;
    }
    // Both ends, and two points of every stretch in between.
    let stretch = points.len().div_ceil((n_max - 2) / 2);
    let mut kept = Vec::with_capacity(n_max);
    kept.extend(points.first());
    for part in points.chunks(stretch) {
        let finite = || part.iter().enumerate().filter(|(_, p)| p.1.is_finite());
        let lowest = finite().min_by(|a, b| a.1.1.total_cmp(&b.1.1));
        let highest = finite().max_by(|a, b| a.1.1.total_cmp(&b.1.1));
        let (Some((i, low)), Some((k, high))) = (lowest, highest) else {
            // A gap stays a gap.
            kept.extend(part.first());
            continue;
        };
        kept.extend(if i <= k { [low, high] } else { [high, low] });
    }
    kept.extend(points.last());
    kept
}

/// A line through the points; what is no number interrupts it.
pub(crate) fn path(frame: &Frame, points: &[(f64, f64)], class: &str) -> String {
    let mut d = String::new();
    let mut previous: Option<(i32, i32)> = None;
    for (x, y) in points {
        let here = frame.place(*x, *y);
        match (previous, here) {
            (None, Some((u, v))) => put!(d, "M{u} {v}l0 0"),
            (Some((a, b)), Some((u, v))) if (a, b) != (u, v) => put!(d, " {} {}", u - a, v - b),
            _ => {}
        }
        previous = here;
    }
    format!(r#"<path class="line {class}" d="{d}"/>"#)
}

/// Shaded stretches of the horizontal axis, cut to its range.
pub(crate) fn spans(frame: &Frame, spans: &[[f64; 2]]) -> String {
    let mut out = String::new();
    for [start, end] in spans {
        let (a, b) = (frame.x.fraction(*start).clamp(0.0, 1.0), frame.x.fraction(*end).clamp(0.0, 1.0));
        if b > a {
            let u = whole(2000.0 * a);
            put!(out, r#"<rect class="span" x="{u}" y="0" width="{}" height="1000"/>"#, whole(2000.0 * b) - u);
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::super::Axis;
    use super::*;

    fn frame() -> Frame {
        let axis = || Axis::over([0.0, 10.0].into_iter(), 0.0, 5.0).unwrap();
        Frame { x: axis(), y: axis() }
    }

    #[test]
    fn decimation_keeps_extremes_and_ends() {
        let x: Vec<f64> = (0..20_000).map(f64::from).collect();
        let mut y: Vec<f64> = x.iter().map(|t| (t * 0.37) % 1.0).collect();
        (y[777], y[13_131]) = (50.0, -40.0);
        let kept = decimate(&x, &y, 1500);
        assert!(kept.len() <= 1500, "{}", kept.len());
        assert!(kept.contains(&(777.0, 50.0)) && kept.contains(&(13_131.0, -40.0)));
        assert_eq!((kept[0].0, kept[kept.len() - 1].0), (0.0, 19_999.0));
        assert!(kept.windows(2).all(|w| w[0].0 <= w[1].0), "time must not run backwards");
        assert_eq!(decimate(&x[..5], &y, 1500).len(), 5);
        assert!(decimate(&x, &vec![f64::NAN; 20_000], 100).len() <= 100);
    }

    #[test]
    fn what_is_no_number_interrupts_a_line() {
        let d = path(&frame(), &[(0.0, 0.0), (1.0, 1.0), (2.0, f64::NAN), (3.0, 1.0), (4.0, f64::INFINITY)], "c");
        assert_eq!(d.matches('M').count(), 2);
        assert!(!d.contains("NaN") && !d.contains("inf"));
    }

    #[test]
    fn spans_are_cut_to_the_axis() {
        let all = spans(&frame(), &[[-5.0, 5.0], [8.0, 99.0], [f64::NAN, 1.0], [20.0, 30.0]]);
        assert_eq!(all.matches("<rect").count(), 2);
        assert!(all.contains(r#"x="0" y="0" width="1000""#) && !all.contains("NaN"));
    }
}
