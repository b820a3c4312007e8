//! Explanations of recorded simulations: when and where a formula is violated, and by which
//! predicate.

use mishandle_results::Remedy;
use mishandle_rollout::{Episode, EpisodeEnd, Request, RolloutError};
use mishandle_stl::{
    Clock, DecisiveSubformula, Diagnosis, Formula, Monitor, Trace, is_satisfied, is_violated,
};
use mishandle_store::{RunFile, RunHeader, Simulation, StoredTrace};

use crate::error::{Compared, MishandleError, RunError, problem};
use crate::inspect::failure_modes::nothing_to_explain;
use crate::replay::replay_command;
use crate::resolve::{Moved, ResolvedPlan, is_python, recorded_plan};
use crate::run::violation::{MAX_SUBFORMULAS, decided};
use crate::run::{header, rows, system_of};

/// Largest number of conjuncts that are evaluated alone, and of predicates that are listed.
const MAX_PARTS: usize = 100;

/// The cause of the robustness of a trace.
#[derive(Clone, Debug)]
pub struct Explanation {
    /// The chain from the formula to the decisive predicate.
    pub diagnosis: Diagnosis,
    /// How the decisive predicate develops; `None` without one.
    pub history: Option<PredicateHistory>,
    /// First sample after which nothing can change whether the trace satisfies the formula; `None`
    /// if the trace does not decide the formula.
    pub decided: Option<usize>,
    /// Each conjunct alone, in the order of the formula. An operand of `and` with a larger
    /// robustness is masked by one with a smaller.
    pub conjuncts: Vec<Conjunct>,
    /// Texts of all predicates, in the order of the formula.
    pub predicates: Vec<String>,
    /// Unit of the decisive predicate, that of its signals; empty if they have none or several.
    pub unit: String,
    /// Requirements of the operators on the chain, in sentences: see [`Explanation::sentences`].
    pub(crate) events: Vec<OperatorEvent>,
}

/// The decisive predicate over its window.
#[derive(Clone, Debug, PartialEq)]
pub struct PredicateHistory {
    /// First and last sample at which the operator above evaluates the predicate.
    pub window: (usize, usize),
    /// The samples of these at which the predicate and the whole operand of that operator are
    /// violated: the premise of an implication that holds violates nothing where the conclusion
    /// holds, too.
    pub violated: Vec<usize>,
    /// That operand, if it is more than the predicate and negations.
    pub operand: Option<WholeOperand>,
    /// Robustness of the predicate at each sample of the trace. If the formula requires the
    /// predicate to be false, the opposite.
    pub robustness: Vec<f64>,
    /// Values of its two sides at each sample of the trace.
    pub sides: [Vec<f64>; 2],
}

/// The operand of the operator above the decisive predicate.
#[derive(Clone, Debug, PartialEq)]
pub struct WholeOperand {
    /// The text.
    pub text: String,
    /// Whether the formula requires it to be false.
    pub is_negated: bool,
}

impl PredicateHistory {
    /// Returns the first and the last violated sample; `None` if there are none.
    pub fn first_and_last(&self) -> Option<(usize, usize)> {
        self.violated.first().copied().zip(self.violated.last().copied())
    }
}

/// A conjunct of the formula, alone: see [`Formula::conjuncts`].
#[derive(Clone, Debug, PartialEq)]
pub struct Conjunct {
    /// Position in the list of [`Formula::subformulas`].
    pub position: usize,
    /// Text of the conjunct.
    pub text: String,
    /// Robustness of the formula without the other operands of each `and` above the conjunct.
    pub robustness: f64,
    /// First sample after which nothing can change whether the trace satisfies this formula; `None`
    /// as for the whole formula.
    pub decided: Option<usize>,
}

/// The requirement of an operator on the chain of a violated formula, and the values that the trace
/// has instead.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum OperatorEvent {
    /// `eventually` or `once`: no sample of the window satisfies the operand; `nearest` comes
    /// nearest.
    NoSample { operator: &'static str, operand: String, nearest: usize },
    /// `until`: first samples at which the left operand fails and the right operand holds.
    Until {
        operands: [String; 2],
        window: (usize, usize),
        left_fails: Option<usize>,
        right_holds: Option<usize>,
    },
    /// `implies`: the condition holds at the sample.
    Implied { operands: [String; 2], sample: usize },
}

/// Explains the robustness of `trace`; `clock` says how bounds count its samples.
///
/// # Errors
/// If the trace lacks a signal of the formula, the formula has no finite value on it, or it has
/// more than 1,000 sub-formulas.
pub fn explain_trace(formula: &Formula, trace: &Trace, clock: Clock) -> Result<Explanation, MishandleError> {
    let subformulas = formula.subformulas().len();
    if subformulas > MAX_SUBFORMULAS {
        return Err(problem(format!(
            "the formula has {subformulas} sub-formulas; one with more than {MAX_SUBFORMULAS} cannot be explained"
        )));
    }
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
            let above = diagnosis.path.iter().rposition(|found| found.window.is_some());
            let window = above.and_then(|above| diagnosis.path[above].window);
            let below = &diagnosis.path[above.map_or(0, |above| above + 1)..];
            let operand = whole_operand(&diagnosis, below);
            let side = |text: &String| -> Result<Vec<f64>, MishandleError> {
                if let Ok(number) = text.parse() {
                    return Ok(vec![number; trace.len()]);
                }
                let term = Formula::parse(text)
                    .map_err(|source| RolloutError::Parse { formula: text.clone(), source })?;
                robustness_of(&term)
            };
            let sides = [side(&predicate.sides[0])?, side(&predicate.sides[1])?];
            let window = window.unwrap_or((predicate.sample, predicate.sample));
            let (first, last) = window;
            let mut violated: Vec<usize> = (first..=last)
                .filter(|sample| robustness.get(*sample).is_some_and(|rho| is_violated(*rho)))
                .collect();
            if let Some(WholeOperand { text, is_negated }) = &operand {
                let whole = Formula::parse(text)
                    .map_err(|source| RolloutError::Parse { formula: text.clone(), source })?;
                let whole = robustness_of(&whole)?;
                violated
                    .retain(|sample| whole.get(*sample).is_some_and(|rho| is_violated(*rho) != *is_negated));
            }
            Some(PredicateHistory { window, violated, operand, robustness, sides })
        }
        None => None,
    };
    let nodes = formula.subformula_nodes(&clock).map_err(monitor_error)?;
    let texts: Vec<String> = formula.subformulas().collect();
    let predicates = nodes.iter().zip(&texts).filter(|(node, _)| node.sides.is_some());
    let predicates = predicates.map(|(_, text)| text.clone()).take(MAX_PARTS).collect();
    let conjuncts = formula.conjuncts().into_iter().take(MAX_PARTS);
    let conjuncts = conjuncts
        .filter_map(|position| Some((position, formula.conjunct(position)?)))
        .map(|(position, alone)| {
            let robustness = robustness_of(&alone)?.first().copied().unwrap_or(f64::NAN);
            let decided = decided(&alone, trace, clock, robustness)?;
            Ok(Conjunct { position, text: texts[position].clone(), robustness, decided })
        })
        .collect::<Result<_, MishandleError>>()?;
    let events = events(&diagnosis, &robustness_of)?;
    let decided = decided(formula, trace, clock, diagnosis.robustness())?;
    Ok(Explanation { diagnosis, history, decided, conjuncts, predicates, unit: String::new(), events })
}

/// Describes the operators of a violated chain that ask for more than a sample of one predicate.
fn events(
    diagnosis: &Diagnosis,
    robustness_of: &dyn Fn(&Formula) -> Result<Vec<f64>, MishandleError>,
) -> Result<Vec<OperatorEvent>, MishandleError> {
    let signal = |text: &String| {
        let formula =
            Formula::parse(text).map_err(|source| RolloutError::Parse { formula: text.clone(), source })?;
        robustness_of(&formula)
    };
    let mut found = Vec::new();
    for (above, below) in diagnosis.path.iter().zip(diagnosis.path.iter().skip(1)) {
        // What a negated operator requires is the opposite.
        let is_positive = is_violated(above.robustness) == is_violated(diagnosis.robustness());
        if is_satisfied(diagnosis.robustness()) || !is_positive {
            continue;
        }
        match (above.operator, above.operands.as_slice(), above.window) {
            (Some(operator @ ("eventually" | "once")), [operand], _) => found.push(OperatorEvent::NoSample {
                operator,
                operand: operand.clone(),
                nearest: below.sample,
            }),
            (Some("until"), [left, right], Some(window)) => {
                let held = signal(left)?;
                let reached = signal(right)?;
                let mut before = above.sample..=window.1;
                found.push(OperatorEvent::Until {
                    operands: [left.clone(), right.clone()],
                    window,
                    left_fails: before.find(|sample| held[*sample] < 0.0),
                    right_holds: (window.0..=window.1).find(|sample| reached[*sample] >= 0.0),
                });
            }
            (Some("implies"), [left, right], _) if below.position != above.position + 1 => {
                found.push(OperatorEvent::Implied {
                    operands: [left.clone(), right.clone()],
                    sample: above.sample,
                });
            }
            _ => {}
        }
    }
    Ok(found)
}

/// Returns what the operator above a predicate evaluates, from the part of the path below this
/// operator; `None` if it is the predicate, negated or not, or if an operator of the part reads
/// other samples.
fn whole_operand(diagnosis: &Diagnosis, below: &[DecisiveSubformula]) -> Option<WholeOperand> {
    const POINTWISE: [&str; 4] = ["not", "and", "or", "implies"];
    let (_, operators) = below.split_last()?;
    let is = |found: &DecisiveSubformula, names: &[&str]| {
        found.operator.is_some_and(|operator| names.contains(&operator))
    };
    let is_more = operators.iter().any(|found| !is(found, &["not"]));
    let whole = operators.first().filter(|_| is_more)?;
    operators.iter().all(|found| is(found, &POINTWISE)).then(|| WholeOperand {
        text: whole.text.clone(),
        is_negated: is_violated(whole.robustness) != is_violated(diagnosis.robustness()),
    })
}

/// A recorded simulation with its trace and explanation.
#[derive(Clone, Debug)]
pub struct ExplainedSimulation {
    /// The record.
    pub recorded: Simulation,
    /// The recorded trace, or that of a replay.
    pub trace: Trace,
    /// Explanation of its robustness.
    pub explanation: Explanation,
}

/// Explains simulation `number` of trial `trial` of a run. A simulation without a recorded trace is
/// replayed; then `moved` has the present paths of the run's files that were moved.
///
/// # Errors
/// If the run has no such simulation, the simulation has no robustness, or a replay is needed and
/// impossible or different.
pub fn explain<'a>(
    run: &RunFile,
    trial: u32,
    number: u32,
    moved: impl Into<Moved<'a>>,
) -> Result<ExplainedSimulation, MishandleError> {
    let recorded = run.simulation(trial, number)?;
    if recorded.robustness.is_none() {
        return Err(nothing_to_explain(&recorded));
    }
    let trace = match &recorded.trace {
        Some(stored) => trace(run.header(), stored),
        None if is_python(&run.header().target.kind) => {
            let others = if run.counts()?.falsified > 0 { "" } else { ", and the run has none" };
            let text = format!(
                "simulation {number} of trial {trial} has no recorded trace, because it is no counterexample{others}. The \
                 system of the run is Python code, so replay it there"
            );
            let replay = replay_command(&run.header().target.kind, run.path(), trial, number);
            return Err(problem(text).with(Remedy::Run(replay)));
        }
        None => replayed_trace(&recorded, &recorded_plan(run.header(), moved)?)?,
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
    let mut explanation = explain_trace(&formula, &trace, Clock::steps(header.control_dt))?;
    if let Some(predicate) = &explanation.diagnosis.predicate {
        explanation.unit = unit(header, &predicate.text);
    }
    Ok(ExplainedSimulation { recorded, trace, explanation })
}

/// Returns the unit of the signals of a formula; empty if they have none or several.
pub fn unit(header: &RunHeader, formula: &str) -> String {
    common_unit(formula, |name| {
        header.signals.iter().find(|signal| signal.name == name).map(|signal| signal.unit.clone())
    })
}

/// Returns the unit that all signals of a formula have, if they have one; empty otherwise. `of` is
/// the unit of a signal.
pub fn common_unit(formula: &str, of: impl Fn(&str) -> Option<String>) -> String {
    let Ok(formula) = Formula::parse(formula) else { return String::new() };
    let mut units: Vec<String> =
        formula.signals().into_iter().map(|name| of(name).unwrap_or_default()).collect();
    units.dedup();
    if units.len() == 1 { units.remove(0) } else { String::new() }
}

/// Explains an episode that is in no run file. The header describes its target, space and formula
/// as that of a run.
///
/// # Errors
/// If the formula has no finite value on the trace.
pub fn explain_episode(
    resolved: &ResolvedPlan,
    episode: &Episode,
) -> Result<(RunHeader, ExplainedSimulation), MishandleError> {
    let header = header::header(resolved);
    let recorded = rows::row(episode, resolved);
    let explained = explain_recorded(&header, recorded, episode.trace.clone())?;
    Ok((header, explained))
}

/// Returns a recorded trace with the names of the run's signals.
pub(crate) fn trace(header: &RunHeader, stored: &StoredTrace) -> Trace {
    rows::trace(header.signals.iter().map(|signal| signal.name.clone()).collect(), stored)
}

/// Simulates a recorded simulation again and returns its trace, which must be the recorded one, or
/// the whole episode if the simulation was stopped early.
fn replayed_trace(recorded: &Simulation, resolved: &ResolvedPlan) -> Result<Trace, MishandleError> {
    let request: Request = rows::request(recorded, resolved.stored_parts > 0);
    let (mut system, _) = system_of(resolved, recorded.trial)?;
    let whole = Request { stop_threshold: None, ..request.clone() };
    let mut simulate =
        |request| system.rollout(&[request])?.pop().ok_or(MishandleError::Run(RunError::NoEpisode));
    let episode = simulate(request)?;
    let again = rows::row(&episode, resolved);
    if again.trace_digest != recorded.trace_digest {
        let trial = recorded.trial;
        let number = recorded.number;
        let difference = format!("trace of simulation {number} of trial {trial}");
        return Err(MishandleError::differs(Compared::Plan, vec![difference]));
    }
    match episode.end {
        EpisodeEnd::Stopped { .. } => Ok(simulate(whole)?.trace),
        _ => Ok(episode.trace),
    }
}
