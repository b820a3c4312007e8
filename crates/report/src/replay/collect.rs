//! The simulations of a replay, simulated again with their states.

use std::ops::ControlFlow;

use mishandle::falsification::off_nominal;
use mishandle::inspect::{Failure, explain_episode};
use mishandle::picture::{replay_states_with, simulate_states};
use mishandle::replay::{ReplayResult, replay_with};
use mishandle::resolve::{Moved, has_scene, named_scenario, picture_model, recorded_plan};
use mishandle::results::{Answer, Trial};
use mishandle::rollout::{Axis, AxisValues, Episode, Request, Scenario, Seed};
use mishandle::store::{RunFile, Simulation};
use mishandle::{Compared, MishandleError, ResolvedPlan, RunError};
use serde_json::json;

use super::MAX_BYTES;
use super::moved::{MovedSystem, Mover};
use super::recorder::{Entry, Filmed, GHOST, Recorder};
use super::scene::SceneReader;
use crate::RunReport;
use crate::html::short;
use crate::space::value_text;

/// Largest number of failure modes whose minimal counterexamples are shown.
const MODES: usize = 3;

/// Largest number of values of an axis that causes a failure. A continuous axis has this many
/// between nominal and the minimal counterexample, and as many beyond.
const VALUES: usize = 9;
const PARTS: usize = 4;

/// Largest number of failures that are simulated again beside those that are always shown.
const FAILURES: usize = 60;

/// The note about shapes that an axis changes.
const CHANGED: &str = "An axis changes shapes of the scene: the 3-D replay draws the shapes of its first \
                       simulation in all.";

/// Largest number of axis values in the title of a simulation.
const TITLE_VALUES: usize = 3;

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

/// The model or system that has the states of simulations.
enum Scenery<'a> {
    /// The model of the target.
    Own,
    /// A system that is not part of this program.
    Moved(MovedSystem<'a>),
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
        let resolved = recorded_plan(run.header(), moved)?;
        self.record(run, &resolved, Scenery::Own, only, command, &mut watch)
    }

    /// Like [`record_replay`](Self::record_replay) of the whole run, with a target that the caller
    /// has resolved. One without a scene needs a `mover`.
    ///
    /// # Errors
    /// If a simulation cannot be run or differs from its record.
    pub fn record_replay_with(
        &mut self,
        run: &RunFile,
        resolved: &ResolvedPlan,
        mover: Option<&mut dyn Mover>,
        command: impl Fn((u32, u32)) -> String,
        mut watch: impl FnMut(u64, u64) -> ControlFlow<()>,
    ) -> Result<Recording, MishandleError> {
        let scenery = match mover {
            _ if has_scene(&run.header().target.kind) => Scenery::Own,
            Some(mover) => Scenery::Moved(MovedSystem::new(mover)),
            None => return Ok(Recording::Nothing),
        };
        self.record(run, resolved, scenery, None, command, &mut watch)
    }

    /// Says on the page why it has no replay.
    pub fn note_no_replay(&mut self, error: &MishandleError) {
        self.add_note(format!("The 3-D replay is missing: {error}."));
    }

    fn record(
        &mut self,
        run: &RunFile,
        resolved: &ResolvedPlan,
        mut scenery: Scenery<'_>,
        only: Option<(u32, u32)>,
        command: impl Fn((u32, u32)) -> String,
        watch: &mut dyn FnMut(u64, u64) -> ControlFlow<()>,
    ) -> Result<Recording, MishandleError> {
        let Chosen { shown, sweep, always } = self.chosen(run, resolved, only)?;
        if shown.is_empty() {
            return Ok(Recording::Nothing);
        }
        let mut recorder = None;
        let most = shown.len().min(always + FAILURES);
        for (index, simulation) in shown.iter().enumerate().take(most) {
            if watch(index as u64, most as u64).is_break() {
                return Ok(Recording::Interrupted);
            }
            let Shown { role, title, row, source } = simulation;
            let (episode, states) = scenery.simulate(run, resolved, source)?;
            let explained = explain_episode(resolved, &episode).ok();
            let explanation = explained.as_ref().map(|(_, explained)| &explained.explanation);
            let filmed = Filmed { episode: &episode, states: &states, explanation };
            let limit = if index < always { usize::MAX } else { MAX_BYTES };
            let recorder = match &mut recorder {
                Some(recorder) => recorder,
                // Only its first simulation says what the scene of another system is.
                None => recorder.insert(Recorder::new(scenery.reader(resolved)?, run.header())),
            };
            if !recorder.add(Entry { role, title, row: *row, filmed }, limit) {
                break;
            }
        }
        let Some(recorder) = recorder else { return Ok(Recording::Nothing) };
        if matches!(&scenery, Scenery::Moved(system) if system.changes) {
            self.add_note(CHANGED);
        }
        let shown_count = recorder.len();
        let left = shown.get(shown_count).and_then(|shown| shown.row);
        let (axis, values) =
            sweep.map_or((None, Vec::new()), |(axis, values)| (Some(&self.axes[axis]), values));
        // The simulation of the minimal counterexample is the first one.
        let minimal = values.iter().find(|(_, simulation)| *simulation == 0).map(|(value, _)| *value);
        let went_back = self.lead.as_ref().is_some_and(|lead| lead.cause.went_back);
        let is_nearer = |value: f64| {
            let nominal = axis.and_then(|axis| axis.nominal).unwrap_or(value);
            minimal.is_some_and(|minimal| (value - nominal).abs() < (minimal - nominal).abs())
        };
        let value = |(value, simulation): &(f64, usize)| {
            json!({
                "value": axis.map(|axis| value_text(axis, Some(*value))),
                "simulation": simulation,
                "isConfirmed": !went_back || !is_nearer(*value),
            })
        };
        let facts = json!({
            "ghost": "nominal simulation",
            "failures": self.counts.falsified,
            "missing": shown.len() - shown_count,
            "command": left.map_or(String::new(), command),
            "axis": axis.map(|axis| short(&axis.name, 80)),
            "sweep": values.iter().map(value).collect::<Vec<_>>(),
        });
        self.replay = recorder.finish(facts);
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
        for found in self.first_failures(only.is_none()) {
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
        shown.push(Shown { role: GHOST, title: "nominal".into(), row: None, source: Source::New(request) });
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

    /// Returns a failure of each mode: that with which the page begins, then representatives.
    fn first_failures(&self, is_wanted: bool) -> Vec<&Failure> {
        let first = self.lead.as_ref().map(|lead| lead.original);
        let is_first = |failure: &&Failure| Some((failure.trial, failure.number)) == first;
        let modes = self.modes.modes.iter().filter(|_| is_wanted);
        let mut found: Vec<&Failure> =
            modes.map(|mode| mode.failures.iter().find(is_first).unwrap_or(mode.representative())).collect();
        found.sort_by_key(|failure| !is_first(failure));
        found.truncate(MODES);
        found
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

impl Scenery<'_> {
    /// Simulates again. Returns the states of the episode, too.
    fn simulate(
        &mut self,
        run: &RunFile,
        resolved: &ResolvedPlan,
        source: &Source,
    ) -> Result<(Episode, Vec<Vec<f64>>), MishandleError> {
        match (self, source) {
            (Scenery::Own, Source::Row(trial, number)) => {
                let (replayed, trajectory) = replay_states_with(run, *trial, *number, resolved)?;
                Ok((same(replayed)?, trajectory.states))
            }
            (Scenery::Own, Source::New(request)) => {
                let (episode, trajectory) = simulate_states(resolved, request)?;
                Ok((episode, trajectory.states))
            }
            (Scenery::Moved(system), source) => system.simulate(|| match source {
                Source::Row(trial, number) => same(replay_with(run, *trial, *number, resolved)?),
                Source::New(request) => {
                    let episode = resolved.system()?.rollout(std::slice::from_ref(request))?.pop();
                    episode.ok_or(MishandleError::Run(RunError::NoEpisode))
                }
            }),
        }
    }

    /// Returns the reader of the scene, once there is a simulation.
    fn reader(&self, resolved: &ResolvedPlan) -> Result<SceneReader, MishandleError> {
        match self {
            Scenery::Own => SceneReader::new(&picture_model(&resolved.plan.target)?),
            Scenery::Moved(system) => system.reader(),
        }
    }
}

/// Returns the episode of a replay, unless it differs from its record.
fn same(replayed: ReplayResult) -> Result<Episode, MishandleError> {
    if replayed.differences.is_empty() {
        Ok(replayed.episode)
    } else {
        Err(MishandleError::differs(Compared::Plan, replayed.differences))
    }
}
