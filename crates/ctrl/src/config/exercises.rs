//! `[[phase]]`: what every coordinate of the task does, and for how long.

use alloc::format;
use alloc::vec::Vec;

use super::FileError;
use super::section::{FINITE, NOT_NEGATIVE, POSITIVE, Section};
use crate::exercise::{Assistance, Channel, Phase, Resistance, Script, Wave};

/// What a coordinate can do.
const KINDS: [&str; 4] = ["position", "force", "resist", "assist"];

pub(super) fn script<const M: usize>(root: &Section<'_>) -> Result<Script<M>, FileError> {
    let mut phases = Vec::new();
    for s in root.sections("phase")? {
        let channels = s.sections("channels")?.iter().map(channel).collect::<Result<Vec<_>, _>>()?;
        let n = channels.len();
        let channels = channels.try_into().map_err(|_| s.whole(&format!("channels: {n} of them (must be {M}: one per coordinate)")))?;
        let ramp_s = s.maybe("ramp_s", NOT_NEGATIVE)?.unwrap_or(0.0);
        phases.push(Phase { duration_s: s.number("duration_s", POSITIVE)?, ramp_s, channels });
    }
    Script::try_new(&phases).map_err(|e| root.refusal(&e))
}

fn wave(s: &Section<'_>) -> Result<Wave, FileError> {
    let or_zero = |key| Ok(s.maybe(key, FINITE)?.unwrap_or(0.0));
    Ok(Wave { mean: or_zero("mean")?, amplitude: or_zero("amplitude")?, w: or_zero("w")? })
}

fn channel(s: &Section<'_>) -> Result<Channel, FileError> {
    let kind = s.choice("kind", &KINDS)?.ok_or_else(|| s.whole(&format!("kind is missing (one of: {})", KINDS.join(", "))))?;
    let or_zero = |key, allowed| Ok::<f64, FileError>(s.maybe(key, allowed)?.unwrap_or(0.0));
    Ok(match kind.as_str() {
        "position" => Channel::Position(wave(s)?),
        "force" => Channel::Force(wave(s)?),
        "resist" => Channel::Resist(Resistance {
            load: or_zero("load", FINITE)?,
            stiffness: or_zero("stiffness", NOT_NEGATIVE)?,
            centre: or_zero("centre", FINITE)?,
            damping: or_zero("damping", NOT_NEGATIVE)?,
        }),
        _ => Channel::Assist(Assistance {
            path: wave(s)?,
            tolerance: or_zero("tolerance", NOT_NEGATIVE)?,
            stiffness: or_zero("stiffness", NOT_NEGATIVE)?,
            learning: or_zero("learning", NOT_NEGATIVE)?,
            forgetting_s: s.maybe("forgetting_s", POSITIVE)?.unwrap_or(1.0),
            damping: or_zero("damping", NOT_NEGATIVE)?,
            most: s.number("most", NOT_NEGATIVE)?,
        }),
    })
}
