//! Campaigns whose simulations another physics engine runs first. The system repeats those that
//! count.

use std::ops::ControlFlow;
use std::sync::Mutex;

use mishandle_random::Sequence;
use mishandle_results::Confirmed;
use mishandle_rollout::{DEFAULT_BATCH_SIZE, Episode, Request, Screen, ScreenedEpisode, System};
use mishandle_search::Observation;
use mishandle_stl::{Trace, is_violated};

use crate::falsification::Simulated;
use crate::trial::observation;
use crate::{Falsification, FalsificationError, FalsificationOutcome, FalsificationSettings, Trial};

/// Number of simulations that the system repeats at once.
const REPEATED_AT_ONCE: usize = 16 * DEFAULT_BATCH_SIZE;

/// Simulations of a screened falsification, by their result on the other engine.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ScreenedCounts {
    /// Violations on the other engine.
    pub violated: Confirmed,
    /// Simulations without a verdict there.
    pub without_verdict: Confirmed,
    /// Number of these in which the other engine had too little memory for contacts or constraints.
    pub overflows: u64,
    /// Simulations without a violation, but with a lower robustness there than all earlier ones of
    /// the trial.
    pub minima: Confirmed,
    /// Audit sample.
    pub sampled: Confirmed,
    /// Number of simulations that the system did not repeat.
    pub not_repeated: u64,
}

/// Why the system repeats a simulation.
#[derive(Clone, Copy)]
enum Reason {
    Violation,
    NoVerdict { has_overflowed: bool },
    Minimum,
    Sample,
}

/// Result of a simulation that counts for a search.
enum Outcome {
    Repeated(Reason, Box<Episode>),
    Screened(Request, Observation),
}

struct Screened {
    outcome: Outcome,
    /// Robustness on the other engine; +∞ without a verdict.
    robustness: f64,
}

impl Simulated for Screened {
    fn request(&self) -> &Request {
        match &self.outcome {
            Outcome::Repeated(_, episode) => &episode.request,
            Outcome::Screened(request, _) => request,
        }
    }

    fn report_to(&self, trial: &mut Trial<'_>) -> Result<(), FalsificationError> {
        match &self.outcome {
            Outcome::Repeated(_, episode) => trial.tell(episode),
            Outcome::Screened(request, observation) => trial.tell_screened(request, observation),
        }
    }
}

impl ScreenedCounts {
    fn add(&mut self, simulation: &Screened) {
        let Outcome::Repeated(reason, episode) = &simulation.outcome else {
            self.not_repeated += 1;
            return;
        };
        let count = match reason {
            Reason::Violation => &mut self.violated,
            Reason::NoVerdict { has_overflowed } => {
                self.overflows += u64::from(*has_overflowed);
                &mut self.without_verdict
            }
            Reason::Minimum => &mut self.minima,
            Reason::Sample => &mut self.sampled,
        };
        count.simulations += 1;
        count.violations += u64::from(episode.is_violated());
    }
}

impl Falsification<'_> {
    /// Runs all trials to their ends as [`run`](Self::run), but on another physics engine.
    ///
    /// `system` repeats each simulation that violates the requirement there, has no verdict there,
    /// or has a lower robustness there than all earlier ones of its trial, and each other one with
    /// the probability `sample_rate`. A search observes the result of the system where there is
    /// one, and otherwise that of the other engine. Only the system's simulations end a trial or
    /// become its minimum.
    ///
    /// `watch` gets the outcome so far now and then. If it breaks, the simulations of the present
    /// batch are lost.
    ///
    /// # Errors
    /// As [`run`](Self::run), if the other engine fails, and [`FalsificationError::ScreenedModes`]
    /// if the trials [keep going](Self::keep_going).
    pub fn run_screened(
        &mut self,
        screening: &mut dyn Screen,
        system: &mut dyn System,
        sample_rate: f64,
        watch: &mut (dyn FnMut(&FalsificationOutcome) -> ControlFlow<()> + Send),
    ) -> Result<(FalsificationOutcome, ScreenedCounts), FalsificationError> {
        if self.keep_going.is_some() {
            return Err(FalsificationError::ScreenedModes);
        }
        let watch = Mutex::new(watch);
        let call =
            |outcome: &FalsificationOutcome| watch.lock().is_ok_and(|mut watch| watch(outcome).is_continue());
        let mut counts = ScreenedCounts::default();
        // Minima of the trials on the other engine.
        let mut lowest = vec![f64::INFINITY; self.settings.trials as usize];
        let mut outcome = self.outcome();
        loop {
            let requests = self.next_batch(self.settings.batch.max(1))?;
            if requests.is_empty() || !call(&outcome) {
                break;
            }
            let outcomes = screening.run(&requests, &|_| call(&outcome))?;
            let Some(outcomes) = outcomes.into_iter().collect::<Option<Vec<ScreenedEpisode>>>() else {
                break;
            };
            let reasons = reasons(&requests, &outcomes, lowest.clone(), &self.settings, sample_rate);
            let repeated = repeat(system, &requests, &reasons)?;
            let simulations = merge(requests, &outcomes, reasons, repeated);
            for simulation in self.receive(simulations, &mut Vec::new())? {
                let lowest = &mut lowest[simulation.request().trial as usize - 1];
                *lowest = lowest.min(simulation.robustness);
                counts.add(&simulation);
            }
            outcome = self.outcome();
        }
        Ok((self.outcome(), counts))
    }
}

/// Returns why the system repeats each simulation; `None` if it does not. `lowest` contains the
/// minimum of each trial.
fn reasons(
    requests: &[Request],
    outcomes: &[ScreenedEpisode],
    mut lowest: Vec<f64>,
    settings: &FalsificationSettings,
    sample_rate: f64,
) -> Vec<Option<Reason>> {
    let reason = |(request, outcome): (&Request, &ScreenedEpisode)| {
        let lowest = &mut lowest[request.trial as usize - 1];
        // NaN is not a verdict.
        let Some(robustness) = outcome.robustness().filter(|rho| !rho.is_nan()) else {
            return Some(Reason::NoVerdict { has_overflowed: outcome.has_overflowed });
        };
        let is_minimum = robustness < *lowest;
        *lowest = lowest.min(robustness);
        // No simulation has this seed, and the sample does not depend on the batch.
        let own = settings.own_seed(request.trial, request.number);
        let is_sampled = || Sequence::new(own.child(u64::MAX).0, 0).uniform() < sample_rate;
        if is_violated(robustness) {
            Some(Reason::Violation)
        } else if is_minimum {
            Some(Reason::Minimum)
        } else {
            is_sampled().then_some(Reason::Sample)
        }
    };
    requests.iter().zip(outcomes).map(reason).collect()
}

/// Simulates the requests that have a reason, without their traces, which would fill the memory.
fn repeat(
    system: &mut dyn System,
    requests: &[Request],
    reasons: &[Option<Reason>],
) -> Result<Vec<Episode>, FalsificationError> {
    let chosen = requests.iter().zip(reasons).filter(|(_, reason)| reason.is_some());
    let chosen: Vec<Request> = chosen.map(|(request, _)| request.clone()).collect();
    let mut repeated = Vec::with_capacity(chosen.len());
    for requests in chosen.chunks(REPEATED_AT_ONCE) {
        let episodes = system.rollout(requests)?;
        let requested = requests.len();
        let returned = episodes.len();
        if requested != returned {
            return Err(FalsificationError::EpisodeCount { requested, returned });
        }
        repeated
            .extend(episodes.into_iter().map(|episode| Episode { trace: Trace::new([].into()), ..episode }));
    }
    Ok(repeated)
}

/// Returns the result of each request: that of the system if it repeated it.
fn merge(
    requests: Vec<Request>,
    outcomes: &[ScreenedEpisode],
    reasons: Vec<Option<Reason>>,
    repeated: Vec<Episode>,
) -> Vec<Screened> {
    let mut repeated = repeated.into_iter();
    let simulations = requests.into_iter().zip(outcomes).zip(reasons);
    simulations
        .map(|((request, screened), reason)| {
            let robustness = screened.robustness().unwrap_or(f64::INFINITY);
            let outcome = match reason.and_then(|reason| Some((reason, repeated.next()?))) {
                Some((reason, episode)) => Outcome::Repeated(reason, Box::new(episode)),
                None => Outcome::Screened(request, observation(screened.robustness(), &screened.verdict)),
            };
            Screened { outcome, robustness }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use mishandle_rollout::{EpisodeEnd, Seed, Verdict};

    use super::*;

    #[test]
    fn a_repetition_without_a_verdict_is_no_violation() {
        let repeated = |end, robustness| {
            let episode = Episode {
                request: Request::new([0.0], Seed(1)),
                end,
                steps: 3,
                verdict: Verdict { robustness, ..Verdict::default() },
                reason: String::new(),
                total_reward: 0.0,
                trace: Trace::new([].into()),
                trace_digest: None,
            };
            let reason = Reason::NoVerdict { has_overflowed: false };
            Screened { outcome: Outcome::Repeated(reason, Box::new(episode)), robustness: f64::INFINITY }
        };
        let mut counts = ScreenedCounts::default();
        counts.add(&repeated(EpisodeEnd::Diverged { step: 3 }, None));
        assert_eq!(counts.without_verdict, Confirmed { simulations: 1, violations: 0 });
        counts.add(&repeated(EpisodeEnd::Completed, Some(-1.0)));
        assert_eq!(counts.without_verdict, Confirmed { simulations: 2, violations: 1 });
    }
}
