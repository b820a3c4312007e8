//! Patterns of names, and what exists if they match nothing.

use mishandle_stl::nearest;
use regex_lite::{Regex, RegexBuilder};

use crate::mjcf::MjcfError;

/// The largest number of names in a message.
const LISTED: usize = 30;

/// The largest size of a compiled pattern, bytes.
const PATTERN: usize = 1 << 20;

/// A pattern that matches whole names.
#[derive(Debug)]
pub(crate) struct Pattern<'a> {
    text: &'a str,
    regex: Regex,
}

impl Pattern<'_> {
    /// Compiles a regular expression.
    pub(crate) fn new(text: &str) -> Result<Pattern<'_>, MjcfError> {
        let compile = |text: &str| RegexBuilder::new(text).size_limit(PATTERN).build();
        // Alone first: `a)|(b` is not valid, but would be in parentheses.
        compile(text)
            .and_then(|_| compile(&format!("^(?:{text})$")))
            .map(|regex| Pattern { text, regex })
            .map_err(|error| MjcfError::edit(format!("`{text}` is not a regular expression: {error}")))
    }

    pub(crate) fn is_match(&self, name: &str) -> bool {
        self.regex.is_match(name)
    }

    /// The error if no element of a kind has such a name.
    pub(crate) fn none(&self, kind: &str, known: &[&str]) -> MjcfError {
        MjcfError::edit(format!("no {kind} matches `{}`{}", self.text, known_names(kind, self.text, known)))
    }
}

/// Returns the part of a message that says which names exist.
pub(crate) fn known_names(kind: &str, name: &str, known: &[&str]) -> String {
    if known.is_empty() {
        return format!("; the model has no {kind} with a name");
    }
    let hint = nearest(name, known.iter().copied()).map(|near| format!("did you mean `{near}`? "));
    let more = match known.len().saturating_sub(LISTED) {
        0 => String::new(),
        more => format!(" and {more} more"),
    };
    let listed = &known[..known.len().min(LISTED)];
    format!("; {}known names: {}{more}", hint.unwrap_or_default(), listed.join(", "))
}
