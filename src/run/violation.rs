//! When and by which predicate a trace violates a formula.

use mishandle_falsification::Signature;
use mishandle_results as results;
use mishandle_rollout::RolloutError;
use mishandle_stl::{
    Clock, DecisivePredicate, DecisiveSubformula, Diagnosis, EvaluationTime, Formula, OnlineMonitor, Trace,
    is_satisfied, is_violated,
};
use mishandle_store::{RANDOM_TRIAL, RunFile, RunHeader};
use mishandle_text::{sample_time, short_unit};

use crate::error::MishandleError;
use crate::run::rows;

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
    let sample = failure_instant(final_sample, &diagnosis).unwrap_or(0);
    let predicate = diagnosis.predicate.map_or(String::new(), |found| found.text);
    Ok(Violation { robustness, signature: Signature { predicate, sample } })
}

/// Returns the instant of a failure: the sample that `decided` it, or the decisive one if the trace
/// does not decide the formula.
pub(crate) fn failure_instant(decided: Option<usize>, diagnosis: &Diagnosis) -> Option<usize> {
    decided.or_else(|| diagnosis.path.last().map(|last| last.sample))
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

/// Returns when and how a recorded simulation violates the requirement; `None` without a recorded
/// trace, and if the formula has no finite value on it.
///
/// # Errors
/// If the run cannot be read.
pub(crate) fn recorded_violation(
    run: &RunFile,
    trial: u32,
    number: u32,
) -> Result<Option<results::Violation>, MishandleError> {
    recorded_violation_of(run, &run.header().formula, trial, number)
}

/// Returns when and how a recorded simulation violates a formula, as [`recorded_violation`] does.
fn recorded_violation_of(
    run: &RunFile,
    formula: &str,
    trial: u32,
    number: u32,
) -> Result<Option<results::Violation>, MishandleError> {
    let header = run.header();
    let stored = run.simulation(trial, number)?.trace;
    let names = header.signals.iter().map(|signal| signal.name.clone());
    let trace = stored.map(|stored| rows::trace(names.collect(), &stored));
    Ok(trace.and_then(|trace| described(header, formula, &trace).ok()))
}

/// Returns how the first random simulation of an evaluation violates each formula whose verdicts
/// are recorded. Only simulations that violate the requirement have a trace.
///
/// # Errors
/// If the run cannot be read.
pub(crate) fn broken_formulas(run: &RunFile) -> Result<Vec<results::Broken>, MishandleError> {
    let header = run.header();
    let mut sought: Vec<(usize, &str, &str)> = Vec::new();
    for name in ["success", "strict", "careful"] {
        let formula = header.formulas.iter().find(|formula| formula.name == name);
        let text = formula.map(|formula| formula.text.as_str());
        // The requirement is what success means without a formula of this name.
        let text = text.or_else(|| (name == "success").then_some(header.formula.as_str()));
        let column = header.verdicts.iter().position(|verdict| verdict == name);
        sought.extend(column.zip(text).map(|(column, text)| (column, name, text)));
    }
    let mut broken = Vec::new();
    for row in run.trial_simulations(RANDOM_TRIAL) {
        let row = row?;
        if sought.is_empty() {
            break;
        }
        if !row.is_violated() {
            continue;
        }
        let is_broken = |(column, ..): &(usize, &str, &str)| {
            row.verdicts.get(*column).copied().flatten().is_some_and(is_violated)
        };
        for (_, name, text) in sought.extract_if(.., |formula| is_broken(formula)) {
            let violation = recorded_violation_of(run, text, row.trial, row.number)?;
            broken.extend(violation.map(|violation| results::Broken {
                formula: name.to_string(),
                simulation: row.number,
                violation,
            }));
        }
    }
    Ok(broken)
}

/// Returns when a trace of a run violates a formula for good, and what is true then, in English.
///
/// # Errors
/// If the formula has no finite value on the trace.
pub(crate) fn described(
    header: &RunHeader,
    formula: &str,
    trace: &Trace,
) -> Result<results::Violation, RolloutError> {
    let formula = Formula::parse(formula)
        .map_err(|source| RolloutError::Parse { formula: formula.to_string(), source })?;
    let clock = Clock::steps(header.control_dt);
    let instant =
        |sample: usize| results::Instant { sample: sample as u64, time: sample as f64 * header.control_dt };
    let decided = decided(&formula, trace, clock, -1.0)?;
    let mut found = results::Violation {
        decided: decided.map(instant),
        at: None,
        predicate: String::new(),
        words: String::new(),
    };
    if formula.subformulas().len() > MAX_SUBFORMULAS {
        return Ok(found);
    }
    let diagnose = |trace: &Trace| {
        let monitor_error = |source| RolloutError::Monitor { formula: formula.to_string(), source };
        formula.diagnose(trace, &clock).map_err(monitor_error)
    };
    // The predicate that decides the formula is the one that does so first, not the worst one.
    let mut diagnosis = match decided {
        Some(last) => diagnose(&start_of(trace, last + 1))?,
        None => diagnose(trace)?,
    };
    if !is_violated(diagnosis.robustness()) {
        diagnosis = diagnose(trace)?;
    }
    let Some(predicate) = &diagnosis.predicate else { return Ok(found) };
    found.predicate.clone_from(&predicate.text);
    let unit = |name: &str| {
        header.signals.iter().find(|signal| signal.name == name).map_or("", |s| short_unit(&s.unit))
    };
    let time = |sample: usize| sample_time(sample, header.control_dt);
    let required = english(predicate, predicate.is_negated, unit);
    let instead = english(predicate, !predicate.is_negated, unit);
    let (Some(required), Some(instead)) = (required, instead) else { return Ok(found) };
    // A violated `eventually` says nothing about one sample.
    let chooses = |part: &&DecisiveSubformula| {
        part.operator.is_some_and(|operator| matches!(operator, "eventually" | "once"))
            && is_violated(part.robustness)
            && !predicate.is_negated
    };
    match diagnosis.path.iter().position(|part| chooses(&part)) {
        Some(place) => {
            let below = diagnosis.path.get(place + 1);
            let is_whole = below.is_none_or(|below| below.position == predicate.position);
            let window = match diagnosis.path[place].window {
                Some((first, last)) if first > 0 || last + 1 < trace.len() => {
                    format!("at no time from {} to {}", time(first), time(last))
                }
                _ => "at no time".to_string(),
            };
            let nearest = time(predicate.sample);
            found.words = match below.filter(|_| !is_whole) {
                None => format!("{required} {window}; {nearest} comes nearest"),
                Some(below) => {
                    format!("`{}` holds {window}; nearest at {nearest}, when {instead}", below.text)
                }
            };
        }
        None => {
            found.at = Some(instant(predicate.sample));
            found.words = instead;
            // The predicate may have been violated before.
            let begins = |part: &DecisiveSubformula| {
                part.operator == Some("always")
                    && part.sample == 0
                    && part.window.is_some_and(|(first, _)| first > 0 && first == predicate.sample)
            };
            if diagnosis.path.iter().any(begins) {
                found.words.push_str(", where the requirement begins to count");
            }
        }
    }
    Ok(found)
}

/// Returns the first samples of a trace.
fn start_of(trace: &Trace, samples: usize) -> Trace {
    let columns = (0..trace.names().len()).map(|column| trace.column(column)[..samples].to_vec()).collect();
    Trace::from_columns(trace.names().clone(), columns)
}

/// Returns a predicate in English, or its opposite; `None` if its sides cannot be compared again.
/// Names of signals are words: `ball_speed` is "ball speed".
fn english<'a>(
    predicate: &DecisivePredicate,
    is_opposite: bool,
    unit: impl Fn(&str) -> &'a str,
) -> Option<String> {
    let comparison = match (predicate.comparison, is_opposite) {
        (comparison, false) => comparison,
        ("<=", _) => ">",
        (">=", _) => "<",
        ("<", _) => ">=",
        (">", _) => "<=",
        ("==", _) => "!==",
        _ => "==",
    };
    let [left, right] = &predicate.sides;
    let formula = Formula::parse(&format!("{left} {comparison} {right}")).ok()?;
    let lines = formula.explain(&Clock::unknown(), EvaluationTime::Any, unit).ok()?;
    let mut text = lines.join(" ");
    for name in formula.signals() {
        text = text.replace(name, &name.replace('_', " "));
    }
    Some(text)
}
