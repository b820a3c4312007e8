//! Simulations of run files with their failure modes.

use std::collections::HashMap;

use mishandle_store::RunFile;

use super::weights::Simulated;
use crate::error::MishandleError;
use crate::inspect::{FailureMode, failure_modes};

/// A failure mode of a search: the decisive predicate, and the names of the axes of its failures.
pub(crate) type ModeKey = (String, Vec<String>);

/// Failure modes with the numbers of their failures.
pub(crate) type Modes = Vec<(ModeKey, u64)>;

/// Returns all simulations of runs with a verdict, and the failure modes with the numbers of their
/// failures. A mode of one run is the same in another one.
///
/// # Errors
/// If a run cannot be read.
pub(crate) fn simulated(runs: &[RunFile]) -> Result<(Vec<Simulated>, Modes), MishandleError> {
    let mut simulated = Vec::new();
    let mut modes = Modes::new();
    for run in runs {
        let mut mode_of = HashMap::new();
        for mode in &failure_modes(run)?.modes {
            let key = mode_key(run, mode);
            let index = modes.iter().position(|(known, _)| *known == key).unwrap_or_else(|| {
                modes.push((key, 0));
                modes.len() - 1
            });
            modes[index].1 += mode.failures.len() as u64;
            mode_of.extend(mode.failures.iter().map(|failure| ((failure.trial, failure.number), index)));
        }
        simulated.extend(rows(run, &mode_of)?);
    }
    Ok((simulated, modes))
}

/// Returns by what a failure mode of a run is the same as one of another run.
pub(crate) fn mode_key(run: &RunFile, mode: &FailureMode) -> ModeKey {
    let name = |axis: &usize| run.header().axes[*axis].name.clone();
    (mode.representative().predicate.clone(), mode.axes.iter().map(name).collect())
}

fn rows(run: &RunFile, mode_of: &HashMap<(u32, u32), usize>) -> Result<Vec<Simulated>, MishandleError> {
    let mut found = Vec::new();
    for simulation in run.simulations() {
        let simulation = simulation?;
        let Some(robustness) = simulation.robustness else { continue };
        let place = (simulation.trial, simulation.number);
        let mode = mode_of.get(&place).copied();
        found.push(Simulated { scenario: simulation.scenario, seed: simulation.seed, robustness, mode });
    }
    Ok(found)
}
