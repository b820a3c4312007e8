//! Monte Carlo on another physics engine, corrected by simulations of the target's own system.

use mishandle_stl::is_violated;
use std::ops::ControlFlow;
use std::sync::Mutex;

use mishandle_evaluation::{EndCounts, Estimate, SCREENED_CHUNK, ScreenedProgress, TwoPhase, screen};
use mishandle_random::{Seed, Sequence};
use mishandle_rollout::{Request, Screen, ScreenedEpisode, System};

use crate::experiment::{Experiment, Outcome};
use crate::risk::SHOWN;
use crate::{CONFIDENCE, Draw, Failure, RiskError, Scenarios};

/// Settings of a screened estimation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ScreenedSettings {
    /// Number of simulations on the other engine.
    pub simulations: u64,
    /// Probability, from 0 to 1, with which a simulation that passes on the other engine is
    /// repeated by the system.
    pub sample_rate: f64,
    /// Random seed. The simulations are those of Monte Carlo with this seed.
    pub seed: Seed,
    /// Batch size of the system. Results do not depend on it.
    pub batch: usize,
}

/// Result of a screened estimation.
#[derive(Clone, Debug, PartialEq)]
pub struct ScreenedReport {
    /// Simulations on the other engine and those of the system. Flagged are those that the other
    /// engine reports as violated or gives no verdict. A simulation of the system without a verdict
    /// counts as passed.
    pub counts: TwoPhase,
    /// Number of simulations without a verdict on the other engine.
    pub screened_without_verdict: u64,
    /// Number of these in which the other engine had too little memory for contacts or constraints.
    pub overflows: u64,
    /// How the flagged and the sampled simulations of the system ended. Invalid starts leave the
    /// estimate. The other engine gives them no verdict either, so they are flagged.
    pub ends: [EndCounts; 2],
    /// Violations of the system, those nearest to the center of the distribution first.
    pub failures: Vec<Failure>,
    /// Whether all simulations are finished. Simulations of an interrupted chunk do not count.
    pub is_complete: bool,
}

impl ScreenedReport {
    /// Returns the failure rate of the system with its 95 % interval: see [`TwoPhase::estimate`].
    pub fn estimate(&self) -> Estimate {
        let [flagged, sampled] = self.ends.map(|ends| ends.invalid_starts);
        let counts = self.counts.without(flagged, sampled);
        if self.all_ends().total() < counts.flagged + counts.sampled {
            counts.estimate(CONFIDENCE)
        } else {
            Estimate { n: counts.trials, ..Estimate::default() }
        }
    }

    /// Returns an upper bound of the failure rate in which every simulation of the system without a
    /// verdict counts as a failure; `None` without any verdict.
    pub fn bound_with_undecided(&self) -> Option<f64> {
        let [flagged, sampled] = self.ends.map(|ends| ends.total());
        let counts = TwoPhase {
            flagged_events: self.counts.flagged_events + flagged,
            sampled_events: self.counts.sampled_events + sampled,
            ..self.counts
        };
        let report = ScreenedReport { counts, failures: Vec::new(), ..*self };
        report.estimate().high
    }

    /// Returns how all simulations of the system ended.
    pub fn all_ends(&self) -> EndCounts {
        let [mut all, sampled] = self.ends;
        all.add_all(sampled);
        all
    }

    /// Returns the number of simulations of the system.
    pub fn confirmed(&self) -> u64 {
        self.counts.flagged + self.counts.sampled
    }
}

/// Estimates the probability that a simulation of `system` violates the requirement. `screening`
/// simulates all draws; `system` repeats those that it reports as violated or gives no verdict, and
/// a random sample of the draws that are not flagged. Only repeated simulations are evidence; the
/// screened ones only decide what is repeated.
///
/// `watch` gets the progress now and then, and can interrupt the estimation.
///
/// # Errors
/// If a simulation cannot be run, or the other engine fails.
pub fn screened_risk(
    screening: &mut dyn Screen,
    system: &mut dyn System,
    scenarios: &Scenarios,
    settings: &ScreenedSettings,
    watch: &mut (dyn FnMut(ScreenedProgress) -> ControlFlow<()> + Send),
) -> Result<ScreenedReport, RiskError> {
    let ScreenedSettings { simulations, sample_rate, seed, batch } = *settings;
    let watch = Mutex::new(watch);
    let call = |progress: ScreenedProgress| watch.lock().is_ok_and(|mut watch| watch(progress).is_continue());
    let mut counts = TwoPhase::default();
    let mut screened_without_verdict = 0;
    let mut overflows = 0;
    let mut ends = [EndCounts::default(); 2];
    // The stream of the draws is that of Monte Carlo.
    let mut random = Sequence::new(seed.child(0).0, 0);
    let mut sample = Sequence::new(seed.child(0).0, 1);
    let mut confirmed = 0;
    let screened = std::cell::Cell::new(0);
    let mut on_confirmed = |done: u64| {
        if call(ScreenedProgress { screened: screened.get(), confirmed: done }) {
            ControlFlow::Continue(())
        } else {
            ControlFlow::Break(())
        }
    };
    let mut experiment = Experiment::new(system, scenarios, u64::MAX, batch, &mut on_confirmed);
    let mut is_complete = true;
    while counts.trials < simulations && is_complete {
        let count = SCREENED_CHUNK.min(simulations - counts.trials);
        let draws: Vec<Draw> = (0..count).map(|_| scenarios.draw(&mut random)).collect();
        let requests: Vec<Request> =
            draws.iter().map(|draw| Request::new(scenarios.scenario(&draw.latent), draw.seed)).collect();
        let base = counts.trials;
        let on_screened = |done| call(ScreenedProgress { screened: base + done as u64, confirmed });

        let selection = screen(
            screening,
            &requests,
            ScreenedEpisode::is_violated,
            sample_rate,
            &mut sample,
            &on_screened,
        )?;
        drop(requests);
        let Some(selection) = selection else {
            is_complete = false;
            break;
        };
        let chosen =
            |indices: &[usize]| indices.iter().map(|index| draws[*index].clone()).collect::<Vec<Draw>>();
        let flagged = chosen(&selection.flagged);
        let sampled = chosen(&selection.sampled);
        screened.set(base + count);
        // The number of violations, and the ends.
        let mut simulate = |draws: &[Draw]| -> Result<(u64, EndCounts), RiskError> {
            let outcomes = experiment.simulate(draws)?;
            is_complete &= outcomes.len() == draws.len();
            let is_failed = |outcome: &&Outcome| outcome.robustness.is_some_and(is_violated);
            let failed = outcomes.iter().filter(is_failed).count() as u64;
            let mut own = EndCounts::default();
            outcomes.iter().for_each(|outcome| outcome.count(&mut own));
            Ok((failed, own))
        };
        let (flagged_events, flagged_ends) = simulate(&flagged)?;
        let (sampled_events, sampled_ends) = simulate(&sampled)?;
        // A part of a chunk would be biased: its flagged trials are repeated first.
        if !is_complete {
            break;
        }
        counts.trials += count;
        counts.flagged += flagged.len() as u64;
        counts.flagged_events += flagged_events;
        counts.sampled += sampled.len() as u64;
        counts.sampled_events += sampled_events;
        screened_without_verdict += selection.without_verdict;
        overflows += selection.overflows;
        ends[0].add_all(flagged_ends);
        ends[1].add_all(sampled_ends);
        confirmed = counts.flagged + counts.sampled;
    }
    Ok(ScreenedReport {
        counts,
        screened_without_verdict,
        overflows,
        ends,
        failures: experiment.distinct_failures(SHOWN.0, SHOWN.1),
        is_complete,
    })
}
