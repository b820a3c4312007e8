//! What can be wrong with a formula, and with a formula on a trace.

/// Where something stands in the text of a formula; both numbers start at 1 and count characters.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Position {
    /// The line, 1 for a formula on one line.
    pub line: usize,
    /// The character within its line; one past the last where the text ends too early.
    pub column: usize,
}

impl std::fmt::Display for Position {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        if self.line > 1 {
            write!(f, "line {}, ", self.line)?;
        }
        write!(f, "column {}", self.column)
    }
}

/// Why a text is not a formula. Every variant knows where: see [`ParseError::position`].
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ParseError {
    /// Something else stands where a certain thing had to.
    #[error("{at}: expected {expected}, found {found}{}", hint(nearest))]
    Unexpected {
        /// Where it stands.
        at: Position,
        /// What would have been right there.
        expected: String,
        /// What stands there, in quotes, or "the end of the formula".
        found: String,
        /// The operator that is written most like this word, or the one before it, where one is close.
        nearest: Option<&'static str>,
    },
    /// A number that is not written as one, or that no `f64` can hold.
    #[error("{at}: expected {expected}, found the number `{text}`")]
    BadNumber {
        /// Where the number begins.
        at: Position,
        /// The number as written.
        text: String,
        /// What would have been right there.
        expected: String,
    },
    /// An interval whose begin lies after its end.
    #[error("{at}: expected an interval whose begin is at most its end, found [{begin}:{end}]")]
    BeginAfterEnd {
        /// Where the interval's `[` stands.
        at: Position,
        /// The begin as written.
        begin: String,
        /// The end as written.
        end: String,
    },
    /// A name that is defined twice.
    #[error("{at}: `{name}` is already defined; expected a new name")]
    DefinedTwice {
        /// Where the second definition stands.
        at: Position,
        /// The name.
        name: String,
    },
    /// More operands wait for their operators than a monitor has buffers for.
    #[error("{at}: expected at most {limit} operands waiting for their operators; the formula nests deeper")]
    TooDeep {
        /// Where the limit is passed.
        at: Position,
        /// The limit.
        limit: usize,
    },
    /// More operators and operands than a formula may have, sub-formulas written out.
    #[error(
        "{at}: expected at most {limit} operators and operands; the formula, its named parts written out, has more"
    )]
    TooLong {
        /// Where the limit is passed.
        at: Position,
        /// The limit.
        limit: usize,
    },
}

impl ParseError {
    /// Where in the text the formula goes wrong.
    pub fn position(&self) -> Position {
        match self {
            ParseError::Unexpected { at, .. }
            | ParseError::BadNumber { at, .. }
            | ParseError::BeginAfterEnd { at, .. }
            | ParseError::DefinedTwice { at, .. }
            | ParseError::TooDeep { at, .. }
            | ParseError::TooLong { at, .. } => *at,
        }
    }

    /// The column of [`ParseError::position`].
    pub fn column(&self) -> usize {
        self.position().column
    }
}

/// Why a formula has no robustness: it does not fit the signals or the clock, or the trace holds what no formula can
/// be measured on.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum MonitorError {
    /// The formula names a signal that the trace lacks.
    #[error("signal `{wanted}` is not in the trace, which holds: {}", list(known))]
    UnknownSignal {
        /// The name in the formula.
        wanted: String,
        /// The names in the trace, in its order.
        known: Vec<String>,
        /// The name in the trace that is written most alike, where one is close: a hint to show.
        nearest: Option<String>,
    },
    /// A clock whose period is not a length of time.
    #[error("the sampling period must be positive and finite, in seconds; it is {period_secs}")]
    BadPeriod {
        /// The period asked for, s.
        period_secs: f64,
    },
    /// An interval bound that falls between two samples.
    #[error(
        "bound {bound} of `{operator}` must be a whole number of steps of {period_secs} s; it is {samples} of them"
    )]
    NotAMultiple {
        /// The operator whose interval it is.
        operator: String,
        /// The bound as written.
        bound: String,
        /// The bound divided by the period.
        samples: f64,
        /// The sampling period, s.
        period_secs: f64,
    },
    /// A trace without samples has no time 0.
    #[error("the trace is empty; robustness needs at least one sample")]
    EmptyTrace,
    /// A trace whose signals are not those that the monitor was made for.
    #[error(
        "the monitor was made for `{wanted}` as signal {index} of the trace, which holds: {}",
        list(found)
    )]
    OtherSignals {
        /// The name that the monitor was made for.
        wanted: String,
        /// Its place among the signals, from 0.
        index: usize,
        /// The names in this trace.
        found: Vec<String>,
    },
    /// A sample that is NaN or infinite, in a signal of the formula.
    #[error("signal `{signal}` is {value} at step {step} (t = {time_secs} s); every sample must be finite")]
    NotFinite {
        /// The signal.
        signal: String,
        /// The value: NaN or an infinity.
        value: f64,
        /// The sample, from 0.
        step: usize,
        /// Its time, s.
        time_secs: f64,
    },
    /// Arithmetic without a value: a division by zero, the root of a negative number, an overflow.
    #[error("`{operation}` has no finite value at step {step} (t = {time_secs} s)")]
    Undefined {
        /// The operation with the values it was applied to.
        operation: String,
        /// The sample, from 0.
        step: usize,
        /// Its time, s.
        time_secs: f64,
    },
}

fn hint(nearest: &Option<&'static str>) -> String {
    nearest.map(|word| format!("; did you mean `{word}`?")).unwrap_or_default()
}

fn list(names: &[String]) -> String {
    if names.is_empty() { "no signals".to_owned() } else { names.join(", ") }
}

/// The known name that takes the fewest edits to reach, if it is at most a third of the name away (or two edits).
pub(crate) fn nearest<'a>(wanted: &str, known: &'a [String]) -> Option<&'a str> {
    let limit = (wanted.chars().count() / 3).max(2);
    nearest_within(limit, wanted, known.iter().map(String::as_str))
}

/// The known name that takes the fewest edits to reach, if it takes no more than `limit`.
pub(crate) fn nearest_within<'a>(
    limit: usize,
    wanted: &str,
    known: impl Iterator<Item = &'a str>,
) -> Option<&'a str> {
    let ranked = known.map(|name| (edits(wanted, name), name));
    ranked
        .filter(|(distance, _)| *distance <= limit)
        .min_by_key(|(distance, _)| *distance)
        .map(|(_, name)| name)
}

/// The Levenshtein distance of two texts, in characters, letter case ignored.
fn edits(a: &str, b: &str) -> usize {
    let b: Vec<char> = b.to_lowercase().chars().collect();
    let mut row: Vec<usize> = (0..=b.len()).collect();
    for (i, from) in a.to_lowercase().chars().enumerate() {
        let mut diagonal = row[0];
        row[0] = i + 1;
        for (j, to) in b.iter().enumerate() {
            let changed = diagonal + usize::from(from != *to);
            diagonal = row[j + 1];
            row[j + 1] = changed.min(row[j] + 1).min(diagonal + 1);
        }
    }
    row[b.len()]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nearest_name_is_the_one_fewest_edits_away() {
        let known = ["cube_height", "cube_speed", "door_yaw_deg"].map(String::from);
        let check = |wanted: &str, expected: Option<&str>| {
            assert_eq!(nearest(wanted, &known), expected, "{wanted}");
        };
        check("cube_hieght", Some("cube_height")); // two letters swapped: two edits
        check("Cube_Speed", Some("cube_speed"));
        check("door_yaw", None); // four edits, more than a third of eight letters
        check("x", None);
    }
}
