use crate::Estimate;
use mishandle_results::StopDecision;

/// When to stop: a condition on an interval that holds at any time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum StopRule {
    /// The interval is at most this wide.
    Width(f64),
    /// The interval lies on one side of this rate.
    Rate(f64),
    /// The interval of a difference excludes 0, or lies within ± this margin.
    Difference(Option<f64>),
}

impl StopRule {
    /// Returns what the interval decides; `None` if more simulations are necessary.
    ///
    /// # Example
    /// ```
    /// use mishandle_evaluation::{Estimate, StopRule};
    /// use mishandle_results::StopDecision;
    /// let found = Estimate { value: Some(0.97), low: Some(0.953), high: Some(0.98), n: 900 };
    /// assert_eq!(StopRule::Rate(0.95).decide(&found), Some(StopDecision::Above));
    /// assert_eq!(StopRule::Width(0.02).decide(&found), None);
    /// ```
    pub fn decide(&self, found: &Estimate) -> Option<StopDecision> {
        let (low, high) = found.low.zip(found.high)?;
        let side = |value: f64| match (low > value, high < value) {
            (true, _) => Some(StopDecision::Above),
            (_, true) => Some(StopDecision::Below),
            _ => None,
        };
        match *self {
            StopRule::Width(width) => (high - low <= width).then_some(StopDecision::Narrow),
            StopRule::Rate(rate) => side(rate),
            StopRule::Difference(margin) => side(0.0).or_else(|| {
                let is_within = margin.is_some_and(|margin| -margin < low && high < margin);
                is_within.then_some(StopDecision::Equivalent)
            }),
        }
    }
}
