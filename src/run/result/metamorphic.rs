use std::path::Path;

use mishandle_evaluation::wilson;
use mishandle_falsification::{Case, Metamorphic, Pair, Relation, RelationOutcome, SmallestChange};
use mishandle_results as results;
use mishandle_results::{
    BrokenPair, MetamorphicRelation, Named, PairCase, Seed, SourceRange, WithoutVerdict,
};
use mishandle_rollout::Axis;
use mishandle_stl::is_violated;

use crate::error::MishandleError;
use crate::resolve::{
    MetamorphicCases, ResolvedPlan, metamorphic_cases, named_scenario, space_depends_on_seed,
};

/// Returns the result of a metamorphic test. `run` is the path of its run file.
///
/// # Errors
/// If the plan is not that of the test.
pub(crate) fn metamorphic_result(
    resolved: &ResolvedPlan,
    found: &Metamorphic,
    run: &Path,
) -> Result<results::Metamorphic, MishandleError> {
    let MetamorphicCases { cases, relations, settings } = metamorphic_cases(resolved)?;
    // Axes that source cases lack are nominal in them.
    let range = |axis: &Axis| {
        let drawn = cases.sources().axes().iter().find(|drawn| drawn.name == axis.name);
        let nominal = axis.nominal.unwrap_or(axis.low);
        let [low, high] = drawn.map_or([nominal; 2], |drawn| [drawn.low, drawn.high]);
        SourceRange { axis: axis.name.clone(), low, high }
    };
    Ok(results::Metamorphic {
        run: Some(run.to_string_lossy().into_owned()),
        subject: resolved.subject(),
        formula: resolved.specification.requirement.to_string(),
        sources: resolved.space.axes().iter().map(range).collect(),
        pairs: settings.pairs,
        simulations: found.simulations,
        without_verdict: WithoutVerdict::default(),
        asks_nothing: None,
        is_random: space_depends_on_seed(resolved),
        is_complete: found.is_complete,
        relations: relations
            .iter()
            .zip(&found.relations)
            .map(|(asked, found)| relation(resolved, asked, found))
            .collect(),
        reasons: None,
    })
}

fn relation(resolved: &ResolvedPlan, asked: &Relation, found: &RelationOutcome) -> MetamorphicRelation {
    let axes = resolved.space.axes();
    let decided = found.pairs - found.without_verdict;
    let smallest = |smallest: &SmallestChange| {
        let source = found.worst.first().filter(|pair| pair.number == smallest.pair);
        let change = |(index, _): &(usize, _)| {
            let source = source.and_then(|pair| pair.source.scenario.get(*index));
            let (from, to) = source.zip(smallest.case.scenario.get(*index))?;
            Some((axes[*index].name.clone(), to - from))
        };
        results::SmallestChange {
            pair: smallest.pair,
            share: smallest.share,
            holds_at: smallest.holds_at,
            change: asked.changes.iter().filter_map(change).collect(),
            follow_up: case(resolved, &smallest.case),
            simulations: smallest.simulations,
        }
    };
    MetamorphicRelation {
        name: asked.name.clone(),
        change: asked
            .changes
            .iter()
            .map(|(index, change)| (axes[*index].name.clone(), change.to_string()))
            .collect::<Named<String>>(),
        holds: asked.holds.to_string(),
        pairs: found.pairs,
        out_of_bounds: found.out_of_bounds,
        without_verdict: found.without_verdict,
        verdicts: found.verdicts,
        broken: found.broken,
        broken_rate: wilson(found.broken, decided),
        worst: found.worst.iter().map(|pair| broken_pair(resolved, pair)).collect(),
        smallest_change: found.smallest_change.as_ref().map(smallest),
    }
}

fn broken_pair(resolved: &ResolvedPlan, pair: &Pair) -> BrokenPair {
    BrokenPair {
        pair: pair.number,
        seed: Seed(pair.source.seed.0),
        source: case(resolved, &pair.source),
        follow_up: case(resolved, &pair.follow_up),
        difference: pair.difference().unwrap_or_default().into(),
    }
}

fn case(resolved: &ResolvedPlan, case: &Case) -> PairCase {
    PairCase {
        trial: case.trial,
        simulation: case.number,
        scenario: named_scenario(resolved.space.axes(), case.scenario.values()),
        robustness: case.robustness,
        is_violated: case.robustness.map(is_violated),
    }
}
