//! Critical gains over the orientations of the foot, and a schedule below them.

use pkm_ctrl::design::force_loop::Direction;
use pkm_ctrl::design::schedule::{Sample, fit};
use pkm_ctrl::force::GainCurve;

use super::ankle::{K_D, PROPOSED, force_loop};
use crate::error::PaperError;
use crate::refused::refused;
use crate::row::{Gate, Line, Plot, Row};

const WHAT: &str = "schedule of gains";

/// Orientations `[deg]`, effective masses `[kg]`, critical gains k1, k2, k3, k0 with PD, computed by another program.
const KNOWN: [([f64; 3], [f64; 3], [f64; 4]); 3] = [
    ([20.0, 0.0, 0.0], [67.7, 13.3, 2.62], [16.3, 27.8, 102.8, 18.5]),
    ([0.0, 15.0, 0.0], [208.6, 14.8, 2.43], [16.2, 26.0, 112.1, 18.5]),
    ([0.0, 0.0, 20.0], [39.4, 16.6, 2.48], [17.2, 25.1, 109.5, 18.5]),
];

/// Share of the critical gain that the schedule may use.
const SHARE: f64 = 0.6;

/// Breakpoints of a curve.
const BREAKPOINTS: usize = 3;

/// Orientations that the schedule is made for `[deg]`.
const FLEXION: [f64; 5] = [-20.0, -10.0, 0.0, 10.0, 20.0];
const INVERSION: [f64; 3] = [-15.0, 0.0, 15.0];

/// Effective masses and critical gains at one orientation.
struct Found {
    masses: Vec<f64>,
    gains: Vec<f64>,
}

fn find(degrees: [f64; 3], directions: &[usize]) -> Result<Found, PaperError> {
    let model = force_loop(degrees.map(f64::to_radians), K_D)?;
    let critical = |&k: &usize| model.critical_gain(Direction::Along(k)).map_err(refused(WHAT));
    let gains = directions.iter().map(critical).collect::<Result<Vec<_>, _>>()?;
    Ok(Found { masses: model.effective_masses().to_vec(), gains })
}

fn known_rows() -> Result<Vec<Row>, PaperError> {
    let mut rows = Vec::new();
    let mut spread = [[f64::INFINITY, 0.0_f64]; 2];
    for (degrees, masses, gains) in KNOWN {
        let found = find(degrees, &[0, 1, 2, 3])?;
        let at = format!("at {} {} {} degrees", degrees[0], degrees[1], degrees[2]);
        let mut add = |what: String, ours: f64, known: f64| {
            rows.push(Row::held_against("Figure 8.14", what, ours, None, (Gate::Within(0.06), known)));
        };
        for (k, (ours, known)) in found.masses.iter().zip(masses).enumerate() {
            add(format!("effective mass in direction {} {at}, kg", k + 1), *ours, known);
        }
        for (name, (ours, known)) in ["k1", "k2", "k3", "k0"].iter().zip(found.gains.iter().zip(gains)) {
            add(format!("gain {name} at the limit of stability {at}"), *ours, known);
        }
        for (spread, gain) in spread.iter_mut().zip([found.gains[0], found.gains[3]]) {
            *spread = [spread[0].min(gain), spread[1].max(gain)];
        }
    }
    for (name, [least, most], limit) in [("k1", spread[0], 0.12), ("k0", spread[1], 0.005)] {
        let what = format!("change of the critical {name} over these orientations");
        let row = Row::new("Figure 8.14", what, most / least - 1.0, None, Gate::AtMost(limit));
        rows.push(row.because("one gain that hardly changes and one that does not: constants, as the paper has them"));
    }
    Ok(rows)
}

/// Critical gains of the second and third direction over their effective masses, over all orientations.
fn samples() -> Result<[Vec<Sample>; 2], PaperError> {
    let mut out = [Vec::new(), Vec::new()];
    for x in FLEXION {
        for y in INVERSION {
            let found = find([x, y, 0.0], &[1, 2])?;
            for (i, out) in out.iter_mut().enumerate() {
                out.push(Sample { value: found.masses[i + 1], critical: found.gains[i] });
            }
        }
    }
    Ok(out)
}

/// The largest modulus of a pole with the schedule, over its own orientations and some between them.
fn worst_radius(curves: &[GainCurve; 2]) -> Result<f64, PaperError> {
    let mut worst = 0.0_f64;
    for x in [-20.0, -13.0, -4.0, 0.0, 7.0, 16.0, 20.0] {
        for y in [-15.0, -6.0, 0.0, 11.0, 15.0] {
            let model = force_loop([x, y, 5.0].map(f64::to_radians), K_D)?;
            let masses = model.effective_masses().to_vec();
            let k = [PROPOSED[0], curves[0].at(masses[1]), curves[1].at(masses[2]), PROPOSED[3]];
            worst = worst.max(model.spectral_radius(&model.gain(|i| k[i])).map_err(refused(WHAT))?);
        }
    }
    Ok(worst)
}

fn plot(name: &str, samples: &[Sample], points: &[[f64; 2]]) -> Plot {
    let mut limit: Vec<(f64, f64)> = samples.iter().map(|s| (s.value, s.critical)).collect();
    limit.sort_by(|a, b| a.0.total_cmp(&b.0));
    Plot {
        title: format!("Gain {name} over the singular value of its direction (Figure 8.14)"),
        x_label: "effective mass, kg".to_string(),
        y_label: "gain".to_string(),
        lines: vec![
            Line { label: "limit of stability".to_string(), points: limit },
            Line { label: "schedule".to_string(), points: points.iter().map(|p| (p[0], p[1])).collect() },
        ],
    }
}

/// Critical gains over one turn of the foot.
fn over_flexion() -> Result<Plot, PaperError> {
    let mut lines = ["k1", "k2", "k0"].map(|name| Line { label: name.to_string(), points: Vec::new() });
    for x in FLEXION {
        let found = find([x, 0.0, 0.0], &[0, 1, 3])?;
        lines.iter_mut().zip(found.gains).for_each(|(line, gain)| line.points.push((x, gain)));
    }
    Ok(Plot {
        title: "Gains at the limit of stability over the flexion of the foot".to_string(),
        x_label: "flexion, deg".to_string(),
        y_label: "gain".to_string(),
        lines: lines.into(),
    })
}

/// Critical gains elsewhere, and what a schedule makes of them.
pub(super) fn rows() -> Result<(Vec<Row>, Vec<Plot>), PaperError> {
    let mut rows = known_rows()?;
    let samples = samples()?;
    let mut curves = Vec::new();
    let mut plots = vec![over_flexion()?];
    for (name, samples) in ["k2", "k3"].into_iter().zip(&samples) {
        let points = fit(samples, BREAKPOINTS, SHARE).map_err(refused(WHAT))?;
        let fall = points[BREAKPOINTS - 1][1] - points[0][1];
        let what = format!("change of the schedule of {name} from its smallest to its largest singular value");
        let row = Row::new("Figure 8.14", what, fall, None, Gate::AtMost(0.0));
        rows.push(row.conclusion_only("gains fall as the mass rises; the paper's breakpoints are in a figure that is not in its text"));
        plots.push(plot(name, samples, &points));
        curves.push(GainCurve::try_new(&points)?);
    }
    let curves: [GainCurve; 2] = curves.try_into().map_err(|_| PaperError::Other { what: WHAT, reason: "two curves".to_string() })?;
    let row = Row::new(
        "Figure 8.14",
        "largest modulus of a pole with scheduled gains, 35 orientations",
        worst_radius(&curves)?,
        None,
        Gate::AtMost(0.9999),
    );
    rows.push(
        row.because("piecewise-linear k2 and k3 below the limits, constant k1 and k0: stable between the orientations it was made at"),
    );
    Ok((rows, plots))
}
