//! Simulations of a run as counterexamples of a suite, as they are or minimized.

use std::ops::ControlFlow;
use std::path::{Path, PathBuf};

use mishandle_falsification::{
    FailurePoint, FalsificationError, Keeps, Minimized, PhysicsChecks, Repeated, Survivor, axes_off_nominal,
    is_close, minimize, mode_distance, repeat, repeat_seeds, unit_scenario,
};
use mishandle_results as results;
use mishandle_results::{CheckedFailure, ExportedCounterexample, Exports, PhysicsCheck};
use mishandle_rollout::{Episode, Request, Scenario, Seed, System};
use mishandle_store::RunFile;
use mishandle_text::path_text;

use crate::counterexample::{Counterexample, MinimizedFrom};
use crate::error::MishandleError;
use crate::inspect::{FailureMode, FailureModes, failure_modes};
use crate::resolve::{ResolvedPlan, depends_on_seed, named_scenario};
use crate::run::recorded_axes;
use crate::run::violation::violation_of;

/// A simulation to export.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Chosen {
    /// File to write.
    pub path: PathBuf,
    /// Failure mode, from 1, that it represents.
    pub mode: Option<usize>,
    /// Number of the trial.
    pub trial: u32,
    /// Number of the simulation within the trial.
    pub simulation: u32,
}

/// How counterexamples are simulated before they are exported: their physics is checked, and they
/// can be moved toward the nominal scenario while they still fail.
#[derive(Clone, Copy)]
pub struct Preparation<'a> {
    /// The plan of the run.
    pub resolved: &'a ResolvedPlan,
    /// Largest number of simulations that move each counterexample; `None` leaves it as it is.
    pub minimize: Option<u64>,
}

/// Counterexamples to write.
#[derive(Debug)]
pub struct Exported {
    /// The result.
    pub result: Exports,
    /// The files to write.
    pub files: Vec<(PathBuf, Counterexample)>,
    /// Number of simulations.
    pub simulations: u64,
    /// Whether the minimization was ended early. The last counterexample fails, but can be nearer
    /// to nominal; the ones after it are missing.
    pub is_interrupted: bool,
}

/// Returns the representative of each failure mode of a run, with its file in `folder`.
///
/// # Errors
/// If the run cannot be read.
pub fn representatives(run: &RunFile, folder: &Path) -> Result<Vec<Chosen>, MishandleError> {
    let stem = run.path().file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let chosen = |(mode, found): (usize, &FailureMode)| Chosen {
        path: folder.join(format!("{stem}-mode-{mode}.json")),
        mode: Some(mode),
        trial: found.representative().trial,
        simulation: found.representative().number,
    };
    Ok((1..).zip(&failure_modes(run)?.modes).map(chosen).collect())
}

/// Makes counterexamples of simulations of a run. Several failure modes can have the same minimized
/// scenario, which is in the files once. Failures that depend on the solver of the physics are not
/// in the files. Without a preparation, nothing is simulated and no physics is checked.
///
/// `watch` gets the number of simulations of each counterexample after each batch, and can end it.
///
/// # Errors
/// If a simulation does not fail, or cannot be read, run or explained, or if all depend on the
/// solver.
pub fn export(
    run: &RunFile,
    chosen: Vec<Chosen>,
    preparation: Option<Preparation<'_>>,
    mut watch: impl FnMut(u64) -> ControlFlow<()>,
) -> Result<Exported, MishandleError> {
    let mut found = Exported {
        result: Exports {
            run: path_text(run.path()),
            files: Vec::new(),
            space_axes: recorded_axes(&run.header().axes),
        },
        files: Vec::new(),
        simulations: 0,
        is_interrupted: false,
    };
    // The minimized scenarios whose failure does not depend on the seed.
    let mut written: Vec<(PathBuf, Scenario)> = Vec::new();
    let is_minimized = preparation.is_some_and(|preparation| preparation.minimize.is_some());
    let modes = if is_minimized { failure_modes(run)? } else { FailureModes::default() };
    for Chosen { path, mode, trial, simulation } in chosen {
        if found.is_interrupted {
            break;
        }
        let recorded = Counterexample::from_run(run, trial, simulation)?;
        let Prepared { known, shrunk, simulations, is_interrupted } = match preparation {
            Some(preparation) => prepare(preparation, &modes, recorded, &mut watch)?,
            None => Prepared { known: recorded, shrunk: None, simulations: 0, is_interrupted: false },
        };
        found.simulations += simulations;
        found.is_interrupted = is_interrupted;
        let depends_on_solver = known.physics.as_ref().is_some_and(|physics| physics.depends_on_solver);
        let mut same_as = None;
        if let (Some(shrunk), Some(Preparation { resolved, .. }), false) =
            (&shrunk, preparation, depends_on_solver)
            && shrunk.repeats.is_none()
        {
            let scenario = known.scenario_in(&resolved.space)?;
            let is_same = |other: &&(PathBuf, Scenario)| is_close(&resolved.space, &other.1, &scenario);
            same_as = written.iter().find(is_same).map(|(path, _)| path.clone());
            if same_as.is_none() {
                written.push((path.clone(), scenario));
            }
        }
        let is_written = same_as.is_none() && !depends_on_solver;
        found.result.files.push(ExportedCounterexample {
            file: is_written.then(|| path_text(&path)),
            same_as: same_as.as_deref().map(path_text),
            mode: mode.map(|mode| mode as u64),
            trial: known.trial,
            simulation: known.simulation,
            seed: results::Seed(known.seed),
            scenario: known.scenario.iter().map(|axis| (axis.axis.clone(), axis.value)).collect(),
            robustness: known.expected.robustness.into(),
            predicate: known.decisive.as_ref().map(|decisive| decisive.predicate.clone()),
            minimized: shrunk,
            physics: known.physics.clone(),
        });
        if is_written {
            found.files.push((path, known));
        }
    }
    match &found.result.files[..] {
        [ExportedCounterexample { trial, simulation, physics: Some(check), .. }, ..]
            if found.files.is_empty() && check.depends_on_solver =>
        {
            let (trial, simulation, check) = (*trial, *simulation, check.clone());
            Err(FalsificationError::DependsOnSolver { trial, simulation, check }.into())
        }
        _ => Ok(found),
    }
}

/// A counterexample that was simulated before its export.
struct Prepared {
    known: Counterexample,
    shrunk: Option<results::Minimized>,
    simulations: u64,
    is_interrupted: bool,
}

/// Minimizes a counterexample within its mode if that is required, and measures how often its
/// scenario fails with other seeds; checks its physics.
fn prepare(
    Preparation { resolved, minimize }: Preparation<'_>,
    modes: &FailureModes,
    recorded: Counterexample,
    watch: &mut impl FnMut(u64) -> ControlFlow<()>,
) -> Result<Prepared, MishandleError> {
    let mut is_interrupted = false;
    let mut watch = |done| {
        let flow = watch(done);
        is_interrupted |= flow.is_break();
        flow
    };
    let mut checks = resolved.physics_checks()?;
    let request = recorded.request(&resolved.space)?;
    let Some(budget) = minimize else {
        let check = checks.check(&[request], &mut watch)?.and_then(|mut found| found.pop());
        let physics = check.filter(|_| checks.are_possible());
        let known = Counterexample { physics, ..recorded };
        return Ok(Prepared { known, shrunk: None, simulations: checks.simulations(), is_interrupted });
    };
    let mut system = resolved.system()?;
    let own = (recorded.trial, recorded.simulation);
    let (axes, steps) = (resolved.space.axes(), resolved.target.episode_steps);
    let keeps = |failure: &Episode, other: &Episode| {
        let is_of_other = |point| modes.tells_apart(own, axes, steps, &point);
        is_same_failure(resolved, failure, other) && !failure_point(resolved, other).is_some_and(is_of_other)
    };
    let failing = Failing { request: &request, robustness: recorded.expected.robustness };
    let smaller = smaller(resolved, &mut *system, &mut checks, failing, budget, &keeps, &mut watch)?;
    let Smaller { found, minimized, went_back, checked } = smaller;
    let scenario = found.scenario_in(&resolved.space)?;
    let done = minimized.simulations + checks.simulations();
    let repeats = if depends_on_seed(resolved, &scenario) && watch(done).is_continue() {
        let seeds = repeat_seeds(Seed(recorded.seed), Repeated::Counterexample.simulations());
        Some(repeat(&mut *system, &scenario, seeds, |_| watch(done))?)
    } else {
        None
    };
    let original = minimized.original();
    let recorded_scenario = &original.request.scenario;
    let off = |scenario: &Scenario| axes_off_nominal(&resolved.space, scenario) as u64;
    let axes_off_nominal = [off(recorded_scenario), off(&scenario)];
    let simulations = done + repeats.as_ref().map_or(0, |repeats| repeats.simulations);
    let shrunk = results::Minimized {
        scenario: named_scenario(resolved.space.axes(), recorded_scenario.values()),
        robustness: original.robustness().map(Into::into),
        axes_off_nominal,
        simulations: minimized.simulations,
        complete: minimized.is_complete,
        interrupted: is_interrupted,
        fewest_axes: minimized.has_fewest_axes && off(&minimized.episode.request.scenario) == off(&scenario),
        repeats,
        went_back,
        checked,
    };
    Ok(Prepared { known: found, shrunk: Some(shrunk), simulations, is_interrupted })
}

/// Returns predicate, time and place of a failure; `None` if its formula has no value.
fn failure_point(resolved: &ResolvedPlan, failure: &Episode) -> Option<FailurePoint> {
    let ResolvedPlan { specification, target, space, .. } = resolved;
    let found = violation_of(&specification.requirement, &failure.trace, target.control_dt).ok()?;
    let point = unit_scenario(space.axes(), failure.request.scenario.values());
    Some(FailurePoint { point, signature: found.signature })
}

/// Returns whether the same predicate decides two failures, at a similar time.
pub(crate) fn is_same_failure(resolved: &ResolvedPlan, a: &Episode, b: &Episode) -> bool {
    let points = failure_point(resolved, a).zip(failure_point(resolved, b));
    points.is_some_and(|(a, b)| mode_distance(&[], &[], resolved.target.episode_steps, &a, &b).is_some())
}

/// A simulation that fails, and its robustness.
#[derive(Clone, Copy)]
pub(crate) struct Failing<'a> {
    pub(crate) request: &'a Request,
    pub(crate) robustness: f64,
}

/// A failure that was moved toward the nominal scenario.
pub(crate) struct Smaller {
    /// The failure, which says where it comes from.
    pub found: Counterexample,
    /// How it was moved.
    minimized: Minimized,
    /// Whether it went back, because nearer failures depend on the solver.
    went_back: bool,
    /// The failures whose physics was checked, in order.
    checked: Vec<CheckedFailure>,
}

/// Moves a failure toward the nominal scenario with at most `budget` simulations, by failures that
/// `keeps` accepts, and checks the physics of the result, which goes back toward the failure until
/// it survives. If the failure itself depends on the solver, the result is the nearest one, and its
/// check says so.
///
/// `watch` gets the number of simulations after each batch, and can end the minimization and the
/// checks. A failure whose checks were ended has none.
///
/// # Errors
/// If the request does not fail, or a simulation cannot be run.
pub(crate) fn smaller(
    resolved: &ResolvedPlan,
    system: &mut dyn System,
    checks: &mut PhysicsChecks,
    failing: Failing<'_>,
    budget: u64,
    keeps: &Keeps<'_>,
    watch: &mut dyn FnMut(u64) -> ControlFlow<()>,
) -> Result<Smaller, MishandleError> {
    let Failing { request, robustness } = failing;
    let mut is_interrupted = false;
    let minimized = minimize(system, request, budget, keeps, |done| {
        let flow = watch(done);
        is_interrupted |= flow.is_break();
        flow
    })?;
    let failures: Vec<&Episode> =
        std::iter::once(&minimized.episode).chain(minimized.path.iter().rev()).collect();
    let requests: Vec<Request> = failures.iter().map(|failure| failure.request.clone()).collect();
    let before = checks.simulations();
    let survivor = if checks.are_possible() && !is_interrupted {
        let mut watch = |done| watch(minimized.simulations + done - before);
        checks.nearest_survivor(&requests, &mut watch)?
    } else {
        None
    };
    let (index, physics, checked) = match survivor {
        Some(Survivor { index, physics, checked }) => (index, Some(physics), checked),
        None => (0, None, Vec::new()),
    };
    let failure = |(index, physics): (usize, PhysicsCheck)| CheckedFailure {
        scenario: named_scenario(resolved.space.axes(), failures[index].request.scenario.values()),
        robustness: failures[index].robustness().unwrap_or_default().into(),
        physics,
    };
    let checked = checked.into_iter().map(failure).collect();
    let minimized_from = Some(MinimizedFrom {
        scenario: request.scenario.values().to_vec(),
        robustness,
        simulations: minimized.simulations,
        is_complete: minimized.is_complete,
    });
    let episode = Counterexample::from_episode(resolved, failures[index])?;
    let found = Counterexample { minimized_from, physics, ..episode };
    Ok(Smaller { found, minimized, went_back: index > 0, checked })
}
