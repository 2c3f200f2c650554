//! The `key = value` pairs of a recording: the same keys as CSV lines and as the `pkm` metadata record of an MCAP file.

use alloc::collections::BTreeMap;

use pkm_ident::{EffortKind, KnownLoad, Meta};

use crate::error::WriteError;

/// Keys with a meaning of their own; all others are kept as text.
pub(crate) const KNOWN: [&str; 5] = ["tau", "load", "gravity", "session", "controller"];

/// Keys the MCAP writer sets itself.
pub(crate) const VERSION: &str = "version";
/// Whole seconds to add to a stamp to get the recording's time.
pub(crate) const TIME_OFFSET: &str = "time_offset";

/// Whether a key is one word: what a metadata line needs to be told from a comment.
pub(crate) fn is_word(key: &str) -> bool {
    !key.is_empty() && key.chars().all(|c| c.is_alphanumeric() || matches!(c, '_' | '-' | '.'))
}

/// The value of `text` read as TOML, if it is any.
pub(crate) fn toml_value(text: &str) -> Option<toml::Value> {
    toml::from_str::<toml::Table>(&format!("v = {text}")).ok()?.remove("v")
}

/// Sets one key from its text; the error says what the key takes.
pub(crate) fn set(meta: &mut Meta, key: &str, text: &str) -> Result<(), String> {
    match key {
        "tau" => {
            meta.tau = Some(match text {
                "measured" => EffortKind::Measured,
                "commanded" => EffortKind::Commanded,
                _ => return Err("measured or commanded".to_string()),
            });
        }
        "load" => meta.load = Some(load(text)?),
        "gravity" => meta.gravity = Some(gravity(text)?),
        "session" => meta.session = Some(text.to_string()),
        "controller" => meta.controller = Some(text.to_string()),
        _ => {
            meta.other.insert(key.to_string(), text.to_string());
        }
    }
    Ok(())
}

fn load(text: &str) -> Result<KnownLoad, String> {
    const FORM: &str = "{link = \"<name>\", mass = <kg>, xyz = [<m>, <m>, <m>]}";
    let value = toml_value(text).ok_or_else(|| FORM.to_string())?;
    let load: KnownLoad = value.try_into().map_err(|e: toml::de::Error| format!("{FORM}: {}", crate::error::clip(e.message())))?;
    if load.mass.is_finite() && load.xyz.iter().all(|x| x.is_finite()) { Ok(load) } else { Err(format!("{FORM}: not finite")) }
}

fn gravity(text: &str) -> Result<[f64; 3], String> {
    const FORM: &str = "[<m/s²>, <m/s²>, <m/s²>]";
    let value = toml_value(text).ok_or_else(|| FORM.to_string())?;
    let gravity: [f64; 3] = value.try_into().map_err(|_| FORM.to_string())?;
    if gravity.iter().all(|x| x.is_finite()) { Ok(gravity) } else { Err(format!("{FORM}, finite")) }
}

/// One metadata pair on its way out.
pub(crate) struct Pair {
    /// One word.
    pub(crate) key: String,
    /// The text: TOML for `load` and `gravity`, the string itself otherwise.
    pub(crate) text: String,
}

impl Pair {
    /// The value as a metadata line of a CSV file carries it.
    pub(crate) fn line_value(&self) -> String {
        match self.key.as_str() {
            "load" | "gravity" | "tau" => self.text.clone(),
            _ => quote(&self.text),
        }
    }
}

/// All pairs of a recording in writing order; `keys` overrides `meta.other`.
pub(crate) fn to_pairs(file: &str, meta: &Meta, keys: &BTreeMap<String, String>) -> Result<Vec<Pair>, WriteError> {
    let bad = |key: &str| WriteError::Key { file: file.to_string(), key: key.to_string() };
    let mut pairs = Vec::new();
    let mut push = |key: &str, text: String| pairs.push(Pair { key: key.to_string(), text });
    if let Some(kind) = meta.tau {
        let text = match kind {
            EffortKind::Measured => "measured",
            EffortKind::Commanded => "commanded",
        };
        push("tau", text.to_string());
    }
    if let Some(load) = &meta.load {
        if !load.mass.is_finite() || !load.xyz.iter().all(|x| x.is_finite()) {
            return Err(bad("load"));
        }
        // Debug prints the shortest form that reads back to the same bits, and for a list it is TOML.
        push("load", format!("{{link = {}, mass = {:?}, xyz = {:?}}}", quote(&load.link), load.mass, load.xyz));
    }
    if let Some(gravity) = meta.gravity {
        if !gravity.iter().all(|x| x.is_finite()) {
            return Err(bad("gravity"));
        }
        push("gravity", format!("{gravity:?}"));
    }
    for (key, text) in [("session", &meta.session), ("controller", &meta.controller)] {
        if let Some(text) = text {
            push(key, text.clone());
        }
    }
    let mut others: BTreeMap<&str, &str> = meta.other.iter().map(|(k, v)| (k.as_str(), v.as_str())).collect();
    others.extend(keys.iter().map(|(k, v)| (k.as_str(), v.as_str())));
    for (key, text) in others {
        if !is_word(key) || KNOWN.contains(&key) || key == VERSION || key == TIME_OFFSET {
            return Err(bad(key));
        }
        push(key, text.to_string());
    }
    Ok(pairs)
}

/// A TOML basic string on one line (the toml crate would write a long text on several).
fn quote(text: &str) -> String {
    let mut quoted = String::from("\"");
    for c in text.chars() {
        match c {
            '"' => quoted.push_str("\\\""),
            '\\' => quoted.push_str("\\\\"),
            c if c.is_control() => quoted.push_str(&format!("\\u{:04X}", u32::from(c))),
            c => quoted.push(c),
        }
    }
    quoted.push('"');
    quoted
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pairs_read_back_to_the_same_meta() {
        let mut meta = Meta {
            tau: Some(EffortKind::Commanded),
            load: Some(KnownLoad { link: "pl\"at\\form".into(), mass: 2.0, xyz: [0.0, 1e-7, 0.1] }),
            gravity: Some([0.1, 1e17, -9.81]),
            session: Some("two\nlines".into()),
            controller: Some("controller.toml".into()),
            other: BTreeMap::new(),
        };
        meta.other.insert("note".into(), "a = \"b\"".into());
        let mut back = Meta::default();
        for pair in to_pairs("x", &meta, &BTreeMap::new()).unwrap() {
            set(&mut back, &pair.key, &pair.text).unwrap();
        }
        assert_eq!(back, meta);
    }

    #[test]
    fn a_key_that_is_taken_cannot_be_written() {
        for key in ["tau", "version", "time_offset", "two words", ""] {
            let keys = BTreeMap::from([(key.to_string(), "x".to_string())]);
            assert!(to_pairs("x", &Meta::default(), &keys).is_err(), "{key}");
        }
    }
}
