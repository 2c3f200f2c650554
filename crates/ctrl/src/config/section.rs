//! A table of a controller.toml that remembers which of its keys were asked for: the others are unknown.

use alloc::collections::{BTreeMap, BTreeSet};
use alloc::format;
use alloc::string::{String, ToString};
use alloc::vec::Vec;
use core::cell::RefCell;

use toml::de::{DeTable, DeValue};

use super::FileError;
use crate::controller::ConfigError;

/// Names of an error's numbers that are called otherwise in files.
const RENAMED: [(&str, &str); 11] = [
    ("dt", "rate_hz"),
    ("-ki", "bandwidth"),
    ("-kp", "bandwidth"),
    ("-kv", "bandwidth"),
    ("bandwidth of the observer", "observer_bandwidth"),
    ("bandwidth of the law", "bandwidth"),
    ("q_upper - q_lower", "q_upper"),
    ("q_upper - q_lower", "q_lower"),
    ("upper - lower", "upper"),
    ("component", "components"),
    ("wrench", "wrench_limit"),
];

/// A table of the file.
pub(super) struct Section<'a> {
    file: &'a str,
    text: &'a str,
    /// Path of the table, with a dot at its end; empty for the whole file.
    path: String,
    table: &'a DeTable<'a>,
    /// Where the table begins.
    start: usize,
    /// Keys of all tables that were asked for, and what each table may have.
    seen: &'a RefCell<BTreeMap<String, BTreeSet<&'static str>>>,
}

/// Calls `done` with the whole of `text`.
pub(super) fn with_root<T>(text: &str, file: &str, done: impl FnOnce(&Section<'_>) -> Result<T, FileError>) -> Result<T, FileError> {
    let parsed = DeTable::parse(text).map_err(|e| {
        let message = e.message().split_whitespace().collect::<Vec<_>>().join(" ");
        FileError { file: format!("{file}:{}", line(text, e.span().map_or(0, |s| s.start))), problem: message }
    })?;
    let seen = RefCell::default();
    done(&Section { file, text, path: String::new(), table: parsed.get_ref(), start: 0, seen: &seen })
}

fn line(text: &str, at: usize) -> usize {
    1 + text.bytes().take(at).filter(|b| *b == b'\n').count()
}

/// A number of the file; none where it is something else.
fn as_number(value: &DeValue<'_>) -> Option<f64> {
    match value {
        DeValue::Integer(x) if x.radix() == 10 => x.as_str().parse().ok(),
        DeValue::Float(x) => x.as_str().parse().ok(),
        _ => None,
    }
}

/// What is allowed, in code and in words.
pub(super) type Allowed = (fn(f64) -> bool, &'static str);

/// Any finite number.
pub(super) const FINITE: Allowed = (f64::is_finite, "must be finite");
/// Gains.
pub(super) const NOT_NEGATIVE: Allowed = (|x| x.is_finite() && x >= 0.0, "must be finite and >= 0");
/// Limits and rates.
pub(super) const POSITIVE: Allowed = (|x| x.is_finite() && x > 0.0, "must be finite and > 0");
/// Limits that may be none.
pub(super) const UP_TO_INFINITY: Allowed = (|x| x > 0.0, "must be > 0, or inf for no limit");
/// Ends of ranges.
pub(super) const ANY: Allowed = (|x| !x.is_nan(), "must be a number");

impl<'a> Section<'a> {
    fn ask(&self, key: &'static str) -> Option<&'a toml::Spanned<DeValue<'a>>> {
        self.seen.borrow_mut().entry(self.path.clone()).or_default().insert(key);
        self.table.get(key)
    }

    fn error(&self, at: usize, problem: String) -> FileError {
        FileError { file: format!("{}:{}", self.file, line(self.text, at)), problem }
    }

    /// An error of the whole table.
    pub(super) fn whole(&self, problem: &str) -> FileError {
        self.error(self.start, problem.to_string())
    }

    fn bad(&self, key: &str, value: &toml::Spanned<DeValue<'_>>, limit: &str) -> FileError {
        let span = value.span();
        let shown: String = self.text.get(span.clone()).unwrap_or_default().split_whitespace().collect::<Vec<_>>().join(" ");
        let shown: String = shown.chars().take(60).collect();
        self.error(span.start, format!("{}{key} = {shown} ({limit})", self.path))
    }

    fn missing(&self, key: &str, limit: &str) -> FileError {
        self.whole(&format!("{}{key} is missing ({limit})", self.path))
    }

    /// Whether the table has the key.
    pub(super) fn has(&self, key: &'static str) -> bool {
        self.ask(key).is_some()
    }

    /// One number, where stated.
    pub(super) fn maybe(&self, key: &'static str, (is_good, limit): Allowed) -> Result<Option<f64>, FileError> {
        let Some(value) = self.ask(key) else { return Ok(None) };
        match as_number(value.get_ref()).filter(|x| is_good(*x)) {
            Some(x) => Ok(Some(x)),
            None => Err(self.bad(key, value, limit)),
        }
    }

    /// One number.
    pub(super) fn number(&self, key: &'static str, allowed: Allowed) -> Result<f64, FileError> {
        self.maybe(key, allowed)?.ok_or_else(|| self.missing(key, allowed.1))
    }

    /// `K` numbers, or one for all of them, where stated.
    pub(super) fn maybe_each<const K: usize>(&self, key: &'static str, (is_good, limit): Allowed) -> Result<Option<[f64; K]>, FileError> {
        let Some(value) = self.ask(key) else { return Ok(None) };
        if let DeValue::Array(list) = value.get_ref() {
            if list.len() != K {
                return Err(self.bad(key, value, &format!("must be one number or {K}")));
            }
            let mut out = [0.0; K];
            for (x, item) in out.iter_mut().zip(list.iter()) {
                *x = as_number(item.get_ref()).filter(|x| is_good(*x)).ok_or_else(|| self.bad(key, item, limit))?;
            }
            return Ok(Some(out));
        }
        match as_number(value.get_ref()).filter(|x| is_good(*x)) {
            Some(x) => Ok(Some([x; K])),
            None => Err(self.bad(key, value, limit)),
        }
    }

    /// `K` numbers, or one for all of them.
    pub(super) fn each<const K: usize>(&self, key: &'static str, allowed: Allowed) -> Result<[f64; K], FileError> {
        self.maybe_each(key, allowed)?.ok_or_else(|| self.missing(key, allowed.1))
    }

    /// `R` rows of `K` numbers.
    pub(super) fn matrix<const R: usize, const K: usize>(&self, key: &'static str) -> Result<[[f64; K]; R], FileError> {
        let rows: Vec<[f64; K]> = self.rows(key)?;
        let n = rows.len();
        rows.try_into().map_err(|_| self.whole(&format!("{}{key} has {n} rows (must have {R})", self.path)))
    }

    /// Any number of rows of `K` finite numbers.
    pub(super) fn rows<const K: usize>(&self, key: &'static str) -> Result<Vec<[f64; K]>, FileError> {
        let limit = format!("must be a list of rows of {K} finite numbers");
        let value = self.ask(key).ok_or_else(|| self.missing(key, &limit))?;
        let DeValue::Array(list) = value.get_ref() else { return Err(self.bad(key, value, &limit)) };
        let mut out = Vec::new();
        for row in list.iter() {
            let DeValue::Array(items) = row.get_ref() else { return Err(self.bad(key, row, &limit)) };
            let numbers: Option<Vec<f64>> = items.iter().map(|x| as_number(x.get_ref()).filter(|x| x.is_finite())).collect();
            let numbers: Option<[f64; K]> = numbers.and_then(|x| x.try_into().ok());
            out.push(numbers.ok_or_else(|| self.bad(key, row, &limit))?);
        }
        Ok(out)
    }

    /// A text.
    pub(super) fn text(&self, key: &'static str) -> Result<String, FileError> {
        let value = self.ask(key).ok_or_else(|| self.missing(key, "must be a text"))?;
        value.get_ref().as_str().map(ToString::to_string).ok_or_else(|| self.bad(key, value, "must be a text"))
    }

    /// One of some texts, where stated.
    pub(super) fn choice(&self, key: &'static str, known: &[&str]) -> Result<Option<String>, FileError> {
        let Some(value) = self.ask(key) else { return Ok(None) };
        match value.get_ref().as_str().filter(|x| known.contains(x)) {
            Some(x) => Ok(Some(x.to_string())),
            None => Err(self.bad(key, value, &format!("must be one of: {}", known.join(", ")))),
        }
    }

    /// Texts, where stated.
    pub(super) fn texts(&self, key: &'static str) -> Result<Option<Vec<String>>, FileError> {
        let Some(value) = self.ask(key) else { return Ok(None) };
        let list = value.get_ref().as_array().ok_or_else(|| self.bad(key, value, "must be a list of texts"))?;
        let text = |x: &toml::Spanned<DeValue<'_>>| x.get_ref().as_str().map(ToString::to_string);
        list.iter().map(|x| text(x).ok_or_else(|| self.bad(key, x, "must be a text"))).collect::<Result<Vec<_>, _>>().map(Some)
    }

    /// A table inside this one, where there is one.
    pub(super) fn section(&self, key: &'static str) -> Result<Option<Section<'a>>, FileError> {
        let Some(value) = self.ask(key) else { return Ok(None) };
        let table = value.get_ref().as_table().ok_or_else(|| self.bad(key, value, "must be a table"))?;
        Ok(Some(self.inside(format!("{}{key}.", self.path), table, value.span().start)))
    }

    /// A table inside this one.
    pub(super) fn must(&self, key: &'static str) -> Result<Section<'a>, FileError> {
        self.section(key)?.ok_or_else(|| self.missing(key, "must be a table"))
    }

    /// Tables inside this one, in order.
    pub(super) fn sections(&self, key: &'static str) -> Result<Vec<Section<'a>>, FileError> {
        let value = self.ask(key).ok_or_else(|| self.missing(key, "must be a list of tables"))?;
        let list = value.get_ref().as_array().ok_or_else(|| self.bad(key, value, "must be a list of tables"))?;
        let mut out = Vec::new();
        for (i, item) in list.iter().enumerate() {
            let table = item.get_ref().as_table().ok_or_else(|| self.bad(key, item, "must be a table"))?;
            out.push(self.inside(format!("{}{key}[{i}].", self.path), table, item.span().start));
        }
        Ok(out)
    }

    fn inside(&self, path: String, table: &'a DeTable<'a>, start: usize) -> Section<'a> {
        // Known from now on, though nothing may be asked of it.
        self.seen.borrow_mut().entry(path.clone()).or_default();
        Section { path, table, start, ..*self }
    }

    /// What a controller refused, at the line of the number where the file has it.
    pub(super) fn refusal(&self, e: &ConfigError) -> FileError {
        let renamed = RENAMED.iter().filter(|(name, _)| *name == e.what).map(|(_, key)| *key);
        let at = renamed.chain([e.what]).find_map(|key| find(self.table, key)).unwrap_or(self.start);
        self.error(at, format!("{}{e}", self.path))
    }

    /// Refuses the first key that nobody asked for, in the whole file.
    pub(super) fn finish(&self) -> Result<(), FileError> {
        self.unknown(&self.path, self.table)
    }

    fn unknown(&self, path: &str, table: &DeTable<'_>) -> Result<(), FileError> {
        let seen = self.seen.borrow();
        for (key, value) in table {
            let name: &str = key.get_ref();
            if !seen.get(path).is_some_and(|known| known.contains(name)) {
                let known: Vec<&str> = seen.get(path).into_iter().flatten().copied().collect();
                let shown: String = name.chars().take(60).collect();
                let problem = format!("{path}{shown} is unknown (has: {})", known.join(", "));
                return Err(self.error(key.span().start, problem));
            }
            match value.get_ref() {
                DeValue::Table(inner) => self.unknown(&format!("{path}{name}."), inner)?,
                DeValue::Array(list) => {
                    for (i, item) in list.iter().enumerate() {
                        // Lists of numbers hold inline tables only by mistake, and those were refused when they were read.
                        if let DeValue::Table(inner) = item.get_ref() {
                            self.unknown(&format!("{path}{name}[{i}]."), inner)?;
                        }
                    }
                }
                _ => {}
            }
        }
        Ok(())
    }
}

/// Where a key is stated first, in the table or below.
fn find(table: &DeTable<'_>, wanted: &str) -> Option<usize> {
    table.iter().find(|(key, _)| key.get_ref() == wanted).map(|(key, _)| key.span().start).or_else(|| {
        table.iter().find_map(|(_, value)| match value.get_ref() {
            DeValue::Table(inner) => find(inner, wanted),
            DeValue::Array(list) => list.iter().find_map(|item| item.get_ref().as_table().and_then(|inner| find(inner, wanted))),
            _ => None,
        })
    })
}
