/// Shortens a text to a number of characters. The last of a longer text is `…`.
///
/// # Example
/// ```
/// assert_eq!(mishandle_text::short("millimeters", 6), "milli…");
/// assert_eq!(mishandle_text::short("mm", 6), "mm");
/// ```
pub fn short(text: &str, most: usize) -> String {
    match text.char_indices().nth(most) {
        None => text.to_string(),
        Some(_) => text.chars().take(most.saturating_sub(1)).chain(['…']).collect(),
    }
}

/// Returns a unit as it stands in sentences: the start of one that is longer than any real unit.
///
/// # Example
/// ```
/// assert_eq!(mishandle_text::short_unit("control steps"), "control steps");
/// assert_eq!(mishandle_text::short_unit(&"m".repeat(60_000)).len(), 24);
/// ```
pub fn short_unit(unit: &str) -> &str {
    unit.char_indices().nth(24).map_or(unit, |(end, _)| &unit[..end])
}

/// Leaves out the middle of a text that has more than this number of characters, so that no text of
/// a file fills a page or a terminal.
///
/// # Example
/// ```
/// let text = format!("a{}z", "b".repeat(100));
/// assert_eq!(mishandle_text::without_middle(&text, 10), "abbbb … bbbbz");
/// assert_eq!(mishandle_text::without_middle("abc", 10), "abc");
/// ```
pub fn without_middle(text: &str, most: usize) -> String {
    let count = text.chars().count();
    if count <= most {
        return text.to_string();
    }
    let first: String = text.chars().take(most / 2).collect();
    let last: String = text.chars().skip(count - most / 2).collect();
    format!("{first} … {last}")
}
