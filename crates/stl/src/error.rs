//! Errors of parsing a formula and of evaluating it on a trace.

use crate::name::{is_plain, is_visible, one_line, shown, spelled};
use crate::number::{Shown, with_short_numbers};

/// The hint on characters that a plain name cannot have.
pub(crate) const FINITE: &str =
    "a formula compares with finite numbers; a signal of this name needs backquotes";

pub(crate) const NO_UNIT: &str = "a number has no unit: `x <= 2` compares with 2 in the unit of the signal `x`, and only bounds such as [0:2s] have one";

/// Returns the hint on a letter that is an operator.
pub(crate) fn letter_hint(letter: &str) -> Box<str> {
    format!("a signal of this name needs backquotes: `{letter}`").into()
}

pub(crate) const BACKQUOTES: &str = "names with other characters are written in backquotes: `a/b[0]`";

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
    #[error("{at}: expected {expected}, found {found}{}", after(hint))]
    Unexpected {
        /// The position of the token.
        at: Position,
        /// The allowed text there.
        expected: String,
        /// The token in quotes, or "the end of the formula".
        found: String,
        /// A suggestion, such as the operator whose spelling is similar to this word.
        hint: Option<Box<str>>,
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
    /// A line that could go on with the definition before it or be the next statement.
    #[error(
        "{at}: a line that starts with {found} could continue the definition before it or be the next statement; write `;` \
         before {found} to start a statement, or put {found} at the end of the line before to continue"
    )]
    Ambiguous {
        /// The position of the token.
        at: Position,
        /// The token in quotes.
        found: String,
    },
    /// A definition of a word that has a meaning.
    #[error(
        "{at}: `{name}` is a word of the language, which no statement can define; choose another name, or write it in \
         backquotes wherever the name is meant"
    )]
    Reserved {
        /// The position of the word.
        at: Position,
        /// The word.
        name: String,
    },
    /// A definition after a use of its name, which was a signal there.
    #[error(
        "{at}: {} is defined here, but {first} reads it as a signal; write the definition before its uses, or choose \
         another name",
        shown(name)
    )]
    DefinedAfterUse {
        /// The position of the definition.
        at: Position,
        /// The name.
        name: String,
        /// The position of its first use.
        first: Position,
    },
    /// A name defined twice.
    #[error("{at}: {} is already defined; expected a new name", shown(name))]
    DefinedTwice {
        /// The position of the second definition.
        at: Position,
        /// The name.
        name: String,
    },
    /// A number as last statement, which must be a formula.
    #[error(
        "{at}: `{} = ...` defines a number, but the last statement must be a formula; did you mean `==`?",
        one_line(&spelled(name))
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
            | ParseError::Ambiguous { at, .. }
            | ParseError::Reserved { at, .. }
            | ParseError::DefinedAfterUse { at, .. }
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
    #[error("signal {} is not in the trace; known signals: {}", shown(signal), list(known))]
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
        "`{} = ...` defines a name that is already a signal of the trace; did you mean `==`? If not, rename the \
         definition",
        one_line(&spelled(name))
    )]
    ShadowsSignal {
        /// The name.
        name: String,
    },
    /// A letter in the formula is an operator, and also the name of a signal of the trace.
    #[error(
        "the formula reads {letter} as the operator `{operator}`, and the trace has a signal of this name; write `{operator}` \
         for the operator, or the name in backquotes for the signal: `{letter}`"
    )]
    LetterIsSignal {
        /// The letter.
        letter: String,
        /// The operator.
        operator: String,
    },
    /// A formula whose value depends on no trace.
    #[error("the formula reads no signal, so its verdict is the same on every trace")]
    NoSignal,
    /// A sampling period that is not positive and finite.
    #[error("the sampling period is {} s; it must be positive and finite", Shown(*period_secs))]
    InvalidPeriod {
        /// The sampling period, s.
        period_secs: f64,
    },
    /// A bound in a unit of time, although the sampling period is unknown.
    #[error(
        "bound {bound} of `{operator}` is a time, but the time between two samples is unknown; pass it as period, or \
         count samples"
    )]
    UnknownPeriod {
        /// The operator that has the interval.
        operator: String,
        /// The bound with its unit.
        bound: String,
    },
    /// An interval bound that is not a multiple of the sampling period.
    #[error(
        "bound {bound} of `{operator}` is {} steps{}; it must be a whole number of steps",
        Shown(*samples),
        of_period(*period_secs)
    )]
    NotAMultiple {
        /// The operator that has the interval.
        operator: String,
        /// The bound with its unit.
        bound: String,
        /// The bound divided by the period.
        samples: f64,
        /// The sampling period, s; NaN if it is unknown.
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
    #[error(
        "expected {} as signal {index} of the trace, found the signals: {}",
        shown(expected),
        list(found)
    )]
    SignalMismatch {
        /// The name that the monitor was compiled for.
        expected: String,
        /// The index of the signal, from 0.
        index: usize,
        /// The names of the trace's signals.
        found: Vec<String>,
    },
    /// A sample is NaN or infinite, in a signal that the formula reads.
    #[error(
        "signal {} is {value} at step {step}{}; every sample must be finite",
        shown(signal),
        at_time(*time_secs)
    )]
    NotFinite {
        /// The signal.
        signal: String,
        /// The value: NaN or ±∞.
        value: f64,
        /// The sample, from 0.
        step: usize,
        /// Its time, s; NaN if the sampling period is unknown.
        time_secs: f64,
    },
    /// Arithmetic without a finite value: a division by zero, the square root of a negative number,
    /// an overflow.
    #[error(
        "`{}` has no finite value at step {step}{}",
        with_short_numbers(operation),
        at_time(*time_secs)
    )]
    Undefined {
        /// The operation with the values of its operands.
        operation: String,
        /// The sample, from 0.
        step: usize,
        /// Its time, s; NaN if the sampling period is unknown.
        time_secs: f64,
    },
}

impl MonitorError {
    /// Returns a suggestion for the user, if there is one.
    pub fn hint(&self) -> Option<String> {
        match self {
            MonitorError::UnknownSignal { nearest: Some(name), .. } if is_plain(name) => {
                Some(format!("did you mean `{name}`?"))
            }
            MonitorError::UnknownSignal { nearest: Some(name), .. } => name_hint(name),
            _ => None,
        }
    }
}

/// Returns the hint on a signal whose name a formula must spell with backquotes; `None` if it has
/// characters that no reader could copy from a message.
pub fn name_hint(name: &str) -> Option<String> {
    is_visible(name)
        .then(|| format!("to read the signal {}, write its name with the backquotes", spelled(name)))
}

fn after(hint: &Option<Box<str>>) -> String {
    hint.as_ref().map(|hint| format!("; {hint}")).unwrap_or_default()
}

fn of_period(secs: f64) -> String {
    if secs.is_nan() { String::new() } else { format!(" of {} s", Shown(secs)) }
}

fn at_time(secs: f64) -> String {
    if secs.is_nan() { String::new() } else { format!(" (t = {} s)", Shown(secs)) }
}

/// The number of names that a message lists.
const LISTED: usize = 50;

/// Lists names as a formula spells them.
fn list(names: &[String]) -> String {
    if names.is_empty() {
        return "no signals".to_owned();
    }
    let listed: Vec<String> = names.iter().take(LISTED).map(|name| one_line(&spelled(name))).collect();
    match names.len() - listed.len() {
        0 => listed.join(", "),
        more => format!("{} and {more} more", listed.join(", ")),
    }
}
