//! Words for people: standard output, one-line errors, aligned tables.

use std::io::{ErrorKind, IsTerminal, Write};

use anyhow::Context;

/// Prints a line (or several) on standard output.
///
/// # Errors
/// When the output refuses, a full disk say. A reader who has gone away is none: `pkm effects | head` is in order.
pub(crate) fn say(text: &str) -> anyhow::Result<()> {
    show(text).map(|_| ())
}

/// Words for people: on standard error where standard output is for JSON alone.
///
/// # Errors
/// When standard output refuses.
pub(crate) fn words(text: &str, is_json: bool) -> anyhow::Result<()> {
    if is_json {
        line_on_stderr(text);
        return Ok(());
    }
    say(text)
}

/// As [`say`]; whether there is somebody to read more.
///
/// # Errors
/// When the output refuses.
pub(crate) fn show(text: &str) -> anyhow::Result<bool> {
    let mut out = std::io::stdout().lock();
    let written = out.write_all(text.as_bytes()).and_then(|()| out.write_all(b"\n")).and_then(|()| out.flush());
    match written {
        Err(e) if e.kind() == ErrorKind::BrokenPipe => Ok(false),
        other => other.map(|()| true).context("standard output"),
    }
}

/// Prints `error: ...` on standard error, on one line whatever the message holds.
pub(crate) fn error(message: &str) {
    line_on_stderr(&format!("error: {message}"));
}

/// Prints one line on standard error.
pub(crate) fn line_on_stderr(message: &str) {
    // Nobody is left to be told when standard error fails.
    let _ = writeln!(std::io::stderr(), "{}", one_line(message));
}

/// The text on one line, with nothing in it that steers a terminal.
fn one_line(text: &str) -> String {
    let words = text.split_whitespace().collect::<Vec<_>>().join(" ");
    words.chars().map(|c| if c.is_control() { '\u{fffd}' } else { c }).collect()
}

/// Names from files, without anything that steers a terminal.
pub(crate) fn clean(text: &str) -> String {
    text.chars().map(|c| if c.is_control() && c != '\n' { '\u{fffd}' } else { c }).collect()
}

/// Whether standard output takes colours.
pub(crate) fn is_coloured() -> bool {
    takes_colour(&std::io::stdout())
}

/// Whether a stream takes colours: a terminal that can, and nobody who asked for none (<https://no-color.org>).
pub(crate) fn takes_colour(stream: &impl IsTerminal) -> bool {
    stream.is_terminal()
        && std::env::var_os("NO_COLOR").is_none_or(|v| v.is_empty())
        && std::env::var_os("TERM").is_none_or(|v| v != "dumb")
}

/// Rows of cells as text with aligned columns, each line indented by two spaces.
pub(crate) fn table(rows: &[Vec<String>]) -> String {
    let columns = rows.iter().map(Vec::len).max().unwrap_or(0);
    let width = |c: usize| rows.iter().filter_map(|r| r.get(c)).map(|cell| cell.chars().count()).max().unwrap_or(0);
    let widths: Vec<usize> = (0..columns).map(width).collect();
    let line = |row: &Vec<String>| {
        let cells: Vec<String> = row.iter().zip(&widths).map(|(cell, &w)| format!("{cell:<w$}")).collect();
        format!("  {}", cells.join("  ")).trim_end().to_string()
    };
    rows.iter().map(line).collect::<Vec<_>>().join("\n")
}

/// Four significant digits, without an exponent where a person would not write one.
pub(crate) fn number(x: f64) -> String {
    let size = x.abs();
    if !x.is_finite() {
        "-".to_string()
    } else if size >= 1e6 || (size > 0.0 && size < 1e-3) {
        format!("{x:.3e}")
    } else {
        let digits = [1000.0, 100.0, 10.0, 1.0].iter().take_while(|&&limit| size < limit).count();
        let text = format!("{x:.digits$}");
        if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_string() } else { text }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_read_as_people_write_them() {
        let texts = [0.0, 20.0, 0.1234567, 123.456, 12345.6, 1e-5, -2.5, f64::INFINITY].map(number);
        assert_eq!(texts, ["0", "20", "0.1235", "123.5", "12346", "1.000e-5", "-2.5", "-"]);
    }

    #[test]
    fn errors_stay_on_one_line() {
        assert_eq!(one_line("a\n  b\u{1b}[2J\tc"), "a b\u{fffd}[2J c");
    }

    #[test]
    fn tables_are_aligned() {
        let rows = [vec!["a".to_string(), "b".to_string()], vec!["long".to_string(), "c".to_string()]];
        assert_eq!(table(&rows), "  a     b\n  long  c");
    }
}
