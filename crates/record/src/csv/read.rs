//! CSV to recording. By lines, not by the csv crate: its records do not know their line once a comment stands between.

use alloc::collections::BTreeMap;

use pkm_ident::{Meta, Recording};

use crate::error::{ReadError, clip, list};
use crate::meta;

/// Reads a whole file's bytes; `file` names it in the recording and in errors.
pub(crate) fn parse(file: &str, bytes: &[u8]) -> Result<Recording, ReadError> {
    let text = bytes.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(bytes);
    if text.trim_ascii().is_empty() {
        return Err(ReadError::Empty { file: file.to_string() });
    }
    let mut lines =
        text.split(|b| *b == b'\n').enumerate().map(|(k, line)| (k + 1, line.trim_ascii())).filter(|(_, line)| !line.is_empty());
    let mut meta = Meta::default();
    let mut seen = Vec::new();
    let (line, header) = loop {
        let Some((line, content)) = lines.next() else {
            return Err(ReadError::NoHeader { file: file.to_string() });
        };
        let at = Place { file, line };
        match comment(content) {
            Some(Comment::Plain(text)) => metadata(&at, at.utf8(text)?, (&mut meta, &mut seen))?,
            Some(Comment::Quoted) => metadata(&at, &unquoted(&at, content)?, (&mut meta, &mut seen))?,
            None => break (line, content),
        }
    };
    let mut table = Table::new(Place { file, line }, header, text.len())?;
    for (line, content) in lines {
        if comment(content).is_none() {
            table.push(&Place { file, line }, content)?;
        }
    }
    table.finish(file, meta)
}

/// A line that is no row.
enum Comment<'a> {
    /// What follows its `#`.
    Plain(&'a [u8]),
    /// The whole line is a quoted field, and empty ones, as a spreadsheet writes a comment that it was given.
    Quoted,
}

/// Spreadsheets put a comment with a comma or a quote in it into quotes, and commas behind any, one per column of the widest row.
fn comment(content: &[u8]) -> Option<Comment<'_>> {
    if let Some(text) = content.strip_prefix(b"#") {
        let kept = text.iter().rposition(|b| *b != b',').map_or(0, |last| last + 1);
        return Some(Comment::Plain(&text[..kept]));
    }
    content.strip_prefix(b"\"").is_some_and(|field| field.trim_ascii_start().starts_with(b"#")).then_some(Comment::Quoted)
}

/// What follows the `#` of a quoted comment: its first field, in which two quotes are one.
fn unquoted(at: &Place<'_>, content: &[u8]) -> Result<String, ReadError> {
    let record = fields(at, at.utf8(content)?)?;
    let text = record.get(0).unwrap_or_default().trim_start();
    Ok(text.strip_prefix('#').unwrap_or(text).to_string())
}

/// Where a message points to.
struct Place<'a> {
    file: &'a str,
    line: usize,
}

impl Place<'_> {
    fn file(&self) -> String {
        self.file.to_string()
    }

    fn utf8<'b>(&self, bytes: &'b [u8]) -> Result<&'b str, ReadError> {
        core::str::from_utf8(bytes).map_err(|_| ReadError::NotUtf8 { file: self.file(), line: self.line })
    }
}

/// Takes one `#` line: a pair if its key is one word, else a comment.
fn metadata(at: &Place<'_>, comment: &str, into: (&mut Meta, &mut Vec<String>)) -> Result<(), ReadError> {
    let (meta, seen) = into;
    let Some((key, raw)) = comment.split_once('=') else { return Ok(()) };
    let (key, raw) = (key.trim(), raw.trim());
    if !meta::is_word(key) {
        return Ok(());
    }
    let bad =
        |wants: String| ReadError::Metadata { at: format!("{} line {}", at.file, at.line), key: key.to_string(), value: clip(raw), wants };
    if meta::KNOWN.contains(&key) {
        if seen.iter().any(|k| k == key) {
            return Err(ReadError::DuplicateKey { file: at.file(), line: at.line, key: key.to_string() });
        }
        seen.push(key.to_string());
    }
    let value = meta::toml_value(raw);
    if matches!(key, "session" | "controller") {
        let is_word_or_date = raw.chars().all(|c| !c.is_whitespace()) && !raw.is_empty();
        let is_text = match &value {
            Some(toml::Value::Array(_) | toml::Value::Table(_) | toml::Value::Boolean(_)) => false,
            Some(_) => true,
            None => is_word_or_date,
        };
        if !is_text {
            return Err(bad("a text in quotes or one bare word".to_string()));
        }
    }
    let text = match &value {
        Some(toml::Value::String(text)) => text,
        _ => raw,
    };
    meta::set(meta, key, text).map_err(bad)
}

/// Columns as they fill up.
struct Table {
    names: Vec<String>,
    columns: Vec<Vec<f64>>,
    time: usize,
}

impl Table {
    fn new(at: Place<'_>, header: &[u8], file_bytes: usize) -> Result<Self, ReadError> {
        let names = names(&at, at.utf8(header)?)?;
        let Some(time) = names.iter().position(|n| n == "t") else {
            let is_one = |with: char| names.len() == 1 && names[0].contains(with);
            let hint = if is_one(';') || is_one('\t') { ": fields must be separated by commas" } else { "" };
            return Err(ReadError::MissingTime { file: at.file(), line: at.line, found: list(names.iter().map(String::as_str)), hint });
        };
        // A guess, bounded by the file itself: two bytes are the least a field takes.
        let rows = file_bytes / (2 * names.len().max(1)) / 4;
        let columns = names.iter().map(|_| Vec::with_capacity(rows)).collect();
        Ok(Self { names, columns, time })
    }

    fn push(&mut self, at: &Place<'_>, content: &[u8]) -> Result<(), ReadError> {
        let wanted = self.columns.len();
        let mut found = 0;
        for field in content.split(|b| *b == b',') {
            if let Some(column) = self.columns.get_mut(found) {
                let name = self.names.get(found).map_or("", String::as_str);
                match number(field) {
                    Ok(value) => column.push(value),
                    // A wrong number of fields explains a wrong field better than the reverse.
                    Err(_) if content.split(|b| *b == b',').count() != wanted => {}
                    Err(bad) => return Err(bad.at(at, name, field)),
                }
            }
            found += 1;
        }
        if found != wanted {
            return Err(ReadError::FieldCount { file: at.file(), line: at.line, found, wanted });
        }
        self.check_time(at, content)
    }

    fn check_time(&self, at: &Place<'_>, content: &[u8]) -> Result<(), ReadError> {
        let times = self.columns.get(self.time).map(Vec::as_slice).unwrap_or_default();
        match *times {
            [.., t] if t.is_nan() => {
                let field = content.split(|b| *b == b',').nth(self.time).unwrap_or_default();
                Err(Bad::NotFinite.at(at, "t", field))
            }
            [.., before, t] if t <= before => Err(ReadError::NotIncreasing { file: at.file(), line: at.line, t, before }),
            _ => Ok(()),
        }
    }

    fn finish(mut self, file: &str, meta: Meta) -> Result<Recording, ReadError> {
        let time = core::mem::take(&mut self.columns[self.time]);
        if time.is_empty() {
            return Err(ReadError::NoSamples { file: file.to_string() });
        }
        let mut signals: BTreeMap<String, Vec<f64>> = self.names.into_iter().zip(self.columns).collect();
        signals.remove("t");
        Ok(Recording { name: file.to_string(), time, signals, meta })
    }
}

/// Fields of a line, quoted or not.
fn fields(at: &Place<'_>, line: &str) -> Result<::csv::StringRecord, ReadError> {
    let mut record = ::csv::StringRecord::new();
    let mut reader = ::csv::ReaderBuilder::new().has_headers(false).from_reader(line.as_bytes());
    // The text is UTF-8 already, and reading from memory cannot fail.
    reader.read_record(&mut record).map_err(|_| ReadError::NotUtf8 { file: at.file(), line: at.line })?;
    Ok(record)
}

/// Column names of a header line.
fn names(at: &Place<'_>, header: &str) -> Result<Vec<String>, ReadError> {
    let record = fields(at, header)?;
    let mut names: Vec<String> = Vec::with_capacity(record.len());
    let mut sorted = alloc::collections::BTreeSet::new();
    for (k, name) in record.iter().map(str::trim).enumerate() {
        if name.is_empty() {
            return Err(ReadError::UnnamedColumn { file: at.file(), line: at.line, number: k + 1 });
        }
        if !sorted.insert(name.to_string()) {
            return Err(ReadError::DuplicateColumn { file: at.file(), line: at.line, column: clip(name) });
        }
        names.push(name.to_string());
    }
    Ok(names)
}

/// Why a field is no sample.
#[derive(Debug, Clone, Copy)]
enum Bad {
    NotANumber,
    NotFinite,
}

impl Bad {
    fn at(self, at: &Place<'_>, column: &str, field: &[u8]) -> ReadError {
        let (file, line, column) = (at.file(), at.line, clip(column));
        let value = clip(&String::from_utf8_lossy(field.trim_ascii()));
        match self {
            Self::NotANumber => ReadError::NotANumber { file, line, column, value },
            Self::NotFinite => ReadError::NotFinite { file, line, column, value },
        }
    }
}

fn number(field: &[u8]) -> Result<f64, Bad> {
    let field = field.trim_ascii();
    let field = field.strip_prefix(b"\"").and_then(|f| f.strip_suffix(b"\"")).map_or(field, <[u8]>::trim_ascii);
    if field.is_empty() {
        return Ok(f64::NAN);
    }
    let value: f64 = core::str::from_utf8(field).ok().and_then(|text| text.parse().ok()).ok_or(Bad::NotANumber)?;
    if value.is_infinite() {
        return Err(Bad::NotFinite);
    }
    // One NaN only: a sign or payload would make two equal recordings differ.
    Ok(if value.is_nan() { f64::NAN } else { value })
}

#[cfg(test)]
mod tests {
    use super::*;
    use pkm_ident::EffortKind;

    fn say(text: &str) -> String {
        parse("A.csv", text.as_bytes()).unwrap_err().to_string()
    }

    #[test]
    fn plain_file_is_read() {
        let text = "\u{feff}# made by hand\r\n# tau = measured\r\n# session = 2021-03-03\r\n# x.y = Jane Doe\r\nt, q.a ,\"tau.a\"\r\n0,1,\r\n# note\r\n\r\n0.5,nan,-2e-3\r\n";
        let recording = parse("A.csv", text.as_bytes()).unwrap();
        assert_eq!(recording.time, [0.0, 0.5]);
        assert_eq!(recording.signal("q.a").unwrap()[0].to_bits(), 1f64.to_bits());
        assert!(recording.signal("q.a").unwrap()[1].is_nan() && recording.signal("tau.a").unwrap()[0].is_nan());
        assert_eq!(recording.meta.tau, Some(EffortKind::Measured));
        assert_eq!(recording.meta.session.as_deref(), Some("2021-03-03"));
        assert_eq!(recording.meta.other.get("x.y").map(String::as_str), Some("Jane Doe"));
    }

    #[test]
    fn comments_as_spreadsheets_write_them_are_comments() {
        // What Excel and LibreOffice make of the lines in the other test when they save them beside three columns.
        let text = "# made by hand,,\r\n# tau = measured,,\r\n\"# load = {link = \"\"hand\"\", mass = 2.0, xyz = [0, 0, 0.1]}\",,\r\n\
            \"# session = \"\"3 March, noon\"\"\",,\r\n\"t\",\"q.a\",\"tau.a\"\r\n\"# a, b\",,\r\n0,1,2\r\n";
        let recording = parse("A.csv", text.as_bytes()).unwrap();
        assert_eq!((recording.time.as_slice(), recording.signal("tau.a").unwrap()), (&[0.0][..], &[2.0][..]));
        assert_eq!(recording.meta.tau, Some(EffortKind::Measured));
        assert_eq!(recording.meta.session.as_deref(), Some("3 March, noon"));
        let load = recording.meta.load.unwrap();
        assert_eq!((load.link.as_str(), load.mass, load.xyz), ("hand", 2.0, [0.0, 0.0, 0.1]));
        assert_eq!(say("\"# tau = guessed\"\nt\n0\n"), "A.csv line 1: tau = guessed is not measured or commanded");
        // A quoted number is a sample, quoted words are none.
        assert!(say("t\n\"1\"\n\"two\"\n").starts_with("A.csv line 3, column t: "));
    }

    #[test]
    fn messages_name_file_line_and_value() {
        assert_eq!(say("t,tau.q1\n0,1\n1,abc\n"), "A.csv line 3, column tau.q1: \"abc\" is not a number");
        assert_eq!(say("t\n0.04\n# x\n0.03\n"), "A.csv line 4: t = 0.03 s does not increase (line before: 0.04 s)");
        assert_eq!(say("#\nt,a,b\n0,1\n"), "A.csv line 3: 2 fields, the header has 3");
        assert_eq!(say("t,a,a\n0,1,2\n"), "A.csv line 1: column a is there twice");
        assert_eq!(say("# tau = guessed\nt\n0\n"), "A.csv line 1: tau = guessed is not measured or commanded");
    }
}
