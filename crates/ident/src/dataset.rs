//! Time-aligned named signals of one recording: the only input of this crate. Where they came from (CSV, MCAP, a simulation) is
//! not known here.

use alloc::collections::BTreeMap;

/// What the `tau.*` columns of a recording hold.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum EffortKind {
    /// The effort as measured (current × nominal constant × gear, or a force cell).
    Measured,
    /// The effort as commanded, before the drive's saturation.
    Commanded,
}

/// A known mass fixed to a link for one recording.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct KnownLoad {
    /// Link that carries the mass.
    pub link: String,
    /// Mass `[kg]`.
    pub mass: f64,
    /// Its centre in the link's frame `[m]`.
    #[serde(default)]
    pub xyz: [f64; 3],
}

/// What a recording says of itself besides its signals; every field is optional.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Meta {
    /// What `tau.*` holds, where stated.
    pub tau: Option<EffortKind>,
    /// A known mass fixed for this recording.
    pub load: Option<KnownLoad>,
    /// Gravity in the root link's frame `[m/s²]`, where the base was tilted on purpose.
    pub gravity: Option<[f64; 3]>,
    /// Recordings of one session share friction state.
    pub session: Option<String>,
    /// Controller file that produced the recording.
    pub controller: Option<String>,
    /// Other `key = value` lines, kept as text.
    pub other: BTreeMap<String, String>,
}

/// One recording: equally long named signals over one time axis.
///
/// Signal names are the column names of the CSV form (`q.<joint>`, `tau.<joint>`, `pose.<sensor>.x`, …); `t` is [`Recording::time`].
/// A missing sample is NaN. Units are SI.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Recording {
    /// How the user named it (the path as given).
    pub name: String,
    /// Sample times `[s]`, strictly increasing.
    pub time: Vec<f64>,
    /// Signals by column name, each as long as `time`.
    pub signals: BTreeMap<String, Vec<f64>>,
    /// What the recording says of itself.
    pub meta: Meta,
}

impl Recording {
    /// The signal of that column name, if the recording has it.
    #[must_use]
    pub fn signal(&self, name: &str) -> Option<&[f64]> {
        self.signals.get(name).map(Vec::as_slice)
    }

    /// Names of the columns for a message, the first dozen.
    #[must_use]
    pub fn columns(&self) -> String {
        const MOST: usize = 12;
        let mut names: Vec<&str> = self.signals.keys().take(MOST).map(String::as_str).collect();
        let more = self.signals.len().saturating_sub(MOST);
        let rest = format!("and {more} more");
        if more > 0 {
            names.push(&rest);
        }
        if names.is_empty() { "none but t".to_string() } else { names.join(", ") }
    }

    /// Number of samples.
    #[must_use]
    pub fn len(&self) -> usize {
        self.time.len()
    }

    /// Whether there is no sample at all.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.time.is_empty()
    }

    /// Time from the first to the last sample `[s]`; 0 with fewer than two samples.
    #[must_use]
    pub fn duration(&self) -> f64 {
        match (self.time.first(), self.time.last()) {
            (Some(first), Some(last)) => last - first,
            _ => 0.0,
        }
    }
}
