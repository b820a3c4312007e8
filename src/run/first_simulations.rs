//! A search whose first simulations all fail would spend its budget on nothing.

use mishandle_rollout::{Episode, EpisodeEnd};
use mishandle_store::RunFile;

use crate::error::{MishandleError, RunError};
use crate::resolve::ResolvedPlan;
use crate::run::end_text;

/// Number of simulations after which a search stops if none of them ran to a verdict: enough that a
/// space with a few invalid scenarios continues, and few enough for a simulator that takes a minute
/// to time out.
const FIRST: u32 = 20;

/// Watches the first simulations of a search, recorded ones too: a resumed run stops as well.
#[derive(Default)]
pub(crate) struct FirstSimulations {
    failed: u32,
    /// Trial, number and end of the first simulation.
    first: Option<(u32, u32, EpisodeEnd)>,
    has_run: bool,
}

impl FirstSimulations {
    /// Adds the next simulation.
    pub(crate) fn add(&mut self, episode: &Episode) {
        let Episode { end, request, .. } = episode;
        if self.failed < FIRST && !end.is_failed() && !end.is_invalid() {
            self.has_run = true;
        }
        self.failed += 1;
        self.first.get_or_insert((request.trial, request.number, *end));
    }

    /// Returns the first simulation if the search is hopeless.
    fn hopeless(&self) -> Option<(u32, u32, EpisodeEnd)> {
        self.first.filter(|_| self.failed >= FIRST && !self.has_run)
    }

    /// Checks that the search is not hopeless. `run` has its simulations.
    ///
    /// # Errors
    /// [`RunError::NothingRuns`] if it is.
    pub(crate) fn check(&self, resolved: &ResolvedPlan, run: &RunFile) -> Result<(), MishandleError> {
        let Some((trial, number, end)) = self.hopeless() else { return Ok(()) };
        // Rows that are read in order have no reasons.
        let reason = run.simulation(trial, number)?.reason;
        let names: Vec<&str> = resolved.signals.iter().map(|signal| signal.name.as_str()).collect();
        let reason = if reason.is_empty() { String::new() } else { format!(": {reason}") };
        Err(RunError::NothingRuns { count: FIRST, end: format!("{}{reason}", end_text(end, &names)) }.into())
    }
}

#[cfg(test)]
mod tests {
    use mishandle_rollout::{Request, Seed, Verdict};
    use mishandle_stl::Trace;

    use super::*;

    fn stops(ends: &[EpisodeEnd]) -> bool {
        let mut first = FirstSimulations::default();
        for end in ends {
            first.add(&Episode {
                request: Request::new([0.5], Seed(0)),
                end: *end,
                reason: String::new(),
                steps: 0,
                verdict: Verdict::default(),
                total_reward: 0.0,
                trace: Trace::new(std::sync::Arc::from([])),
                trace_digest: None,
            });
        }
        first.hopeless().is_some()
    }

    #[test]
    fn twenty_failures_stop_a_search_and_one_simulation_that_ran_lets_it_go_on() {
        use EpisodeEnd::{
            Completed, Crashed, Diverged, InvalidAction, InvalidObservation, InvalidReward, InvalidScenario,
            InvalidSignal, Stopped, Terminated, TimedOut, Undefined,
        };
        let step = 1;
        let index = 0;
        let failures = [
            Crashed { step },
            TimedOut { step },
            InvalidScenario,
            InvalidAction { step, index },
            InvalidObservation { step, index },
            InvalidReward { step, index },
            InvalidSignal { step, index },
        ];
        for end in failures {
            assert!(!stops(&[end; 19]) && stops(&[end; 20]) && stops(&[end; 64]), "{end:?}");
        }
        for ran in [Completed, Terminated { step }, Stopped { step }, Diverged { step }, Undefined { step }] {
            for place in [0, 10, 19] {
                let mut ends = [Crashed { step }; 64];
                ends[place] = ran;
                assert!(!stops(&ends), "{ran:?}");
            }
            let mut ends = [Crashed { step }; 64];
            ends[20] = ran;
            assert!(stops(&ends), "{ran:?}: too late");
        }
    }
}
