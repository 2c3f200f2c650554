//! A smooth force along the stroke that is no straight line: polynomials of the position.

use super::{Axis, Columns, Context, Family, Proposal, Reading, Shape, Source, View, local, stroke};

/// Highest power of the position that the law has.
const DEGREE: usize = 4;

/// Names of the law's coefficients, constant first.
const NAMES: [&str; DEGREE + 1] = ["c0", "c1", "c2", "c3", "c4"];

/// See the catalogue entry of the same name.
pub(super) struct Effect;

impl Columns for Effect {
    fn entry(&self) -> &'static pkm_dyn::effects::Entry {
        super::entry("cable_force")
    }

    fn family(&self) -> Family {
        Family::Structural
    }

    fn axis(&self) -> Axis {
        Axis::Position
    }

    fn propose(&self, ctx: &Context) -> Vec<Proposal> {
        let shapes = |k: usize| {
            let [middle, half] = stroke(ctx, k);
            let source = |n: usize| local(k, move |m, k| m.segment.q[k].iter().map(|q| chebyshev(n, (q - middle) / half)).collect());
            // From the parabola on: a straight line is a spring.
            let shape = |degree: usize| {
                let mut sources: Vec<Source> = vec![Source::Offset(k)];
                sources.extend((1..=degree).map(|n| if degree == 2 || n == degree { source(n) } else { Source::Again(n - 1) }));
                Shape::free(sources).with(vec![middle, half])
            };
            (2..=DEGREE).map(shape).collect()
        };
        super::that_travel(ctx).map(|k| Proposal::at_drive(ctx, k, shapes(k))).collect()
    }

    fn read(&self, view: &View) -> Reading {
        let [middle, half] = [view.shape[0], view.shape[1]];
        let c = in_powers(view.own, middle, half);
        Ok(NAMES.iter().copied().zip(c).take(view.own.len()).collect())
    }
}

/// Chebyshev's polynomials stay between −1 and 1 over the stroke and hardly resemble each other.
fn chebyshev(n: usize, x: f64) -> f64 {
    let (mut last, mut now) = (1.0, x);
    if n == 0 {
        return last;
    }
    for _ in 1..n {
        (last, now) = (now, 2.0 * x * now - last);
    }
    now
}

/// Coefficients of powers of `q` from those of Chebyshev polynomials of `(q − middle)/half`, both constant first.
fn in_powers(own: &[f64], middle: f64, half: f64) -> Vec<f64> {
    // Polynomials as lists of coefficients; x = (q − middle)/half.
    let times_x = |p: &[f64]| {
        let mut out = vec![0.0; p.len() + 1];
        for (i, c) in p.iter().enumerate() {
            out[i] -= c * middle / half;
            out[i + 1] += c / half;
        }
        out
    };
    let (mut last, mut now) = (vec![1.0], times_x(&[1.0]));
    let mut out = vec![0.0; own.len()];
    for c in own {
        last.iter().enumerate().for_each(|(i, p)| out[i] += c * p);
        let mut next = times_x(&now);
        next.iter_mut().for_each(|c| *c *= 2.0);
        next.iter_mut().zip(&last).for_each(|(n, l)| *n -= l);
        (last, now) = (now, next);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{Bench, series, view};

    #[test]
    fn chebyshev_of_a_cosine_is_the_cosine_of_the_multiple() {
        for n in 0..=DEGREE {
            for i in 0..20 {
                let angle = 0.1 * f64::from(i);
                let want = pkm_dyn::math::cos(n as f64 * angle);
                assert!((chebyshev(n, pkm_dyn::math::cos(angle)) - want).abs() < 1e-12);
            }
        }
    }

    #[test]
    fn columns_are_the_law_at_its_reading() {
        let bench = Bench::sine(0.2, 1.0);
        let shapes = bench.shapes(&Effect, 0);
        let (own, parabola) = ([0.7, -0.4, 0.9], &shapes[0]);
        let reading = Effect.read(&view(&bench.model, &own, &parabola.values)).expect("a cable may pull in any way");
        let values = bench.values("cable_force", &reading);
        let columns: Vec<Vec<f64>> = parabola.sources[1..].iter().map(|s| series(s, &bench.motion)).collect();
        for (i, (line, bend)) in columns[0].iter().zip(&columns[1]).enumerate() {
            let sum = own[0] + own[1] * line + own[2] * bend;
            assert!((sum - bench.effort("cable_force", &values, i)).abs() < 1e-9);
        }
    }
}
