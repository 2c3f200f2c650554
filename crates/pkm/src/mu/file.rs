//! The file of `pkm mu`: a system or a matrix, and the uncertainty; layout in docs/FORMATS.md.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use anyhow::{Context, anyhow, bail, ensure};
use nalgebra::{Complex, DMatrix};
use pkm_ctrl::design::mu::{Block, CMatrix, Performance, StateSpace, Structure};
use serde::Deserialize;

/// Largest file read, in bytes.
const BYTES_MAX: u64 = 16 << 20;
/// Most states, and most inputs or outputs, of a system.
const STATES_MAX: usize = 400;
const CHANNELS_MAX: usize = 64;
/// Largest repetition of a scalar: the scalings have its square as unknowns.
const REPEATS_MAX: usize = 16;

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Layout {
    name: Option<String>,
    dt: Option<f64>,
    #[serde(rename = "A")]
    a: Option<Rows>,
    #[serde(rename = "B")]
    b: Option<Rows>,
    #[serde(rename = "C")]
    c: Option<Rows>,
    #[serde(rename = "D")]
    d: Option<Rows>,
    #[serde(rename = "M")]
    m: Option<ComplexRows>,
    frequency: Option<Frequency>,
    #[serde(default)]
    block: Vec<Entry>,
    performance: Option<Channels>,
}

type Rows = Vec<Vec<f64>>;

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct ComplexRows {
    re: Rows,
    im: Option<Rows>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct Frequency {
    lower: Option<f64>,
    upper: Option<f64>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Entry {
    kind: String,
    name: Option<String>,
    repeats: Option<usize>,
    rows: Option<usize>,
    cols: Option<usize>,
    lower: Option<f64>,
    upper: Option<f64>,
    unit: Option<String>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Channels {
    inputs: usize,
    outputs: usize,
}

/// What a block stands for.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Meaning {
    /// Its name, or its number.
    pub(crate) name: String,
    /// Of a parameter: the values at δ = −1 and δ = 1.
    pub(crate) range: Option<[f64; 2]>,
    /// Unit of the parameter.
    pub(crate) unit: String,
}

/// What is analysed.
#[derive(Debug)]
pub(crate) enum Subject {
    Matrix(CMatrix),
    /// A system and its range of frequencies `[rad/s]`.
    System(StateSpace, [f64; 2]),
}

/// A file that was understood.
#[derive(Debug)]
pub(crate) struct Problem {
    pub(crate) name: String,
    pub(crate) subject: Subject,
    pub(crate) structure: Structure,
    pub(crate) meanings: Vec<Meaning>,
    pub(crate) performance: Option<Performance>,
}

/// Reads a file; errors are one line that begins with its name.
pub(crate) fn read(path: &Path) -> anyhow::Result<Problem> {
    let file = path.display();
    let text = text_of(path)?;
    let is_json = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("json"));
    let layout: Layout = if is_json {
        serde_json::from_str(&text).map_err(|e| anyhow!("{file}: {e}"))?
    } else {
        toml::from_str(&text).map_err(|e: toml::de::Error| {
            let line = e.span().map_or(1, |s| 1 + text[..s.start.min(text.len())].matches('\n').count());
            anyhow!("{file}: line {line}: {}", e.message())
        })?
    };
    let fallback = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    understand(layout, fallback).with_context(|| file.to_string())
}

fn text_of(path: &Path) -> anyhow::Result<String> {
    let file = path.display();
    let mut bytes = Vec::new();
    let open = File::open(path).map_err(|e| anyhow!("{file}: {e}"))?;
    ensure!(!open.metadata().is_ok_and(|m| m.is_dir()), "{file}: is a directory");
    open.take(BYTES_MAX + 1).read_to_end(&mut bytes).map_err(|e| anyhow!("{file}: {e}"))?;
    ensure!(bytes.len() as u64 <= BYTES_MAX, "{file}: more than {BYTES_MAX} bytes (the limit)");
    String::from_utf8(bytes).map_err(|e| anyhow!("{file}: byte {} is not UTF-8", e.utf8_error().valid_up_to()))
}

fn understand(layout: Layout, fallback: String) -> anyhow::Result<Problem> {
    let blocks = layout.block.iter().enumerate().map(|(i, e)| block(i, e)).collect::<anyhow::Result<Vec<Block>>>()?;
    let meanings = layout.block.iter().enumerate().map(|(i, e)| meaning(i, e)).collect::<anyhow::Result<Vec<Meaning>>>()?;
    let structure = Structure::try_new(blocks)?;
    let performance = layout.performance.as_ref().map(|p| Performance { inputs: p.inputs, outputs: p.outputs });
    if let Some(p) = performance {
        for (what, n) in [("inputs", p.inputs), ("outputs", p.outputs)] {
            ensure!((1..=CHANNELS_MAX).contains(&n), "performance: {n} {what} (must be 1 to {CHANNELS_MAX})");
        }
    }
    let subject = subject(&layout)?;
    let found = match &subject {
        Subject::Matrix(m) => m.shape(),
        Subject::System(s, _) => s.matrices()[3].shape(),
    };
    let extra = performance.map_or((0, 0), |p| (p.outputs, p.inputs));
    let wanted = (structure.n_z() + extra.0, structure.n_w() + extra.1);
    if found != wanted {
        let what = if matches!(subject, Subject::Matrix(_)) { "M" } else { "D" };
        let asked = if performance.is_some() { "the blocks and the performance channels" } else { "the blocks" };
        bail!("{what}: {} x {} ({asked} ask for {} x {})", found.0, found.1, wanted.0, wanted.1);
    }
    ensure!(
        performance.is_none() || matches!(subject, Subject::System(..)),
        "performance: needs a system A, B, C, D (a matrix M has no gain over frequency)"
    );
    Ok(Problem { name: layout.name.unwrap_or(fallback), subject, structure, meanings, performance })
}

/// Number and name of a block, for messages.
fn place(i: usize, e: &Entry) -> String {
    e.name.as_ref().map_or_else(|| format!("block {}", i + 1), |n| format!("block {} ({n:?})", i + 1))
}

fn block(i: usize, e: &Entry) -> anyhow::Result<Block> {
    let place = place(i, e);
    let size = |what: &str, value: Option<usize>, most: usize| {
        let n = value.unwrap_or(1);
        ensure!((1..=most).contains(&n), "{place}: {what} {n} (must be 1 to {most})");
        Ok(n)
    };
    let not_for = |what: &str, is_there: bool| {
        ensure!(!is_there, "{place}: {what} is not for kind {:?}", e.kind);
        Ok(())
    };
    match e.kind.as_str() {
        "real" | "complex" => {
            not_for("rows", e.rows.is_some())?;
            not_for("cols", e.cols.is_some())?;
            let repeats = size("repeats", e.repeats, REPEATS_MAX)?;
            Ok(if e.kind == "real" { Block::Real { repeats } } else { Block::Complex { repeats } })
        }
        "full" => {
            not_for("repeats", e.repeats.is_some())?;
            Ok(Block::Full { rows: size("rows", e.rows, CHANNELS_MAX)?, cols: size("cols", e.cols, CHANNELS_MAX)? })
        }
        other => bail!("{place}: kind {other:?} (must be \"real\", \"complex\" or \"full\")"),
    }
}

fn meaning(i: usize, e: &Entry) -> anyhow::Result<Meaning> {
    let place = place(i, e);
    let range = match (e.lower, e.upper) {
        (None, None) => None,
        (Some(lower), Some(upper)) => {
            ensure!(e.kind == "real", "{place}: lower and upper are for kind \"real\"");
            ensure!(lower.is_finite() && upper.is_finite() && lower < upper, "{place}: {lower} to {upper} (must be finite, lower < upper)");
            Some([lower, upper])
        }
        _ => bail!("{place}: lower and upper belong together"),
    };
    let name = e.name.clone().unwrap_or_else(|| format!("block {}", i + 1));
    Ok(Meaning { name, range, unit: e.unit.clone().unwrap_or_default() })
}

fn subject(layout: &Layout) -> anyhow::Result<Subject> {
    let system = [("A", &layout.a), ("B", &layout.b), ("C", &layout.c), ("D", &layout.d)];
    if let Some(m) = &layout.m {
        let extra = system.iter().find(|(_, x)| x.is_some());
        ensure!(extra.is_none(), "{} beside M (a file has either a system A, B, C, D or a matrix M)", extra.map_or("", |e| e.0));
        ensure!(layout.dt.is_none() && layout.frequency.is_none(), "dt and frequency are for a system A, B, C, D, not for a matrix M");
        return Ok(Subject::Matrix(complex(m)?));
    }
    let missing: Vec<&str> = system.iter().filter(|(_, x)| x.is_none()).map(|(n, _)| *n).collect();
    ensure!(missing.is_empty(), "no {} (a system has A, B, C and D; a matrix alone is M)", missing.join(", "));
    let mut matrices = Vec::new();
    for (what, rows) in system {
        matrices.push(real(what, rows.as_deref().unwrap_or_default())?);
    }
    let [a, b, c, d]: [DMatrix<f64>; 4] = matrices.try_into().map_err(|_| anyhow!("four matrices"))?;
    // Without states the empty matrices have no shape of their own.
    let n = a.nrows();
    let (b, c) = if n == 0 { (DMatrix::zeros(0, d.ncols()), DMatrix::zeros(d.nrows(), 0)) } else { (b, c) };
    ensure!(n <= STATES_MAX, "A: {n} states (at most {STATES_MAX})");
    let system = StateSpace::try_new([a, b, c, d], layout.dt)?;
    let limit = system.nyquist();
    let given = layout.frequency.as_ref();
    let lower = given.and_then(|f| f.lower).unwrap_or(0.0);
    let upper = given.and_then(|f| f.upper).unwrap_or(limit);
    ensure!(lower >= 0.0 && lower < upper && upper <= limit, "frequency: {lower} to {upper} rad/s (must be 0 <= lower < upper <= {limit})");
    Ok(Subject::System(system, [lower, upper]))
}

fn real(what: &str, rows: &[Vec<f64>]) -> anyhow::Result<DMatrix<f64>> {
    let cols = rows.first().map_or(0, Vec::len);
    for (i, row) in rows.iter().enumerate() {
        ensure!(row.len() == cols, "{what}: row {} has {} entries, row 1 has {cols}", i + 1, row.len());
        if let Some(j) = row.iter().position(|x| !x.is_finite()) {
            bail!("{what}: entry ({}, {}) is {} (must be finite)", i + 1, j + 1, row[j]);
        }
    }
    let most = STATES_MAX.max(CHANNELS_MAX);
    ensure!(rows.len() <= most && cols <= most, "{what}: {} x {cols} (at most {most} x {most})", rows.len());
    Ok(DMatrix::from_fn(rows.len(), cols, |i, j| rows[i][j]))
}

fn complex(m: &ComplexRows) -> anyhow::Result<CMatrix> {
    let re = real("M.re", &m.re)?;
    let im = m.im.as_ref().map_or_else(|| Ok(DMatrix::zeros(re.nrows(), re.ncols())), |rows| real("M.im", rows))?;
    let ((r, c), (p, q)) = (re.shape(), im.shape());
    ensure!((r, c) == (p, q), "M: re is {r} x {c}, im is {p} x {q} (must be equal)");
    Ok(CMatrix::from_fn(r, c, |i, j| Complex::new(re[(i, j)], im[(i, j)])))
}
