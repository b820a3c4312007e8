//! Decimal numbers as they are written, without rounding.

/// A number that is a whole number of powers of ten.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Decimal {
    digits: i128,
    /// The power of ten of the last digit.
    pub(crate) last_digit: i32,
}

impl Decimal {
    /// Reads a number such as `-1.25e-3`; `None` if the text is none, or has more than 36 digits.
    pub(crate) fn parse(text: &str) -> Option<Decimal> {
        let (mantissa, exponent) = text.split_once(['e', 'E']).unwrap_or((text, "0"));
        let exponent: i32 = exponent.parse().ok()?;
        let unsigned = mantissa.strip_prefix(['-', '+']).unwrap_or(mantissa);
        let (whole, fraction) = unsigned.split_once('.').unwrap_or((unsigned, ""));
        if whole.is_empty() && fraction.is_empty() || whole.len() + fraction.len() > 36 {
            return None;
        }
        let mut digits = 0_i128;
        for byte in whole.bytes().chain(fraction.bytes()) {
            digits = digits * 10 + i128::from(char::from(byte).to_digit(10)?);
        }
        let digits = if mantissa.starts_with('-') { -digits } else { digits };
        Some(Decimal { digits, last_digit: exponent.saturating_sub_unsigned(fraction.len() as u32) })
    }

    /// Returns the product with `factor`; `None` if it is not a whole number, or too large.
    pub(crate) fn times(self, factor: i128) -> Option<i128> {
        if self.digits == 0 {
            return Some(0);
        }
        let power = 10_i128.checked_pow(self.last_digit.unsigned_abs())?;
        if self.last_digit >= 0 {
            return self.digits.checked_mul(power)?.checked_mul(factor);
        }
        if factor % power == 0 {
            return self.digits.checked_mul(factor / power);
        }
        let product = self.digits.checked_mul(factor)?;
        (product % power == 0).then_some(product / power)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_number_keeps_all_its_digits() {
        let scaled = |text: &str, factor| Decimal::parse(text)?.times(factor);
        assert_eq!(scaled("1700000000.000000001", 10_i128.pow(9)), Some(1_700_000_000_000_000_001));
        assert_eq!(scaled("-1.25e-3", 100_000), Some(-125));
        assert_eq!(scaled("1.5", 1), None);
        assert_eq!(scaled("2.50", 10), Some(25));
        assert_eq!(scaled("1e30", 10_i128.pow(18)), None);
        assert_eq!(scaled("0e999", 1), Some(0));
        for text in ["", ".", "-", "1.2.3", "1e", "e5", "nan", "inf", "1_0", "0x1", "--1"] {
            assert_eq!(Decimal::parse(text), None, "{text}");
        }
    }
}
