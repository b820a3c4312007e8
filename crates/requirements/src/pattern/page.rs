//! The reference page of the patterns.

use std::fmt::Write;

use super::{FAMILIES, Pattern};

/// Returns the page `docs/reference/patterns.md` after this text.
pub fn page(introduction: &str) -> String {
    let mut text = introduction.to_owned();
    for family in FAMILIES {
        // Writing to a string cannot fail.
        let _ = write!(text, "\n## {}\n\n{}\n", family.title, filled(family.text));
        family.patterns.iter().for_each(|pattern| write_pattern(&mut text, pattern));
    }
    text
}

fn write_pattern(text: &mut String, pattern: &Pattern) {
    let _ = write!(text, "\n### {}\n\n", pattern.name);
    let _ = writeln!(text, "{}", filled(&format!("{} Source: {}.", code(pattern.words), pattern.source)));
    let _ = write!(text, "\n```text\n{}\n```\n\n", pattern.formula);
    text.push_str("| parameter | kind | default | meaning |\n|---|---|---|---|\n");
    for slot in pattern.slots {
        let default = slot.default.map_or("–".to_owned(), |default| format!("`{default}`"));
        let _ = writeln!(text, "| `{}` | {} | {default} | {} |", slot.name, slot.kind.name(), slot.meaning);
    }
    let shown = &pattern.shown;
    let settings: Vec<String> =
        shown.settings.iter().map(|(name, value)| format!("{name} = `{value}`")).collect();
    let intro = format!("With {}, one sample per second:", settings.join(", "));
    let _ = write!(text, "\n{}\n\n| signal | satisfies | violates |\n|---|---|---|\n", filled(&intro));
    for ((signal, satisfies), violates) in shown.signals.iter().zip(shown.satisfies).zip(shown.violates) {
        let _ = writeln!(text, "| `{signal}` | {} | {} |", list(satisfies), list(violates));
    }
}

fn list(values: &[f64]) -> String {
    values.iter().map(f64::to_string).collect::<Vec<String>>().join(", ")
}

/// Puts the parameters of a sentence into backquotes.
fn code(words: &str) -> String {
    words.replace(['{', '}'], "`")
}

/// Breaks a paragraph into lines of at most 120 characters.
fn filled(text: &str) -> String {
    let mut lines = vec![String::new()];
    for word in text.split(' ') {
        let line = lines.len() - 1;
        let has_room = lines[line].chars().count() + 1 + word.chars().count() <= 120;
        if lines[line].is_empty() {
            lines[line].push_str(word);
        } else if has_room {
            lines[line].extend([" ", word]);
        } else {
            lines.push(word.to_owned());
        }
    }
    lines.join("\n")
}
