//! What a reproduction says: rows with a number of ours, the paper's, and what follows.

/// What a number of ours is held against.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Gate {
    /// Within so much of the paper's (or the checked) number.
    Within(f64),
    /// At most this number.
    AtMost(f64),
    /// At least this number.
    AtLeast(f64),
    /// Any number: it is told, not judged.
    Told,
}

/// What follows from a row.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Verdict {
    /// Our number agrees with the paper's, or with what its equations give once misprints are mended.
    Reproduced,
    /// The paper's conclusion holds, its number does not come out; the row says why.
    ConclusionHolds,
    /// What the paper says does not come out; the row says why.
    NotReproducible,
    /// Our number misses its gate: something is wrong here.
    Missed,
}

impl Verdict {
    /// As a word of the table.
    #[must_use]
    pub const fn word(self) -> &'static str {
        match self {
            Self::Reproduced => "reproduced",
            Self::ConclusionHolds => "conclusion holds",
            Self::NotReproducible => "not reproducible",
            Self::Missed => "MISSED",
        }
    }
}

/// One number of a paper and ours.
#[derive(Debug, Clone, PartialEq)]
pub struct Row {
    /// Where in the paper: equation, table, figure or section.
    pub place: &'static str,
    /// What is compared, unit included.
    pub what: String,
    /// Ours.
    pub ours: f64,
    /// The paper's, as printed; none where it prints none.
    pub paper: Option<f64>,
    /// What ours is held against.
    pub gate: Gate,
    /// The number that [`Gate::Within`] is about: the paper's or, where that is a misprint, the checked one; not a number without either.
    pub target: f64,
    /// What follows.
    pub verdict: Verdict,
    /// Why the verdict is not "reproduced", or what had to be mended; may be empty.
    pub why: String,
}

impl Row {
    /// A row that is reproduced if `gate` is met; `Gate::Within` is about the paper's number.
    #[must_use]
    pub fn new(place: &'static str, what: impl Into<String>, ours: f64, paper: Option<f64>, gate: Gate) -> Self {
        Self::held_against(place, what, ours, paper, (gate, paper.unwrap_or(f64::NAN)))
    }

    /// As [`Row::new`], where `Gate::Within` is about a checked number instead of the printed one.
    #[must_use]
    pub fn held_against(place: &'static str, what: impl Into<String>, ours: f64, paper: Option<f64>, (gate, target): (Gate, f64)) -> Self {
        let is_met = match gate {
            Gate::Within(width) => (ours - target).abs() <= width,
            Gate::AtMost(most) => ours <= most,
            Gate::AtLeast(least) => ours >= least,
            Gate::Told => ours.is_finite(),
        };
        let verdict = if is_met { Verdict::Reproduced } else { Verdict::Missed };
        Self { place, what: what.into(), ours, paper, gate, target, verdict, why: String::new() }
    }

    /// Says what had to be mended, or why.
    #[must_use]
    pub fn because(mut self, why: impl Into<String>) -> Self {
        self.why = why.into();
        self
    }

    /// The gate is the paper's conclusion, not its number. A missed gate stays missed.
    #[must_use]
    pub fn conclusion_only(mut self, why: impl Into<String>) -> Self {
        if self.verdict == Verdict::Reproduced {
            self.verdict = Verdict::ConclusionHolds;
        }
        self.because(why)
    }

    /// What the paper says does not come out: ours stands beside it, held against what is expected instead. A missed gate stays missed.
    #[must_use]
    pub fn not_reproducible(mut self, why: impl Into<String>) -> Self {
        if self.verdict == Verdict::Reproduced {
            self.verdict = Verdict::NotReproducible;
        }
        self.because(why)
    }
}

/// A curve of a plot: a label and its points.
#[derive(Debug, Clone, PartialEq)]
pub struct Line {
    /// What it shows.
    pub label: String,
    /// Its points, x first.
    pub points: Vec<(f64, f64)>,
}

/// A plot of a reproduction.
#[derive(Debug, Clone, PartialEq)]
pub struct Plot {
    /// What it shows and where the paper does.
    pub title: String,
    /// Quantity and unit along x.
    pub x_label: String,
    /// Quantity and unit along y.
    pub y_label: String,
    /// At most three lines.
    pub lines: Vec<Line>,
}

/// A paper's experiments, done again.
#[derive(Debug, Clone, PartialEq)]
pub struct Reproduction {
    /// Every compared number.
    pub rows: Vec<Row>,
    /// Pictures.
    pub plots: Vec<Plot>,
}

impl Reproduction {
    /// Whether no row misses its gate.
    #[must_use]
    pub fn is_sound(&self) -> bool {
        self.rows.iter().all(|row| row.verdict != Verdict::Missed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_gate_decides_and_a_miss_cannot_be_talked_away() {
        let met = Row::new("Table 1", "ratio", 4.0, Some(3.7), Gate::AtLeast(3.0));
        assert_eq!(met.verdict, Verdict::Reproduced);
        assert_eq!(met.clone().conclusion_only("another filter").verdict, Verdict::ConclusionHolds);
        assert_eq!(met.not_reproducible("no figure").verdict, Verdict::NotReproducible);
        for gate in [Gate::AtLeast(5.0), Gate::AtMost(1.0), Gate::Within(0.1)] {
            let missed = Row::new("Table 1", "ratio", 4.0, Some(3.7), gate);
            assert_eq!(missed.verdict, Verdict::Missed, "{gate:?}");
            assert_eq!(missed.clone().conclusion_only("x").verdict, Verdict::Missed);
            assert_eq!(missed.not_reproducible("x").verdict, Verdict::Missed);
        }
    }

    #[test]
    fn numbers_that_are_none_miss_every_gate() {
        for gate in [Gate::AtLeast(0.0), Gate::AtMost(0.0), Gate::Within(1.0), Gate::Told] {
            assert_eq!(Row::new("eq. 1", "x", f64::NAN, Some(0.0), gate).verdict, Verdict::Missed);
        }
        assert_eq!(Row::new("eq. 1", "x", 1.0, None, Gate::Within(1.0)).verdict, Verdict::Missed, "nothing to be near to");
    }
}
