use std::fmt::Display;

/// Formats a number of things.
///
/// # Example
/// ```
/// assert_eq!(mishandle::plural(1, "trial"), "1 trial");
/// assert_eq!(mishandle::plural(2, "trial"), "2 trials");
/// ```
pub fn plural<N: Copy + Display + PartialEq + From<u8>>(count: N, noun: &str) -> String {
    format!("{count} {noun}{}", if count == N::from(1) { "" } else { "s" })
}
