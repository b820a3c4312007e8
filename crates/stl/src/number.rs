//! Numbers as text.

use std::fmt;

/// A number in a message: its shortest text, with an exponent if it would have many zeros.
pub(crate) struct Shown(pub f64);

impl fmt::Display for Shown {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.0.is_finite() { write_number(f, self.0) } else { write!(f, "{}", self.0) }
    }
}

/// Writes the shortest text that parses to the same number; ±∞ are the truth values.
pub(crate) fn write_number(f: &mut fmt::Formatter<'_>, value: f64) -> fmt::Result {
    match value {
        f64::INFINITY => f.write_str("true"),
        f64::NEG_INFINITY => f.write_str("false"),
        _ if value == 0.0 || (1e-5..1e16).contains(&value.abs()) => write!(f, "{value}"),
        _ => write!(f, "{value:e}"),
    }
}

/// Returns a text whose numbers, between spaces, commas and parentheses, are as [`Shown`] shows
/// them.
pub(crate) fn with_short_numbers(text: &str) -> String {
    let shorten = |part: &str| {
        let word = part.trim_end_matches([' ', ',', '(', ')']);
        match word.parse() {
            Ok(number) => format!("{}{}", Shown(number), &part[word.len()..]),
            Err(_) => part.to_owned(),
        }
    };
    text.split_inclusive([' ', ',', '(', ')']).map(shorten).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_have_no_more_zeros_than_digits() {
        let cases =
            [(0.0, "0"), (-2.5, "-2.5"), (1e300, "1e300"), (1e-300, "1e-300"), (f64::INFINITY, "inf")];
        for (number, text) in cases {
            assert_eq!(Shown(number).to_string(), text);
        }
        let text = format!("pow({}, -2) * {}", 1e200, 1e-200);
        assert_eq!(with_short_numbers(&text), "pow(1e200, -2) * 1e-200");
    }
}
