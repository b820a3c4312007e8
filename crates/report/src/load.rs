//! Reads the facts of a run from its file.

use std::path::{Path, PathBuf};

use mishandle::evaluation::{Corners, Lifetime, lifetimes};
use mishandle::inspect::{
    ExplainedSimulation, FailureMode, FailureModes, MinimalFailure, ModeSurvey, explain, failure_modes,
    mode_survey,
};
use mishandle::portable::portable_plan;
use mishandle::results::{Answer, AxisRates, Falsification, Requirement, Words};
use mishandle::rollout::{Axis, Episode};
use mishandle::run::{needs_target, recorded_answer, recorded_axis, requirements, stops_by_itself};
use mishandle::stl::is_violated;
use mishandle::store::{Counts, RunFile, RunHeader, RunKind, Simulation, TrialSummary};
use mishandle::verdict::smallest_cause;
use mishandle::{MishandleError, Plan, ResolvedPlan};

use crate::measure::Measured;
use crate::replay::Replay;

/// Largest number of simulations that charts show; failures come first.
const MAX_POINTS: usize = 3000;

/// Largest number of failures among them.
const MAX_FAILURES: usize = 1000;

/// Largest numbers of failing and of other simulations that are links to a row of the table.
const LINKED_FAILURES: usize = 150;
const LINKED_OTHERS: usize = 100;

/// Trial of a margin in which its witness is found.
const WITNESS_TRIAL: u32 = 1;

/// Largest number of failure modes that are described.
pub const MAX_MODES: usize = 6;

/// Facts about a run.
#[derive(Debug)]
pub struct RunReport {
    pub(crate) path: String,
    /// How the page names commands.
    pub(crate) words: Words,
    pub(crate) header: RunHeader,
    /// `None` if this program cannot read the plan.
    pub(crate) plan: Option<Plan>,
    pub(crate) axes: Vec<Axis>,
    pub(crate) counts: Counts,
    pub(crate) trials: Vec<Trial>,
    /// Some of the simulations, all failures among them unless they are very many.
    pub(crate) points: Vec<Point>,
    /// Of an evaluation: the robustness of all random simulations.
    pub(crate) robustness: Vec<f64>,
    /// The answer, also of an unfinished run; `None` if it is missing, with a note.
    pub(crate) answer: Option<Answer>,
    /// The requirements with a verdict of their own.
    pub(crate) requirements: Vec<Requirement>,
    pub(crate) modes: FailureModes,
    /// Of a falsification whose trials keep going.
    pub(crate) survey: Option<ModeSurvey>,
    /// The representatives of the first modes, explained: moved toward nominal if they were.
    pub(crate) representatives: Vec<ExplainedSimulation>,
    /// The failure to which each of them was moved; `None` if none was.
    pub(crate) minimal: Vec<Option<MinimalFailure>>,
    /// Of a falsification: the minimal counterexample with the fewest axes off nominal.
    pub(crate) lead: Option<MinimalFailure>,
    /// Trial and number of the simulation that came closest to a failure.
    pub(crate) nearest: Option<(u32, u32)>,
    /// That simulation, if nothing fails and it was simulated again.
    pub(crate) closest: Option<ExplainedSimulation>,
    /// Of a margin: the simulation with the smallest disturbance that was found, explained.
    pub(crate) witness: Option<ExplainedSimulation>,
    pub(crate) measured: Option<Measured>,
    /// File that keeps the simulations of the page.
    pub(crate) kept: Option<PathBuf>,
    /// The 3-D replay, if it was recorded.
    pub(crate) replay: Option<Replay>,
    /// Why the page lacks what takes simulations.
    pub(crate) no_simulations: Option<String>,
    /// Other parts that the page lacks, with the reason.
    pub(crate) notes: Vec<String>,
}

/// A trial.
#[derive(Clone, Debug)]
pub struct Trial {
    pub summary: TrialSummary,
    /// First failing simulation.
    pub first_failure: Option<u32>,
    /// The simulation with the least robustness.
    pub worst: Option<(u32, f64)>,
    /// Simulations with a smaller robustness than all before.
    pub improvements: Vec<(u32, f64)>,
}

/// A simulation.
#[derive(Clone, Debug)]
pub struct Point {
    pub trial: u32,
    pub number: u32,
    pub seed: u64,
    pub scenario: Vec<Option<f64>>,
    pub robustness: Option<f64>,
    pub end: &'static str,
    pub is_linked: bool,
}

impl Point {
    pub fn fails(&self) -> bool {
        self.robustness.is_some_and(is_violated)
    }
}

impl From<Simulation> for Point {
    fn from(simulation: Simulation) -> Point {
        Point {
            trial: simulation.trial,
            number: simulation.number,
            seed: simulation.seed,
            scenario: simulation.scenario,
            robustness: simulation.robustness,
            end: simulation.end.name(),
            is_linked: false,
        }
    }
}

impl From<&Episode> for Point {
    fn from(episode: &Episode) -> Point {
        Point {
            trial: 0,
            number: episode.request.number,
            seed: episode.request.seed.0,
            scenario: episode.request.scenario.values().to_vec(),
            robustness: episode.robustness(),
            end: "",
            is_linked: false,
        }
    }
}

/// The simulation with which a page begins.
pub(crate) struct Lead<'a> {
    pub explained: &'a ExplainedSimulation,
    /// The failure to which it was moved; `None` if it was not.
    pub minimal: Option<&'a MinimalFailure>,
}

impl<'a> Lead<'a> {
    fn alone(explained: &'a ExplainedSimulation) -> Lead<'a> {
        Lead { explained, minimal: None }
    }

    fn moved(minimal: &'a MinimalFailure) -> Lead<'a> {
        Lead { explained: &minimal.explained, minimal: Some(minimal) }
    }
}

/// Returns the minimal counterexample that the verdict of a falsification names.
pub fn smallest_failure(
    run: &RunFile,
    found: &Falsification,
) -> Result<Option<MinimalFailure>, MishandleError> {
    let smallest = smallest_cause(found).filter(|trial| trial.cause.is_some());
    Ok(smallest.map(|trial| MinimalFailure::recorded(run, trial.trial)).transpose()?.flatten())
}

impl RunReport {
    /// Reads the facts of a run. `path` is its name on the page and in the commands that the page
    /// shows, which `words` states.
    ///
    /// `resolved` is the plan of the run with a target that is not part of this program, such as a
    /// Python system, or whose files were moved. Without it, the page depends on the run file
    /// alone: no file of the plan is opened, no program is started, and the answer lacks what only
    /// the target knows.
    ///
    /// # Errors
    /// If the run cannot be read, or a formula has no finite value on a recorded trace.
    pub fn load(
        run: &RunFile,
        path: &str,
        resolved: Option<&ResolvedPlan>,
        words: Words,
    ) -> Result<RunReport, MishandleError> {
        let header = run.header().clone();
        let counts = run.counts()?;
        let mut trials: Vec<Trial> = run
            .trials()?
            .into_iter()
            .map(|summary| Trial { summary, first_failure: None, worst: None, improvements: Vec::new() })
            .collect();
        let plan = Plan::from_toml(&header.plan).ok();
        let falsify = plan.as_ref().and_then(|plan| plan.falsify.as_ref());
        let survey =
            if falsify.is_some_and(|falsify| falsify.keep_going) { Some(mode_survey(run)?) } else { None };
        let modes = match &survey {
            Some(survey) => survey.modes.clone(),
            None => failure_modes(run)?,
        };
        let mut minimal = Vec::new();
        let mut representatives = Vec::new();
        for mode in modes.modes.iter().take(MAX_MODES) {
            let found = mode.representative();
            let moved = found.cause.as_ref().map(|_| MinimalFailure::recorded(run, found.trial));
            let moved = moved.transpose()?.flatten();
            representatives.push(match &moved {
                Some(moved) => moved.explained.clone(),
                None => explain(run, found.trial, found.number, None)?,
            });
            minimal.push(moved);
        }
        let is_representative = |trial: u32, number: u32| {
            let is_it = |mode: &FailureMode| {
                (mode.representative().trial, mode.representative().number) == (trial, number)
            };
            modes.modes.iter().take(MAX_MODES).any(is_it)
        };
        let others = counts.simulations.saturating_sub(counts.falsified);
        let every = others.div_ceil((MAX_POINTS - MAX_FAILURES) as u64).max(1);
        let every_linked =
            others.min((MAX_POINTS - MAX_FAILURES) as u64).div_ceil(LINKED_OTHERS as u64).max(1);
        let mut notes = Vec::new();
        let answer = match recorded_answer(run, resolved.filter(|_| needs_target(&header))) {
            Ok(answer) => Some(answer),
            Err(_) if counts.simulations == 0 => None,
            Err(error) => {
                notes.push(format!("The answer is missing: {error}."));
                None
            }
        };
        let witness = match &answer {
            Some(Answer::Margin(found)) => found.witness.as_ref(),
            _ => None,
        };
        let witness = witness.map(|witness| explain(run, WITNESS_TRIAL, witness.simulation, None));
        let lead = match &answer {
            Some(Answer::Falsification(found)) => smallest_failure(run, found)?,
            _ => None,
        };
        let mut robustness = Vec::new();
        let mut points = Vec::new();
        let mut index = 0_u64;
        let mut failures = 0_usize;
        let mut kept = 0_u64;
        for simulation in run.simulations() {
            let simulation = simulation?;
            let number = simulation.number;
            let rho = simulation.robustness;
            let found = trials.binary_search_by_key(&simulation.trial, |trial| trial.summary.trial.number);
            if let (Ok(index), Some(rho)) = (found, rho) {
                let trial = &mut trials[index];
                if trial.worst.is_none_or(|(_, least)| rho < least) {
                    trial.worst = Some((number, rho));
                    trial.improvements.push((number, rho));
                }
                if is_violated(rho) && trial.first_failure.is_none() {
                    trial.first_failure = Some(number);
                }
            }
            if header.kind == RunKind::Evaluate && simulation.trial != Corners::TRIAL {
                robustness.extend(rho);
            }
            let mut point = Point::from(simulation);
            let is_chosen = is_representative(point.trial, point.number);
            if point.fails() {
                failures += 1;
                point.is_linked = is_chosen || failures <= LINKED_FAILURES;
                if failures <= MAX_FAILURES || is_chosen {
                    points.push(point);
                }
            } else {
                if index.is_multiple_of(every) {
                    point.is_linked = kept.is_multiple_of(every_linked);
                    kept += 1;
                    points.push(point);
                }
                index += 1;
            }
        }
        let least = trials.iter().filter_map(|trial| {
            let (number, rho) = trial.worst?;
            Some((rho, (trial.summary.trial.number, number)))
        });
        let nearest = least.min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, place)| place);
        let preflight = mishandle::run::warnings(run)?.into_iter();
        let preflight = preflight.map(|warning| format!("Before the first simulation: {warning}."));
        let reasons = run.reasons()?;
        let reasons = reasons.iter().map(|found| {
            let simulations = mishandle_text::plural(found.simulations, "simulation");
            let reason = mishandle_text::first_and_last_line(&found.reason);
            let trial = found.trial;
            let number = found.number;
            format!("{}: {simulations}, the first of them {number} of trial {trial}: {reason}", found.end)
        });
        notes.extend(preflight.chain(reasons));
        let requirements = requirements(run)?.unwrap_or_default();
        notes.extend(requirements.iter().filter_map(|found| {
            let reason = found.asks_nothing.as_ref()?;
            Some(format!("Requirement {} asks nothing: {reason}.", found.name))
        }));
        Ok(RunReport {
            path: path.to_string(),
            words,
            plan,
            answer,
            witness: witness.transpose()?,
            requirements,
            axes: header.axes.iter().map(recorded_axis).collect(),
            header,
            counts,
            trials,
            points,
            robustness,
            modes,
            survey,
            representatives,
            minimal,
            lead,
            nearest,
            closest: None,
            measured: None,
            kept: None,
            replay: None,
            no_simulations: None,
            notes,
        })
    }

    /// Keeps the simulations of [`measure`](Self::measure) in a file, so that a second report of the
    /// run continues.
    pub fn keep_in(&mut self, path: PathBuf) {
        self.kept = Some(path);
    }

    /// Returns the number of samples of the longest trace that the page draws: all plots share its
    /// time.
    pub(crate) fn samples(&self) -> usize {
        let nominal = self.measured.iter().filter_map(|measured| measured.lead.nominal.as_ref());
        let lead = self.lead().map(|lead| lead.explained);
        let all = self.representatives.iter().chain(&self.witness).chain(lead).chain(nominal);
        all.map(|explained| explained.trace.len()).max().unwrap_or(0)
    }

    /// Returns the failure with which the page begins: the smallest disturbance of a margin, the
    /// counterexample with the smallest cause, or the failure of the first mode. If nothing fails,
    /// it is the simulation that came closest to a failure.
    pub(crate) fn lead(&self) -> Option<Lead<'_>> {
        let mode = || {
            let minimal = self.minimal.first().and_then(Option::as_ref);
            minimal.map(Lead::moved).or_else(|| self.representatives.first().map(Lead::alone))
        };
        let first = self.witness.as_ref().map(Lead::alone).or_else(|| self.lead.as_ref().map(Lead::moved));
        first.or_else(mode).or_else(|| self.closest.as_ref().map(Lead::alone))
    }

    /// Returns whether the page simulated each point of the space.
    pub(crate) fn has_all_points(&self) -> bool {
        self.measured.as_ref().is_some_and(|measured| measured.has_all_points)
    }

    /// Says on the page that nothing was simulated, and why.
    pub fn note_no_simulations(&mut self, reason: &str) {
        self.no_simulations = Some(format!(
            "Sizes of failing patches, checks of the physics, repeats with other seeds, corners, the share of noise and pictures are missing, because \
             they take simulations: {reason}."
        ));
    }

    /// Adds a sentence about something that the page lacks.
    pub fn add_note(&mut self, note: impl Into<String>) {
        self.notes.push(note.into());
    }

    /// Leaves out the folders of the target's parts and of the files of the plan, which are paths
    /// of the machine that made the run.
    pub fn hide_paths(&mut self) {
        if let Ok(plan) = portable_plan(&self.header) {
            self.header.plan = plan.to_toml();
        }
        for component in &mut self.header.components {
            let path = Path::new(&component.name);
            if let (true, Some(name)) = (path.is_absolute(), path.file_name()) {
                component.name = name.to_string_lossy().into_owned();
            }
        }
    }

    /// Returns success over the values of the axes, of an evaluation.
    pub(crate) fn axis_rates(&self) -> Option<&AxisRates> {
        match &self.answer {
            Some(Answer::Evaluation(found)) => found.axis_rates.as_ref(),
            _ => None,
        }
    }

    /// Returns whether the results decide how many simulations there are.
    pub(crate) fn stops_by_itself(&self) -> bool {
        self.plan.as_ref().is_some_and(stops_by_itself)
    }

    pub(crate) fn is_evaluation(&self) -> bool {
        self.header.kind == RunKind::Evaluate
    }

    /// Returns the trials with at least one simulation.
    pub(crate) fn searches(&self) -> impl Iterator<Item = &Trial> {
        self.trials.iter().filter(|trial| trial.summary.counts.simulations > 0)
    }

    /// Returns the lifetimes of the trials that ended, of a falsification.
    pub(crate) fn lifetimes(&self) -> Vec<Lifetime> {
        match &self.answer {
            Some(Answer::Falsification(found)) => lifetimes(&found.trials, found.budget),
            _ => Vec::new(),
        }
    }
}
