//! When and by which predicate a trace violates a formula.

use std::sync::Arc;

use mishandle_falsification::Signature;
use mishandle_rollout::RolloutError;
use mishandle_stl::{Clock, Formula, Monitor, Trace, is_satisfied, is_violated};
use mishandle_store::RunHeader;

/// Largest number of sub-formulas of a formula that is explained: the text of each is written, and
/// the first ones contain most of the others.
pub(crate) const MAX_SUBFORMULAS: usize = 1000;

/// Largest number of samples of a trace whose continuations are bounded.
const MAX_SAMPLES: usize = 10_000_000;

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
/// robustness.
pub(crate) fn decided(
    formula: &Formula,
    trace: &Trace,
    clock: Clock,
    robustness: f64,
) -> Result<Option<usize>, RolloutError> {
    let monitor_error = |source| RolloutError::Monitor { formula: formula.to_string(), source };
    let mut monitor = Monitor::new(formula, trace.names(), clock).map_err(monitor_error)?;
    // An episode that ended early may be shorter than the windows.
    let samples = monitor.horizon().map_or(trace.len(), |horizon| trace.len().max(horizon.saturating_add(1)));
    if samples > MAX_SAMPLES {
        return Ok(None);
    }
    let mut is_decided = |len: usize| -> Result<bool, RolloutError> {
        let bounds = monitor.robustness_bounds(&prefix(trace, len), samples).map_err(monitor_error)?;
        let is_fixed =
            |(low, high)| if is_violated(robustness) { is_violated(high) } else { is_satisfied(low) };
        Ok(bounds.is_some_and(is_fixed))
    };
    if !is_decided(trace.len())? {
        return Ok(None);
    }
    // More samples can only narrow the bounds.
    let (mut open, mut closed) = (0, trace.len());
    while closed - open > 1 {
        let middle = (open + closed) / 2;
        if is_decided(middle)? { closed = middle } else { open = middle }
    }
    Ok(Some(closed - 1))
}

/// Returns the first samples of a trace.
fn prefix(trace: &Trace, len: usize) -> Trace {
    let mut prefix = Trace::with_capacity(Arc::clone(trace.names()), len);
    let mut sample = vec![0.0; trace.names().len()];
    for step in 0..len {
        sample.iter_mut().enumerate().for_each(|(index, value)| *value = trace.column(index)[step]);
        prefix.push(&sample);
    }
    prefix
}
