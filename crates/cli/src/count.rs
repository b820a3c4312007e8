//! Integers on the command line: 1000000, `1_000_000` or 1e6.

/// Parses a non-negative integer. clap prints the name of the flag before the message.
pub fn count<T: TryFrom<u64>>(text: &str) -> Result<T, String> {
    let error = |why: &str| format!("{why}; expected an integer such as 1000000, 1_000_000 or 1e6");
    let number = integer(text).map_err(error)?;
    T::try_from(number).map_err(|_| error("the value is too large"))
}

/// Parses an integer exactly, from its decimal digits: a float would round large numbers.
fn integer(text: &str) -> Result<u64, &'static str> {
    const NOT_A_NUMBER: &str = "the value is not a number";
    let (mantissa, exponent) = text.split_once(['e', 'E']).unwrap_or((text, "0"));
    let exponent: i32 = exponent.parse().map_err(|_| NOT_A_NUMBER)?;
    let (whole, fraction) = mantissa.split_once('.').unwrap_or((mantissa, ""));
    let not_a_number = if text.starts_with('-') { "the value is negative" } else { NOT_A_NUMBER };
    let mut digits = digits(whole).ok_or(not_a_number)?;
    if mantissa.contains('.') {
        digits += &self::digits(fraction).ok_or(NOT_A_NUMBER)?;
    }
    // Number of zeros to append to the digits; negative: number of digits to remove.
    let zeros = exponent.saturating_sub(fraction.chars().filter(char::is_ascii_digit).count() as i32);
    let cut = digits.len().saturating_sub(zeros.min(0).unsigned_abs() as usize);
    if digits[cut..].bytes().any(|digit| digit != b'0') {
        return Err("the value is not an integer");
    }
    let digits = digits[..cut].trim_start_matches('0');
    let scale = if digits.is_empty() { Some(1) } else { 10_u64.checked_pow(zeros.max(0).unsigned_abs()) };
    let number = if digits.is_empty() { Some(0) } else { digits.parse::<u64>().ok() };
    number.zip(scale).and_then(|(number, scale)| number.checked_mul(scale)).ok_or("the value is too large")
}

/// Returns the digits without the underscores between them.
fn digits(text: &str) -> Option<String> {
    let groups: Vec<&str> = text.split('_').collect();
    let is_valid =
        groups.iter().all(|group| !group.is_empty() && group.bytes().all(|byte| byte.is_ascii_digit()));
    is_valid.then(|| groups.concat())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn integers_are_parsed_exactly_in_every_notation() {
        for (text, number) in [
            ("0", 0),
            ("100000", 100_000),
            ("100_000", 100_000),
            ("1e6", 1_000_000),
            ("1.5E+3", 1500),
            ("2.50e1", 25),
            ("1200e-2", 12),
            ("3.0", 3),
            ("0e99", 0),
            ("1_0.5e1", 105),
            // 2⁵³ + 1, which f64 cannot represent, and the largest u64.
            ("9007199254740993", 9_007_199_254_740_993),
            ("1.8446744073709551615e19", u64::MAX),
        ] {
            assert_eq!(count::<u64>(text), Ok(number), "{text}");
        }
    }

    #[test]
    fn an_invalid_integer_is_an_error_with_its_reason() {
        for (text, why) in [
            ("1.5", "not an integer"),
            ("1e-1", "not an integer"),
            ("15e-1", "not an integer"),
            ("-5", "negative"),
            ("-1e6", "negative"),
            ("1e20", "too large"),
            ("18446744073709551616", "too large"),
            ("1e999999999999", "not a number"),
            ("1e999999999", "too large"),
            ("", "not a number"),
            ("e6", "not a number"),
            ("1.", "not a number"),
            (".5", "not a number"),
            ("_1", "not a number"),
            ("1__0", "not a number"),
            ("1e", "not a number"),
            ("1e6e6", "not a number"),
            ("1,000", "not a number"),
            ("ten", "not a number"),
            ("nan", "not a number"),
        ] {
            let error = count::<u64>(text).unwrap_err();
            assert!(error.starts_with(&format!("the value is {why};")), "{text}: {error}");
        }
        assert!(count::<u32>("4294967295").is_ok() && count::<u32>("4294967296").is_err());
    }
}
