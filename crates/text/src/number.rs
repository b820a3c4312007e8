use std::fmt::Display;

/// Formats a number of things.
///
/// # Example
/// ```
/// assert_eq!(mishandle_text::plural(1, "trial"), "1 trial");
/// assert_eq!(mishandle_text::plural(2, "trial"), "2 trials");
/// ```
pub fn plural<N: Copy + Display + PartialEq + From<u8>>(count: N, noun: &str) -> String {
    format!("{count} {noun}{}", if count == N::from(1) { "" } else { "s" })
}

/// Formats a number with all its digits, in scientific notation where zeros would be many of them.
///
/// # Example
/// ```
/// assert_eq!(mishandle_text::number_text(0.1), "0.1");
/// assert_eq!(mishandle_text::number_text(-1.5e307), "-1.5e307");
/// assert_eq!(mishandle_text::number_text(f64::INFINITY), "inf");
/// ```
pub fn number_text(value: f64) -> String {
    if value == 0.0 || !value.is_finite() || (1e-5..1e16).contains(&value.abs()) {
        format!("{value}")
    } else {
        format!("{value:e}")
    }
}

/// Formats a number with this many decimals, or in scientific notation from 10⁹ on, where decimals
/// would be hundreds of digits.
///
/// # Example
/// ```
/// assert_eq!(mishandle_text::decimal(-0.25, 4), "-0.2500");
/// assert_eq!(mishandle_text::decimal(-1.5e307, 4), "-1.5000e307");
/// assert_eq!(mishandle_text::decimal(f64::NEG_INFINITY, 4), "-inf");
/// ```
pub fn decimal(value: f64, decimals: usize) -> String {
    if value.is_finite() && value.abs() >= 1e9 {
        format!("{value:.decimals$e}")
    } else {
        format!("{value:.decimals$}")
    }
}

/// Formats a measured number with at most four significant digits.
///
/// # Example
/// ```
/// assert_eq!(mishandle_text::measured(-0.251349), "-0.2513");
/// assert_eq!(mishandle_text::measured(2.0), "2");
/// assert_eq!(mishandle_text::measured(f64::INFINITY), "inf");
/// ```
pub fn measured(value: f64) -> String {
    number_text(format!("{value:.3e}").parse().unwrap_or(value))
}

/// Formats a number with at most six significant digits.
///
/// # Example
/// ```
/// assert_eq!(mishandle_text::short_number(10.0 / 3.0), "3.33333");
/// assert_eq!(mishandle_text::short_number(0.5), "0.5");
/// assert_eq!(mishandle_text::short_number(1e300), "1e300");
/// ```
pub fn short_number(value: f64) -> String {
    number_text(format!("{value:.5e}").parse().unwrap_or(value))
}

/// Formats a probability with three digits.
///
/// # Example
/// ```
/// assert_eq!(mishandle_text::probability_text(0.25), "0.25000");
/// assert_eq!(mishandle_text::probability_text(0.000123), "1.23e-4");
/// ```
pub fn probability_text(p: f64) -> String {
    match p {
        0.0 => "0".to_string(),
        0.001.. => decimal(p, 5),
        _ => format!("{p:.2e}"),
    }
}

/// Formats a p-value with four decimals, or as `< 0.0001`.
///
/// # Example
/// ```
/// assert_eq!(mishandle_text::p_value_text(0.03), "0.0300");
/// assert_eq!(mishandle_text::p_value_text(0.00001), "< 0.0001");
/// ```
pub fn p_value_text(p: f64) -> String {
    if p < 0.0001 { "< 0.0001".to_string() } else { format!("{p:.4}") }
}

/// Formats a p-value for a sentence: `p = 0.0312`, or `p < 0.0001` for smaller ones.
pub fn p_value_phrase(p: f64) -> String {
    match p_value_text(p) {
        small if small.starts_with('<') => format!("p {small}"),
        value => format!("p = {value}"),
    }
}
