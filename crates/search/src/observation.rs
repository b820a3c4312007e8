//! Observations: the results of simulations that a search uses.

/// The result of one evaluation: the robustness of the requirement and, if requested, its parts.
///
/// A search requests parts with [`Search::needs_parts`](crate::Search::needs_parts). For all other
/// searches the list is empty, and an observation can be converted from a number.
///
/// # Example
/// ```
/// use mishandle_search::Observation;
///
/// let observation = Observation::from(0.3);
/// assert!(observation.robustness == 0.3 && observation.parts.is_empty());
///
/// let observation = Observation { parts: vec![0.5, 0.3], ..Observation::from(0.3) };
/// assert_eq!(observation.parts[1], 0.3);
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Observation {
    /// The robustness of the requirement, which the search minimizes. `+∞` if the simulation has no
    /// verdict.
    pub robustness: f64,
    /// The [parts](crate::Parts) of the robustness, in the order of the space. Empty if the search
    /// does not request them, the simulation has no verdict, or it ended before they were decided.
    pub parts: Vec<f64>,
}

impl From<f64> for Observation {
    /// Creates an observation without parts. Does not allocate.
    fn from(robustness: f64) -> Self {
        Self { robustness, parts: Vec::new() }
    }
}
