use std::path::Path;

use mishandle_falsification::{Margin, Witness, category_axes};
use mishandle_results as results;
use mishandle_results::{CategoryMargin, Named, Repeats, Seed, WithoutVerdict};
use mishandle_rollout::{AxisValues, Space};

use crate::resolve::{ResolvedPlan, named_scenario, space_depends_on_seed};
use crate::run::margin::MarginOutcome;

/// Returns the result of a search for the smallest disturbance. `run` is the path of its run file.
pub(crate) fn margin_result(resolved: &ResolvedPlan, found: &MarginOutcome, run: &Path) -> results::Margin {
    let MarginOutcome { margin, each_category, passed, simulations, repeats, is_complete, .. } = found;
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
    let is_in_space = |name: &str| resolved.space.axes().iter().any(|axis| axis.name == name);
    let others =
        resolved.target.axes.iter().filter(|axis| axis.nominal.is_some() && !is_in_space(&axis.name));
    results::Margin {
        run: Some(run.to_string_lossy().into_owned()),
        subject: resolved.subject(),
        formula: resolved.specification.requirement.to_string(),
        at_nominal: others.map(|axis| axis.name.clone()).collect(),
        simulations: *simulations,
        is_random: space_depends_on_seed(resolved),
        is_complete: *is_complete,
        without_verdict: WithoutVerdict::default(),
        asks_nothing: None,
        smallest_without_verdict: found.smallest_without_verdict,
        categories: categories(&resolved.space, space_of(found).unwrap_or(&resolved.space)),
        each_category: each_category
            .iter()
            .map(|(space, margin)| category_margin(categories(&resolved.space, space), margin))
            .collect(),
        levels: margin.levels.clone(),
        no_violation_up_to: passed.map(|level| level.amplitude),
        no_violation_simulations: passed.map(|level| level.verdicts()),
        no_violation_seeds: passed.map(|level| level.seeds),
        no_violation_is_exhaustive: passed.map(|level| level.is_exhaustive),
        witness: margin.witness.as_ref().map(witness),
        reasons: None,
    }
}

/// Returns the space of the search with the smallest disturbance, if there is one for each
/// combination of categories.
fn space_of(found: &MarginOutcome) -> Option<&Space> {
    let simulation = |margin: &Margin| margin.witness.as_ref().map(|witness| witness.episode.request.number);
    let is_smallest = |(_, margin): &&(Space, Margin)| {
        margin.levels == found.margin.levels && simulation(margin) == simulation(&found.margin)
    };
    found.each_category.iter().find(is_smallest).map(|(space, _)| space)
}

fn category_margin(categories: Named<String>, margin: &Margin) -> CategoryMargin {
    let Margin { simulations, is_complete, .. } = *margin;
    let witness = margin.witness.as_ref();
    let passed = margin.largest_without_violation();
    CategoryMargin {
        categories,
        simulations,
        is_complete,
        amplitude: witness.map(|witness| witness.norms.amplitude),
        simulation: witness.map(|witness| witness.episode.request.number),
        no_violation_up_to: passed.map(|level| level.amplitude),
        no_violation_simulations: passed.map(|level| level.verdicts()),
    }
}

/// Returns the category at which each categorical axis of a space with a choice stays in a part of
/// the space: its nominal one.
fn categories(space: &Space, part: &Space) -> Named<String> {
    let named = |index: usize| {
        let axis = &space.axes()[index];
        let nominal = part.axes()[index].nominal;
        if part.idle_axes().contains(&index) {
            return None;
        }
        let AxisValues::Categorical(names) = &axis.values else { return None };
        let name = names.get((nominal? - axis.low) as usize)?;
        Some((axis.name.clone(), name.clone()))
    };
    category_axes(space).into_iter().filter_map(named).collect()
}
