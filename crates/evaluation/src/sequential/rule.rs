use crate::Estimate;

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

/// Reason to end the simulations.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Decision {
    /// The interval is narrow enough.
    Narrow,
    /// The value is above the rate, or the difference above 0.
    Above,
    /// The value is below the rate, or the difference below 0.
    Below,
    /// The difference is smaller than the margin, in either direction.
    Equivalent,
}

impl StopRule {
    /// Returns what the interval decides; `None` if more simulations are necessary.
    ///
    /// # Example
    /// ```
    /// use mishandle_evaluation::{Decision, Estimate, StopRule};
    /// let found = Estimate { value: Some(0.97), low: Some(0.953), high: Some(0.98), n: 900 };
    /// assert_eq!(StopRule::Rate(0.95).decide(&found), Some(Decision::Above));
    /// assert_eq!(StopRule::Width(0.02).decide(&found), None);
    /// ```
    pub fn decide(&self, found: &Estimate) -> Option<Decision> {
        let (low, high) = found.low.zip(found.high)?;
        let side = |value: f64| match (low > value, high < value) {
            (true, _) => Some(Decision::Above),
            (_, true) => Some(Decision::Below),
            _ => None,
        };
        match *self {
            StopRule::Width(width) => (high - low <= width).then_some(Decision::Narrow),
            StopRule::Rate(rate) => side(rate),
            StopRule::Difference(margin) => side(0.0).or_else(|| {
                let is_within = margin.is_some_and(|margin| -margin < low && high < margin);
                is_within.then_some(Decision::Equivalent)
            }),
        }
    }
}
