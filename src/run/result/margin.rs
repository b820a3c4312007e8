use std::path::Path;

use mishandle_falsification::Witness;
use mishandle_results as results;
use mishandle_results::{Repeats, Seed};

use crate::resolve::{ResolvedPlan, named_scenario};
use crate::run::MarginOutcome;

/// Returns the result of a search for the smallest disturbance. `run` is the path of its run file.
pub fn margin_result(resolved: &ResolvedPlan, found: &MarginOutcome, run: &Path) -> results::Margin {
    let MarginOutcome { margin, repeats, .. } = found;
    let passed = margin.largest_without_violation();
    let witness = |witness: &Witness| {
        let Witness { episode, norms, axes } = witness;
        results::Witness {
            norms: *norms,
            axes: *axes as u64,
            simulation: episode.request.number,
            scenario: named_scenario(resolved.space.axes(), episode.request.scenario.values()),
            seed: Seed(episode.request.seed.0),
            robustness: episode.robustness().map(Into::into),
            repeats: repeats.clone(),
            fails_in_most_repeats: repeats.as_ref().map(Repeats::fails_in_most),
        }
    };
    results::Margin {
        run: Some(run.to_string_lossy().into_owned()),
        subject: resolved.subject(),
        formula: resolved.specification.requirement.to_string(),
        simulations: margin.simulations,
        is_complete: margin.is_complete,
        levels: margin.levels.clone(),
        no_violation_up_to: passed.map(|level| level.amplitude),
        no_violation_simulations: passed.map(|level| level.verdicts()),
        witness: margin.witness.as_ref().map(witness),
    }
}
