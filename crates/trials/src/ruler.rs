//! The generator's own measure of size: how far an effect stands out of what the healthy robot leaves of its recordings anyway.
//!
//! The healthy robot is never matched to the last: friction sticks at reversals in a way that no nominal law has, encoders have steps that
//! are differentiated, and noise is not white. That floor, not the noise of the sensors alone, is what an effect must stand out of.

use nalgebra::{DMatrix, DVector};

/// Rows of one recording: a force per free coordinate each.
pub type Rows = Vec<DVector<f64>>;

/// What the nominal robot leaves of healthy recordings, and the columns that a refit can use, both per recording.
#[derive(Debug, Clone)]
pub struct Healthy {
    /// Residuals.
    pub left: Vec<Rows>,
    /// Columns, a matrix per row.
    pub basis: Vec<Vec<DMatrix<f64>>>,
}

/// Yardstick, and the directions that a refit takes away.
#[derive(Debug, Clone)]
pub struct Ruler {
    /// Root mean square of the floor beside the refit, per free coordinate: the weight of a row.
    pub noise: DVector<f64>,
    span: Span,
    /// Floors over `noise` as the nominal robot leaves them and beside a refit; those of the motion itself first.
    floors: Vec<[Vec<Rows>; 2]>,
}

/// How large a change is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Length {
    /// All of it over the spread of healthy floors along it.
    pub all: f64,
    /// What no refit takes of it over the spread of healthy floors along that.
    pub beside: f64,
    /// Root mean square of it over the floor's, at the coordinate where that is largest: of all of it, and of what no refit takes.
    pub over_floor: [f64; 2],
    /// Share of it that no refit takes.
    pub share: f64,
}

impl Ruler {
    /// From the healthy robot on the motion itself and on `others` of the same design.
    #[must_use]
    pub fn new(own: &Healthy, others: &[Healthy]) -> Self {
        let d = own.left.iter().flatten().next().map_or(0, DVector::len);
        // Coordinates differ in unit and in size: weights first from what a refit with roughly equal weights leaves.
        let mut noise = spread(&own.left, d);
        for _ in 0..2 {
            noise = spread(&Span::new(&own.basis, &noise).beside(&own.left), d);
        }
        let floor = |h: &Healthy| {
            let span = Span::new(&h.basis, &noise);
            [over(&h.left, &noise), over(&span.beside(&h.left), &noise)]
        };
        let floors = core::iter::once(own).chain(others).map(floor).collect();
        Self { span: Span::new(&own.basis, &noise), noise, floors }
    }

    /// Length of what an effect adds to the residuals.
    #[must_use]
    pub fn length(&self, column: &[Rows]) -> Length {
        let (all, beside) = (over(column, &self.noise), over(&self.span.beside(column), &self.noise));
        let [n_all, n_beside] = [&all, &beside].map(|c| norm(c));
        let along = |c: &[Rows], n: f64, kind: usize| if n > 0.0 { n / self.spread_along(c, n, kind) } else { 0.0 };
        let over_floor = [self.over_floor(&all, 0), self.over_floor(&beside, 1)];
        Length { all: along(&all, n_all, 0), beside: along(&beside, n_beside, 1), over_floor, share: n_beside / n_all.max(1e-300) }
    }

    /// Root mean square of a column over that of the motion's own floor, at the coordinate where it is largest.
    fn over_floor(&self, column: &[Rows], kind: usize) -> f64 {
        let d = self.noise.len();
        let floor = self.floors.first().map_or_else(|| DVector::from_element(d, 1e-12), |f| spread(&f[kind], d));
        spread(column, d).component_div(&floor).max()
    }

    /// Root mean square of healthy floors along a column of the length `n`.
    ///
    /// Every floor is shifted through every instant of its recording: that is its spectrum where the column has its own. A floor of the motion
    /// itself may lie along the column where it stands, as both follow the same reversals; what of that is beyond twice the spread is no
    /// chance and is added.
    fn spread_along(&self, column: &[Rows], n: f64, kind: usize) -> f64 {
        let mut square = 0.0;
        for floor in &self.floors {
            square += shifted(column, &floor[kind]) / (n * n * self.floors.len() as f64);
        }
        let locked = self.floors.first().map_or(0.0, |f| product(column, &f[kind]) / n);
        (square + (locked * locked - 4.0 * square).max(0.0)).sqrt().max(1e-300)
    }
}

/// What a refit can explain.
#[derive(Debug, Clone)]
struct Span {
    basis: Vec<Vec<DMatrix<f64>>>,
    noise: DVector<f64>,
    /// Inverse Gram matrix of the weighted basis over what is well determined.
    inverse: DMatrix<f64>,
}

impl Span {
    fn new(basis: &[Vec<DMatrix<f64>>], noise: &DVector<f64>) -> Self {
        let flat: Vec<DMatrix<f64>> = basis.iter().flatten().cloned().collect();
        Self { basis: basis.to_vec(), noise: noise.clone(), inverse: pseudo_inverse(&gram(&flat, noise)) }
    }

    /// What is left of rows once the basis has been fitted to them, weighted least squares.
    fn beside(&self, column: &[Rows]) -> Vec<Rows> {
        let mut right = DVector::zeros(self.inverse.nrows());
        for (y, b) in column.iter().flatten().zip(self.basis.iter().flatten()) {
            right += b.tr_mul(&y.component_div(&self.noise).component_div(&self.noise));
        }
        let fitted = &self.inverse * right;
        let rest = |(y, b): (&Rows, &Vec<DMatrix<f64>>)| y.iter().zip(b).map(|(y, b)| y - b * &fitted).collect();
        column.iter().zip(&self.basis).map(rest).collect()
    }
}

/// Sum of BᵀS⁻²B over rows.
#[must_use]
pub fn gram(basis: &[DMatrix<f64>], noise: &DVector<f64>) -> DMatrix<f64> {
    let n = basis.first().map_or(0, DMatrix::ncols);
    let mut out = DMatrix::zeros(n, n);
    for b in basis {
        let mut weighted = b.clone();
        weighted.row_iter_mut().zip(noise.iter()).for_each(|(mut r, s)| r /= *s);
        out += weighted.tr_mul(&weighted);
    }
    out
}

/// Inverse over the directions whose eigenvalue, columns scaled to one, is above 1e-7 of the largest.
fn pseudo_inverse(gram: &DMatrix<f64>) -> DMatrix<f64> {
    let n = gram.nrows();
    let scale = DVector::from_fn(n, |i, _| if gram[(i, i)] > 0.0 { 1.0 / gram[(i, i)].sqrt() } else { 0.0 });
    let scaled = DMatrix::from_fn(n, n, |i, j| gram[(i, j)] * scale[i] * scale[j]);
    let eigen = scaled.symmetric_eigen();
    let largest = eigen.eigenvalues.max();
    let mut out = DMatrix::zeros(n, n);
    for (value, vector) in eigen.eigenvalues.iter().zip(eigen.eigenvectors.column_iter()) {
        if *value > 1e-7 * largest {
            out += vector * vector.transpose() / *value;
        }
    }
    DMatrix::from_fn(n, n, |i, j| out[(i, j)] * scale[i] * scale[j])
}

/// Root mean square per coordinate.
fn spread(column: &[Rows], d: usize) -> DVector<f64> {
    let mut sum = DVector::zeros(d);
    let mut count = 0.0;
    for y in column.iter().flatten() {
        sum += y.component_mul(y);
        count += 1.0;
    }
    sum.map(|s: f64| (s / f64::max(count, 1.0)).sqrt().max(1e-12))
}

fn over(column: &[Rows], noise: &DVector<f64>) -> Vec<Rows> {
    column.iter().map(|rows| rows.iter().map(|y| y.component_div(noise)).collect()).collect()
}

fn product(a: &[Rows], b: &[Rows]) -> f64 {
    a.iter().flatten().zip(b.iter().flatten()).map(|(a, b)| a.dot(b)).sum()
}

fn norm(a: &[Rows]) -> f64 {
    product(a, a).sqrt()
}

/// Mean square of the product of a column and a floor that is turned round through all instants, every recording on its own.
fn shifted(column: &[Rows], floor: &[Rows]) -> f64 {
    // Recordings turn independently: the square of a sum of independent numbers.
    let (mut variance, mut mean) = (0.0, 0.0);
    for (a, b) in column.iter().zip(floor) {
        let n = a.len().min(b.len());
        let at = |shift: usize| (0..n).map(|i| a[i].dot(&b[(i + shift) % n])).sum::<f64>();
        let products: Vec<f64> = (0..n).map(at).collect();
        let middle = products.iter().sum::<f64>() / n.max(1) as f64;
        variance += products.iter().map(|p| (p - middle) * (p - middle)).sum::<f64>() / n.max(1) as f64;
        mean += middle;
    }
    variance + mean * mean
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::{cos, sin};
    use crate::random::Stream;

    const N: usize = 1200;

    /// One axis: a recording with the basis sin(0.1 i) and a floor that remembers `keep` of its last value, of spread `sigma`.
    fn healthy(seed: u64, sigma: f64, keep: f64) -> Healthy {
        let mut random = Stream::new(seed, 1, "floor");
        let mut x = 0.0;
        let mut next = || {
            x = keep * x + sigma * (1.0 - keep * keep).sqrt() * random.normal();
            x
        };
        (0..100).for_each(|_| {
            next();
        });
        let left = (0..N).map(|_| DVector::from_element(1, next())).collect();
        let basis = (0..N).map(|i| DMatrix::from_element(1, 1, sin(0.1 * i as f64))).collect();
        Healthy { left: vec![left], basis: vec![basis] }
    }

    fn ruler(sigma: f64, keep: f64) -> Ruler {
        let others: Vec<Healthy> = (2..22).map(|seed| healthy(seed, sigma, keep)).collect();
        Ruler::new(&healthy(1, sigma, keep), &others)
    }

    fn column(f: impl Fn(f64) -> f64) -> Vec<Rows> {
        vec![(0..N).map(|i| DVector::from_element(1, f(i as f64))).collect()]
    }

    /// A sweep over half of the frequencies: the spread along it is a mean over many lines of the spectrum.
    fn sweep(i: f64) -> f64 {
        cos(0.5 * i + 0.0006 * i * i)
    }

    #[test]
    fn in_white_noise_it_is_the_length_over_the_noise() {
        let l = ruler(2.0, 0.0).length(&column(|i| 3.0 * sweep(i)));
        // ‖C‖/σ = 3·√(N/2)/2, nothing of it in the span of the sine.
        let expected = 1.5 * (0.5 * N as f64).sqrt();
        assert!((l.beside / expected - 1.0).abs() < 0.05 && (l.all / expected - 1.0).abs() < 0.05, "{l:?} {expected}");
        assert!((l.share - 1.0).abs() < 1e-2, "{l:?}");
        // A sine of 3 has 3/√2, and the noise 2, which 1,200 of it show to 2 % (one sigma).
        assert!(l.over_floor.iter().all(|x| (x / (1.5 * 0.5_f64.sqrt()) - 1.0).abs() < 0.08), "{l:?}");
    }

    #[test]
    fn what_a_refit_takes_has_no_length_beside_it() {
        let l = ruler(2.0, 0.0).length(&column(|i| 3.0 * sin(0.1 * i) + 0.3 * sweep(i)));
        // The sine is taken, the sweep stays: one part in √(1 + 10²).
        assert!((l.share - 1.0 / 101.0_f64.sqrt()).abs() < 3e-3, "{l:?}");
        assert!((l.beside / (0.15 * (0.5 * N as f64).sqrt()) - 1.0).abs() < 0.06, "{l:?}");
    }

    #[test]
    fn a_floor_that_remembers_hides_what_is_slow_and_shows_what_is_fast() {
        let (sigma, keep) = (2.0, 0.8);
        let ruler = ruler(sigma, keep);
        for w in [0.05, 0.3, 1.5, 3.0] {
            let l = ruler.length(&column(|i| cos(w * i)));
            // Spectrum of a first-order autoregression of variance σ²: σ²(1 − φ²)/(1 − 2φ·cos ω + φ²).
            let density = sigma * sigma * (1.0 - keep * keep) / (1.0 - 2.0 * keep * cos(w) + keep * keep);
            let expected = (0.5 * N as f64 / density).sqrt();
            assert!((l.all / expected - 1.0).abs() < 0.3, "{w}: {l:?} {expected}");
        }
    }

    #[test]
    fn a_floor_that_keeps_time_with_the_effect_counts_in_full() {
        // A spike where the effect has its own: turned round it is met once in N instants, in place always.
        let spike = |i: f64| f64::from((i - 600.0).abs() < 3.0);
        let mut own = healthy(1, 1.0, 0.0);
        own.left[0].iter_mut().enumerate().for_each(|(i, y)| y[0] += 20.0 * spike(i as f64));
        let l = Ruler::new(&own, &[healthy(2, 1.0, 0.0)]).length(&column(|i| 10.0 * spike(i)));
        // Half as large as what the healthy robot does there itself.
        assert!((l.all - 0.5).abs() < 0.1, "{l:?}");
    }
}
