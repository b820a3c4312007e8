/// Returns a text on one line: its first line and its last one, which names the exception of a
/// traceback. Lines without a character do not count.
///
/// # Example
/// ```
/// use mishandle_text::first_and_last_line;
/// let text = "the program ended: Traceback\n  line 3\nValueError: level\n";
/// assert_eq!(first_and_last_line(text), "the program ended: Traceback ... ValueError: level");
/// assert_eq!(first_and_last_line("no license\n"), "no license");
/// ```
pub fn first_and_last_line(text: &str) -> String {
    let mut lines = text.lines().map(str::trim).filter(|line| !line.is_empty());
    match (lines.next(), lines.next_back()) {
        (Some(first), Some(last)) => format!("{first} ... {last}"),
        (first, _) => first.unwrap_or_default().to_string(),
    }
}
