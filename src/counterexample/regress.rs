//! Counterexamples as a regression suite: the same scenarios with another controller.

use std::ops::ControlFlow;
use std::path::Path;

use mishandle_falsification::{repeat, repeat_seeds};
use mishandle_results::Repeats;
use mishandle_rollout::{Episode, Seed};
use mishandle_store::{ComponentRecord, RunHeader};

use crate::counterexample::Counterexample;
use crate::error::{MishandleError, RunError};
use crate::inspect::{ExplainedSimulation, explain_episode};
use crate::resolve::{ResolvedPlan, depends_on_seed};
use crate::run::without_verdict_error;

/// A counterexample that was simulated again.
#[derive(Debug)]
pub struct Regression {
    /// The simulation with the recorded seed, with its explanation.
    pub explained: ExplainedSimulation,
    /// Describes the simulation as the header of a run.
    pub header: RunHeader,
    /// The episode with the recorded seed.
    pub episode: Episode,
    /// Simulations with other seeds; `None` if `repeats` is 0, or if nothing is random.
    pub repeats: Option<Repeats>,
    /// Whether the target is not the recorded one, so that its scenarios may have another meaning.
    /// `None` if that is not known: the hash of a target covers its controller, and the recorded
    /// controller cannot be loaded; or the hash does not cover all parts of the target.
    pub has_other_target: Option<bool>,
}

/// Simulates a counterexample with another controller, and `repeats` times with other random seeds.
///
/// `folder` is the folder of the counterexample. Without `controller`, the recorded one is used.
/// `watch` is called after each simulation.
///
/// # Errors
/// If the target is not part of this program, a controller cannot be loaded, the space has other
/// axes, or the simulation has no robustness.
pub fn regress(
    counterexample: &Counterexample,
    folder: &Path,
    controller: Option<&str>,
    repeats: u64,
    watch: impl FnMut(&Episode) -> ControlFlow<()>,
) -> Result<Regression, MishandleError> {
    let resolved: ResolvedPlan = match controller {
        Some(controller) => counterexample.resolve_with(folder, controller)?,
        None => counterexample.resolve(folder, None)?,
    };
    let found = regress_with(counterexample, &resolved, repeats, watch)?;
    let with_recorded = match controller {
        Some(_) => counterexample.resolve(folder, None).ok().map(|recorded| recorded.target.identity.hash),
        None => Some(found.header.target.hash.clone()),
    };
    let has_other_target = with_recorded.and_then(|hash| has_other_target(counterexample, &hash));
    Ok(Regression { has_other_target, ..found })
}

/// Simulates a counterexample with a target that need not be part of this program, and `repeats`
/// times with other random seeds. `watch` is called after each simulation.
///
/// # Errors
/// If the space has other axes, the target cannot run the scenario, or the simulation has no
/// robustness.
pub fn regress_with(
    counterexample: &Counterexample,
    resolved: &ResolvedPlan,
    repeats: u64,
    watch: impl FnMut(&Episode) -> ControlFlow<()>,
) -> Result<Regression, MishandleError> {
    let request = counterexample.request(&resolved.space)?;
    let mut system = resolved.system()?;
    let scenario = request.scenario.clone();
    let episode = system.rollout(&[request])?.pop().ok_or(MishandleError::Run(RunError::NoEpisode))?;
    if episode.robustness().is_none() {
        return Err(without_verdict_error(&episode));
    }
    let (header, explained) = explain_episode(resolved, &episode)?;
    let repeats = match repeats {
        0 => None,
        _ if !depends_on_seed(resolved, &scenario) => None,
        n => Some(repeat(&mut *system, &scenario, repeat_seeds(Seed(counterexample.seed), n), watch)?),
    };
    let has_other_target = has_other_target(counterexample, &header.target.hash);
    Ok(Regression { explained, header, episode, repeats, has_other_target })
}

/// Returns whether the target of a counterexample has another hash than `hash`; `None` if they are
/// equal and do not cover all of it.
fn has_other_target(counterexample: &Counterexample, hash: &str) -> Option<bool> {
    let is_other = counterexample.target.hash != hash;
    let is_covered = !counterexample.components.iter().any(ComponentRecord::is_not_covered);
    (is_other || is_covered).then_some(is_other)
}
