//! What `pkm mu` says: terminal text and JSON.

use core::fmt::Write as _;

use pkm_ctrl::design::mu::{Block, CMatrix, Certificate, Guarantee, UpperStatus, Value};
use serde_json::{Value as Json, json};

use super::Found;
use super::file::{Meaning, Problem, Subject};
use crate::out::{number, table};

/// Six digits: bounds that agree to four are told apart.
pub(super) fn digits(x: f64) -> String {
    if x == f64::INFINITY {
        return "inf".to_string();
    }
    let size = x.abs();
    if size >= 1e6 || (size > 0.0 && size < 1e-3) { format!("{x:.5e}") } else { number_of(x, 6) }
}

fn number_of(x: f64, significant: usize) -> String {
    let before = (0..6).take_while(|&k| x.abs() >= [1.0, 10.0, 100.0, 1e3, 1e4, 1e5][k]).count();
    let text = format!("{x:.0$}", significant.saturating_sub(before));
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_string() } else { text }
}

pub(super) fn interval(range: [f64; 2]) -> String {
    format!("[{}, {}] rad/s", digits(range[0]), digits(range[1]))
}

/// What the file describes, in a line.
pub(super) fn subject(problem: &Problem) -> String {
    let blocks = problem.structure.blocks();
    let n = |is: fn(&Block) -> bool| blocks.iter().filter(|b| is(b)).count();
    let counts = [
        (n(|b| matches!(b, Block::Real { .. })), "real"),
        (n(|b| matches!(b, Block::Complex { .. })), "complex"),
        (n(|b| matches!(b, Block::Full { .. })), "full"),
    ];
    let kinds: Vec<String> = counts.iter().filter(|(n, _)| *n > 0).map(|(n, kind)| format!("{n} {kind}")).collect();
    let what = match &problem.subject {
        Subject::Matrix(m) => format!("matrix {} x {}", m.nrows(), m.ncols()),
        Subject::System(s, _) => {
            let time = s.dt().map_or("continuous".to_string(), |dt| format!("discrete, {} s", number(dt)));
            format!("{time}, {} states", s.matrices()[0].nrows())
        }
    };
    format!("{what}; uncertainty of {} blocks", kinds.join(" + "))
}

/// How far the upper bound goes, in words.
pub(super) fn guarantee(found: &Found) -> String {
    match &found.guarantee {
        None => "guaranteed".to_string(),
        Some(Guarantee::Interval(range)) => format!("guaranteed on {}", interval(*range)),
        Some(Guarantee::GridOnly(gaps)) => {
            let first = gaps.first().map_or(String::new(), |g| format!(", the first {}", interval(*g)));
            format!("grid only: {} intervals are not covered{first}", gaps.len())
        }
    }
}

/// The answer in a sentence.
pub(super) fn answer(found: &Found) -> String {
    if let Some(s) = found.stability.as_ref().filter(|s| s.distance <= 0.0) {
        let [re, im] = s.pole.map(number);
        return format!("The nominal system is not stable (pole {re}, {im}j): the bounds are those of its response, not of a margin.");
    }
    if found.worst.beta >= 1.0 {
        return "Not robust: the perturbation below lies within the stated sizes and makes the loop singular.".to_string();
    }
    match (found.upper < 1.0, found.is_guaranteed()) {
        (true, true) => "Robust: no uncertainty within the stated sizes can make the loop singular.".to_string(),
        (true, false) => "No weakness at the frequencies looked at, but they are not all: grid only.".to_string(),
        (false, _) => "Undecided: the bounds lie on both sides of 1.".to_string(),
    }
}

/// Value of a parameter under a perturbation.
pub(super) fn parameter(meaning: &Meaning, delta: f64) -> Option<f64> {
    meaning.range.map(|[lower, upper]| 0.5 * (lower + upper) + 0.5 * (upper - lower) * delta)
}

/// Rows of the worst perturbation: block, δ, what it means.
pub(super) fn perturbation(problem: &Problem, values: &[Value]) -> Vec<[String; 3]> {
    let row = |(m, value): (&Meaning, &Value)| {
        let delta = match value {
            Value::Real(x) => digits(*x),
            Value::Complex(x) => format!("{} {} {}j", digits(x.re), if x.im < 0.0 { "-" } else { "+" }, digits(x.im.abs())),
            Value::Full(x) => format!("{} x {} of size {}", x.nrows(), x.ncols(), digits(value.size())),
        };
        let means = match (value, m.range) {
            (Value::Real(x), Some([lower, upper])) => {
                let at = digits(parameter(m, *x).unwrap_or(f64::NAN));
                format!("{at} {} (stated {} to {})", m.unit, digits(lower), digits(upper)).replace("  ", " ")
            }
            _ => String::new(),
        };
        [m.name.clone(), delta, means]
    };
    problem.meanings.iter().zip(values).map(row).collect()
}

/// Terminal text.
pub(super) fn text(problem: &Problem, found: &Found) -> String {
    let mut out = format!("{}: {}\n{}\n\n", problem.name, subject(problem), answer(found));
    let margin = |beta: f64| if beta > 0.0 { digits(1.0 / beta) } else { "inf".to_string() };
    let mut rows = vec![
        vec!["upper bound of mu".to_string(), digits(found.upper), guarantee(found)],
        vec!["lower bound of mu".to_string(), digits(found.worst.beta), "shown by the perturbation below".to_string()],
        vec![
            "margin".to_string(),
            format!("{} to {}", margin(found.upper), margin(found.worst.beta)),
            "times the stated sizes".to_string(),
        ],
    ];
    if found.worst.perturbation.is_none() {
        rows[1][2] = "no perturbation found".to_string();
    }
    if let Some(w) = found.peak_w {
        rows.push(vec!["peak at".to_string(), format!("{} rad/s", digits(w)), String::new()]);
    }
    if let Some((_, UpperStatus::Stopped)) = found.matrix {
        rows[0][2] = "guaranteed; the iterations stopped early, a better one may exist".to_string();
    }
    if let Some(gain) = &found.gain {
        let bounds = format!("{} to {}", digits(gain.lower), digits(gain.upper));
        let scope = match &gain.guarantee {
            Guarantee::Interval(range) => format!("upper end guaranteed on {}", interval(*range)),
            Guarantee::GridOnly(_) => "grid only".to_string(),
        };
        rows.push(vec!["worst-case gain".to_string(), bounds, scope]);
    }
    out.push_str(&table(&rows));
    if let Some(p) = &found.worst.perturbation {
        let at = found.peak_w.map_or(String::new(), |_| format!(" at {} rad/s", digits(found.worst.w)));
        let _ = write!(out, "\n\nworst perturbation{at}, of size {}\n", digits(p.size));
        out.push_str(&table(&perturbation(problem, &p.blocks).into_iter().map(Vec::from).collect::<Vec<_>>()));
    }
    out
}

fn complex(m: &CMatrix) -> Json {
    let part = |of: fn(&nalgebra::Complex<f64>) -> f64| {
        (0..m.nrows()).map(|i| (0..m.ncols()).map(|j| of(&m[(i, j)])).collect::<Vec<f64>>()).collect::<Vec<_>>()
    };
    json!({"re": part(|c| c.re), "im": part(|c| c.im)})
}

fn proof(range: Option<[f64; 2]>, c: &Certificate) -> Json {
    json!({"range": range, "beta": c.beta, "D_w": complex(&c.d_w), "D_z": complex(&c.d_z), "G": complex(&c.g)})
}

/// One value of a perturbation.
fn value(meaning: &Meaning, value: &Value) -> Json {
    let delta = match value {
        Value::Real(x) => json!(x),
        Value::Complex(x) => json!({"re": x.re, "im": x.im}),
        Value::Full(x) => complex(x),
    };
    let at = if let Value::Real(x) = value { parameter(meaning, *x) } else { None };
    json!({"name": meaning.name, "delta": delta, "value": at, "unit": meaning.unit})
}

/// JSON, layout `pkm.mu/1`; infinity is null.
pub(super) fn json(problem: &Problem, found: &Found, with_proof: bool) -> anyhow::Result<String> {
    let worst = found.worst.perturbation.as_ref().map(|p| {
        let blocks: Vec<Json> = problem.meanings.iter().zip(&p.blocks).map(|(m, v)| value(m, v)).collect();
        json!({"w": found.peak_w.map(|_| found.worst.w), "size": p.size, "singularity": p.singularity, "blocks": blocks})
    });
    let guarantee = match &found.guarantee {
        None => json!({"kind": "matrix"}),
        Some(Guarantee::Interval(range)) => json!({"kind": "interval", "range": range}),
        Some(Guarantee::GridOnly(gaps)) => json!({"kind": "grid only", "gaps": gaps}),
    };
    let points = found.sweep.as_ref().map(|s| s.points.iter().map(|p| [p.w, p.upper, p.lower]).collect::<Vec<_>>());
    let gain = found.gain.as_ref().map(|g| {
        let is_guaranteed = matches!(g.guarantee, Guarantee::Interval(_));
        json!({"upper": g.upper, "lower": g.lower, "w": g.w, "is_guaranteed": is_guaranteed})
    });
    let mut out = json!({
        "schema": "pkm.mu/1",
        "name": problem.name,
        "says": answer(found),
        "is_stable": found.is_stable(),
        "upper": found.upper,
        "lower": found.worst.beta,
        "peak_w": found.peak_w,
        "guarantee": guarantee,
        "worst": worst,
        "gain": gain,
        "points": points,
    });
    if with_proof {
        let segments = found.sweep.iter().flat_map(|s| &s.segments).map(|s| proof(Some(s.range), &s.proof));
        out["proof"] = segments.chain(found.matrix.iter().map(|(c, _)| proof(None, c))).collect();
    }
    Ok(serde_json::to_string_pretty(&out)?)
}
