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
    /// A coordinate without levels.
    #[error("coordinate {coordinate} has 0 levels; an integer or categorical coordinate needs at least 1")]
    NoLevels {
        /// Index of the coordinate, from 0.
        coordinate: usize,
    },
    /// The search has no option of this name.
    #[error("{search} has no option `{wanted}`; {}", listed(known))]
    UnknownOption {
        /// The search.
        search: &'static str,
        /// The name given.
        wanted: String,
        /// The options of the search.
        known: Vec<String>,
    },
    /// An option has a wrong type or is out of range.
    #[error("option `{option}` of {search} is {found}; it must be {expected}")]
    Option {
        /// The search whose option it is.
        search: &'static str,
        /// The name of the option.
        option: String,
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
    /// The robustness told is NaN.
    #[error("the robustness told at {told:?} is NaN; a simulation without a verdict is told as +inf")]
    NotANumber {
        /// The point told.
        told: Vec<f64>,
    },
}

fn listed(known: &[String]) -> String {
    if known.is_empty() {
        "it has no options".to_owned()
    } else {
        format!("its options are: {}", known.join(", "))
    }
}
