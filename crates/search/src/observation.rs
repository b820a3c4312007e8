//! Observations: the results of simulations that a search uses.

/// The result of one evaluation: the robustness of the requirement and, if requested, of its
/// sub-formulas.
///
/// A search requests sub-formulas with
/// [`Search::needs_subformulas`](crate::Search::needs_subformulas). For all other searches the list
/// is empty, and an observation can be converted from a number.
///
/// # Example
/// ```
/// use mishandle_search::{Observation, SubformulaMinimum};
///
/// let observation = Observation::from(0.3);
/// assert!(observation.robustness == 0.3 && observation.subformulas.is_empty());
///
/// let left = SubformulaMinimum { minimum: 0.3, step: 120 };
/// let observation = Observation { subformulas: vec![left], ..Observation::from(0.3) };
/// assert_eq!(observation.subformulas[0].step, 120);
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Observation {
    /// The robustness of the requirement, which the search minimizes. `+∞` if the simulation has no
    /// verdict.
    pub robustness: f64,
    /// One entry per sub-formula of the requirement, in the order in which the monitor lists them:
    /// root first, depth first. Empty if the search does not request them or the simulation has no
    /// verdict.
    pub subformulas: Vec<SubformulaMinimum>,
}

/// The least robustness of a sub-formula over a trace.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SubformulaMinimum {
    /// The minimum over all samples at which the trace covers the sub-formula; `+∞` if there is no
    /// such sample.
    pub minimum: f64,
    /// The first control step (sample index) at which the minimum is attained; 0 if there is no
    /// such sample.
    pub step: usize,
}

impl From<f64> for Observation {
    /// Creates an observation without sub-formulas. Does not allocate.
    fn from(robustness: f64) -> Self {
        Self { robustness, subformulas: Vec::new() }
    }
}
