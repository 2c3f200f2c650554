//! How late one channel is against another.

/// By how much one signal lags another.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Offset {
    /// `b(t) ≈ a(t − seconds)`: positive when `b` is late `[s]`.
    pub seconds: f64,
    /// Correlation of the two at that lag, −1 to 1.
    pub correlation: f64,
    /// Whether the best lag lies inside the range that was searched.
    pub is_inside: bool,
}

/// Lag of `b` behind `a`, both uniform at `dt` `[s]`, to `most` `[s]` to either side: the peak of the cross-correlation, refined by a
/// parabola through its neighbours. `None` for signals that are constant, or shorter than four times the range.
#[must_use]
pub fn time_offset(a: &[f64], b: &[f64], dt: f64, most: f64) -> Option<Offset> {
    let n = a.len().min(b.len());
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a positive ratio, compared with the length below")]
    let reach = (most / dt).ceil().clamp(1.0, 1e9) as usize;
    if n < 4 * reach {
        return None;
    }
    // The middle of `a` against windows of `b`: as many pairs at every lag.
    let middle = &a[reach..n - reach];
    let correlation = |lag: usize| {
        let window = &b[lag..lag + middle.len()];
        let mean = |x: &[f64]| x.iter().sum::<f64>() / x.len() as f64;
        let (ma, mb) = (mean(middle), mean(window));
        let (mut ab, mut aa, mut bb) = (0.0, 0.0, 0.0);
        for (x, y) in middle.iter().zip(window) {
            ab += (x - ma) * (y - mb);
            aa += (x - ma) * (x - ma);
            bb += (y - mb) * (y - mb);
        }
        if aa > 0.0 && bb > 0.0 { ab / (aa * bb).sqrt() } else { 0.0 }
    };
    let all: Vec<f64> = (0..=2 * reach).map(correlation).collect();
    let (best, top) = all.iter().enumerate().max_by(|x, y| x.1.total_cmp(y.1))?;
    if *top <= 0.0 {
        return None;
    }
    let is_inside = best > 0 && best < 2 * reach;
    let bend = if is_inside { all[best - 1] - 2.0 * top + all[best + 1] } else { 0.0 };
    let part = if bend < 0.0 { 0.5 * (all[best - 1] - all[best + 1]) / bend } else { 0.0 };
    Some(Offset { seconds: (best as f64 - reach as f64 + part) * dt, correlation: *top, is_inside })
}

/// The lowest point of a function of one bounded variable, by golden sections; `tolerance` is that of the variable.
pub(crate) fn lowest(mut f: impl FnMut(f64) -> f64, [mut a, mut b]: [f64; 2], tolerance: f64) -> f64 {
    let ratio = 0.5 * (5.0_f64.sqrt() - 1.0);
    let (mut c, mut d) = (b - ratio * (b - a), a + ratio * (b - a));
    let (mut fc, mut fd) = (f(c), f(d));
    while b - a > tolerance {
        if fc < fd {
            (b, d, fd) = (d, c, fc);
            c = b - ratio * (b - a);
            fc = f(c);
        } else {
            (a, c, fc) = (c, d, fd);
            d = a + ratio * (b - a);
            fd = f(d);
        }
    }
    0.5 * (a + b)
}

#[cfg(test)]
mod tests {
    use super::*;
    use pkm_dyn::math;

    #[test]
    fn a_known_lag_is_found_to_a_fraction_of_a_sample() {
        let signal = |t: f64| math::sin(7.0 * t) + 0.5 * math::sin(17.3 * t + 1.0) + 0.2 * math::cos(31.0 * t);
        let a: Vec<f64> = (0..2000).map(|i| signal(0.005 * f64::from(i))).collect();
        for late in [0.0, 0.0123, -0.0371] {
            let b: Vec<f64> = (0..2000).map(|i| -3.0 + 2.0 * signal(0.005 * f64::from(i) - late)).collect();
            let found = time_offset(&a, &b, 0.005, 0.1).unwrap();
            assert!((found.seconds - late).abs() < 3e-4 && found.correlation > 0.999 && found.is_inside, "{late}: {found:?}");
        }
        assert!(time_offset(&a, &[1.0; 2000], 0.005, 0.1).is_none());
        assert!((lowest(|x| (x - 0.3) * (x - 0.3), [-1.0, 1.0], 1e-6) - 0.3).abs() < 1e-6);
    }
}
