//! The measured numbers as Markdown.

use core::fmt::Write;

use crate::ours::PARTS;

/// One algorithm on one robot.
pub(crate) struct Row {
    pub(crate) robot: String,
    pub(crate) algorithm: &'static str,
    /// Nanoseconds per call.
    pub(crate) ours: f64,
    /// Nanoseconds per call and which way was the fastest, for every peer.
    pub(crate) theirs: Vec<(f64, &'static str)>,
    /// Largest relative difference of the numbers.
    pub(crate) apart: f64,
}

impl Row {
    fn best(&self) -> Option<(f64, &'static str)> {
        self.theirs.iter().copied().min_by(|a, b| a.0.total_cmp(&b.0))
    }

    fn ratio(&self) -> String {
        self.best().map_or("–".to_string(), |(best, _)| format!("{:.2}", self.ours / best))
    }

    /// For the terminal, while it runs.
    pub(crate) fn short(&self) -> String {
        let theirs: Vec<String> = self.theirs.iter().map(|(ns, way)| format!("{ns:.0} ({way})")).collect();
        let (robot, name, ours, apart) = (&self.robot, self.algorithm, self.ours, self.apart);
        format!("{robot:12} {name:50} {ours:7.0} ns, theirs {}, ratio {}, apart {apart:.0e}", theirs.join(", "), self.ratio())
    }
}

/// One step of a computed-torque controller on one robot.
pub(crate) struct Budget {
    pub(crate) robot: String,
    /// Age of the previous sample `[ms]`.
    pub(crate) before_ms: f64,
    /// Mean number of Newton steps, here and there.
    pub(crate) steps: f64,
    pub(crate) their_steps: Option<f64>,
    /// Nanoseconds of each part with those before it.
    pub(crate) parts: [f64; PARTS.len()],
}

/// Both tables; `peers` are the names of the other columns.
pub(crate) fn markdown(peers: &[&str], rows: &[Row], budgets: &[Budget]) -> String {
    let mut out = String::new();
    let heads: String = peers.iter().map(|p| format!(" {p} |")).collect();
    let _ = writeln!(out, "| robot | algorithm | pkm-dyn, ns |{heads} ours / their best | numbers apart |");
    let _ = writeln!(out, "|---|---|---|{}---|---|", "---|".repeat(peers.len()));
    for row in rows {
        let theirs: String = row.theirs.iter().map(|(ns, _)| format!(" {ns:.0} |")).collect();
        let way = row.best().map_or("", |(_, way)| way.rsplit_once('_').map_or("", |(_, last)| last));
        let note = if way == "world" || way == "local" { format!(" ({})", way.to_uppercase()) } else { String::new() };
        let (robot, name, ours, apart) = (&row.robot, row.algorithm, row.ours, row.apart);
        let _ = writeln!(out, "| {robot} | {name}{note} | {ours:.0} |{theirs} {} | {apart:.0e} |", row.ratio());
    }
    let _ = writeln!(out, "\nOne step of a computed-torque controller in pkm-dyn, ns, each column with those before it:\n");
    let heads: String = PARTS.iter().map(|(name, _)| format!(" {name} |")).collect();
    let _ = writeln!(out, "| robot | previous sample | Newton steps (theirs) |{heads}");
    let _ = writeln!(out, "|---|---|---|{}", "---|".repeat(PARTS.len()));
    for b in budgets {
        let parts: String = b.parts.iter().map(|ns| format!(" {ns:.0} |")).collect();
        let theirs = b.their_steps.map_or("–".to_string(), |s| format!("{s:.2}"));
        let _ = writeln!(out, "| {} | {} ms | {:.2} ({theirs}) |{parts}", b.robot, b.before_ms, b.steps);
    }
    out
}
