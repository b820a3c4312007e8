//! The smallest change that still breaks a relation.

use std::ops::ControlFlow;

use mishandle_rollout::{Request, Scenario, System};

use super::cases::Cases;
use super::{Case, Pair, SmallestChange};
use crate::FalsificationError;
use crate::metamorphic::relation::Relation;

/// Number of bisections: the share of the change is known to a thousandth.
pub(super) const BISECTIONS: u64 = 10;

/// Bisects the share of the change of a broken pair. The share 0 is the source case itself, which
/// breaks no relation. A share without a verdict counts as one that does not break it.
///
/// Returns `None` if a changed axis has categories, or `watch` ends the search.
pub(super) fn shrink(
    system: &mut dyn System,
    cases: &Cases,
    relation: &Relation,
    trial: u32,
    pair: &Pair,
    mut watch: impl FnMut(u64) -> ControlFlow<()>,
) -> Result<Shrunk, FalsificationError> {
    let mut found = SmallestChange {
        pair: pair.number,
        share: 1.0,
        holds_at: 0.0,
        case: pair.follow_up.clone(),
        simulations: 0,
    };
    if !relation.changes.iter().all(|(_, change)| change.can_shrink()) {
        return Ok(Shrunk::Impossible);
    }
    let mut intact: Scenario = pair.source.scenario.clone();
    for _ in 0..BISECTIONS {
        let share = f64::midpoint(found.holds_at, found.share);
        let Some(scenario) = cases.follow_up(relation, &pair.source.scenario, share) else { break };
        // Shares of a change of whole numbers have few scenarios.
        if scenario.is_same(&intact) {
            found.holds_at = share;
            continue;
        }
        if scenario.is_same(&found.case.scenario) {
            found.share = share;
            continue;
        }
        let number = found.simulations as u32 + 1;
        let request = Request { trial, number, ..Request::new(scenario, pair.source.seed) };
        let episode = system
            .rollout(&[request])?
            .pop()
            .ok_or(FalsificationError::EpisodeCount { requested: 1, returned: 0 })?;
        found.simulations += 1;
        let case = Case::from(&episode);
        let is_broken = |(source, follow_up)| relation.holds.is_broken(source, follow_up);
        if pair.source.robustness.zip(case.robustness).is_some_and(is_broken) {
            (found.share, found.case) = (share, case);
        } else {
            (found.holds_at, intact) = (share, case.scenario);
        }
        if watch(found.simulations).is_break() {
            return Ok(Shrunk::Interrupted(found.simulations));
        }
    }
    Ok(Shrunk::Found(found))
}

/// The result of [`shrink`].
pub(super) enum Shrunk {
    Found(SmallestChange),
    Impossible,
    /// Number of simulations until the interruption.
    Interrupted(u64),
}
