//! An identification in words and as JSON.

use pkm_ident::Identification;
use pkm_ident::note::Status;
use serde_json::{Value, json};

use crate::out::{number, table};

/// The answer in words: errors by drive, parameters with intervals, objections.
pub(super) fn text(answer: &Identification) -> String {
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
    out.push(format!(
        "  base parameters {} of {} that this robot can show (tolerance {:.0e}); condition number {} (in SI units {})",
        base.shown,
        base.structural,
        base.tolerance,
        number(base.condition),
        number(base.condition_raw)
    ));
    out.push("\nHeld-out error, share of the effort's rms".to_string());
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
    out.push(table(&rows));
    if !answer.parameters.is_empty() {
        out.push("\nBase parameters".to_string());
        let mut rows = vec![["nominal", "identified", "95 % interval", "rel. sd", "unit", "parameter"].map(str::to_string).to_vec()];
        rows.extend(answer.parameters.iter().map(|p| {
            let interval = format!("{} .. {}", number(p.ci95[0]), number(p.ci95[1]));
            vec![number(p.nominal), number(p.value), interval, percent(p.relative_sd.min(99.0)), p.unit.to_string(), p.name.clone()]
        }));
        out.push(table(&rows));
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
    if !answer.notes.is_empty() {
        out.push("\nNotes".to_string());
        out.extend(answer.notes.iter().map(|n| format!("  {n}")));
    }
    out.join("\n")
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

fn percent(x: f64) -> String {
    format!("{:.1} %", 100.0 * x)
}

/// The answer as JSON.
pub(super) fn json(answer: &Identification) -> Value {
    let standard: Vec<Value> = answer
        .columns
        .list
        .iter()
        .zip(&answer.theta)
        .map(|(p, value)| json!({"name": p.name, "unit": p.unit, "nominal": p.nominal, "value": value}))
        .collect();
    json!({
        "schema": "pkm.identification/1",
        "status": answer.status,
        "notes": answer.notes.iter().map(|n| json!({"numbers": n, "says": n.to_string()})).collect::<Vec<_>>(),
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
        "reduction": answer.steps,
        "parameters": standard,
    })
}
