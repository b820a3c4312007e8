//! What can go wrong between a search and its caller.

/// A mistake in how a search was made or told.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SearchError {
    /// No search has this name.
    #[error("there is no search `{wanted}`; there are {}", known.join(", "))]
    UnknownSearch {
        /// The name asked for.
        wanted: String,
        /// The names there are.
        known: Vec<&'static str>,
    },
    /// A search needs at least one coordinate.
    #[error("a search of dimension {found} was asked for; the dimension must be at least 1")]
    Dimension {
        /// The dimension asked for.
        found: usize,
    },
    /// An option is outside its range.
    #[error("option `{option}` of {search} is {found}; it must be {expected}")]
    Option {
        /// The search whose option it is.
        search: &'static str,
        /// The option's field.
        option: &'static str,
        /// What was given.
        found: String,
        /// What would be right.
        expected: String,
    },
    /// A value was told though no point awaits one.
    #[error("a value was told at {told:?}, but no point awaits its value; ask first")]
    NotAsked {
        /// The point told.
        told: Vec<f64>,
    },
    /// A value was told at another point than the one whose turn it is.
    #[error("a value was told at {told:?}; the next value expected is that at {asked:?}")]
    WrongPoint {
        /// The point told.
        told: Vec<f64>,
        /// The point that has waited longest.
        asked: Vec<f64>,
    },
    /// The value told is NaN.
    #[error("the value told at {told:?} is NaN; a failed evaluation is told as +inf")]
    NotANumber {
        /// The point told.
        told: Vec<f64>,
    },
}
