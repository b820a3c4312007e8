//! One failure of each failure mode of the final comparison, to look at.

use std::path::{Path, PathBuf};

use mishandle_results::{HardenedMode, Hardening};
use mishandle_rollout::{Episode, Request, Scenario, Seed};
use mishandle_store::RunFile;

use super::folder::Folder;
use super::minimized::{file_of, suite_of};
use super::search::search_files;
use crate::archive::{ModeKey, mode_key, simulated};
use crate::counterexample::Counterexample;
use crate::error::MishandleError;
use crate::inspect::{Failure, failure_modes};
use crate::plan::HardenPlan;
use crate::resolve::{ResolvedPlan, recorded_plan};
use crate::run::Opening;

/// Failures of the failure modes of a hardening.
pub struct ModeExamples {
    /// The controllers before and after, with target, space and requirement.
    pub controllers: [ResolvedPlan; 2],
    /// One failure of each mode, in the order of the request.
    pub examples: Vec<ModeExample>,
}

/// A failure of a failure mode.
#[derive(Clone, Debug, PartialEq)]
pub struct ModeExample {
    /// Scenario and seed.
    pub request: Request,
    /// Index of the controller that fails: 0 for the one before, if the mode vanished, otherwise 1.
    pub failing: usize,
    /// Where it is recorded.
    pub source: ExampleSource,
}

/// Record of a failure.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum ExampleSource {
    /// The worst failure of the mode in the final searches.
    Worst {
        /// Run file.
        run: PathBuf,
        /// Number of the trial.
        trial: u32,
        /// Number of the simulation within the trial.
        number: u32,
    },
    /// A failure of the mode that a round moved toward the nominal scenario.
    Minimized {
        /// Number of the round.
        round: u32,
        /// Counterexample.
        file: PathBuf,
    },
}

/// Returns a failure of some failure modes of a finished hardening: a minimized one of a round, the
/// latest first, if it fails in this mode, or else the worst one of the final searches. Each is
/// simulated again. `modes` are modes of `found`.
///
/// Returns `None` if no round was accepted: then there are no modes.
///
/// # Errors
/// If a file of the folder is missing or differs, or a simulation differs from its record.
pub fn mode_examples(
    folder: &Path,
    found: &Hardening,
    modes: &[&HardenedMode],
) -> Result<Option<ModeExamples>, MishandleError> {
    let accepted = found.rounds.iter().rev().find(|round| round.accepted);
    let Some(accepted) = accepted else { return Ok(None) };
    let (folder, plan) = Folder::open(folder, Opening::default())?;
    let table = plan.harden.ok_or(MishandleError::MissingPlanTable { table: "harden" })?;
    let paths = [folder.before(), folder.candidate(accepted.number)];
    let searched: [Searched; 2] = [
        Searched::open(&folder, &table, "before", &paths[0])?,
        Searched::open(&folder, &table, "after", &paths[1])?,
    ];
    let smaller = minimized_failures(&folder, &table, found)?;
    let example = |mode: &&HardenedMode| {
        let failing = usize::from(mode.after > 0);
        searched[failing].example(&(mode.predicate.clone(), mode.axes.clone()), &smaller, failing)
    };
    let examples = modes.iter().map(example).collect::<Result<_, _>>()?;
    Ok(Some(ModeExamples { controllers: searched.map(|searched| searched.resolved), examples }))
}

/// The final searches of a controller.
struct Searched {
    runs: Vec<RunFile>,
    resolved: ResolvedPlan,
}

impl Searched {
    fn open(
        folder: &Folder,
        table: &HardenPlan,
        name: &str,
        controller: &Path,
    ) -> Result<Searched, MishandleError> {
        let runs = open(&search_files(&folder.of_final(&format!("{name}-search")), table))?;
        let header = runs.first().ok_or(MishandleError::NoEpisode)?.header();
        let resolved = recorded_plan(header, Some(&controller.to_string_lossy()))?;
        Ok(Searched { runs, resolved })
    }

    fn example(
        &self,
        key: &ModeKey,
        smaller: &[Minimized],
        failing: usize,
    ) -> Result<ModeExample, MishandleError> {
        for Minimized { key: known, round, file } in smaller.iter().rev() {
            if known != key {
                continue;
            }
            let request = Counterexample::read(file)?.request(&self.resolved.space)?;
            let episode = self.simulate(&request)?;
            let fails_alike = episode.is_violated()
                && Counterexample::from_episode(&self.resolved, &episode)?
                    .decisive
                    .is_some_and(|decisive| decisive.predicate == key.0);
            if fails_alike {
                let source = ExampleSource::Minimized { round: *round, file: file.clone() };
                return Ok(ModeExample { request, failing, source });
            }
        }
        let (run, worst) = self.worst(key)?.ok_or(MishandleError::NoEpisode)?;
        let request = Request::new(Scenario::new(worst.scenario), Seed(worst.seed));
        let again = self.simulate(&request)?.robustness();
        let (trial, number) = (worst.trial, worst.number);
        if again.map(f64::to_bits) != Some(worst.robustness.to_bits()) {
            let difference = format!("robustness of simulation {number} of trial {trial}");
            return Err(MishandleError::RunMismatch { differences: vec![difference] });
        }
        Ok(ModeExample { request, failing, source: ExampleSource::Worst { run, trial, number } })
    }

    fn simulate(&self, request: &Request) -> Result<Episode, MishandleError> {
        let mut episodes = self.resolved.system()?.rollout(std::slice::from_ref(request))?;
        episodes.pop().ok_or(MishandleError::NoEpisode)
    }

    /// Returns the failure of a mode with the least robustness, and its run file.
    fn worst(&self, key: &ModeKey) -> Result<Option<(PathBuf, Failure)>, MishandleError> {
        let mut worst: Option<(PathBuf, Failure)> = None;
        for run in &self.runs {
            let modes = failure_modes(run)?.modes;
            let of_mode = modes.into_iter().filter(|mode| mode_key(run, mode) == *key);
            for failure in of_mode.flat_map(|mode| mode.failures) {
                if worst.as_ref().is_none_or(|(_, known)| failure.robustness < known.robustness) {
                    worst = Some((run.path().to_path_buf(), failure));
                }
            }
        }
        Ok(worst)
    }
}

/// A failure that a round moved toward the nominal scenario.
struct Minimized {
    key: ModeKey,
    round: u32,
    file: PathBuf,
}

/// Returns the minimized failures of all rounds, in order.
fn minimized_failures(
    folder: &Folder,
    table: &HardenPlan,
    found: &Hardening,
) -> Result<Vec<Minimized>, MishandleError> {
    let mut all = Vec::new();
    for round in found.rounds.iter().map(|round| round.number) {
        let (_, modes) = simulated(&open(&search_files(&folder.of_round(round, "search"), table))?)?;
        let suite = suite_of(folder, round);
        let files = (0..).zip(modes).map(|(index, (key, _))| (key, file_of(&suite, index)));
        let present = files.filter(|(_, file)| file.exists());
        all.extend(present.map(|(key, file)| Minimized { key, round, file }));
    }
    Ok(all)
}

fn open(paths: &[PathBuf]) -> Result<Vec<RunFile>, MishandleError> {
    Ok(paths.iter().map(RunFile::open).collect::<Result<_, _>>()?)
}
