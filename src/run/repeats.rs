//! Results of a plan, simulated with other seeds.

use std::ops::ControlFlow;

use mishandle_evaluation::RepeatReport;
use mishandle_falsification::{Repeated, Witness, repeat, repeat_seeds};
use mishandle_rollout::{Episode, Request};

use crate::error::MishandleError;
use crate::resolve::{ResolvedPlan, depends_on_seed};

/// Simulates a witness with other seeds. Returns `None` if they cannot change the result.
///
/// # Errors
/// If a simulation cannot be run.
pub fn witness_repeats(
    resolved: &ResolvedPlan,
    witness: &Witness,
    watch: impl FnMut(&Episode) -> ControlFlow<()>,
) -> Result<Option<RepeatReport>, MishandleError> {
    let Request { scenario, seed, .. } = &witness.episode.request;
    if !depends_on_seed(resolved, scenario) {
        return Ok(None);
    }
    let mut system = resolved.system()?;
    let seeds = repeat_seeds(*seed, Repeated::Counterexample.simulations());
    Ok(Some(repeat(&mut *system, scenario, seeds, watch)?))
}
