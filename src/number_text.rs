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

/// Formats a number with this many decimals, or in scientific notation from 10⁹ on, where decimals would be hundreds of digits.
///
/// # Example
/// ```
/// assert_eq!(mishandle::decimal(-0.25, 4), "-0.2500");
/// assert_eq!(mishandle::decimal(-1.5e307, 4), "-1.5000e307");
/// assert_eq!(mishandle::decimal(f64::NEG_INFINITY, 4), "-inf");
/// ```
pub fn decimal(value: f64, decimals: usize) -> String {
    if value.is_finite() && value.abs() >= 1e9 {
        format!("{value:.decimals$e}")
    } else {
        format!("{value:.decimals$}")
    }
}
