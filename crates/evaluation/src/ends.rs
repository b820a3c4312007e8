//! Simulations without a verdict, by reason.

use mishandle_results::EndCounts;
use mishandle_rollout::{Episode, EpisodeEnd};

/// Adds a simulation to the counts if it has no verdict on success.
pub fn count_end(counts: &mut EndCounts, episode: &Episode) {
    match episode.end {
        EpisodeEnd::Diverged { .. } => counts.diverged += 1,
        end if end.is_invalid() => counts.invalid += 1,
        end if end.is_failed() => counts.failed += 1,
        _ => counts.undecided += u64::from(episode.verdict.success.is_none()),
    }
}

/// All ends that have no verdict.
#[cfg(test)]
pub(crate) const WITHOUT_VERDICT: [EpisodeEnd; 9] = [
    EpisodeEnd::Diverged { step: 1 },
    EpisodeEnd::Undefined { step: 1 },
    EpisodeEnd::InvalidAction { step: 1, index: 0 },
    EpisodeEnd::InvalidObservation { step: 1, index: 0 },
    EpisodeEnd::InvalidReward { step: 1, index: 0 },
    EpisodeEnd::InvalidSignal { step: 1, index: 0 },
    EpisodeEnd::InvalidScenario,
    EpisodeEnd::Crashed { step: 1 },
    EpisodeEnd::TimedOut { step: 1 },
];
