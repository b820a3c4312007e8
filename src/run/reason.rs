//! Reasons of the ends of simulations, for readers.

/// Returns a reason, if there is one.
pub(crate) fn given(reason: &str) -> Option<String> {
    (!reason.is_empty()).then(|| reason.to_string())
}

/// Returns a reason on one line: its first line and its last one, which names the exception of a
/// traceback.
///
/// # Example
/// ```
/// use mishandle::run::short_reason;
/// let reason = "the program ended; its standard error: Traceback\n  line 3\nValueError: level";
/// assert_eq!(short_reason(reason), "the program ended; its standard error: Traceback ... ValueError: level");
/// assert_eq!(short_reason("no license\n"), "no license");
/// ```
pub fn short_reason(reason: &str) -> String {
    let mut lines = reason.lines().map(str::trim).filter(|line| !line.is_empty());
    match (lines.next(), lines.next_back()) {
        (Some(first), Some(last)) => format!("{first} ... {last}"),
        (first, _) => first.unwrap_or_default().to_string(),
    }
}
