//! Integers in the notations that people type: 1000000, `1_000_000` or 1e6.

/// Parses an integer exactly, from its decimal digits: a float would round large numbers. The error
/// says what the text is instead.
///
/// # Errors
/// If the text is not an integer from 0 to 2⁶⁴ - 1.
///
/// # Example
/// ```
/// use mishandle_text::parse_integer;
/// assert_eq!(parse_integer("1.5e6"), Ok(1_500_000));
/// assert_eq!(parse_integer("1_000"), Ok(1000));
/// assert_eq!(parse_integer("0.5"), Err("not an integer"));
/// ```
pub fn parse_integer(text: &str) -> Result<u64, &'static str> {
    const NOT_A_NUMBER: &str = "not a number";
    let (mantissa, exponent) = text.split_once(['e', 'E']).unwrap_or((text, "0"));
    let exponent: i32 = exponent.parse().map_err(|_| NOT_A_NUMBER)?;
    let (whole, fraction) = mantissa.split_once('.').unwrap_or((mantissa, ""));
    let not_a_number = if text.starts_with('-') { "negative" } else { NOT_A_NUMBER };
    let mut digits = digits(whole).ok_or(not_a_number)?;
    if mantissa.contains('.') {
        digits += &self::digits(fraction).ok_or(NOT_A_NUMBER)?;
    }
    // Number of zeros to append to the digits; negative: number of digits to remove.
    let zeros = exponent.saturating_sub(fraction.chars().filter(char::is_ascii_digit).count() as i32);
    let cut = digits.len().saturating_sub(zeros.min(0).unsigned_abs() as usize);
    if digits[cut..].bytes().any(|digit| digit != b'0') {
        return Err("not an integer");
    }
    let digits = digits[..cut].trim_start_matches('0');
    let scale = if digits.is_empty() { Some(1) } else { 10_u64.checked_pow(zeros.max(0).unsigned_abs()) };
    let number = if digits.is_empty() { Some(0) } else { digits.parse::<u64>().ok() };
    number.zip(scale).and_then(|(number, scale)| number.checked_mul(scale)).ok_or("too large")
}

/// Returns the digits without the underscores between them.
fn digits(text: &str) -> Option<String> {
    let groups: Vec<&str> = text.split('_').collect();
    let is_valid =
        groups.iter().all(|group| !group.is_empty() && group.bytes().all(|byte| byte.is_ascii_digit()));
    is_valid.then(|| groups.concat())
}
