//! The Boolean verdict that a robustness carries.

/// Returns whether a trace with this robustness satisfies the formula: it is positive or +0.0.
///
/// # Example
/// ```
/// use std::sync::Arc;
/// use mishandle_stl::{Clock, Formula, Monitor, Trace, is_satisfied};
///
/// let names: Arc<[String]> = Arc::from(["collisions".to_owned()]);
/// let mut trace = Trace::new(Arc::clone(&names));
/// trace.push(&[0.0]);
/// let mut holds = |text: &str| {
///     let formula = Formula::parse(text).unwrap();
///     let mut monitor = Monitor::new(&formula, &names, Clock::steps(0.1)).unwrap();
///     is_satisfied(monitor.robustness(&trace).unwrap())
/// };
/// // The robustness of both is 0.
/// assert!(holds("always(collisions == 0)") && !holds("always(collisions < 0)"));
/// ```
pub fn is_satisfied(robustness: f64) -> bool {
    robustness.is_sign_positive()
}

/// Returns whether a trace with this robustness violates the formula: it is negative or −0.0.
pub fn is_violated(robustness: f64) -> bool {
    robustness.is_sign_negative()
}
