//! Recording to CSV.

use core::fmt::Write as _;
use std::fs::File;
use std::io::{BufWriter, Write as _};

use pkm_ident::Recording;

use crate::meta::Pair;

/// Writes metadata lines, header and samples; a missing sample is an empty field.
pub(crate) fn write(file: &mut File, recording: &Recording, pairs: &[Pair]) -> std::io::Result<()> {
    let mut out = BufWriter::new(file);
    for pair in pairs {
        writeln!(out, "# {} = {}", pair.key, pair.line_value())?;
    }
    let mut header = ::csv::WriterBuilder::new().from_writer(Vec::new());
    let names = core::iter::once("t").chain(recording.signals.keys().map(String::as_str));
    header.write_record(names)?;
    out.write_all(&header.into_inner().map_err(|e| std::io::Error::other(e.to_string()))?)?;
    let columns: Vec<&[f64]> = recording.signals.values().map(Vec::as_slice).collect();
    let mut line = String::new();
    for (k, t) in recording.time.iter().enumerate() {
        line.clear();
        push(&mut line, *t);
        for column in &columns {
            line.push(',');
            push(&mut line, column.get(k).copied().unwrap_or(f64::NAN));
        }
        line.push('\n');
        out.write_all(line.as_bytes())?;
    }
    out.flush()
}

/// The shortest text that reads back to the same bits.
fn push(line: &mut String, value: f64) {
    if !value.is_nan() {
        // Writing to a String cannot fail.
        let _ = write!(line, "{value:?}");
    }
}
