//! The failure modes of a round, minimized: a regression suite, and scenarios to train on.

use std::path::{Path, PathBuf};

use mishandle_falsification::is_close;
use mishandle_files::{limits, read_text_bounded};
use mishandle_rollout::{Episode, Request, Scenario, Seed};
use serde::{Deserialize, Serialize};

use super::folder::Folder;
use super::{HardenProgress, HardenUnit, Watch};
use crate::archive::{ModeKey, Modes, Simulated, simulated_in};
use crate::counterexample::{Counterexample, Failing, is_same_failure, smaller};
use crate::error::MishandleError;
use crate::resolve::ResolvedPlan;

/// Largest number of failure modes that a round minimizes: those with the most failures.
const MODES: usize = 10;

/// Largest number of simulations of a minimization.
const BUDGET: u64 = 100;

/// Largest number of simulations of all minimizations of a round.
pub(super) const LARGEST: u64 = MODES as u64 * BUDGET;

/// Returns the folder of the minimized failures of a round, a regression suite.
pub(super) fn suite_of(folder: &Folder, round: u32) -> PathBuf {
    folder.of_round(round, "failures")
}

/// Returns the path of the minimized failure of a mode, which may not exist. `mode` is its index
/// among the modes of the round's searches.
fn file_of(suite: &Path, mode: usize) -> PathBuf {
    suite.join(format!("mode-{}.json", mode + 1))
}

/// Returns the path of the file that says that another mode has the minimized failure of a mode.
fn duplicate_of(suite: &Path, mode: usize) -> PathBuf {
    file_of(suite, mode).with_extension("duplicate")
}

/// File that says which failure modes a round found.
const MODES_FILE: &str = "modes.toml";

/// The failure modes of a round, in the order of the numbers of their minimized failures.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Keys {
    modes: Vec<ModeKey>,
}

/// Writes which failure modes a round found.
pub(super) fn write_keys(folder: &Folder, round: u32, modes: &Modes) -> Result<(), MishandleError> {
    let path = folder.of_round(round, MODES_FILE);
    let keys = Keys { modes: modes.iter().map(|(key, _)| key.clone()).collect() };
    let text = toml::to_string(&keys).map_err(|error| MishandleError::File {
        path: path.clone(),
        source: std::io::Error::other(error.to_string()),
    })?;
    folder.write(&path, text.as_bytes())
}

/// A failure that a round moved toward the nominal scenario.
pub(super) struct MinimizedFailure {
    pub key: ModeKey,
    pub round: u32,
    /// Counterexample.
    pub file: PathBuf,
}

/// Returns the minimized failures of a round; none if it minimized nothing.
///
/// # Errors
/// If the file of the modes cannot be read.
pub(super) fn minimized_failures(
    folder: &Folder,
    round: u32,
) -> Result<Vec<MinimizedFailure>, MishandleError> {
    let path = folder.of_round(round, MODES_FILE);
    if !path.exists() {
        return Ok(Vec::new());
    }
    let text = read_text_bounded(&path, limits::RESULT);
    let read = text.and_then(|text| toml::from_str::<Keys>(&text).map_err(std::io::Error::other));
    let keys = read.map_err(|source| MishandleError::File { path, source })?;
    let suite = suite_of(folder, round);
    let files = (0..).zip(keys.modes).map(|(mode, key)| (key, file_of(&suite, mode)));
    let present = files.filter(|(_, file)| file.exists());
    Ok(present.map(|(key, file)| MinimizedFailure { key, round, file }).collect())
}

/// Moves the worst failure of each mode toward the nominal scenario while it still fails and does
/// not depend on the solver of the physics, writes it as a counterexample into `suite`, and returns
/// these failures. Reads those that are there. Returns `None` if it was interrupted.
///
/// # Errors
/// If a simulation cannot be run, or a file cannot be read or written.
pub(super) fn minimized(
    folder: &Folder,
    resolved: &ResolvedPlan,
    suite: &Path,
    simulated: &[Simulated],
    modes: &Modes,
    phase: &str,
    watch: Watch<'_>,
) -> Result<Option<Vec<Simulated>>, MishandleError> {
    let mut order: Vec<usize> = (0..modes.len()).collect();
    order.sort_by_key(|mode| std::cmp::Reverse(modes[*mode].1));
    order.truncate(MODES);
    let mut system = resolved.system()?;
    let mut checks = resolved.physics_checks()?;
    let mut found = Vec::new();
    let mut written = Vec::new();
    for (done, mode) in order.iter().enumerate() {
        let path = file_of(suite, *mode);
        let duplicate = duplicate_of(suite, *mode);
        if duplicate.exists() {
            continue;
        }
        if !path.exists() {
            let of_mode = simulated.iter().filter(|failure| failure.mode == Some(*mode));
            let Some(worst) = of_mode.min_by(|a, b| a.robustness.total_cmp(&b.robustness)) else {
                continue;
            };
            let mut is_interrupted = false;
            let mut watch = |simulations: u64| {
                let flow = watch(&HardenProgress {
                    phase: phase.to_string(),
                    done: done as u64 * BUDGET + simulations.min(BUDGET),
                    all: order.len() as u64 * BUDGET,
                    unit: HardenUnit::Simulations,
                });
                is_interrupted |= flow.is_break();
                flow
            };
            let request = Request::new(Scenario::new(worst.scenario.clone()), Seed(worst.seed));
            let keeps = |failure: &Episode, other: &Episode| is_same_failure(resolved, failure, other);
            let failing = Failing { request: &request, robustness: worst.robustness };
            let smaller =
                smaller(resolved, &mut *system, &mut checks, failing, BUDGET, &keeps, &mut watch)?.found;
            if is_interrupted {
                return Ok(None);
            }
            // Several modes can have the same minimized scenario.
            let scenario = smaller.scenario_in(&resolved.space)?;
            if written.iter().any(|other| is_close(&resolved.space, other, &scenario)) {
                folder.write(&duplicate, &[])?;
                continue;
            }
            folder.write(&path, smaller.to_json().as_bytes())?;
        }
        let known = Counterexample::read(&path)?;
        written.push(known.scenario_in(&resolved.space)?);
        found.push(Simulated { mode: Some(*mode), ..simulated_in(&path, &known, &resolved.space)? });
    }
    Ok(Some(found))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plan::Plan;
    use std::ops::ControlFlow;

    #[test]
    fn modes_with_the_same_minimized_failure_have_one_file_and_are_minimized_once() {
        let home = tempfile::tempdir().unwrap();
        let folder = Folder::at(home.path());
        let suite = suite_of(&folder, 1);
        let resolved = ResolvedPlan::new(&Plan::new("toy/sphere-2d", "")).unwrap();
        // The point that must be avoided is (0.3, -0.4), by 0.1 m.
        let failure = |mode| Simulated {
            scenario: vec![Some(0.35), Some(-0.42)],
            seed: 1,
            robustness: -0.05,
            mode: Some(mode),
        };
        let simulated = [failure(0), failure(1)];
        let modes: Modes = vec![(("a".to_string(), Vec::new()), 2), (("b".to_string(), Vec::new()), 1)];
        write_keys(&folder, 1, &modes).unwrap();
        let run = || {
            let mut simulations = 0;
            let mut watch = |progress: &HardenProgress| {
                simulations += progress.done;
                ControlFlow::Continue(())
            };
            let found = minimized(&folder, &resolved, &suite, &simulated, &modes, "", &mut watch);
            (found.unwrap().unwrap(), simulations)
        };
        let (first, simulations) = run();
        assert!(first.len() == 1 && first[0].mode == Some(0) && simulations > 0);
        assert_eq!(run(), (first, 0), "a resumed one simulates nothing");
        let known = minimized_failures(&folder, 1).unwrap();
        let [MinimizedFailure { key, round: 1, file }] = &known[..] else { panic!("one failure") };
        assert_eq!((key, file), (&modes[0].0, &file_of(&suite, 0)));
    }
}
