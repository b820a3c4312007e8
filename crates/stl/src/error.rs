//! Errors of parsing a formula and of evaluating it on a trace.

/// A position in the text of a formula. Line and column start at 1; columns count characters.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Position {
    /// The line.
    pub line: usize,
    /// The column; one past the last character if the text ends too early.
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

/// The error of parsing a formula. [`ParseError::position`] returns where it is.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ParseError {
    /// An unexpected token.
    #[error("{at}: expected {expected}, found {found}{}", hint(nearest))]
    Unexpected {
        /// The position of the token.
        at: Position,
        /// The allowed text there.
        expected: String,
        /// The token in quotes, or "the end of the formula".
        found: String,
        /// The operator with the most similar spelling, if one is similar to this word or to the
        /// one before it.
        nearest: Option<&'static str>,
    },
    /// A malformed number, or one outside the range of `f64`.
    #[error("{at}: expected {expected}, found the number `{text}`")]
    BadNumber {
        /// The position of the number.
        at: Position,
        /// The number as written.
        text: String,
        /// The allowed text there.
        expected: String,
    },
    /// An interval whose begin is later than its end.
    #[error("{at}: expected an interval [begin:end] with begin <= end, found [{begin}:{end}]")]
    BeginAfterEnd {
        /// The position of the interval's `[`.
        at: Position,
        /// The begin as written.
        begin: String,
        /// The end as written.
        end: String,
    },
    /// A name defined twice.
    #[error("{at}: `{name}` is already defined; expected a new name")]
    DefinedTwice {
        /// The position of the second definition.
        at: Position,
        /// The name.
        name: String,
    },
    /// A number as last statement, which must be a formula.
    #[error(
        "{at}: `{name} = ...` defines a number, but the last statement must be a formula; did you mean `==`?"
    )]
    NamesNumber {
        /// The position of the name.
        at: Position,
        /// The name.
        name: String,
    },
    /// The formula is nested too deeply: it needs more buffers than a monitor may have.
    #[error("{at}: the formula is nested too deeply; at most {limit} operands may be pending at once")]
    TooDeep {
        /// The position where the limit is exceeded.
        at: Position,
        /// The limit.
        limit: usize,
    },
    /// The formula has too many operators and operands: those of all statements together, after the
    /// names in them are expanded.
    #[error(
        "{at}: the formula is too long: all statements together may have at most {limit} operators and operands after \
         named sub-formulas are expanded; name fewer sub-formulas, or use them less often"
    )]
    TooLong {
        /// The position where the limit is exceeded.
        at: Position,
        /// The limit.
        limit: usize,
    },
    /// The text of the formula is too long.
    #[error("the formula has {bytes} bytes; at most {limit} are allowed")]
    TextTooLong {
        /// The first character.
        at: Position,
        /// The length of the text, bytes.
        bytes: usize,
        /// The limit, bytes.
        limit: usize,
    },
}

impl ParseError {
    /// Returns the position of the error in the text.
    pub fn position(&self) -> Position {
        match self {
            ParseError::Unexpected { at, .. }
            | ParseError::BadNumber { at, .. }
            | ParseError::BeginAfterEnd { at, .. }
            | ParseError::DefinedTwice { at, .. }
            | ParseError::NamesNumber { at, .. }
            | ParseError::TooDeep { at, .. }
            | ParseError::TooLong { at, .. }
            | ParseError::TextTooLong { at, .. } => *at,
        }
    }

    /// Returns the column of [`ParseError::position`].
    pub fn column(&self) -> usize {
        self.position().column
    }
}

/// The error of compiling a formula for a set of signals, or of evaluating it on a trace.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum MonitorError {
    /// The trace has no signal of this name.
    #[error("signal `{signal}` is not in the trace; known signals: {}", list(known))]
    UnknownSignal {
        /// The name in the formula.
        signal: String,
        /// The names of the trace's signals, in order.
        known: Vec<String>,
        /// The known signal with the most similar spelling, if one is similar.
        nearest: Option<String>,
    },
    /// A definition in the formula has the name of a signal and would shadow it.
    #[error(
        "`{name} = ...` defines a name that is already a signal of the trace; did you mean `==`? If not, rename the \
         definition"
    )]
    ShadowsSignal {
        /// The name.
        name: String,
    },
    /// A sampling period that is not positive and finite.
    #[error("the sampling period is {period_secs} s; it must be positive and finite")]
    InvalidPeriod {
        /// The sampling period, s.
        period_secs: f64,
    },
    /// An interval bound that is not a multiple of the sampling period.
    #[error(
        "bound {bound} of `{operator}` is {samples} steps of {period_secs} s; it must be a whole number of steps"
    )]
    NotAMultiple {
        /// The operator that has the interval.
        operator: String,
        /// The bound with its unit.
        bound: String,
        /// The bound divided by the period.
        samples: f64,
        /// The sampling period, s.
        period_secs: f64,
    },
    /// An interval bound so large that the sum of bounds could overflow.
    #[error(
        "bound {bound} of `{operator}` is {samples:e} samples, more than any trace has; write `inf` for an unbounded \
     interval"
    )]
    BoundTooLarge {
        /// The operator that has the interval.
        operator: String,
        /// The bound with its unit.
        bound: String,
        /// The bound divided by the period.
        samples: f64,
    },
    /// The trace has no samples.
    #[error("the trace is empty; it must have at least one sample")]
    EmptyTrace,
    /// The trace's signals differ from those that the monitor was compiled for.
    #[error("expected `{expected}` as signal {index} of the trace, found the signals: {}", list(found))]
    SignalMismatch {
        /// The name that the monitor was compiled for.
        expected: String,
        /// The index of the signal, from 0.
        index: usize,
        /// The names of the trace's signals.
        found: Vec<String>,
    },
    /// A recording was made for another formula than the monitor's.
    #[error("the recording was made for another formula; make one for the formula of the monitor")]
    OtherFormula,
    /// A sample is NaN or infinite, in a signal that the formula reads.
    #[error("signal `{signal}` is {value} at step {step} (t = {time_secs} s); every sample must be finite")]
    NotFinite {
        /// The signal.
        signal: String,
        /// The value: NaN or ±∞.
        value: f64,
        /// The sample, from 0.
        step: usize,
        /// Its time, s.
        time_secs: f64,
    },
    /// Arithmetic without a finite value: a division by zero, the square root of a negative number,
    /// an overflow.
    #[error("`{operation}` has no finite value at step {step} (t = {time_secs} s)")]
    Undefined {
        /// The operation with the values of its operands.
        operation: String,
        /// The sample, from 0.
        step: usize,
        /// Its time, s.
        time_secs: f64,
    },
}

impl MonitorError {
    /// Returns a suggestion for the user, if there is one.
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

/// The number of names that a message lists.
const LISTED: usize = 50;

fn list(names: &[String]) -> String {
    match names.get(LISTED..) {
        _ if names.is_empty() => "no signals".to_owned(),
        Some(more) if !more.is_empty() => format!("{} and {} more", names[..LISTED].join(", "), more.len()),
        _ => names.join(", "),
    }
}
