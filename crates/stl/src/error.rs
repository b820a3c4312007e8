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
    /// A last statement that gives a name to a number, where a formula has to stand.
    #[error("{at}: `{name} = ...` names a number and measures nothing; did you mean `==`?")]
    NamesNumber {
        /// Where the name stands.
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
            | ParseError::NamesNumber { at, .. }
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
    /// A definition of the formula bears the name of a signal, which it would hide.
    #[error(
        "`{name} = ...` defines a name that is a signal of the trace; did you mean `==`? If not, the definition needs \
         another name"
    )]
    HidesSignal {
        /// The name.
        name: String,
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
    /// An interval bound past the end of any trace, so that horizons could not be added up.
    #[error(
        "bound {bound} of `{operator}` is {samples:e} samples, more than any trace has; write `inf` for a window \
         without an end"
    )]
    TooLate {
        /// The operator whose interval it is.
        operator: String,
        /// The bound as written.
        bound: String,
        /// The bound divided by the period.
        samples: f64,
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

impl MonitorError {
    /// What may have been meant, if something can be said.
    pub fn hint(&self) -> Option<String> {
        match self {
            MonitorError::UnknownSignal { nearest: Some(name), .. } => {
                Some(format!("did you mean `{name}`?"))
            }
            _ => None,
        }
    }
}

fn hint(nearest: &Option<&'static str>) -> String {
    nearest.map(|word| format!("; did you mean `{word}`?")).unwrap_or_default()
}

fn list(names: &[String]) -> String {
    if names.is_empty() { "no signals".to_owned() } else { names.join(", ") }
}
