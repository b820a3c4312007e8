//! Numbers on the command line: integers as 1000000, `1_000_000` or 1e6, and numbers with a
//! fraction.
//!
//! clap prints the name of the flag and the value before the message of a parser.

use std::ops::RangeInclusive;

use mishandle_text::parse_integer;

/// Returns a parser of integers in `range`.
pub fn integer<T: TryFrom<u64>>(range: RangeInclusive<u64>) -> impl Fn(&str) -> Result<T, String> + Clone {
    move |text| {
        let low = range.start();
        let high = range.end();
        let error = |why: &str| {
            format!("the value is {why}; expected an integer from {low} to {high}{}", examples(&range))
        };
        let number = parse_integer(text).map_err(error)?;
        if number < *low {
            return Err(error("too small"));
        }
        T::try_from(number).ok().filter(|_| number <= *high).ok_or_else(|| error("too large"))
    }
}

/// Returns examples of a number in its notations, from those that the range allows.
fn examples(range: &RangeInclusive<u64>) -> String {
    let notations = [(10, "10"), (1000, "1_000"), (1000, "1e3"), (100_000, "100_000"), (100_000, "1e5")];
    let allowed = notations.into_iter().filter(|(number, _)| range.contains(number)).take(3);
    match allowed.map(|(_, text)| text).collect::<Vec<_>>()[..] {
        [first, second, third] => format!(", such as {first}, {second} or {third}"),
        [first, ..] => format!(", such as {first}"),
        [] => String::new(),
    }
}

/// Returns a parser of numbers that satisfy `is_allowed`; `expected` describes them.
pub fn number(
    expected: &'static str,
    is_allowed: fn(f64) -> bool,
) -> impl Fn(&str) -> Result<f64, String> + Clone {
    move |text| {
        let error = |why: &str| format!("the value is {why}; expected {expected}");
        let number: f64 = text.trim().parse().map_err(|_| error("not a number"))?;
        if is_allowed(number) { Ok(number) } else { Err(error("out of range")) }
    }
}

/// Parses the width and the height of the images of a camera, pixels.
pub fn image_size(text: &str) -> Result<[u16; 2], String> {
    let sides = text.split_once('x').map(|(width, height)| [width, height].map(|side| side.parse().ok()));
    match sides {
        Some([Some(width @ 1..=1024), Some(height @ 1..=1024)]) => Ok([width, height]),
        _ => Err("expected two numbers from 1 to 1024, such as 64x64".to_string()),
    }
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
            assert_eq!(integer::<u64>(0..=u64::MAX)(text), Ok(number), "{text}");
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
            let error = integer::<u64>(0..=u64::MAX)(text).unwrap_err();
            let expected = format!(
                "the value is {why}; expected an integer from 0 to 18446744073709551615, such as 10, 1_000 or 1e3"
            );
            assert_eq!(error, expected, "{text}");
        }
    }

    #[test]
    fn an_integer_outside_of_its_range_is_an_error_that_names_the_range() {
        let parse = integer::<u8>(1..=200);
        assert_eq!((parse("1"), parse("2e2")), (Ok(1), Ok(200)));
        for (text, why) in [("0", "too small"), ("201", "too large"), ("256", "too large")] {
            let error = parse(text).unwrap_err();
            assert!(
                error.starts_with(&format!("the value is {why}; expected an integer from 1 to 200")),
                "{error}"
            );
        }
    }

    #[test]
    fn the_examples_of_an_error_are_in_the_range() {
        let examples = |range| {
            let error = integer::<u64>(range)("-1").unwrap_err();
            error.split_once(", such as ").map_or(String::new(), |(_, examples)| examples.to_string())
        };
        assert_eq!(examples(1..=1_000_000), "10, 1_000 or 1e3");
        assert_eq!(examples(100..=1_000_000_000), "1_000, 1e3 or 100_000");
        assert_eq!(examples(1..=200), "10");
        assert_eq!(examples(1..=3), "");
    }

    #[test]
    fn a_number_is_checked_and_its_error_says_what_is_expected() {
        let parse = number("a number from 0 to 10", |number| (0.0..=10.0).contains(&number));
        assert_eq!((parse("0.5"), parse(" 1e1 ")), (Ok(0.5), Ok(10.0)));
        for (text, why) in
            [("0,5", "not a number"), ("", "not a number"), ("-1", "out of range"), ("nan", "out of range")]
        {
            assert_eq!(
                parse(text),
                Err(format!("the value is {why}; expected a number from 0 to 10")),
                "{text}"
            );
        }
    }
}
