//! Errors in the text of a formula, with a mark below the place of the error.

use mishandle::stl::ParseError;

/// Largest number of characters that are shown of a line.
const WINDOW: usize = 80;

/// Stands for the part of a line that is not shown.
const OMITTED: &str = "...";

/// Describes an error with the line in which it is, or a part of a long line.
pub fn message(formula: &str, error: &ParseError) -> String {
    let position = error.position();
    let line = formula.split('\n').nth(position.line - 1).unwrap_or_default().trim_end_matches('\r');
    let (shown, mark) = window(line, position.column - 1);
    format!("formula: {error}\n  {shown}\n  {}^", " ".repeat(mark))
}

/// Returns the part of a line around the character with this index, and the index of the character
/// in it.
fn window(line: &str, index: usize) -> (String, usize) {
    // A tab has no fixed width.
    let characters: Vec<char> = line.chars().map(|c| if c == '\t' { ' ' } else { c }).collect();
    let start = index.saturating_sub(WINDOW / 2).min(characters.len().saturating_sub(WINDOW));
    let end = characters.len().min(start + WINDOW);
    let omitted = |is_omitted: bool| if is_omitted { OMITTED } else { "" };
    let before = omitted(start > 0);
    let part: String = characters[start..end].iter().collect();
    (format!("{before}{part}{}", omitted(end < characters.len())), before.len() + index - start)
}

#[cfg(test)]
mod tests {
    use mishandle::stl::Formula;

    use super::*;

    /// Returns the line that the message shows and the character above the mark.
    fn shown(formula: &str) -> (String, Option<char>) {
        let message = message(formula, &Formula::parse(formula).unwrap_err());
        let lines: Vec<&str> = message.split('\n').collect();
        assert_eq!(lines.len(), 3, "{message}");
        let above = lines[1].chars().nth(lines[2].find('^').unwrap());
        (lines[1].trim_start().to_string(), above)
    }

    #[test]
    fn the_mark_is_below_the_error() {
        assert_eq!(shown("always[0:2](d <= )"), ("always[0:2](d <= )".to_string(), Some(')')));
        assert_eq!(shown("d > "), ("d > ".to_string(), None));
        assert_eq!(shown("d >\t0 ä"), ("d > 0 ä".to_string(), Some('ä')));
        assert_eq!(shown("d > 0 and\nd > )\nor"), ("d > )".to_string(), Some(')')));
        assert_eq!(shown("d > 0 and\r\nd > )\r\nor"), ("d > )".to_string(), Some(')')));
    }

    #[test]
    fn a_long_line_is_shown_around_the_error_only() {
        let terms = |count: usize| "(d > 0) and ".repeat(count);
        for (before, after) in [(0, 400), (1, 400), (400, 0), (400, 1), (400, 300)] {
            let formula = format!("{}(d > ?) and {}d > 0", terms(before), terms(after));
            let (line, above) = shown(&formula);
            assert_eq!(above, Some('?'), "{line}");
            assert!(line.chars().count() <= WINDOW + 2 * OMITTED.len(), "{line}");
            assert_eq!(line.starts_with(OMITTED), before > 3, "{line}");
            assert_eq!(line.ends_with(OMITTED), after > 3, "{line}");
        }
        // The end of a long formula.
        let (line, above) = shown(&terms(400));
        assert_eq!((line.ends_with("(d > 0) and "), above), (true, None), "{line}");
    }
}
