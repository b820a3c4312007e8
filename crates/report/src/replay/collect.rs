//! The simulations of a replay, simulated again with their states.

use std::ops::ControlFlow;

use mishandle::falsification::off_nominal;
use mishandle::inspect::{Explanation, Failure, FailureMode, explain_episode, unit};
use mishandle::picture::{replay_states_with, simulate_states};
use mishandle::resolve::{Moved, has_scene, named_scenario, picture_model, recorded_plan};
use mishandle::results::{Answer, Trial};
use mishandle::rollout::{Axis, AxisValues, Episode, Request, Scenario, Seed};
use mishandle::stl::{Clock, Formula, Monitor};
use mishandle::store::{RunFile, RunHeader, Simulation};
use mishandle::{Compared, MishandleError, ResolvedPlan};
use mishandle_text::instant;
use serde_json::{Value, json};

use super::pack::block;
use super::scene::SceneReader;
use super::{MAX_BYTES, Replay};
use crate::RunReport;
use crate::html::{number, short};
use crate::predicate_chart::predicates;
use crate::space::value_text;
use crate::trace::spans;

/// Largest number of failure modes whose minimal counterexamples are shown.
const MODES: usize = 3;

/// Largest number of values of an axis that causes a failure. A continuous axis has this many
/// between nominal and the minimal counterexample, and as many beyond.
const VALUES: usize = 9;
const PARTS: usize = 4;

/// Largest numbers of predicates and of signals with a chart.
const PREDICATES: usize = 6;
const SIGNALS: usize = 18;

/// Largest number of failures that are simulated again beside those that are always shown.
const FAILURES: usize = 60;

/// Largest number of axis values in the title of a simulation.
const TITLE_VALUES: usize = 3;

/// Number of states that frame the first view.
const FRAMING: usize = 6;

/// A simulation that the page shows.
struct Shown {
    role: &'static str,
    title: String,
    /// Trial and number of the row whose links lead to it.
    row: Option<(u32, u32)>,
    source: Source,
}

/// How a simulation is simulated again.
enum Source {
    /// A row of the run, with which all bits are compared.
    Row(u32, u32),
    /// A simulation that no row has.
    New(Request),
}

/// The simulations of a replay.
struct Chosen {
    shown: Vec<Shown>,
    /// An axis that alone causes the first failure, and the simulation of each of its values.
    sweep: Option<(usize, Vec<(f64, usize)>)>,
    /// Number of the first simulations, which are shown however large the page is.
    always: usize,
}

/// How the recording of a replay ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Recording {
    /// The report has a replay.
    Done,
    /// The target has no scene, or the run has no failure.
    Nothing,
    /// The caller ended it, and the report has no replay.
    Interrupted,
}

impl RunReport {
    /// Simulates again what the replay of the page shows: minimal counterexamples and those that
    /// were found, the nominal scenario, values of an axis that alone causes a failure, and the
    /// other failures of the run until the page is large. `only` is the trial and number of one
    /// simulation, which is shown beside the nominal scenario.
    ///
    /// `command` returns what opens a simulation that the page lacks. Calls `watch` before each
    /// simulation with the number of those before and in total; it can end them.
    ///
    /// # Errors
    /// If a simulation cannot be run or differs from its record.
    pub fn record_replay<'a>(
        &mut self,
        run: &RunFile,
        moved: impl Into<Moved<'a>>,
        only: Option<(u32, u32)>,
        command: impl Fn((u32, u32)) -> String,
        mut watch: impl FnMut(u64, u64) -> ControlFlow<()>,
    ) -> Result<Recording, MishandleError> {
        if !has_scene(&run.header().target.kind) {
            return Ok(Recording::Nothing);
        }
        let header = run.header();
        let resolved = recorded_plan(header, moved)?;
        let Chosen { shown, sweep, always } = self.chosen(run, &resolved, only)?;
        if shown.is_empty() {
            return Ok(Recording::Nothing);
        }
        let formula = Formula::parse(&header.formula).ok();
        let mut predicates = formula.as_ref().map_or(Vec::new(), predicates);
        predicates.truncate(PREDICATES);
        let signals = signals(header, formula.as_ref());
        let mut reader = SceneReader::new(&picture_model(&resolved.plan.target)?)?;
        let mut scene = None;
        let mut blocks = vec![Vec::new()];
        let mut facts = Vec::new();
        let mut size = 0;
        let most = shown.len().min(always + FAILURES);
        for (index, simulation) in shown.iter().enumerate().take(most) {
            if watch(index as u64, most as u64).is_break() {
                return Ok(Recording::Interrupted);
            }
            let simulated = simulate(run, &resolved, &simulation.source)?;
            // The first simulation, the minimal counterexample, frames the first view.
            if scene.is_none() {
                scene = Some(reader.data(&framing(&simulated)));
            }
            let data = encoded(&mut reader, header, &simulated, &predicates, &signals);
            size += 4 * data.len().div_ceil(3);
            if index >= always && size > MAX_BYTES {
                break;
            }
            blocks.push(data);
            facts.push(fact(header, simulation, &simulated));
        }
        let Some((mut head, bytes)) = scene else { return Ok(Recording::Nothing) };
        let named = |name: &str, unit: &str| json!({ "name": short(name, 80), "unit": short(unit, 20) });
        let missing = shown.len() - facts.len();
        let left = shown.get(facts.len()).and_then(|shown| shown.row);
        head["dt"] = json!(header.control_dt);
        head["predicates"] = predicates.iter().map(|text| named(text, &unit(header, text))).collect();
        head["signals"] = signals.iter().map(|(name, unit)| named(name, unit)).collect();
        head["simulations"] = json!(facts);
        head["failures"] = json!(self.counts.falsified);
        head["missing"] = json!(missing);
        head["command"] = json!(left.map_or(String::new(), command));
        let (axis, values) =
            sweep.map_or((None, Vec::new()), |(axis, values)| (Some(&self.axes[axis]), values));
        head["axis"] = json!(axis.map(|axis| short(&axis.name, 80)));
        let value = |(value, simulation): &(f64, usize)| json!({ "value": axis.map(|axis| value_text(axis, Some(*value))), "simulation": simulation });
        head["sweep"] = values.iter().map(value).collect();
        blocks[0] = block(&head, &bytes);
        self.replay = Some(Replay { blocks });
        Ok(Recording::Done)
    }

    /// Chooses what the replay shows.
    fn chosen(
        &self,
        run: &RunFile,
        resolved: &ResolvedPlan,
        only: Option<(u32, u32)>,
    ) -> Result<Chosen, MishandleError> {
        let mut shown: Vec<Shown> = Vec::new();
        let mut minimal = None;
        if let Some((trial, number)) = only {
            let recorded = run.simulation(trial, number)?;
            shown.push(row("chosen", &format!("trial {trial}, simulation {number}"), (trial, number)));
            minimal = Some(recorded);
        }
        let modes = self.modes.modes.iter().filter(|_| only.is_none()).take(MODES);
        for found in modes.map(FailureMode::representative) {
            let place = (found.trial, found.number);
            let closest = self.minimal(run, found)?;
            let what =
                if closest.is_some() { "minimal counterexample" } else { "failure closest to nominal" };
            let recorded = match closest {
                Some(closest) => closest,
                None => run.simulation(found.trial, found.number)?,
            };
            let title = format!("{what}: {}", self.off_nominal_text(&recorded.scenario));
            let source = (recorded.trial, recorded.number);
            shown.push(Shown { row: Some(place), ..row("minimal", &title, source) });
            if source != place {
                let title = format!("found: trial {}, simulation {}", found.trial, found.number);
                shown.push(row("found", &title, place));
            }
            minimal.get_or_insert(recorded);
        }
        let Some(minimal) = minimal else { return Ok(Chosen { shown, sweep: None, always: 0 }) };
        let seed = Seed(minimal.seed);
        let nominal = shown.len();
        let request = Request::new(resolved.space.nominal(), seed);
        shown.push(Shown {
            role: "nominal",
            title: "nominal".into(),
            row: None,
            source: Source::New(request),
        });
        let sweep = if only.is_none() { self.sweep(resolved, &minimal, nominal, &mut shown) } else { None };
        let always = shown.len();
        let known = |place: (u32, u32)| shown.iter().any(|shown| shown.row == Some(place));
        let failing = self.points.iter().filter(|point| point.fails() && only.is_none());
        let others = failing.map(|point| (point.trial, point.number)).filter(|place| !known(*place));
        let title = |(trial, number): (u32, u32)| format!("trial {trial}, simulation {number}");
        let others: Vec<Shown> = others.map(|place| row("failure", &title(place), place)).collect();
        shown.extend(others);
        Ok(Chosen { shown, sweep, always })
    }

    /// Returns the row of the scenario that the answer calls the cause of a failure.
    fn minimal(&self, run: &RunFile, failure: &Failure) -> Result<Option<Simulation>, MishandleError> {
        let Some(Answer::Falsification(answer)) = &self.answer else { return Ok(None) };
        let is_own = |trial: &&Trial| trial.trial == failure.trial && failure.cause.is_some();
        let cause = answer.trials.iter().find(is_own).and_then(|trial| trial.cause.as_ref());
        let Some(cause) = cause else { return Ok(None) };
        for simulation in run.derived_simulations(failure.trial).chain(run.trial_simulations(failure.trial)) {
            let simulation = simulation?;
            let is_cause = named_scenario(&self.axes, &simulation.scenario) == cause.scenario;
            if is_cause && simulation.is_violated() {
                return Ok(Some(simulation));
            }
        }
        Ok(None)
    }

    /// Adds simulations over the axis that alone causes the first failure, if one does. Returns the
    /// axis, and the value and the index of each simulation.
    fn sweep(
        &self,
        resolved: &ResolvedPlan,
        minimal: &Simulation,
        nominal: usize,
        shown: &mut Vec<Shown>,
    ) -> Option<(usize, Vec<(f64, usize)>)> {
        let scenario = Scenario::new(minimal.scenario.clone());
        let [index] = off_nominal(&resolved.space, &scenario)[..] else { return None };
        let axis = &self.axes[index];
        let (start, end) = (axis.nominal?, minimal.scenario.get(index).copied().flatten()?);
        let mut found = Vec::new();
        for value in values(axis, start, end) {
            let place = if value == end {
                0
            } else if value == start {
                nominal
            } else {
                let mut values = minimal.scenario.clone();
                values[index] = Some(value);
                let scenario = resolved.space.canonical(Scenario::new(values));
                let title = format!("{} = {}", short(&axis.name, 40), value_text(axis, Some(value)));
                let source = Source::New(Request::new(scenario, Seed(minimal.seed)));
                shown.push(Shown { role: "value", title, row: None, source });
                shown.len() - 1
            };
            found.push((value, place));
        }
        Some((index, found))
    }

    /// Returns the axes of a scenario that are off nominal with their values, as text.
    fn off_nominal_text(&self, scenario: &[Option<f64>]) -> String {
        let axes = self.axes.iter().zip(scenario);
        let off: Vec<String> = axes
            .filter(|(axis, value)| value.is_some() && **value != axis.nominal)
            .map(|(axis, value)| format!("{} = {}", short(&axis.name, 40), value_text(axis, *value)))
            .collect();
        let more = if off.len() > TITLE_VALUES { ", …" } else { "" };
        let shown: Vec<String> = off.into_iter().take(TITLE_VALUES).collect();
        if shown.is_empty() { "the nominal scenario".into() } else { shown.join(", ") + more }
    }
}

/// Returns a row of the run.
fn row(role: &'static str, title: &str, place: (u32, u32)) -> Shown {
    Shown { role, title: title.to_string(), row: Some(place), source: Source::Row(place.0, place.1) }
}

/// Returns values of an axis from nominal over the minimal counterexample, in order.
fn values(axis: &Axis, nominal: f64, minimal: f64) -> Vec<f64> {
    let mut values: Vec<f64> = match axis.values {
        AxisValues::Categorical(_) => (0..axis.levels().unwrap_or(0)).map(|i| axis.low + i as f64).collect(),
        AxisValues::Integer => {
            let side = (minimal - nominal).signum();
            let all = (0..).map(|step| nominal + side * f64::from(step));
            all.take_while(|value| (axis.low..=axis.high).contains(value)).take(VALUES).collect()
        }
        AxisValues::Continuous | AxisValues::Logarithmic => {
            let value = |part| nominal + (minimal - nominal) * part as f64 / PARTS as f64;
            let all = (0..VALUES).map(|part| if part == PARTS { minimal } else { value(part) });
            all.map(|value| value.clamp(axis.low, axis.high)).collect()
        }
    };
    values.truncate(VALUES);
    if !values.contains(&minimal) {
        values.push(minimal);
    }
    values.sort_by(f64::total_cmp);
    values.dedup();
    values
}

/// One simulation with its states.
struct Simulated {
    episode: Episode,
    states: Vec<Vec<f64>>,
    /// `None` if it has no verdict.
    explanation: Option<Explanation>,
}

fn simulate(run: &RunFile, resolved: &ResolvedPlan, source: &Source) -> Result<Simulated, MishandleError> {
    let (episode, trajectory) = match source {
        Source::Row(trial, number) => {
            let (replayed, trajectory) = replay_states_with(run, *trial, *number, resolved)?;
            if !replayed.differences.is_empty() {
                return Err(MishandleError::differs(Compared::Plan, replayed.differences));
            }
            (replayed.episode, trajectory)
        }
        Source::New(request) => simulate_states(resolved, request)?,
    };
    let explanation = explain_episode(resolved, &episode).ok().map(|(_, explained)| explained.explanation);
    Ok(Simulated { episode, states: trajectory.states, explanation })
}

/// Returns states that the first view shows: those until nothing can satisfy the requirement. What
/// falls flies far after that.
fn framing(simulated: &Simulated) -> Vec<&[f64]> {
    let states = &simulated.states;
    let explanation = simulated.explanation.as_ref().filter(|_| simulated.episode.is_violated());
    let decided = explanation.and_then(|explanation| explanation.decided);
    let end = decided.map_or(states.len(), |sample| (sample + 1).min(states.len()));
    let states = &states[..end];
    states.iter().step_by((end / FRAMING).max(1)).chain(states.last()).map(Vec::as_slice).collect()
}

/// Returns the signals that have a chart, with their units. Signals of the formula come first.
fn signals(header: &RunHeader, formula: Option<&Formula>) -> Vec<(String, String)> {
    let read = formula
        .map_or(Vec::new(), |formula| formula.signals().into_iter().map(ToString::to_string).collect());
    let mut signals: Vec<(String, String)> =
        header.signals.iter().map(|signal| (signal.name.clone(), signal.unit.clone())).collect();
    signals.sort_by_key(|(name, _)| !read.contains(name));
    signals.truncate(SIGNALS);
    signals
}

/// Returns what the page says about a simulation.
fn fact(header: &RunHeader, shown: &Shown, simulated: &Simulated) -> Value {
    let Simulated { episode, explanation, .. } = simulated;
    let robustness = episode.robustness();
    let decided = explanation.as_ref().and_then(|explanation| explanation.decided);
    let note = match (episode.is_violated(), robustness, decided) {
        (true, Some(rho), Some(sample)) => {
            format!("fails: lost from {} on, robustness {}", instant(sample, header.control_dt), number(rho))
        }
        (true, Some(rho), None) => format!("fails, robustness {}", number(rho)),
        (false, Some(rho), _) => format!("passes, robustness {}", number(rho)),
        _ => "no verdict".to_string(),
    };
    json!({
        "role": shown.role,
        "title": shown.title,
        "note": note,
        "isViolated": episode.is_violated(),
        "row": shown.row.map(|(trial, number)| [trial, number]),
    })
}

/// Returns the block of a simulation.
fn encoded(
    reader: &mut SceneReader,
    header: &RunHeader,
    simulated: &Simulated,
    predicates: &[String],
    signals: &[(String, String)],
) -> Vec<u8> {
    let Simulated { episode, states, explanation } = simulated;
    let mut columns = reader.motion(states);
    let integers = columns.end();
    let mut bytes = columns.bytes;
    let trace = &episode.trace;
    let mut series = |values: Option<&[f64]>| {
        let value =
            |sample| values.and_then(|values| values.get(sample)).map_or(f32::NAN, |value| *value as f32);
        bytes.extend((0..trace.len()).flat_map(|sample| value(sample).to_le_bytes()));
    };
    for text in predicates {
        let formula = Formula::parse(text).ok();
        let monitor = formula
            .and_then(|formula| Monitor::new(&formula, trace.names(), Clock::steps(header.control_dt)).ok());
        match monitor {
            Some(mut monitor) => series(monitor.robustness_signal(trace).ok()),
            None => series(None),
        }
    }
    signals.iter().for_each(|(name, _)| series(trace.signal(name)));
    let violated = explanation.as_ref().filter(|_| episode.is_violated());
    let history = violated.and_then(|explanation| explanation.history.as_ref());
    let head = json!({
        "samples": states.len(),
        "values": trace.len(),
        "integers": integers,
        "decided": violated.and_then(|explanation| explanation.decided),
        "window": history.map(|history| [history.window.0, history.window.1]),
        "violated": history.map_or(Vec::new(), |history| spans(&history.violated)),
    });
    block(&head, &bytes)
}
