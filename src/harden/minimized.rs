//! The failure modes of a round, minimized: a regression suite, and scenarios to train on.

use std::path::{Path, PathBuf};

use mishandle_falsification::is_close;
use mishandle_rollout::{Request, Scenario, Seed};

use super::folder::Folder;
use super::{HardenProgress, Watch};
use crate::archive::{Modes, Simulated, simulated_in};
use crate::counterexample::{Counterexample, smaller};
use crate::error::MishandleError;
use crate::resolve::ResolvedPlan;

/// Largest number of failure modes that a round minimizes: those with the most failures.
const MODES: usize = 10;

/// Largest number of simulations of a minimization.
const BUDGET: u64 = 100;

/// Returns the folder of the minimized failures of a round, a regression suite.
pub(super) fn suite_of(folder: &Folder, round: u32) -> PathBuf {
    folder.of_round(round, "failures")
}

/// Returns the path of the minimized failure of a mode, which may not exist. `mode` is its index
/// among the modes of the round's searches.
pub(super) fn file_of(suite: &Path, mode: usize) -> PathBuf {
    suite.join(format!("mode-{}.json", mode + 1))
}

/// Moves the worst failure of each mode toward the nominal scenario while it still fails, writes it
/// as a counterexample into `suite`, and returns these failures. Reads those that are there.
/// Returns `None` if it was interrupted.
///
/// # Errors
/// If a simulation cannot be run, or a file cannot be read or written.
pub(super) fn minimized(
    folder: &Folder,
    resolved: &ResolvedPlan,
    suite: &Path,
    (simulated, modes): (&[Simulated], &Modes),
    phase: &str,
    watch: Watch<'_>,
) -> Result<Option<Vec<Simulated>>, MishandleError> {
    let mut order: Vec<usize> = (0..modes.len()).collect();
    order.sort_by_key(|mode| std::cmp::Reverse(modes[*mode].1));
    order.truncate(MODES);
    let mut system = resolved.system()?;
    let (mut found, mut written) = (Vec::new(), Vec::new());
    for (done, mode) in order.iter().enumerate() {
        let path = file_of(suite, *mode);
        if !path.exists() {
            let of_mode = simulated.iter().filter(|failure| failure.mode == Some(*mode));
            let Some(worst) = of_mode.min_by(|a, b| a.robustness.total_cmp(&b.robustness)) else { continue };
            let mut is_interrupted = false;
            let watch = |simulations: u64| {
                let flow = watch(&HardenProgress {
                    phase: phase.to_string(),
                    done: done as u64 * BUDGET + simulations.min(BUDGET),
                    all: order.len() as u64 * BUDGET,
                    unit: HardenProgress::SIMULATIONS,
                });
                is_interrupted |= flow.is_break();
                flow
            };
            let request = Request::new(Scenario::new(worst.scenario.clone()), Seed(worst.seed));
            let worst = (&request, worst.robustness);
            let (smaller, _) = smaller(resolved, &mut *system, worst, BUDGET, watch)?;
            if is_interrupted {
                return Ok(None);
            }
            // Several modes can have the same minimized scenario.
            let scenario = smaller.scenario_in(&resolved.space)?;
            if written.iter().any(|other| is_close(&resolved.space, other, &scenario)) {
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
