//! Makes text safe to print. Names and texts from files can contain escape sequences that move the
//! cursor, retitle the window or fill the clipboard, and invisible characters that reorder or hide
//! what a reader sees.
//!
//! All output of the program passes through this module: [`output`](crate::output) calls it.

use std::io::Write;

use mishandle_text::is_invisible;
use serde_json::ser::{Formatter, PrettyFormatter};

/// Escapes a text of several lines, such as a table or an error of a parser: line breaks and tabs
/// remain.
pub fn text(text: &str) -> String {
    escaped(text, |c| c == '\n' || c == '\t', rust)
}

/// Escapes a text that is printed within a line, such as a name.
pub fn name(name: &str) -> String {
    escaped(name, |_| false, rust)
}

/// Writes JSON with indentation, and escapes strings with JSON's own escapes, so that a parser
/// returns the same strings.
#[derive(Default)]
pub struct EscapedJson(PrettyFormatter<'static>);

impl Formatter for EscapedJson {
    fn write_string_fragment<W: Write + ?Sized>(
        &mut self,
        out: &mut W,
        fragment: &str,
    ) -> std::io::Result<()> {
        EscapedLine.write_string_fragment(out, fragment)
    }

    fn begin_array<W: Write + ?Sized>(&mut self, out: &mut W) -> std::io::Result<()> {
        self.0.begin_array(out)
    }

    fn end_array<W: Write + ?Sized>(&mut self, out: &mut W) -> std::io::Result<()> {
        self.0.end_array(out)
    }

    fn begin_array_value<W: Write + ?Sized>(&mut self, out: &mut W, first: bool) -> std::io::Result<()> {
        self.0.begin_array_value(out, first)
    }

    fn end_array_value<W: Write + ?Sized>(&mut self, out: &mut W) -> std::io::Result<()> {
        self.0.end_array_value(out)
    }

    fn begin_object<W: Write + ?Sized>(&mut self, out: &mut W) -> std::io::Result<()> {
        self.0.begin_object(out)
    }

    fn end_object<W: Write + ?Sized>(&mut self, out: &mut W) -> std::io::Result<()> {
        self.0.end_object(out)
    }

    fn begin_object_key<W: Write + ?Sized>(&mut self, out: &mut W, first: bool) -> std::io::Result<()> {
        self.0.begin_object_key(out, first)
    }

    fn begin_object_value<W: Write + ?Sized>(&mut self, out: &mut W) -> std::io::Result<()> {
        self.0.begin_object_value(out)
    }

    fn end_object_value<W: Write + ?Sized>(&mut self, out: &mut W) -> std::io::Result<()> {
        self.0.end_object_value(out)
    }
}

/// As [`EscapedJson`], on one line.
pub struct EscapedLine;

impl Formatter for EscapedLine {
    fn write_string_fragment<W: Write + ?Sized>(
        &mut self,
        out: &mut W,
        fragment: &str,
    ) -> std::io::Result<()> {
        out.write_all(escaped(fragment, |_| false, unicode).as_bytes())
    }
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
        let mut serializer = serde_json::Serializer::with_formatter(&mut out, EscapedJson::default());
        value.serialize(&mut serializer).unwrap();
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
    fn ordinary_text_is_unchanged() {
        let ordinary = "größe 10⁻³ m/s², φ ≥ 0, 日本語, 🤖, \\u{1b}";
        assert_eq!([text(ordinary), name(ordinary)], [ordinary; 2]);
        assert_eq!(json(&"größe 10⁻³ m/s², φ ≥ 0, 日本語"), "\"größe 10⁻³ m/s², φ ≥ 0, 日本語\"");
    }
}
