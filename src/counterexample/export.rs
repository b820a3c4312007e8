//! Simulations of a run as counterexamples of a suite, as they are or minimized.

use std::ops::ControlFlow;
use std::path::{Path, PathBuf};

use mishandle_falsification::{
    Minimized, Repeated, axes_off_nominal, is_close, minimize, repeat, repeat_seeds,
};
use mishandle_results as results;
use mishandle_results::{ExportedCounterexample, Exports, Repeats};
use mishandle_rollout::{Request, Scenario, Seed, System};
use mishandle_store::RunFile;
use mishandle_text::path_text;

use crate::counterexample::{Counterexample, MinimizedFrom};
use crate::error::MishandleError;
use crate::inspect::{FailureMode, failure_modes};
use crate::resolve::{ResolvedPlan, depends_on_seed, named_scenario};
use crate::run::recorded_axes;

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

/// Moves counterexamples toward the nominal scenario while they still fail.
#[derive(Clone, Copy)]
pub struct Minimization<'a> {
    /// The plan of the run.
    pub resolved: &'a ResolvedPlan,
    /// Largest number of simulations for each counterexample.
    pub budget: u64,
}

impl Minimization<'_> {
    /// Default of `budget`.
    pub const BUDGET: u64 = 300;
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
/// scenario, which is in the files once.
///
/// `watch` gets the number of simulations of a minimization after each batch, and can end it.
///
/// # Errors
/// If a simulation does not fail, or cannot be read, run or explained.
pub fn export(
    run: &RunFile,
    chosen: Vec<Chosen>,
    minimization: Option<Minimization<'_>>,
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
    for Chosen { path, mode, trial, simulation } in chosen {
        if found.is_interrupted {
            break;
        }
        let recorded = Counterexample::from_run(run, trial, simulation)?;
        let (known, shrunk) = match minimization {
            Some(minimization) => {
                let (minimized, shrunk) = shrink(minimization, &recorded, &mut watch)?;
                (minimized, Some((minimization.resolved, shrunk)))
            }
            None => (recorded, None),
        };
        let mut same_as = None;
        if let Some((resolved, shrunk)) = &shrunk {
            found.simulations += shrunk.simulations();
            found.is_interrupted = shrunk.is_interrupted;
            if shrunk.repeats.is_none() {
                let scenario = &shrunk.minimized.episode.request.scenario;
                let is_same = |other: &&(PathBuf, Scenario)| is_close(&resolved.space, &other.1, scenario);
                same_as = written.iter().find(is_same).map(|(path, _)| path.clone());
                if same_as.is_none() {
                    written.push((path.clone(), scenario.clone()));
                }
            }
        }
        found.result.files.push(ExportedCounterexample {
            file: same_as.is_none().then(|| path_text(&path)),
            same_as: same_as.as_deref().map(path_text),
            mode: mode.map(|mode| mode as u64),
            trial: known.trial,
            simulation: known.simulation,
            seed: results::Seed(known.seed),
            scenario: known.scenario.iter().map(|axis| (axis.axis.clone(), axis.value)).collect(),
            robustness: known.expected.robustness.into(),
            predicate: predicate(&known),
            minimized: shrunk.map(|(resolved, shrunk)| shrunk.result(resolved)),
        });
        if same_as.is_none() {
            found.files.push((path, known));
        }
    }
    Ok(found)
}

/// How a counterexample was minimized.
struct Shrunk {
    minimized: Minimized,
    has_same_predicate: bool,
    repeats: Option<Repeats>,
    is_interrupted: bool,
}

impl Shrunk {
    fn simulations(&self) -> u64 {
        self.minimized.simulations + self.repeats.as_ref().map_or(0, |repeats| repeats.simulations)
    }

    fn result(self, resolved: &ResolvedPlan) -> results::Minimized {
        let Shrunk { minimized, has_same_predicate, repeats, is_interrupted } = self;
        let recorded = &minimized.original.request.scenario;
        let off = |scenario: &Scenario| axes_off_nominal(&resolved.space, scenario) as u64;
        results::Minimized {
            scenario: named_scenario(resolved.space.axes(), recorded.values()),
            robustness: minimized.original.robustness().map(Into::into),
            axes_off_nominal: [off(recorded), off(&minimized.episode.request.scenario)],
            simulations: minimized.simulations,
            complete: minimized.is_complete,
            interrupted: is_interrupted,
            fewest_axes: minimized.has_fewest_axes,
            same_predicate: has_same_predicate,
            repeats,
        }
    }
}

/// Minimizes a counterexample, and measures how often its scenario fails with other seeds.
fn shrink(
    Minimization { resolved, budget }: Minimization<'_>,
    recorded: &Counterexample,
    watch: &mut impl FnMut(u64) -> ControlFlow<()>,
) -> Result<(Counterexample, Shrunk), MishandleError> {
    let mut system = resolved.system()?;
    let request = recorded.request(&resolved.space)?;
    let mut is_interrupted = false;
    let mut watch = |done| {
        let flow = watch(done);
        is_interrupted |= flow.is_break();
        flow
    };
    let robustness = recorded.expected.robustness;
    let (found, minimized) = smaller(resolved, &mut *system, (&request, robustness), budget, &mut watch)?;
    let scenario = &minimized.episode.request.scenario;
    let repeats = if depends_on_seed(resolved, scenario) && watch(minimized.simulations).is_continue() {
        let seeds = repeat_seeds(Seed(recorded.seed), Repeated::Counterexample.simulations());
        Some(repeat(&mut *system, scenario, seeds, |_| watch(minimized.simulations))?)
    } else {
        None
    };
    let has_same_predicate = predicate(&found) == predicate(recorded);
    Ok((found, Shrunk { minimized, has_same_predicate, repeats, is_interrupted }))
}

/// Moves a failure toward the nominal scenario with at most `budget` simulations. Returns it as a
/// counterexample that says where it comes from, and how it was found.
///
/// `watch` gets the number of simulations after each batch, and can end the minimization.
///
/// # Errors
/// If the request does not fail, or a simulation cannot be run.
pub(crate) fn smaller(
    resolved: &ResolvedPlan,
    system: &mut dyn System,
    (request, robustness): (&Request, f64),
    budget: u64,
    watch: impl FnMut(u64) -> ControlFlow<()>,
) -> Result<(Counterexample, Minimized), MishandleError> {
    let minimized = minimize(system, request, budget, watch)?;
    let mut found = Counterexample::from_episode(resolved, &minimized.episode)?;
    found.minimized_from = Some(MinimizedFrom {
        scenario: request.scenario.values().to_vec(),
        robustness,
        simulations: minimized.simulations,
        is_complete: minimized.is_complete,
    });
    Ok((found, minimized))
}

fn predicate(known: &Counterexample) -> Option<String> {
    known.decisive.as_ref().map(|decisive| decisive.predicate.clone())
}
