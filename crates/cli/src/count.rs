//! Counts as people type them: 1000000, `1_000_000` or 1e6.

/// The whole number that a text says; clap puts the flag's name before the message.
pub fn count<T: TryFrom<u64>>(text: &str) -> Result<T, String> {
    let wrong = |why: &str| format!("{why}; give a whole number, as 1000000, 1_000_000 or 1e6");
    let number = whole(text).map_err(wrong)?;
    T::try_from(number).map_err(|_| wrong("it is too large"))
}

/// Exact, in decimal digits: a float would round large numbers.
fn whole(text: &str) -> Result<u64, &'static str> {
    const NO_NUMBER: &str = "it is no number";
    let (mantissa, exponent) = text.split_once(['e', 'E']).unwrap_or((text, "0"));
    let exponent: i32 = exponent.parse().map_err(|_| NO_NUMBER)?;
    let (before, behind) = mantissa.split_once('.').unwrap_or((mantissa, ""));
    let mut digits = digits(before).ok_or(if text.starts_with('-') { "it is below 0" } else { NO_NUMBER })?;
    if mantissa.contains('.') {
        digits += &self::digits(behind).ok_or(NO_NUMBER)?;
    }
    // How many zeros are to be put behind the digits, or taken from there.
    let zeros = exponent.saturating_sub(behind.chars().filter(char::is_ascii_digit).count() as i32);
    let cut = digits.len().saturating_sub(zeros.min(0).unsigned_abs() as usize);
    if digits[cut..].bytes().any(|digit| digit != b'0') {
        return Err("it is not whole");
    }
    let digits = digits[..cut].trim_start_matches('0');
    let scale = if digits.is_empty() { Some(1) } else { 10_u64.checked_pow(zeros.max(0).unsigned_abs()) };
    let number = if digits.is_empty() { Some(0) } else { digits.parse::<u64>().ok() };
    number.zip(scale).and_then(|(number, scale)| number.checked_mul(scale)).ok_or("it is too large")
}

/// Digits without the underscores between them.
fn digits(text: &str) -> Option<String> {
    let groups: Vec<&str> = text.split('_').collect();
    let right =
        groups.iter().all(|group| !group.is_empty() && group.bytes().all(|byte| byte.is_ascii_digit()));
    right.then(|| groups.concat())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn whole_numbers_are_exact_however_they_are_written() {
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
            // 2⁵³ + 1, which no f64 is, and the largest.
            ("9007199254740993", 9_007_199_254_740_993),
            ("1.8446744073709551615e19", u64::MAX),
        ] {
            assert_eq!(count::<u64>(text), Ok(number), "{text}");
        }
    }

    #[test]
    fn what_is_no_whole_number_is_refused_with_the_reason() {
        for (text, why) in [
            ("1.5", "not whole"),
            ("1e-1", "not whole"),
            ("15e-1", "not whole"),
            ("-5", "below 0"),
            ("-1e6", "below 0"),
            ("1e20", "too large"),
            ("18446744073709551616", "too large"),
            ("1e999999999999", "no number"),
            ("1e999999999", "too large"),
            ("", "no number"),
            ("e6", "no number"),
            ("1.", "no number"),
            (".5", "no number"),
            ("_1", "no number"),
            ("1__0", "no number"),
            ("1e", "no number"),
            ("1e6e6", "no number"),
            ("1,000", "no number"),
            ("ten", "no number"),
            ("nan", "no number"),
        ] {
            let refusal = count::<u64>(text).unwrap_err();
            assert!(refusal.starts_with(&format!("it is {why}")), "{text}: {refusal}");
        }
        assert!(count::<u32>("4294967295").is_ok() && count::<u32>("4294967296").is_err());
    }
}
