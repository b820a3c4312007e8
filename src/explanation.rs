//! Explanations of recorded simulations: when and where a formula is violated, and by which predicate.

use std::sync::Arc;

use mishandle_rollout::{Episode, Request, RolloutError};
use mishandle_stl::{Clock, Diagnosis, Formula, Monitor, Trace};
use mishandle_store::{RunFile, RunHeader, Simulation, StoredTrace};

use crate::record;
use crate::replay::recorded_plan;
use crate::{MishandleError, ResolvedPlan};

/// Largest number of predicates whose robustness alone is computed.
const MAX_PREDICATES: usize = 100;

/// What determines the robustness of a trace.
#[derive(Clone, Debug)]
pub struct Explanation {
    /// The chain from the formula to the decisive predicate.
    pub diagnosis: Diagnosis,
    /// How the decisive predicate develops; `None` without one.
    pub history: Option<PredicateHistory>,
    /// The robustness of the formula with each predicate as the only conjunct, in the order of the formula. An operand of
    /// `and` with a larger robustness is masked by one with a smaller.
    pub conjuncts: Vec<Conjunct>,
}

/// The decisive predicate over its window.
#[derive(Clone, Debug, PartialEq)]
pub struct PredicateHistory {
    /// First and last sample at which the operator above evaluates the predicate.
    pub window: (usize, usize),
    /// Number of these samples that violate the predicate.
    pub violated: usize,
    /// First and last of these samples; `None` if there are none.
    pub first_and_last: Option<(usize, usize)>,
    /// Robustness of the predicate at each sample of the trace. If the formula requires the predicate to be false, the
    /// opposite.
    pub robustness: Vec<f64>,
}

/// A predicate of the formula, alone.
#[derive(Clone, Debug, PartialEq)]
pub struct Conjunct {
    /// Position in the list of [`Formula::subformulas`].
    pub position: usize,
    /// Text of the predicate.
    pub predicate: String,
    /// Robustness of the formula without the other operands of each `and` above the predicate.
    pub robustness: f64,
}

/// Explains the robustness of `trace`.
///
/// # Errors
/// If the trace lacks a signal of the formula, or the formula has no finite value on it.
pub fn explain_trace(
    formula: &Formula,
    trace: &Trace,
    control_dt: f64,
) -> Result<Explanation, MishandleError> {
    let clock = Clock::steps(control_dt);
    let monitor_error = |source| RolloutError::Monitor { formula: formula.to_string(), source };
    let diagnosis = formula.diagnose(trace, &clock).map_err(monitor_error)?;
    let robustness_of = |formula: &Formula| -> Result<Vec<f64>, MishandleError> {
        let mut monitor = Monitor::new(formula, trace.names(), clock).map_err(monitor_error)?;
        Ok(monitor.robustness_signal(trace).map_err(monitor_error)?.to_vec())
    };
    let history = match &diagnosis.predicate {
        Some(predicate) => {
            let text = Formula::parse(&predicate.text)
                .map_err(|source| RolloutError::Parse { formula: predicate.text.clone(), source })?;
            let sign = if predicate.is_negated { -1.0 } else { 1.0 };
            let robustness: Vec<f64> = robustness_of(&text)?.into_iter().map(|rho| sign * rho).collect();
            let window = diagnosis.path.iter().rev().find_map(|found| found.window);
            Some(history(window.unwrap_or((predicate.sample, predicate.sample)), robustness))
        }
        None => None,
    };
    let nodes = formula.subformula_nodes(&clock).map_err(monitor_error)?;
    let predicates =
        (0..).zip(nodes).zip(formula.subformulas()).filter(|((_, node), _)| node.sides.is_some());
    let conjuncts = predicates
        .take(MAX_PREDICATES)
        .filter_map(|((position, _), predicate)| Some((position, predicate, formula.conjunct(position)?)))
        .map(|(position, predicate, alone)| {
            let robustness = robustness_of(&alone)?.first().copied().unwrap_or(f64::NAN);
            Ok(Conjunct { position, predicate, robustness })
        })
        .collect::<Result<_, MishandleError>>()?;
    Ok(Explanation { diagnosis, history, conjuncts })
}

fn history(window: (usize, usize), robustness: Vec<f64>) -> PredicateHistory {
    let (first, last) = window;
    let violates = |sample: &usize| robustness.get(*sample).is_some_and(|rho| *rho < 0.0);
    let violating: Vec<usize> = (first..=last).filter(violates).collect();
    let first_and_last = violating.first().copied().zip(violating.last().copied());
    PredicateHistory { window, violated: violating.len(), first_and_last, robustness }
}

/// A recorded simulation with its trace and explanation.
#[derive(Clone, Debug)]
pub struct ExplainedSimulation {
    /// The record.
    pub recorded: Simulation,
    /// The recorded trace, or that of a replay.
    pub trace: Trace,
    /// What determines its robustness.
    pub explanation: Explanation,
}

/// Explains simulation `number` of trial `trial` of a run. A simulation without a recorded trace is replayed; then
/// `controller` is the present path of the run's controller, if the file was moved.
///
/// # Errors
/// If the run has no such simulation, the simulation has no robustness, or a replay is needed and impossible or different.
pub fn explain(
    run: &RunFile,
    trial: u32,
    number: u32,
    controller: Option<&str>,
) -> Result<ExplainedSimulation, MishandleError> {
    let recorded = run.simulation(trial, number)?;
    if recorded.robustness.is_none() {
        return Err(MishandleError::NothingToExplain { trial, number });
    }
    let trace = match &recorded.trace {
        Some(stored) => trace(run.header(), stored),
        None => replayed_trace(&recorded, &recorded_plan(run.header(), controller)?)?,
    };
    explain_recorded(run.header(), recorded, trace)
}

/// Explains a recorded simulation with this trace.
///
/// # Errors
/// If the formula has no finite value on the trace.
pub fn explain_recorded(
    header: &RunHeader,
    recorded: Simulation,
    trace: Trace,
) -> Result<ExplainedSimulation, MishandleError> {
    let formula = Formula::parse(&header.formula)
        .map_err(|source| RolloutError::Parse { formula: header.formula.clone(), source })?;
    let explanation = explain_trace(&formula, &trace, header.control_dt)?;
    Ok(ExplainedSimulation { recorded, trace, explanation })
}

/// Explains an episode that is in no run file. The header describes its target, space and formula as that of a run.
///
/// # Errors
/// If the formula has no finite value on the trace.
pub fn explain_episode(
    resolved: &ResolvedPlan,
    episode: &Episode,
) -> Result<(RunHeader, ExplainedSimulation), MishandleError> {
    let header = record::header(resolved);
    let recorded = record::record(episode, resolved.stored_subformulas);
    let explained = explain_recorded(&header, recorded, episode.trace.clone())?;
    Ok((header, explained))
}

/// Returns a recorded trace with the names of the run's signals.
pub(crate) fn trace(header: &RunHeader, stored: &StoredTrace) -> Trace {
    let names: Arc<[String]> = header.signals.iter().map(|signal| signal.name.clone()).collect();
    let samples = stored.columns.first().map_or(0, Vec::len);
    let mut trace = Trace::with_capacity(names, samples);
    let mut sample = vec![0.0; stored.columns.len()];
    for step in 0..samples {
        sample.iter_mut().zip(&stored.columns).for_each(|(value, column)| *value = column[step]);
        trace.push(&sample);
    }
    trace
}

/// Simulates a recorded simulation again and returns its trace, which must be the recorded one.
fn replayed_trace(recorded: &Simulation, resolved: &ResolvedPlan) -> Result<Trace, MishandleError> {
    let request: Request = record::request(recorded, resolved.stored_subformulas > 0);
    let mut system = resolved.system()?;
    let episode = system.rollout(&[request])?.pop().ok_or(MishandleError::NoEpisode)?;
    let again = record::record(&episode, resolved.stored_subformulas);
    if again.trace_digest != recorded.trace_digest {
        let (trial, number) = (recorded.trial, recorded.number);
        let difference = format!("trace of simulation {number} of trial {trial}");
        return Err(MishandleError::RunMismatch { differences: vec![difference] });
    }
    Ok(episode.trace)
}
