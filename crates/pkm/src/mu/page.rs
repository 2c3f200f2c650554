//! The page of `pkm mu`: both bounds over frequency.

use pkm_report::{Curve, Figure, Ink, Scale, Sheet, Table, Tone, sheet};

use super::Found;
use super::file::Problem;
use super::text::{answer, digits, guarantee, interval, perturbation, subject};
use pkm_ctrl::design::mu::{Guarantee, Sweep};

/// The page as HTML.
pub(super) fn html(problem: &Problem, found: &Found) -> String {
    let outcome = match () {
        () if !found.is_stable() => ("nominally unstable", Tone::Bad),
        () if found.worst.beta >= 1.0 => ("not robust", Tone::Bad),
        () if found.upper < 1.0 && found.is_guaranteed() => ("robust", Tone::Good),
        () => ("undecided", Tone::Found),
    };
    let sheet_of = Sheet {
        eyebrow: "Structured singular value".to_string(),
        title: problem.name.clone(),
        outcome: (outcome.0.to_string(), outcome.1),
        answer: format!("{} System: {}.", answer(found), subject(problem)),
        figures: found.sweep.iter().map(|s| figure(s, found)).collect(),
        tables: tables(problem, found),
        footer:
            "Upper bounds are proved by scalings whose inequality is checked with a bound on every rounding; lower bounds are shown by \
                 perturbations that were put into the loop and found to make it singular."
                .to_string(),
    };
    sheet(&sheet_of)
}

fn figure(s: &Sweep, found: &Found) -> Figure {
    let curve = |label: &str, ink, of: fn(&pkm_ctrl::design::mu::Point) -> f64| Curve {
        label: label.to_string(),
        ink,
        points: s.points.iter().map(|p| (p.w, of(p))).collect(),
    };
    let ends: Vec<f64> = s.points.iter().map(|p| p.w).filter(|w| *w > 0.0 && w.is_finite()).collect();
    let mut lower = curve("lower bound at points", Ink::Second, |p| p.lower);
    // The worst perturbation is searched for between the points as well.
    lower.points.push((found.worst.w, found.worst.beta));
    lower.points.retain(|(w, beta)| w.is_finite() && beta.is_finite());
    lower.points.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut curves = vec![lower, curve("upper bound at points", Ink::First, |p| p.upper)];
    let mut shaded = (String::new(), Vec::new());
    match &s.guarantee {
        Guarantee::Interval(range) => {
            let level = [ends.first(), ends.last()].into_iter().flatten().map(|w| (*w, found.upper)).collect();
            curves.insert(0, Curve { label: format!("level proved on {}", interval(*range)), ink: Ink::Plain, points: level });
        }
        Guarantee::GridOnly(gaps) => shaded = ("not covered by a proof".to_string(), gaps.clone()),
    }
    Figure {
        title: "Bounds over frequency".to_string(),
        x_label: "frequency, rad/s".to_string(),
        y_label: "structured singular value".to_string(),
        scales: [Scale::Log, Scale::Linear],
        curves,
        shaded,
    }
}

fn tables(problem: &Problem, found: &Found) -> Vec<Table> {
    let row = |cells: [&str; 3]| cells.map(str::to_string).to_vec();
    let mut bounds = vec![
        row(["upper bound", &digits(found.upper), &guarantee(found)]),
        row(["lower bound", &digits(found.worst.beta), "shown by the perturbation below"]),
    ];
    if let Some(w) = found.peak_w {
        bounds.push(row(["peak at", &format!("{} rad/s", digits(w)), ""]));
    }
    if let Some(g) = &found.gain {
        bounds.push(row(["worst-case gain", &format!("{} to {}", digits(g.lower), digits(g.upper)), ""]));
    }
    let head = |cells: [&str; 3]| cells.map(str::to_string).to_vec();
    let mut out = vec![Table { title: "Bounds".to_string(), head: head(["what", "value", "how far"]), rows: bounds }];
    if let Some(p) = &found.worst.perturbation {
        let at = found.peak_w.map_or(String::new(), |_| format!(" at {} rad/s", digits(found.worst.w)));
        let rows = perturbation(problem, &p.blocks).into_iter().map(Vec::from).collect();
        out.push(Table { title: format!("Worst perturbation{at}"), head: head(["block", "δ", "parameter"]), rows });
    }
    out
}
