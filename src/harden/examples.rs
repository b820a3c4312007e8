//! One failure of each failure mode of the final comparison, to look at.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use mishandle_results::{HardenedMode, Hardening};
use mishandle_rollout::{Request, Scenario, Seed};
use mishandle_store::RunFile;
use mishandle_text::path_text;

use super::folder::Folder;
use super::minimized::{MinimizedFailure, minimized_failures};
use super::search::search_files;
use crate::archive::{ModeKey, mode_key};
use crate::counterexample::Counterexample;
use crate::error::{Compared, MishandleError, RunError};
use crate::inspect::{Failure, failure_modes};
use crate::picture::ExampleSimulation;
use crate::plan::HardenPlan;
use crate::resolve::{ResolvedPlan, is_target_file, recorded_plan};

/// Failures of the failure modes of a finished hardening: a minimized one of a round, the latest
/// first, if it fails in this mode, or else the worst one of the final searches.
pub struct ModeExamples {
    controllers: [ResolvedPlan; 2],
    worst: [HashMap<ModeKey, Worst>; 2],
    smaller: Vec<MinimizedFailure>,
}

/// A failure of a failure mode, simulated again.
pub struct ModeExample {
    /// Where it is recorded.
    pub source: ExampleSource,
    /// Its simulations with the controllers before and after.
    pub simulated: [ExampleSimulation; 2],
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

impl ModeExamples {
    /// Reads the folder of a finished hardening. Its paths begin with `folder`.
    ///
    /// Returns `None` if no round was accepted: then there are no modes. The same holds for a robot
    /// of a file, whose states have no pictures.
    ///
    /// # Errors
    /// If a file of the folder is missing or differs.
    pub fn open(folder: &Path, found: &Hardening) -> Result<Option<ModeExamples>, MishandleError> {
        let accepted = found.rounds.iter().rev().find(|round| round.accepted);
        let Some(accepted) = accepted else { return Ok(None) };
        let (folder, plan) = Folder::open(folder)?;
        if is_target_file(&plan.target) {
            return Ok(None);
        }
        let table = plan.harden.ok_or(MishandleError::MissingPlanTable { table: "harden" })?;
        let (before, worst_before) = final_search(&folder, &table, "before", &folder.before())?;
        let (after, worst_after) =
            final_search(&folder, &table, "after", &folder.candidate(accepted.number))?;
        let mut smaller = Vec::new();
        for round in &found.rounds {
            smaller.extend(minimized_failures(&folder, round.number)?);
        }
        Ok(Some(ModeExamples { controllers: [before, after], worst: [worst_before, worst_after], smaller }))
    }

    /// Returns the controllers before and after, with target, space and requirement.
    pub fn controllers(&self) -> &[ResolvedPlan; 2] {
        &self.controllers
    }

    /// Simulates a failure of a mode of the hardening.
    ///
    /// # Errors
    /// If a record of the failure cannot be read or differs from its simulation, or this cannot be
    /// run.
    pub fn example(&self, mode: &HardenedMode) -> Result<ModeExample, MishandleError> {
        let failing = mode.failing();
        let key = (mode.predicate.clone(), mode.axes.clone());
        for MinimizedFailure { round, file, .. } in self.smaller.iter().rev().filter(|one| one.key == key) {
            let known = Counterexample::read(file)?;
            let request = known.request(&self.controllers[failing].space)?;
            let fails = ExampleSimulation::new(&self.controllers[failing], &request)?;
            if !fails.fails_by(&key.0) {
                continue;
            }
            let simulated = self.both(failing, fails, &request)?;
            for (controller, simulation) in self.controllers.iter().zip(&simulated) {
                // That of another round may be neither.
                let hashes = controller.target.components.iter().map(|component| &component.hash);
                if hashes.eq(known.components.iter().map(|component| &component.hash)) {
                    simulation.check(known.expected.robustness, || path_text(file))?;
                }
            }
            let source = ExampleSource::Minimized { round: *round, file: file.clone() };
            return Ok(ModeExample { source, simulated });
        }
        let Worst { run, failure } =
            self.worst[failing].get(&key).ok_or(MishandleError::Run(RunError::NoEpisode))?;
        let request = Request::new(Scenario::new(failure.scenario.clone()), Seed(failure.seed));
        let fails = ExampleSimulation::new(&self.controllers[failing], &request)?;
        let trial = failure.trial;
        let number = failure.number;
        fails.check(failure.robustness, || format!("simulation {number} of trial {trial}"))?;
        let source = ExampleSource::Worst { run: run.clone(), trial, number };
        Ok(ModeExample { source, simulated: self.both(failing, fails, &request)? })
    }

    /// Adds the simulation of the other controller.
    fn both(
        &self,
        failing: usize,
        fails: ExampleSimulation,
        request: &Request,
    ) -> Result<[ExampleSimulation; 2], MishandleError> {
        let other = ExampleSimulation::new(&self.controllers[1 - failing], request)?;
        Ok(if failing == 0 { [fails, other] } else { [other, fails] })
    }
}

impl ExampleSimulation {
    /// Returns whether it fails, and this predicate decides it.
    fn fails_by(&self, predicate: &str) -> bool {
        let decisive = self.explained.as_ref().and_then(|(_, found)| {
            found.explanation.diagnosis.predicate.as_ref().map(|decisive| decisive.text.as_str())
        });
        self.episode.is_violated() && decisive == Some(predicate)
    }

    /// Checks that it has the recorded robustness.
    fn check(&self, recorded: f64, name: impl Fn() -> String) -> Result<(), MishandleError> {
        let again = self.episode.robustness();
        if again.map(f64::to_bits) == Some(recorded.to_bits()) {
            return Ok(());
        }
        let again = again.map_or("none".to_string(), |again| format!("{again:?}"));
        let difference = format!("robustness of {}: recorded {recorded:?}, simulated {again}", name());
        Err(MishandleError::differs(Compared::Plan, vec![difference]))
    }
}

/// The failure of a mode with the least robustness, and its run file.
struct Worst {
    run: PathBuf,
    failure: Failure,
}

/// Returns a controller, and the worst failure of each mode of its final searches.
fn final_search(
    folder: &Folder,
    table: &HardenPlan,
    name: &str,
    controller: &Path,
) -> Result<(ResolvedPlan, HashMap<ModeKey, Worst>), MishandleError> {
    let mut resolved = None;
    let mut worst = HashMap::<ModeKey, Worst>::new();
    for path in search_files(&folder.of_final(&format!("{name}-search")), table) {
        let run = RunFile::open(&path)?;
        if resolved.is_none() {
            resolved = Some(recorded_plan(run.header(), Some(path_text(controller).as_str()))?);
        }
        for mode in failure_modes(&run)?.modes {
            let key = mode_key(&run, &mode);
            for failure in mode.failures {
                if worst.get(&key).is_none_or(|known| failure.robustness < known.failure.robustness) {
                    worst.insert(key.clone(), Worst { run: path.clone(), failure });
                }
            }
        }
    }
    Ok((resolved.ok_or(MishandleError::Run(RunError::NoEpisode))?, worst))
}
