//! An identification in words and as JSON.

use pkm_dyn::parameters::NAMES;
use pkm_ident::Identification;
use pkm_ident::beside::Beside;
use pkm_ident::note::{Note, Status};
use pkm_report::HOPELESS;
use serde_json::{Value, json};

use crate::out::{number, table};

/// The answer in words: errors by drive, parameters with intervals, objections.
pub(super) fn text(answer: &Identification, beside: &Beside) -> String {
    let base = &answer.base;
    let mut out = vec![format!(
        "{}: {}, method {}, band {} Hz, {} rows",
        answer.robot,
        match answer.status {
            Status::Identified => "identified",
            Status::Doubtful => "identified, with doubts",
            Status::NotIdentified => "not identified",
        },
        answer.method.name(),
        number(answer.band_hz),
        answer.n_rows
    )];
    let is_there = answer.status != Status::NotIdentified;
    if is_there {
        out.push(format!(
            "  base parameters {} of {} that this robot can show (tolerance {:.0e}); condition number {} (in SI units {})",
            base.shown,
            base.structural,
            base.tolerance,
            number(base.condition),
            number(base.condition_raw)
        ));
    } else {
        // Why there is nothing comes before everything that there is not.
        out.extend(answer.notes.iter().map(|n| format!("  {n}")));
    }
    errors(answer, is_there, &mut out);
    if !answer.parameters.is_empty() {
        out.push("\nBase parameters".to_string());
        let mut rows = vec![["nominal", "identified", "95 % interval", "rel. sd", "unit", "parameter"].map(str::to_string).to_vec()];
        rows.extend(answer.parameters.iter().map(|p| {
            let interval = format!("{} .. {}", number(p.ci95[0]), number(p.ci95[1]));
            vec![number(p.nominal), number(p.value), interval, relative(p.relative_sd), p.unit.to_string(), p.name.clone()]
        }));
        out.push(table(&rows));
        out.push(format!("  intervals {}", answer.intervals.says()));
    }
    if let (Some(first), Some(last)) = (answer.steps.first(), answer.steps.last()) {
        out.push(format!(
            "\nReduced from {} to {} parameters: held-out error {} -> {}, physical: {}",
            first.parameters,
            last.parameters,
            percent(first.heldout),
            percent(last.heldout),
            if last.is_feasible { "yes" } else { "no" }
        ));
    }
    extras(answer, &mut out);
    gains(beside, &mut out);
    payload(beside, &mut out);
    if is_there && !answer.notes.is_empty() {
        out.push("\nNotes".to_string());
        out.extend(answer.notes.iter().map(|n| format!("  {n}")));
    }
    out.join("\n")
}

/// Errors by drive; without an identified robot those of the nominal one alone.
fn errors(answer: &Identification, is_there: bool, out: &mut Vec<String>) {
    out.push("\nHeld-out error, share of the effort's rms".to_string());
    let columns = if is_there { 6 } else { 3 };
    let mut rows = vec![["drive", "effort rms", "nominal", "identified", "fitted rows", "residual"].map(str::to_string).to_vec()];
    rows.extend(answer.joints.iter().map(|j| {
        let colour = if j.is_white { "white".to_string() } else { format!("coloured, neighbours {:.2}", j.lag_one) };
        vec![
            j.joint.clone(),
            format!("{} {}", number(j.effort_rms), j.unit),
            percent(j.nominal),
            percent(j.identified),
            percent(j.fitted),
            colour,
        ]
    }));
    let pooled = [answer.pooled(|j| j.nominal), answer.pooled(|j| j.identified), answer.pooled(|j| j.fitted)].map(percent);
    rows.push([vec!["all".to_string(), String::new()], pooled.to_vec()].concat());
    rows.iter_mut().for_each(|row| row.truncate(columns));
    out.push(table(&rows));
}

/// Shapes, instruments and preprocessing, where there were any.
fn extras(answer: &Identification, out: &mut Vec<String>) {
    if !answer.shapes.is_empty() {
        out.push("\nShapes of friction laws".to_string());
        let mut rows = vec![["stated", "identified", "95 % interval", "unit", "shape"].map(str::to_string).to_vec()];
        rows.extend(answer.shapes.iter().map(|s| {
            let interval = format!("{} .. {}", number(s.ci95[0]), number(s.ci95[1]));
            vec![number(s.stated), number(s.value), interval, s.unit.to_string(), s.name.clone()]
        }));
        out.push(table(&rows));
    }
    if let Some(i) = &answer.instruments {
        let says = if i.test.is_exogenous { "least squares would have done" } else { "least squares would be biased" };
        out.push(format!(
            "\nInstruments: {} simulations, they explain {} of every column at least; Durbin-Wu-Hausman F {} (p {}): {says}",
            i.iterations,
            percent(i.test.relevance),
            number(i.test.f),
            number(i.test.p)
        ));
    }
    let told: Vec<String> = answer.preprocessing.iter().filter(|d| d.step != "filtered").map(|d| format!("  {d}")).collect();
    if !told.is_empty() {
        out.push("\nPreprocessing".to_string());
        out.extend(told);
    }
}

fn gains(beside: &Beside, out: &mut Vec<String>) {
    let Some(g) = &beside.gains else { return };
    out.push("\nGains of the drives, acting effort over recorded effort".to_string());
    if !g.gains.is_empty() {
        let mut rows = vec![["drive", "gain", "95 % interval", "load"].map(str::to_string).to_vec()];
        rows.extend(g.gains.iter().map(|g| {
            let interval = format!("{} .. {}", number(g.ci95[0]), number(g.ci95[1]));
            vec![g.joint.clone(), number(g.gain), interval, format!("{} of the effort", percent(g.load_share))]
        }));
        out.push(table(&rows));
    }
    out.extend(g.notes.iter().map(|n| format!("  {n}")));
}

fn payload(beside: &Beside, out: &mut Vec<String>) {
    let Some(p) = &beside.payload else { return };
    let [x, y, z]: [f64; 3] = p.body.centre_of_mass().0.into();
    out.push(format!("\nPayload on {}: {} kg at ({}, {}, {}) m", p.link, number(p.body.mass), number(x), number(y), number(z)));
    let mut rows = vec![["value", "95 % interval", "unit", "shown by the motion"].map(str::to_string).to_vec()];
    rows.extend(p.shown.iter().map(|e| {
        let interval = format!("{} .. {}", number(e.ci95[0]), number(e.ci95[1]));
        vec![number(e.value), interval, e.unit.to_string(), e.name.clone()]
    }));
    out.push(table(&rows));
    out.extend(p.notes.iter().map(|n| format!("  {n}")));
}

fn percent(x: f64) -> String {
    format!("{:.1} %", 100.0 * x)
}

/// A standard deviation over its value; of what the motion does not show no number says more than that it is large, as the page says too.
fn relative(x: f64) -> String {
    if x < HOPELESS { percent(x) } else { format!("> {}", percent(HOPELESS)) }
}

/// The answer as JSON.
pub(super) fn json(answer: &Identification, beside: &Beside) -> Value {
    let standard: Vec<Value> = answer
        .columns
        .list
        .iter()
        .zip(&answer.theta)
        .map(|(p, value)| json!({"name": p.name, "unit": p.unit, "nominal": p.nominal, "value": value}))
        .collect();
    let noted = |notes: &[Note]| notes.iter().map(|n| json!({"numbers": n, "says": n.to_string()})).collect::<Vec<_>>();
    let mut out = json!({
        "schema": "pkm.identification/1",
        "status": answer.status,
        "notes": noted(&answer.notes),
        "robot": answer.robot,
        "method": answer.method,
        "band_hz": answer.band_hz,
        "prior_weight": answer.prior_weight,
        "rows": answer.n_rows,
        "recordings": answer.recordings,
        "base": answer.base,
        "heldout": {
            "rms_nominal": answer.pooled(|j| j.nominal),
            "rms_identified": answer.pooled(|j| j.identified),
            "unit": "fraction of tau rms",
            "joints": answer.joints,
        },
        "preprocessing": answer.preprocessing,
        "shapes": answer.shapes,
        "instruments": answer.instruments,
        "base_parameters": answer.parameters,
        "intervals": answer.intervals,
        "reduction": answer.steps,
        "parameters": standard,
    });
    if let Some(g) = &beside.gains {
        out["gains"] = json!({"status": g.status, "notes": noted(&g.notes), "drives": g.gains});
    }
    if let Some(p) = &beside.payload {
        let theta = p.body.to_vector();
        let body: serde_json::Map<String, Value> = NAMES.iter().zip(theta.iter()).map(|(name, x)| (name.to_string(), json!(x))).collect();
        out["payload"] = json!({"link": p.link, "status": p.status, "notes": noted(&p.notes), "body": body, "shown": p.shown});
    }
    out
}
