//! Writing: tones, wrapping, columns and bars.

use super::Style;

/// Columns of the text.
const COLUMNS: usize = 100;

/// Cells of a full bar.
const BAR: f64 = 36.0;

/// What a piece of text is, shown as colour.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Tone {
    /// Running text.
    Plain,
    /// Names and headings.
    Bold,
    /// Asides.
    Soft,
    /// The model as given.
    Before,
    /// The refined model.
    After,
    /// Nothing wrong.
    Good,
    /// What to beware of.
    Warn,
}

impl Tone {
    /// ANSI parameters of the tone.
    const fn code(self) -> &'static str {
        match self {
            Self::Plain => "",
            Self::Bold => "1",
            Self::Soft => "2",
            Self::Before => "38;5;208",
            Self::After => "38;5;75",
            Self::Good => "38;5;43",
            Self::Warn => "38;5;214",
        }
    }
}

/// Text under way.
#[derive(Debug)]
pub(super) struct Ink {
    /// Whether tones are written.
    style: Style,
    /// What is written so far.
    out: String,
}

/// Text without control characters: they could steer the terminal.
pub(super) fn clean(text: &str) -> String {
    text.chars()
        .map(|c| if c.is_whitespace() && c != '\u{a0}' { ' ' } else { c })
        .map(|c| if c.is_control() { '\u{fffd}' } else { c })
        .collect()
}

/// `text` filled with spaces to `width` on the right.
pub(super) fn left(text: &str, width: usize) -> String {
    format!("{text:<width$}")
}

/// `text` filled with spaces to `width` on the left.
pub(super) fn right(text: &str, width: usize) -> String {
    format!("{text:>width$}")
}

/// Width of a column that holds all of `texts`.
pub(super) fn widest<'a>(texts: impl Iterator<Item = &'a str>) -> usize {
    texts.map(|t| t.chars().count()).max().unwrap_or(0)
}

/// A bar of the share `value` of the full length, in eighths of a cell.
pub(super) fn bar(value: f64) -> String {
    const PARTS: [&str; 8] = ["", "▏", "▎", "▍", "▌", "▋", "▊", "▉"];
    let eighths = eighths(value);
    let (full, part) = (eighths / 8, eighths % 8);
    "█".repeat(full) + PARTS.get(part).unwrap_or(&"")
}

/// Length of a bar in eighths of a cell.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "between 0 and eight times the cells of a bar")]
fn eighths(value: f64) -> usize {
    if value.is_finite() { (8.0 * BAR * value.clamp(0.0, 1.0)).round() as usize } else { 0 }
}

impl Ink {
    /// An empty text.
    pub(super) const fn new(style: Style) -> Self {
        Self { style, out: String::new() }
    }

    /// Appends a piece in its tone.
    fn piece(&mut self, tone: Tone, text: &str) {
        let text = clean(text);
        if self.style == Style::Plain || tone == Tone::Plain || text.trim().is_empty() {
            self.out.push_str(&text);
        } else {
            put!(self.out, "\u{1b}[{}m{text}\u{1b}[0m", tone.code());
        }
    }

    /// One line of pieces.
    pub(super) fn line(&mut self, pieces: &[(Tone, &str)]) {
        for (tone, text) in pieces {
            self.piece(*tone, text);
        }
        // Filled columns leave spaces behind.
        self.out.truncate(self.out.trim_end_matches(' ').len());
        self.out.push('\n');
    }

    /// A heading after an empty line.
    pub(super) fn heading(&mut self, text: &str) {
        self.out.push('\n');
        self.line(&[(Tone::Bold, text)]);
    }

    /// Text broken into lines; `first` starts the first one and the others are indented as far.
    pub(super) fn wrapped(&mut self, first: &str, text: &str) {
        self.wrapped_in(Tone::Plain, first, text);
    }

    /// The same in a tone.
    pub(super) fn wrapped_in(&mut self, tone: Tone, first: &str, text: &str) {
        let indent = first.chars().count();
        let room = COLUMNS.saturating_sub(indent).max(20);
        for (i, line) in wrap(&clean(text), room).iter().enumerate() {
            let start = if i == 0 { first.to_owned() } else { " ".repeat(indent) };
            self.line(&[(Tone::Soft, &start), (tone, line)]);
        }
    }

    /// The finished text.
    pub(super) fn finish(self) -> String {
        self.out
    }
}

/// Lines of at most `room` characters; a longer word stands alone.
fn wrap(text: &str, room: usize) -> Vec<String> {
    let mut lines = vec![String::new()];
    for word in text.split(' ').filter(|w| !w.is_empty()) {
        let used = lines.last().map_or(0, |l| l.chars().count());
        match lines.last_mut() {
            Some(line) if used == 0 => line.push_str(word),
            Some(line) if used + 1 + word.chars().count() <= room => put!(line, " {word}"),
            _ => lines.push(word.to_owned()),
        }
    }
    lines
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_fit_and_no_word_is_lost() {
        let text = "The platform carries 1.83 kg more than the model says and this goes on for quite a while";
        let lines = wrap(text, 20);
        assert!(lines.iter().all(|l| l.chars().count() <= 20));
        assert_eq!(lines.join(" "), text);
        assert_eq!(wrap("", 20), [""]);
        assert_eq!(wrap("a_word_longer_than_the_room b", 5).len(), 2);
    }

    #[test]
    fn bars_are_as_long_as_their_share() {
        assert_eq!(bar(1.0).chars().count(), 36);
        assert_eq!(bar(0.5).chars().count(), 18);
        assert_eq!(bar(f64::NAN), "");
        assert_eq!(bar(99.0).chars().count(), 36);
    }
}
