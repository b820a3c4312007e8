//! Intervals as people write them, with closed or open ends.

use std::fmt;
use std::str::FromStr;

/// The bounds of an axis as text, such as `[0, 61.2)`: a square end is closed, a round end is open.
///
/// Bounds of an [`Axis`](crate::Axis) are always values that it can have. So an open end becomes
/// the nearest number inside, and nothing else needs to know of it.
///
/// # Example
/// ```
/// use mishandle_rollout::Interval;
/// let Interval { low, high } = "[0, 61.2)".parse()?;
/// assert!(low == 0.0 && high < 61.2 && high.next_up() == 61.2);
/// assert!("[0; 1]".parse::<Interval>().is_err());
/// # Ok::<(), mishandle_rollout::IntervalError>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Interval {
    /// Smallest value of the interval.
    pub low: f64,
    /// Largest value of the interval.
    pub high: f64,
}

/// A text is not an interval.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct IntervalError;

impl fmt::Display for IntervalError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("an interval is written [0, 1], or with an open end such as [0, 1)")
    }
}

impl std::error::Error for IntervalError {}

impl FromStr for Interval {
    type Err = IntervalError;

    fn from_str(text: &str) -> Result<Interval, IntervalError> {
        let text = text.trim();
        let (from, until) = match (text.chars().next(), text.chars().last()) {
            (Some(from @ ('[' | '(')), Some(until @ (']' | ')'))) => (from, until),
            _ => return Err(IntervalError),
        };
        let inner = text.get(1..text.len() - 1).unwrap_or_default();
        let (low, high) = inner.split_once([',', ':']).ok_or(IntervalError)?;
        let number = |text: &str| text.trim().parse::<f64>().map_err(|_| IntervalError);
        let low = number(low)?;
        let high = number(high)?;
        let low = if from == '(' { low.next_up() } else { low };
        let high = if until == ')' { high.next_down() } else { high };
        Ok(Interval { low, high })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_round_end_is_open_and_a_square_end_is_closed() {
        for (text, low_is_open, high_is_open) in [
            ("[-1, 2.5]", false, false),
            ("(-1,2.5]", true, false),
            (" [-1:2.5) ", false, true),
            ("( -1 , 2.5 )", true, true),
        ] {
            let Interval { low, high } = text.parse().unwrap();
            assert_eq!((low > -1.0, high < 2.5), (low_is_open, high_is_open), "{text}");
            let between = |x: f64| x > -1.0 && x < low || x > high && x < 2.5;
            assert!(!between(low.next_down()) && !between(high.next_up()), "{text}: no number is lost");
        }
    }

    #[test]
    fn other_texts_are_errors() {
        for text in ["", "[", "[]", "[1]", "1, 2", "[1, 2", "[a, 2]", "[1 2]", "{1, 2}", "é1, 2)", ")1, 2("]
        {
            assert_eq!(text.parse::<Interval>(), Err(IntervalError), "{text}");
        }
    }
}
