//! Errors of creating and calling searches.

/// The error of creating a search or of calling it.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SearchError {
    /// No search has this name.
    #[error("search `{name}` is not known; known searches: {}", known.join(", "))]
    UnknownSearch {
        /// The given name.
        name: String,
        /// The names of all searches.
        known: Vec<&'static str>,
    },
    /// A search needs at least one coordinate.
    #[error("the dimension of the search is {found}; it must be at least 1")]
    Dimension {
        /// The given dimension.
        found: usize,
    },
    /// A coordinate without levels.
    #[error("coordinate {coordinate} has 0 levels; integer and categorical coordinates need at least 1")]
    NoLevels {
        /// The index of the coordinate, from 0.
        coordinate: usize,
    },
    /// The search has no option of this name.
    #[error("{search} has no option `{name}`; {}", listed(known))]
    UnknownOption {
        /// The search.
        search: &'static str,
        /// The given name.
        name: String,
        /// The options of the search.
        known: Vec<String>,
    },
    /// An option has a wrong type or is out of range.
    #[error("option `{option}` of {search} is {found}; it must be {expected}")]
    Option {
        /// The search.
        search: &'static str,
        /// The name of the option.
        option: String,
        /// The given value.
        found: String,
        /// The allowed values.
        expected: String,
    },
    /// An observation although no point is pending.
    #[error("received a value at {point:?}, but no point is pending; call `ask` first")]
    NotAsked {
        /// The point of the observation.
        point: Vec<f64>,
    },
    /// An observation at a point that is not the oldest pending one.
    #[error("received a value at {point:?}; expected the value at the oldest pending point, {expected:?}")]
    WrongPoint {
        /// The point of the observation.
        point: Vec<f64>,
        /// The oldest pending point.
        expected: Vec<f64>,
    },
    /// The robustness is NaN.
    #[error("the robustness at {point:?} is NaN; use +inf for a simulation without a verdict")]
    NotANumber {
        /// The point of the observation.
        point: Vec<f64>,
    },
}

fn listed(known: &[String]) -> String {
    if known.is_empty() {
        "it has no options".to_owned()
    } else {
        format!("its options are: {}", known.join(", "))
    }
}
