//! Names of signals: as a formula spells them, and as messages show them.

use crate::lexer::{is_word_part, is_word_start};
use crate::operator::Operator;
use std::borrow::Cow;

/// Words that start a declaration or an import.
const KEYWORDS: [&str; 8] = ["specification", "const", "input", "output", "float", "int", "long", "from"];

/// Largest number of characters of a name in a message.
const SHOWN: usize = 100;

/// Returns the name as a formula spells it: in backquotes if it is not a plain word, with the
/// backquotes inside doubled.
///
/// # Example
/// ```
/// use mishandle_stl::spelled;
/// assert_eq!(spelled("pose.x_1"), "pose.x_1");
/// assert_eq!(spelled("/joint[0]/speed"), "`/joint[0]/speed`");
/// assert_eq!(spelled("until"), "`until`"); // an operator without the backquotes
/// assert_eq!(spelled("a`b"), "`a``b`");
/// ```
pub fn spelled(name: &str) -> Cow<'_, str> {
    if is_plain(name) { Cow::Borrowed(name) } else { Cow::Owned(format!("`{}`", name.replace('`', "``"))) }
}

/// Returns the name that `inside` stands for, the text between the outer backquotes.
pub(crate) fn unescaped(inside: &str) -> String {
    inside.replace("``", "`")
}

/// Returns whether the name needs no backquotes: it is a word without a meaning of its own.
pub(crate) fn is_plain(name: &str) -> bool {
    name.starts_with(is_word_start)
        && name.chars().all(is_word_part)
        && !KEYWORDS.contains(&name)
        && !is_truth_value(name)
        && !is_not_finite(name)
        && !Operator::all().any(|operator| operator.spellings().contains(&name))
}

/// Returns whether `word` cannot name a signal or a sub-formula without backquotes. `R`, `release`
/// and `ln` are names in RTAMT, so their position decides whether they are operators.
pub(crate) fn is_reserved(word: &str) -> bool {
    let decided_by_position = [Operator::Release, Operator::Ln];
    let is_operator =
        |operator: Operator| operator.spellings().contains(&word) && !decided_by_position.contains(&operator);
    is_truth_value(word) || is_not_finite(word) || Operator::all().any(is_operator)
}

/// Returns whether a word is a number of other languages that no formula compares with: as the name
/// of a signal, a typo in a limit would be a signal that the trace lacks.
pub(crate) fn is_not_finite(word: &str) -> bool {
    ["nan", "inf", "infinity"].iter().any(|known| word.eq_ignore_ascii_case(known))
}

pub(crate) fn is_truth_value(word: &str) -> bool {
    ["true", "TRUE", "false", "FALSE"].contains(&word)
}

/// Returns the name in backquotes, on one line, for a message: as a formula spells it if that has
/// backquotes. A long name is shortened.
pub(crate) fn shown(name: &str) -> String {
    format!("`{}`", one_line(&name.replace('`', "``")))
}

/// Returns a text on one line: control characters are escaped, and the end of a long text is left
/// out.
pub(crate) fn one_line(text: &str) -> String {
    let escaped = |c: char| if c.is_control() { c.escape_default().to_string() } else { c.to_string() };
    let mut line: String = text.chars().take(SHOWN).map(escaped).collect();
    if text.chars().nth(SHOWN).is_some() {
        line += "...";
    }
    line
}

/// Returns whether a reader sees every character of the name and can type it.
pub(crate) fn is_visible(name: &str) -> bool {
    let is_visible = |c: char| {
        c.is_alphanumeric()
            || c.is_ascii_graphic()
            || c == ' '
            || ('\u{a1}'..='\u{bf}').contains(&c) && c != '\u{ad}'
            || ('\u{2190}'..='\u{2bff}').contains(&c)
    };
    name.chars().all(is_visible)
}

/// Returns the longest name that `text` contains as it is, outside of backquotes, although a
/// formula must spell it with backquotes.
///
/// # Example
/// ```
/// use mishandle_stl::unquoted;
/// let known = ["time", "/joint[0]/speed", "/joint[0]"];
/// assert_eq!(unquoted("always(/joint[0]/speed <= 2)", known), Some("/joint[0]/speed"));
/// assert_eq!(unquoted("always(`/joint[0]/speed` <= 2)", known), None);
/// ```
pub fn unquoted<'a>(text: &str, known: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    let outside: Vec<&str> = text.split('`').step_by(2).collect();
    let is_in = |name: &&str| !name.is_empty() && outside.iter().any(|part| stands_in(part, name));
    known.into_iter().filter(|name| !is_plain(name)).filter(is_in).max_by_key(|name| name.len())
}

/// Returns whether `text` contains the name, and not only as a part of a longer word.
fn stands_in(text: &str, name: &str) -> bool {
    let splits_word =
        |before: &str, after: &str| before.ends_with(is_word_part) && after.starts_with(is_word_part);
    text.match_indices(name).any(|(start, _)| {
        let end = start + name.len();
        !splits_word(&text[..start], name) && !splits_word(name, &text[end..])
    })
}

/// Returns the longest known name that the formula of these signals could have meant by `signal`:
/// written without backquotes, `LOAD/diff1` is the quotient of two signals.
pub(crate) fn split_name<'a>(signal: &str, signals: &[String], known: &'a [String]) -> Option<&'a str> {
    let words =
        |name: &'a str| name.split(|c| !is_word_part(c)).filter(|word| word.starts_with(is_word_start));
    let is_read = |word: &str| is_reserved(word) || signals.iter().any(|signal| signal == word);
    known
        .iter()
        .map(String::as_str)
        .filter(|name| !is_plain(name))
        .filter(|name| words(name).any(|word| word == signal) && words(name).all(is_read))
        .max_by_key(|name| name.len())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_with_a_meaning_need_backquotes() {
        for name in ["a", "größe", "$x", "_", "pose.x", "s", "info", "t2"] {
            assert!(is_plain(name), "{name}");
        }
        for name in [
            "", " a", "a b", "2a", "a-b", "G", "always", "R", "ln", "true", "float", "const", "inf", "NaN",
            "a`", ".x",
        ] {
            assert!(!is_plain(name), "{name}");
        }
    }

    #[test]
    fn a_number_that_is_not_finite_is_no_signal() {
        for word in ["nan", "NaN", "inf", "Infinity"] {
            let error = crate::Formula::parse(&format!("always(x <= {word})")).expect_err(word).to_string();
            assert!(error.contains("a formula compares with finite numbers"), "{error}");
        }
        assert!(crate::Formula::parse("always[0:inf](`nan` <= 1)").is_ok());
    }

    #[test]
    fn a_shown_name_is_one_short_line() {
        assert_eq!(shown("a\nerror: b"), "`a\\nerror: b`");
        assert_eq!(shown(&"x".repeat(500)).len(), 2 + SHOWN + 3);
    }

    #[test]
    fn a_name_without_its_backquotes_is_found_in_a_text() {
        let known = ["LOAD/diff", "a b", "until"];
        assert_eq!(unquoted("G(LOAD/diff1 > 0)", known), None);
        assert_eq!(unquoted("G(xLOAD/diff > 0)", known), None);
        assert_eq!(unquoted("G(LOAD/diff>0)", known), Some("LOAD/diff"));
        assert_eq!(unquoted("`LOAD/diff` > 0 and a b > 0", known), Some("a b"));
        let names = |names: &[&str]| names.iter().map(|name| (*name).to_owned()).collect::<Vec<_>>();
        let known = names(&["LOAD/diff1", "LOAD/diff", "x"]);
        assert_eq!(split_name("LOAD", &names(&["LOAD", "diff1"]), &known), Some("LOAD/diff1"));
        assert_eq!(split_name("LOAD", &names(&["LOAD", "x"]), &known), None);
    }
}
