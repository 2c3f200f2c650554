//! Structured singular value of the proposed loop: over all frequencies in the neutral pose, at points over the orientations of the foot.

#![expect(non_snake_case, reason = "matrices carry the capital letters of the literature")]

use nalgebra::DMatrix;
use pkm_ctrl::design::margin::spectral_radius;
use pkm_ctrl::design::mu::{Block, Guarantee, Response, Settings, StateSpace, Structure, sweep, upper_bound};
use pkm_dyn::math;

use super::ankle::{DT, PROPOSED, structure, uncertain_loop};
use crate::chance::Chance;
use crate::error::PaperError;
use crate::refused::refused;
use crate::row::{Gate, Line, Plot, Row};

const WHAT: &str = "structured singular value";

/// Share by which the guaranteed bound may exceed the largest one at a point.
const SLACK: f64 = 1e-3;

/// Points of the first grid of frequencies.
const POINTS: usize = 40;

/// Perturbations drawn.
const DRAWN: usize = 300;

/// Frequencies `[rad/s]` and bounds that SLICOT's AB13MD gives for the same system.
const SLICOT: [(f64, f64); 5] =
    [(1.0, 0.101_278_580_1), (10.0, 0.057_000_101_9), (100.0, 0.004_551_620_1), (348.152, 0.735_997_190_3), (1000.0, 0.035_079_268_0)];

/// Frequencies `[rad/s]` and bounds of a simpler search: scalings of the blocks and of the three real numbers alone.
const SIMPLER: [(f64, f64); 3] = [(300.0, 0.0990), (405.0, 0.0860), (1500.0, 0.0483)];

/// Turns of the foot in flexion and inversion `[deg]`.
const FLEXION: [f64; 5] = [-40.0, -20.0, 0.0, 20.0, 40.0];
const INVERSION: [f64; 5] = [-30.0, -15.0, 0.0, 15.0, 30.0];

fn upper(system: &StateSpace, structure: &Structure, w: f64) -> Result<f64, PaperError> {
    let M = system.at(w).ok_or_else(|| PaperError::Other { what: WHAT, reason: format!("a pole at {w} rad/s") })?;
    Ok(upper_bound(&M, structure).map_err(refused(WHAT))?.certificate.beta)
}

/// Bounds at single frequencies.
fn point_rows(system: &StateSpace, structure: &Structure) -> Result<Vec<Row>, PaperError> {
    let mut rows = vec![
        Row::held_against("eq. 8.45", "mu as the frequency goes to zero", upper(system, structure, 1e-3)?, None, (Gate::Within(1e-4), 0.1))
            .because("the weight of the stiffness"),
    ];
    for (w, known) in SLICOT {
        let what = format!("upper bound of mu at {w} rad/s");
        let row = Row::held_against("Figure 8.15", what, upper(system, structure, w)?, None, (Gate::Within(1e-3 * known), known));
        rows.push(row.because("against SLICOT's AB13MD"));
    }
    for (w, known) in SIMPLER {
        let what = format!("upper bound of mu at {w} rad/s");
        let row = Row::new("Figure 8.15", what, upper(system, structure, w)?, None, Gate::AtMost(1.005 * known));
        rows.push(row.because("a bound of a simpler search stands above it"));
    }
    let (complex, full) = (Block::Complex { repeats: 1 }, Block::Full { rows: 3, cols: 3 });
    let as_complex = Structure::try_new(vec![complex, complex, complex, full, full]).map_err(refused(WHAT))?;
    let known = 0.781_188_833_1;
    let what = "the same at 348.152 rad/s with the inertias as complex numbers";
    let row = Row::held_against("Figure 8.15", what, upper(system, &as_complex, 348.152)?, None, (Gate::Within(1e-5 * known), known));
    rows.push(row.because("against SLICOT's AB13MD"));
    Ok(rows)
}

/// The whole range of frequencies.
fn range_rows(system: &StateSpace, structure: &Structure, progress: &mut dyn FnMut(f64)) -> Result<(Vec<Row>, Plot), PaperError> {
    let range = [0.0, core::f64::consts::PI / DT];
    let settings = Settings { slack: SLACK, points: POINTS, ..Settings::default() };
    let found = sweep(system, structure, range, &settings).map_err(refused(WHAT))?;
    progress(1.0);
    let gaps = match &found.guarantee {
        Guarantee::Interval(_) => 0,
        Guarantee::GridOnly(gaps) => gaps.len(),
    };
    let gain = |w: f64| system.at(w).map_or(f64::NAN, |M| M.singular_values().max());
    let largest = found.points.iter().map(|p| gain(p.w)).fold(0.0, f64::max);
    let sharp = "a grid of 82 points says 0.458 at 353 rad/s: too low, the lightly damped mode at 348 rad/s stands between its points; this bound \
                 is proved between points as well";
    let rows = vec![
        Row::new("Figure 8.15", "largest mu over all frequencies, neutral pose", found.upper, None, Gate::AtMost(1.0))
            .because("below one, as the paper finds on 200 frequencies"),
        Row::held_against("Figure 8.15", "the same against its number", found.upper, None, (Gate::Within(1e-3), 0.737)).because(sharp),
        Row::new("Figure 8.15", "lower bound of the same: a perturbation that was found", found.worst.beta, None, Gate::AtLeast(0.7359))
            .because("upper and lower bound meet within 1 part in 1000"),
        Row::held_against("Figure 8.15", "frequency of the worst perturbation, rad/s", found.worst.w, None, (Gate::Within(0.1), 348.15))
            .because(sharp),
        Row::new(
            "Figure 8.15",
            "intervals of frequency that the bound does not cover",
            f64::from(u32::try_from(gaps).unwrap_or(u32::MAX)),
            None,
            Gate::AtMost(0.0),
        ),
        Row::new("Figure 8.15", "largest singular value over the same frequencies", largest, None, Gate::AtLeast(10.0))
            .because("a bound that does not use the structure says nothing here"),
    ];
    let decades = |w: f64| math::ln(w) / core::f64::consts::LN_10;
    let line = |label: &str, of: fn(&pkm_ctrl::design::mu::Point) -> f64| Line {
        label: label.to_string(),
        points: found.points.iter().filter(|p| p.w >= 0.1).map(|p| (decades(p.w), of(p))).collect(),
    };
    let plot = Plot {
        title: "Bounds of mu over frequency, proposed gains, neutral pose (Figure 8.15)".to_string(),
        x_label: "log10 of the frequency in rad/s".to_string(),
        y_label: "mu".to_string(),
        lines: vec![line("upper bound", |p| p.upper), line("lower bound", |p| p.lower)],
    };
    Ok((rows, plot))
}

/// Places about a mode, in units of its decay.
const ABOUT: [f64; 9] = [-3.0, -1.5, -0.7, -0.3, 0.0, 0.3, 0.7, 1.5, 3.0];

/// Frequencies about the lightly damped modes `[rad/s]`, and a few between.
fn frequencies(system: &StateSpace) -> Vec<f64> {
    let mut out = vec![0.01, 1.0, 30.0, 1000.0];
    for p in system.poles() {
        let (size, turn) = (math::hypot(p.re, p.im), math::atan2(p.im, p.re));
        if size > 0.8 && turn > 0.02 {
            let decay = -math::ln(size);
            out.extend(ABOUT.iter().map(|x| (turn + x * decay) / DT).filter(|w| *w > 0.0 && *w < core::f64::consts::PI / DT));
        }
    }
    out
}

/// Largest bound and largest modulus of a pole over the orientations of the foot, at points.
fn orientation_rows(structure: &Structure, progress: &mut dyn FnMut(f64)) -> Result<Vec<Row>, PaperError> {
    let (mut most, mut radius, mut done) = (0.0_f64, 0.0_f64, 0.0);
    for x in FLEXION {
        for y in INVERSION {
            let system = uncertain_loop([x, y, 0.0].map(f64::to_radians), PROPOSED)?;
            radius = radius.max(spectral_radius(system.matrices()[0]));
            for w in frequencies(&system) {
                most = most.max(upper(&system, structure, w)?);
            }
            done += 1.0;
            progress(done / 25.0);
        }
    }
    Ok(vec![
        Row::new("section 8.3.4", "largest modulus of a pole, flexion to 40, inversion to 30 degrees", radius, None, Gate::AtMost(0.9999))
            .because("every pole inside the unit circle at 25 orientations"),
        Row::new("Figure 8.15", "largest mu at the modes, flexion to 40, inversion to 30 degrees", most, None, Gate::AtMost(1.0)).because(
            "25 orientations; nine frequencies about every lightly damped mode and four more, where the paper has 200; its ankle model is not printed, so \
             flexion and inversion are turned about X and Y, stiffness and damping stay those of the neutral pose",
        ),
    ])
}

/// A full block of size one.
fn full(draw: &mut Chance) -> DMatrix<f64> {
    let X = DMatrix::from_fn(3, 3, |_, _| draw.signed());
    let size = X.singular_values().max().max(f64::MIN_POSITIVE);
    X / size
}

/// Largest modulus of a pole over random perturbations on the edge of what is admitted.
fn drawn_row(system: &StateSpace) -> Result<Row, PaperError> {
    let [A, B, C, D] = system.matrices();
    let mut draw = Chance::new(8);
    let mut worst = 0.0_f64;
    for _ in 0..DRAWN {
        let mut delta = DMatrix::zeros(9, 9);
        (0..3).for_each(|i| delta[(i, i)] = if draw.unit() < 0.5 { -1.0 } else { 1.0 });
        delta.view_mut((3, 3), (3, 3)).copy_from(&full(&mut draw));
        delta.view_mut((6, 6), (3, 3)).copy_from(&full(&mut draw));
        let loop_inside = DMatrix::identity(9, 9) - D * &delta;
        let inside = loop_inside.try_inverse().ok_or(PaperError::Other { what: WHAT, reason: "a loop within the loop".to_string() })?;
        worst = worst.max(spectral_radius(&(A + B * &delta * inside * C)));
    }
    let row = Row::new("section 8.3.4", "largest modulus of a pole, 300 perturbations of full size", worst, None, Gate::AtMost(0.9999));
    Ok(row.because("drawn at random: none makes the loop unstable, as mu below one says"))
}

/// Everything about mu.
pub(super) fn rows(progress: &mut dyn FnMut(f64)) -> Result<(Vec<Row>, Plot), PaperError> {
    let (system, structure) = (uncertain_loop([0.0; 3], PROPOSED)?, structure()?);
    let mut rows = point_rows(&system, &structure)?;
    let (more, plot) = range_rows(&system, &structure, &mut |x| progress(0.5 * x))?;
    rows.extend(more);
    rows.extend(orientation_rows(&structure, &mut |x| progress(0.5 + 0.5 * x))?);
    rows.push(drawn_row(&system)?);
    Ok((rows, plot))
}
