//! Blind trials: one case made, one verdict judged, scores counted. Files and folders are Python's, in `pkm/prove.py`.

use alloc::collections::BTreeMap;

use pkm_trials::case::{Level, MORE, ROBOTS, Wish, make};
use pkm_trials::score::{Marks, Ran, Verdict, judge, markdown};
use pyo3::prelude::*;
use serde::de::DeserializeOwned;

use crate::{error, long};

fn level(name: &str) -> PyResult<Level> {
    let found = Level::ALL.into_iter().find(|l| format!("{l:?}").eq_ignore_ascii_case(name));
    found.ok_or_else(|| error::value(format!("levels names {name:?} (must be of L0, L1 ... L7)")))
}

/// Makes the case of that number and seed: its public files by name, and its answer as JSON, which is to be sealed.
///
/// `levels`: of concealment, all if empty; `robots`: five of the shipped ones if empty; `sizes`: of effects over the smallest that can be
/// detected.
#[pyfunction]
#[pyo3(signature = (number, seed, *, levels = Vec::new(), robots = Vec::new(), sizes = vec![0.5, 1.0, 2.0, 4.0]))]
pub(crate) fn make_trial(
    py: Python<'_>,
    number: u64,
    seed: u64,
    levels: Vec<String>,
    robots: Vec<String>,
    sizes: Vec<f64>,
) -> PyResult<(BTreeMap<String, String>, String)> {
    let mut wanted = levels.iter().map(|l| level(l)).collect::<PyResult<Vec<_>>>()?;
    if wanted.is_empty() {
        wanted = Level::ALL.to_vec();
    }
    let known = || ROBOTS.iter().chain(&MORE);
    if let Some(unknown) = robots.iter().find(|r| !known().any(|k| k == r)) {
        let known: Vec<&str> = known().copied().collect();
        return Err(error::value(format!("robots names {unknown:?} (must be of {})", known.join(", "))));
    }
    if sizes.is_empty() || sizes.iter().any(|s| !(s.is_finite() && *s > 0.0)) {
        return Err(error::value(format!("sizes = {sizes:?} (must be one or more finite numbers > 0)")));
    }
    let wish = Wish::of(number, seed, (&wanted, &robots), &sizes);
    let case = long::apart(py, move || make(&wish))?.map_err(|e| error::value(format!("case {number}: {e}")))?;
    let answer = serde_json::to_string_pretty(&case.answer).map_err(|e| error::value(e.to_string()))? + "\n";
    Ok((case.files.into_iter().collect(), answer))
}

fn read<T: DeserializeOwned>(what: &str, text: &str) -> PyResult<T> {
    serde_json::from_str(text).map_err(|e| error::value(format!("{what}: {e}")))
}

/// Judges a verdict (JSON; None where a diagnosis ended without one) against an opened answer: the marks as JSON.
///
/// `ran`: how the diagnosis ran, as JSON of `seconds`, `exit` and `error`.
#[pyfunction]
pub(crate) fn judge_trial(case: &str, answer: &str, verdict: Option<&str>, ran: &str) -> PyResult<String> {
    let answer = read(&format!("answer of case {case}"), answer)?;
    let verdict: Option<Verdict> = verdict.map(|v| read(&format!("verdict on case {case}"), v)).transpose()?;
    let ran: Ran = read(&format!("run of case {case}"), ran)?;
    serde_json::to_string(&judge(case, &answer, verdict.as_ref(), &ran)).map_err(|e| error::value(e.to_string()))
}

/// Counts marks (JSON of each case) as the table of docs/PROOF.md, in Markdown.
#[pyfunction]
pub(crate) fn score_trials(marks: Vec<String>) -> PyResult<String> {
    let marks: Vec<Marks> = marks.iter().map(|m| read("marks", m)).collect::<PyResult<_>>()?;
    Ok(markdown(&marks))
}
