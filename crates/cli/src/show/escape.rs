//! Makes text safe to print. Names and texts from files can contain escape sequences that move the
//! cursor, retitle the window or fill the clipboard, and invisible characters that reorder or hide
//! what a reader sees.
//!
//! All output of the program passes through this module: [`output`](crate::output) calls it.

use std::borrow::Cow;
use std::io::{Error, Result, Write};

use mishandle_text::{is_invisible, short, without_middle};

/// Largest number of characters of a text within a line: of names and formulas from files that
/// anybody can write.
const MAX_LINE: usize = 2000;

/// Largest number of characters of a word. Paths, hashes and operands of formulas are shorter.
const MAX_WORD: usize = 600;

/// Largest number of characters of a label.
const MAX_LABEL: usize = 80;

/// Escapes a text of several lines, such as a table or an error of a parser: line breaks and tabs
/// remain. The middle of a very long word is left out: see [`MAX_WORD`].
pub fn text(text: &str) -> String {
    escaped(&short_words(text), |c| c == '\n' || c == '\t', rust)
}

/// Escapes a text that is printed within a line, such as a name. The middle of a very long one is
/// left out: see [`MAX_LINE`].
pub fn name(name: &str) -> String {
    escaped(&short_words(&without_middle(name, MAX_LINE)), |_| false, rust)
}

/// Escapes a name of an axis, a target or a controller, or a unit, from a run file. A very long one
/// is cut, so that it hides no other words of its sentence.
pub fn label(label: &str) -> String {
    name(&short(label, MAX_LABEL))
}

/// Escapes JSON that `serde_json` writes to it, with JSON's own escapes, so that a parser returns
/// the same strings. JSON has characters to escape in strings only, and `serde_json` writes each
/// part of a string at once, so that no character arrives in pieces. Line breaks are those of
/// indentation: a string has them as `\n`.
pub struct EscapedJson<W>(pub W);

impl<W: Write> Write for EscapedJson<W> {
    fn write(&mut self, bytes: &[u8]) -> Result<usize> {
        // Numbers, of which a document may have millions, pass without a copy.
        if bytes.iter().all(|byte| matches!(byte, b'\n' | b' '..=b'~')) {
            self.0.write_all(bytes)?;
        } else {
            let text = std::str::from_utf8(bytes).map_err(Error::other)?;
            self.0.write_all(escaped(text, |c| c == '\n', unicode).as_bytes())?;
        }
        Ok(bytes.len())
    }

    fn flush(&mut self) -> Result<()> {
        self.0.flush()
    }
}

/// Leaves out the middle of words longer than [`MAX_WORD`].
fn short_words(text: &str) -> Cow<'_, str> {
    let is_long = |word: &str| word.chars().nth(MAX_WORD).is_some();
    if text.len() <= MAX_WORD || !text.split_whitespace().any(is_long) {
        return Cow::Borrowed(text);
    }
    let words = text.split_inclusive(char::is_whitespace);
    Cow::Owned(words.map(|word| without_middle(word, MAX_WORD)).collect())
}

fn unicode(c: char, out: &mut String) {
    let mut units = [0; 2];
    for unit in c.encode_utf16(&mut units) {
        out.push_str(&format!("\\u{unit:04x}"));
    }
}

fn rust(c: char, out: &mut String) {
    out.extend(c.escape_default());
}

fn escaped(text: &str, keeps: fn(char) -> bool, escape: fn(char, &mut String)) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        if keeps(c) || !(c.is_control() || is_invisible(c)) {
            out.push(c);
        } else {
            escape(c, &mut out);
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use serde::Serialize;

    use super::*;

    fn json(value: &impl Serialize) -> String {
        let mut out = Vec::new();
        serde_json::to_writer_pretty(EscapedJson(&mut out), value).unwrap();
        String::from_utf8(out).unwrap()
    }

    #[test]
    fn control_characters_are_escaped_and_line_breaks_of_texts_are_kept() {
        assert_eq!(text("no `\u{1b}[31mä\u{7}`\nhere\t1"), "no `\\u{1b}[31mä\\u{7}`\nhere\t1");
        assert_eq!(name("a\nerror: b\tc"), "a\\nerror: b\\tc");
    }

    #[test]
    fn no_escape_sequence_or_invisible_character_remains() {
        // OSC 52 fills the clipboard; CSI as one C1 character; carriage return and backspace
        // overwrite text; overrides of the direction; a tag; separators; a zero-width joiner.
        let hostile = "\u{1b}]52;c;cm0=\u{7}\u{9b}2J\u{9d}0;x\u{9c}\r\u{8}\u{7f}\u{202e}\u{2066}\u{e0041}\u{2028}\u{85}\u{200d}";
        for printed in [text(hostile), name(hostile), json(&hostile)] {
            assert!(printed.chars().all(|c| c.is_ascii_graphic()), "{printed}");
        }
    }

    #[test]
    fn escaped_json_has_the_same_values() {
        let value = serde_json::json!({ "a\u{9b}\u{7f}": "\u{202e}x\u{1b}\u{e0041}\n", "ä": [1] });
        let printed = json(&value);
        assert!(
            printed.chars().all(|c| c == '\n' || c == 'ä' || c.is_ascii_graphic() || c == ' '),
            "{printed}"
        );
        assert_eq!(serde_json::from_str::<serde_json::Value>(&printed).unwrap(), value);
    }

    #[test]
    fn the_middle_of_a_long_word_is_left_out() {
        let long = "é".repeat(60_000);
        let (shown, label) = (text(&format!("a {long} b\nc")), label(&long));
        assert!(shown.starts_with("a é") && shown.ends_with("é b\nc"), "{shown}");
        assert_eq!([&shown, &label].map(|shown| shown.matches('é').count()), [599, 79]);
        assert!(name(&format!("{long} {long}")).chars().count() < 2010);
    }

    #[test]
    fn ordinary_text_is_unchanged() {
        let ordinary = "größe 10⁻³ m/s², φ ≥ 0, 日本語, 🤖, \\u{1b}";
        assert_eq!([text(ordinary), name(ordinary)], [ordinary; 2]);
        assert_eq!(json(&"größe 10⁻³ m/s², φ ≥ 0, 日本語"), "\"größe 10⁻³ m/s², φ ≥ 0, 日本語\"");
    }
}
