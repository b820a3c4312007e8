//! The reference page of the patterns.

use std::fmt::Write;

use super::{FAMILIES, Family, Pattern, Slot};

/// Returns the page `docs/reference/patterns.md` after this text. A source and parameters that all
/// patterns of a family share are stated once.
pub fn page(introduction: &str) -> String {
    let mut text = introduction.to_owned();
    for Family { title, text: about, patterns } in FAMILIES {
        let source = patterns[0].source;
        let is_shared = patterns.iter().all(|pattern| pattern.source == source);
        let _ = write!(text, "\n## {title}\n\n");
        if is_shared {
            let mut slots: Vec<&Slot> = Vec::new();
            for slot in patterns.iter().flat_map(|pattern| pattern.slots) {
                if slots.iter().all(|known| known.name != slot.name) {
                    slots.push(slot);
                }
            }
            write_about(&mut text, about, Some(source), slots);
        } else {
            write_about(&mut text, about, None, None);
        }
        patterns.iter().for_each(|pattern| write_pattern(&mut text, pattern, is_shared));
    }
    text
}

fn write_pattern(text: &mut String, pattern: &Pattern, is_shared: bool) {
    // Writing to a string cannot fail.
    let _ = write!(text, "\n### {}\n\n", pattern.name);
    let words = pattern.words.replace(['{', '}'], "`");
    let own = (!is_shared).then_some(pattern.slots);
    write_about(text, &words, own.map(|_| pattern.source), own.into_iter().flatten());
    let _ = write!(text, "\n```text\n{}\n```\n\n", pattern.formula);
    let shown = &pattern.shown;
    let trace = |columns: &[&[f64]]| {
        let column = |(name, values): (&&str, &&[f64])| {
            let values: Vec<String> = values.iter().map(f64::to_string).collect();
            format!("`{name} {}`", values.join(if is_shared { "" } else { " " }))
        };
        shown.signals.iter().zip(columns).map(column).collect::<Vec<_>>().join(", ")
    };
    // The setting of a signal of a template follows from its name.
    let settings = shown.settings.iter().filter(|(name, _)| !is_shared || !shown.signals.contains(name));
    let settings: Vec<String> = settings.map(|(name, value)| format!("{name} = `{value}`")).collect();
    let with = if settings.is_empty() { String::new() } else { format!(", with {}", settings.join(", ")) };
    let verdicts =
        format!("Satisfied by {}; violated by {}{with}.", trace(shown.satisfies), trace(shown.violates));
    let _ = writeln!(text, "{}", filled(&verdicts));
}

/// Writes a sentence, where it comes from, and its parameters.
fn write_about<'a>(
    text: &mut String,
    about: &str,
    source: Option<&str>,
    slots: impl IntoIterator<Item = &'a Slot>,
) {
    let source = source.map_or(String::new(), |source| format!(" Source: {source}."));
    let _ = writeln!(text, "{}", filled(&format!("{about}{source}")));
    let mut gap = "\n";
    for slot in slots {
        let default = slot.default.map_or(String::new(), |default| format!(", `{default}` by default"));
        let _ = writeln!(text, "{gap}- `{}` ({}{default}): {}", slot.name, slot.kind.name(), slot.meaning);
        gap = "";
    }
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
