//! The reference page of the patterns.

use std::fmt::Write;

use super::PATTERNS;

/// Returns the page `docs/reference/patterns.md` after this text.
pub fn page(introduction: &str) -> String {
    let mut text = introduction.to_owned();
    for pattern in PATTERNS {
        // Writing to a string cannot fail.
        let _ = write!(text, "\n## {}\n\n", pattern.name);
        let _ = writeln!(text, "{}", filled(&format!("{} Source: {}.", code(pattern.words), pattern.source)));
        let _ = write!(text, "\n```text\n{}\n```\n\n", pattern.formula);
        text.push_str("| parameter | kind | default | meaning |\n|---|---|---|---|\n");
        for slot in pattern.slots {
            let default = slot.default.map_or("–".to_owned(), |default| format!("`{default}`"));
            let _ =
                writeln!(text, "| `{}` | {} | {default} | {} |", slot.name, slot.kind.name(), slot.meaning);
        }
        let settings: Vec<String> =
            pattern.shown.settings.iter().map(|(name, value)| format!("{name} = `{value}`")).collect();
        let intro = format!("With {}, one sample per second:", settings.join(", "));
        let _ = write!(text, "\n{}\n\n| trace | signal | values |\n|---|---|---|\n", filled(&intro));
        for (name, columns) in [("satisfies", pattern.shown.satisfies), ("violates", pattern.shown.violates)]
        {
            for (signal, values) in pattern.shown.signals.iter().zip(columns) {
                let values: Vec<String> = values.iter().map(f64::to_string).collect();
                let _ = writeln!(text, "| {name} | `{signal}` | {} |", values.join(", "));
            }
        }
    }
    text
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
