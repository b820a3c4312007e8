//! When and by which predicate a trace violates a formula.

use mishandle_falsification::Signature;
use mishandle_rollout::RolloutError;
use mishandle_stl::{Clock, Formula, OnlineMonitor, Trace, is_satisfied};
use mishandle_store::RunHeader;

/// Largest number of sub-formulas of a formula that is explained: the text of each is written, and
/// the first ones contain most of the others.
pub(crate) const MAX_SUBFORMULAS: usize = 1000;

/// A part of the explanation of a violation that takes little time.
pub(crate) struct Violation {
    /// Robustness of the formula; NaN if the formula is too long to be explained.
    pub robustness: f64,
    /// Predicate and time. A formula that is too long to be explained has an empty predicate.
    pub signature: Signature,
}

/// Returns when and by which predicate a trace violates the formula of a run.
///
/// # Errors
/// If the formula has no finite value on the trace.
pub(crate) fn violation(header: &RunHeader, trace: &Trace) -> Result<Violation, RolloutError> {
    let formula = Formula::parse(&header.formula)
        .map_err(|source| RolloutError::Parse { formula: header.formula.clone(), source })?;
    violation_of(&formula, trace, header.control_dt)
}

/// Returns when and by which predicate a trace violates `formula`.
///
/// # Errors
/// If the formula has no finite value on the trace.
pub(crate) fn violation_of(
    formula: &Formula,
    trace: &Trace,
    control_dt: f64,
) -> Result<Violation, RolloutError> {
    let clock = Clock::steps(control_dt);
    let final_sample = decided(formula, trace, clock, -1.0)?;
    if formula.subformulas().len() > MAX_SUBFORMULAS {
        let signature = Signature { predicate: String::new(), sample: final_sample.unwrap_or(0) };
        return Ok(Violation { robustness: f64::NAN, signature });
    }
    let monitor_error = |source| RolloutError::Monitor { formula: formula.to_string(), source };
    let diagnosis = formula.diagnose(trace, &clock).map_err(monitor_error)?;
    let robustness = diagnosis.robustness();
    let sample = final_sample.or(diagnosis.path.last().map(|last| last.sample)).unwrap_or(0);
    let predicate = diagnosis.predicate.map_or(String::new(), |found| found.text);
    Ok(Violation { robustness, signature: Signature { predicate, sample } })
}

/// Returns the first sample after which no continuation of the trace changes the sign of the
/// robustness. It reads no later sample.
pub(crate) fn decided(
    formula: &Formula,
    trace: &Trace,
    clock: Clock,
    robustness: f64,
) -> Result<Option<usize>, RolloutError> {
    let monitor_error = |source| RolloutError::Monitor { formula: formula.to_string(), source };
    let mut monitor = OnlineMonitor::new(std::slice::from_ref(formula), trace.names(), clock, None)
        .map_err(monitor_error)?;
    // An episode that ended early may be shorter than the windows.
    let (needed, is_unbounded) = monitor.needed_samples(0);
    let samples = if is_unbounded { trace.len() } else { trace.len().max(needed) };
    monitor.state_samples(Some(samples));
    for step in 0..trace.len() {
        monitor.push_trace(trace, step..step + 1).map_err(monitor_error)?;
        if monitor.verdict(0) == Some(is_satisfied(robustness)) {
            return Ok(Some(step));
        }
    }
    Ok(None)
}
