//! Text on its way into HTML. Names and paths come from files and may hold anything.

use core::fmt::{self, Display, Write};

/// Text that is safe in HTML content and in quoted attributes.
pub(crate) struct Escaped<'a>(&'a str);

/// Escapes `text` for HTML content and quoted attributes.
pub(crate) fn esc(text: &str) -> Escaped<'_> {
    Escaped(text)
}

impl Display for Escaped<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for c in self.0.chars() {
            match c {
                '&' => f.write_str("&amp;")?,
                '<' => f.write_str("&lt;")?,
                '>' => f.write_str("&gt;")?,
                '"' => f.write_str("&quot;")?,
                '\'' => f.write_str("&#39;")?,
                // Control characters are no characters in HTML, except white space.
                c if c.is_control() && !matches!(c, '\n' | '\t') => f.write_char('\u{fffd}')?,
                c => f.write_char(c)?,
            }
        }
        Ok(())
    }
}

/// Units, and what else a number is not parted from at the end of a line.
const UNITS: [&str; 14] = ["%", "m", "rad", "N", "N·m", "kg", "kg·m", "kg·m²", "s", "Hz", "m/s", "rad/s", "N·s/m", "N·m·s/rad"];

/// Escaped sentences, in which a number keeps its unit.
pub(crate) fn prose(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for word in esc(text).to_string().split(' ') {
        if !out.is_empty() {
            let is_unit = UNITS.contains(&word.trim_end_matches(['.', ',', ';', ':', ')']));
            out.push(if is_unit && out.ends_with(|c: char| c.is_ascii_digit()) { '\u{a0}' } else { ' ' });
        }
        out.push_str(word);
    }
    out
}

/// A formatted number with a true minus sign and a space that does not break.
pub(crate) fn num(text: &str) -> String {
    text.replace('-', "−").replace(' ', "\u{a0}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn markup_and_control_characters_are_escaped() {
        assert_eq!(esc("<a href=\"x\">&'\u{1b}").to_string(), "&lt;a href=&quot;x&quot;&gt;&amp;&#39;\u{fffd}");
        assert_eq!(esc("N·m, µ, q̈").to_string(), "N·m, µ, q̈");
    }

    #[test]
    fn numbers_of_sentences_keep_their_units() {
        let told = prose("takes 2 samples: y = 0 m, from 8.7 % to 0.2 %. At <b> 3 mice (1 N·m)");
        assert_eq!(told, "takes 2 samples: y = 0\u{a0}m, from 8.7\u{a0}% to 0.2\u{a0}%. At &lt;b&gt; 3 mice (1\u{a0}N·m)");
    }

    #[test]
    fn numbers_keep_together() {
        assert_eq!(num("-1.5 %"), "−1.5\u{a0}%");
    }
}
