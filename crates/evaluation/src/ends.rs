//! Counts of simulations without a verdict, by reason.

use mishandle_results::EndCounts;
use mishandle_rollout::EpisodeEnd;

/// Adds `n` simulations with an end to the counts. `has_verdict` says whether the formula of the
/// question is decided.
pub fn count_end(counts: &mut EndCounts, end: EpisodeEnd, has_verdict: bool, n: u64) {
    if !end.counts_in_rates() {
        counts.invalid_starts += n;
        return;
    }
    counts.simulations += n;
    match end {
        EpisodeEnd::Diverged { .. } => counts.diverged += n,
        end if end.is_invalid() => counts.invalid += n,
        end if end.is_failed() => counts.failed += n,
        _ if !has_verdict => counts.undecided += n,
        _ => {}
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_end_counts_once_and_an_invalid_start_in_no_share() {
        for end in WITHOUT_VERDICT {
            let mut counts = EndCounts::default();
            count_end(&mut counts, end, false, 3);
            let starts = end != EpisodeEnd::InvalidScenario;
            let expected = if starts { (3, 3, 0) } else { (0, 0, 3) };
            assert_eq!((counts.simulations, counts.total(), counts.invalid_starts), expected, "{end:?}");
        }
        // A stop rule can end a simulation before one of its formulas is decided.
        let mut counts = EndCounts::default();
        count_end(&mut counts, EpisodeEnd::Stopped { step: 3 }, true, 1);
        count_end(&mut counts, EpisodeEnd::Stopped { step: 3 }, false, 1);
        assert_eq!((counts.simulations, counts.undecided), (2, 1));
    }
}
