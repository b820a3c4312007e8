//! Simulations that another physics engine screens: the target's own system repeats those that
//! count.

use std::ops::ControlFlow;
use std::sync::Mutex;

use mishandle_random::Sequence;
use mishandle_rollout::{Episode, Request, RolloutError, Screen, ScreenedEpisode, System};

use crate::run::simulate;
use crate::two_phase::OthersSample;
use crate::{
    EndCounts, Estimate, Evaluation, EvaluationError, FormulaRoles, TwoPhase, complement, count_end,
    decides_success,
};

/// Confidence of the intervals.
const CONFIDENCE: f64 = 0.95;

/// Number of simulations that are screened at once.
pub const SCREENED_CHUNK: u64 = 131_072;

/// Largest number of failures in a report.
const SHOWN: usize = 100;

/// Progress of a screened estimation.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ScreenedProgress {
    /// Number of simulations on the other engine.
    pub screened: u64,
    /// Number of simulations of the system.
    pub confirmed: u64,
}

/// The simulations that the system repeats after a screening.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Selection {
    /// Indices of the requests that are flagged. All of them are repeated.
    pub flagged: Vec<usize>,
    /// Indices of the random sample of the requests that are not flagged.
    pub sampled: Vec<usize>,
    /// Number of simulations without a verdict on the other engine. They are flagged.
    pub without_verdict: u64,
    /// Number of these in which the other engine had too little memory for contacts or constraints.
    pub overflows: u64,
}

/// Screens all requests and selects those to repeat: the ones without a verdict, those for which
/// `is_flagged` is true, and each other one with the probability `sample_rate`, by the draws of
/// `sample`, but at least 20 of the requests that are not flagged, or all of them.
///
/// `watch` gets the number of finished simulations now and then. If it returns `false`, the result
/// is `None`.
///
/// # Errors
/// If a scenario does not belong to the space, or the other engine fails.
pub fn screen(
    screening: &mut dyn Screen,
    requests: &[Request],
    is_flagged: impl Fn(&ScreenedEpisode) -> bool,
    sample_rate: f64,
    sample: &mut Sequence,
    watch: &(dyn Fn(usize) -> bool + Sync),
) -> Result<Option<Selection>, RolloutError> {
    let mut selection = Selection::default();
    let mut others = OthersSample::default();
    for (index, outcome) in screening.run(requests, watch)?.into_iter().enumerate() {
        // The sample does not depend on the outcomes.
        let is_sampled = sample.uniform() < sample_rate;
        let Some(outcome) = outcome else { return Ok(None) };
        let is_undecided = outcome.robustness().is_none();
        selection.without_verdict += u64::from(is_undecided);
        selection.overflows += u64::from(outcome.has_overflowed);
        if is_undecided || is_flagged(&outcome) {
            selection.flagged.push(index);
        } else {
            others.add(index, is_sampled);
        }
    }
    selection.sampled = others.finish();
    selection.sampled.sort_unstable();
    Ok(Some(selection))
}

/// A simulation of the system without success.
#[derive(Clone, Debug, PartialEq)]
pub struct EvaluationFailure {
    /// The simulation.
    pub request: Request,
    /// Robustness of the success formula; `None` without a verdict.
    pub robustness: Option<f64>,
}

/// Result of a screened evaluation. All rates are of the system.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ScreenedEvaluation {
    /// Simulations, and those without success. Invalid starts have no event.
    pub failures: TwoPhase,
    /// Simulations, and those without strict success; `None` without this formula.
    pub strict_failures: Option<TwoPhase>,
    /// Simulations, and those with a sample that violates the safe condition; `None` without this
    /// condition.
    pub dangerous: Option<TwoPhase>,
    /// Number of simulations without a verdict on the other engine.
    pub screened_without_verdict: u64,
    /// Number of these in which the other engine had too little memory for contacts or constraints.
    pub overflows: u64,
    /// Number of simulations of the system that violate the requirement.
    pub violations: u64,
    /// Number of simulations of the system without a verdict. They are not successes.
    pub without_verdict: u64,
    /// How the flagged and the sampled simulations of the system ended. Invalid starts are in no
    /// rate. The other engine gives them no verdict either, so they are flagged.
    pub ends: [EndCounts; 2],
    /// Simulations of the system without success, at most 100.
    pub first_failures: Vec<EvaluationFailure>,
    /// Whether all simulations are finished. Simulations of an interrupted chunk do not count.
    pub is_complete: bool,
}

impl ScreenedEvaluation {
    /// Returns the success rate: see [`TwoPhase::estimate`].
    pub fn success_rate(&self) -> Estimate {
        complement(self.estimate(self.failures))
    }

    /// Returns the rate of violations of the success formula. Simulations without a verdict count
    /// as failures in the upper bound only.
    pub fn violation_rate(&self) -> Estimate {
        let [flagged, sampled] = self.ends.map(|ends| ends.total());
        let violations = TwoPhase {
            flagged_events: self.failures.flagged_events - flagged,
            sampled_events: self.failures.sampled_events - sampled,
            ..self.failures
        };
        Estimate { high: self.estimate(self.failures).high, ..self.estimate(violations) }
    }

    /// Returns the strict success rate; `None` without this formula.
    pub fn strict_success_rate(&self) -> Option<Estimate> {
        Some(complement(self.estimate(self.strict_failures?)))
    }

    /// Returns the rate of simulations with a sample that violates the safe condition; `None`
    /// without this condition.
    pub fn dangerous_episode_rate(&self) -> Option<Estimate> {
        Some(self.estimate(self.dangerous?))
    }

    /// Returns the rate of an event among the valid scenarios; without a value if the system gave
    /// no verdict at all.
    fn estimate(&self, counts: TwoPhase) -> Estimate {
        let [flagged, sampled] = self.ends.map(|ends| ends.invalid_starts);
        let counts = counts.without(flagged, sampled);
        if self.without_verdict < self.confirmed() {
            counts.estimate(CONFIDENCE)
        } else {
            Estimate { n: counts.trials, ..Estimate::default() }
        }
    }

    /// Returns how all simulations of the system ended.
    pub fn all_ends(&self) -> EndCounts {
        let [mut all, sampled] = self.ends;
        all.add_all(sampled);
        all
    }

    /// Returns the number of simulations of the system.
    pub fn confirmed(&self) -> u64 {
        self.failures.flagged + self.failures.sampled
    }

    /// Adds the simulations of a chunk, of which the system repeated the flagged and the sampled
    /// ones.
    fn add(&mut self, trials: u64, selection: &Selection, flagged: Repeated, sampled: Repeated) {
        let counts = [Some(&mut self.failures), self.strict_failures.as_mut(), self.dangerous.as_mut()];
        for (index, counts) in counts.into_iter().enumerate() {
            let Some(counts) = counts else { continue };
            counts.trials += trials;
            counts.flagged += flagged.simulations;
            counts.flagged_events += flagged.events[index];
            counts.sampled += sampled.simulations;
            counts.sampled_events += sampled.events[index];
        }
        self.screened_without_verdict += selection.without_verdict;
        self.overflows += selection.overflows;
        self.violations += flagged.violations + sampled.violations;
        self.without_verdict += flagged.without_verdict + sampled.without_verdict;
        self.ends[0].add_all(flagged.ends);
        self.ends[1].add_all(sampled.ends);
        self.first_failures.extend(flagged.first_failures);
        self.first_failures.extend(sampled.first_failures);
        self.first_failures.truncate(SHOWN);
    }
}

/// Simulations of the system. Their traces would fill the memory.
#[derive(Default)]
struct Repeated {
    simulations: u64,
    /// Numbers of simulations without success, without strict success, and with any danger.
    events: [u64; 3],
    violations: u64,
    without_verdict: u64,
    ends: EndCounts,
    first_failures: Vec<EvaluationFailure>,
}

impl Repeated {
    fn add(&mut self, episode: &Episode) {
        self.simulations += 1;
        self.violations += u64::from(episode.is_violated());
        self.without_verdict += u64::from(episode.robustness().is_none());
        count_end(&mut self.ends, episode.end, decides_success(episode), 1);
        if !episode.end.counts_in_rates() {
            return;
        }
        let events = [!episode.is_success(), !episode.is_strict_success(), episode.verdict.is_dangerous()];
        for (count, event) in self.events.iter_mut().zip(events) {
            *count += u64::from(event);
        }
        if !episode.is_success() && self.first_failures.len() < SHOWN {
            self.first_failures.push(EvaluationFailure {
                request: episode.request.clone(),
                robustness: episode.verdict.success.filter(|_| episode.end.has_verdict()),
            });
        }
    }
}

/// Evaluates `system` on the simulations of `evaluation`. `screening` simulates all of them;
/// `system` repeats those that the other engine reports as unsuccessful or without a verdict, and
/// each other one with the probability `sample_rate`. Only repeated simulations are evidence.
///
/// The success rate decides, so its formula alone flags. The rates of strict success and of any
/// danger are unbiased, too, but the sample alone finds their events in successful simulations.
///
/// `watch` gets the progress now and then, and can interrupt the evaluation.
///
/// # Errors
/// As [`evaluate`](crate::evaluate), and if the other engine fails.
pub fn evaluate_screened(
    screening: &mut dyn Screen,
    system: &mut dyn System,
    evaluation: &Evaluation<'_>,
    roles: FormulaRoles,
    sample_rate: f64,
    watch: &mut (dyn FnMut(ScreenedProgress) -> ControlFlow<()> + Send),
) -> Result<ScreenedEvaluation, EvaluationError> {
    let watch = Mutex::new(watch);
    let call = |progress: ScreenedProgress| watch.lock().is_ok_and(|mut watch| watch(progress).is_continue());
    let mut report = ScreenedEvaluation {
        strict_failures: roles.strict.then(TwoPhase::default),
        dangerous: roles.safe.then(TwoPhase::default),
        ..ScreenedEvaluation::default()
    };
    // No simulation has this seed.
    let mut sample = Sequence::new(evaluation.seed.child(u64::MAX).0, 0);
    let is_flagged = |episode: &ScreenedEpisode| !episode.verdict.is_success();
    while report.failures.trials < evaluation.episodes {
        let base = report.failures.trials;
        let confirmed = report.confirmed();
        let count = SCREENED_CHUNK.min(evaluation.episodes - base);
        let requests = (base + 1..=base + count)
            .map(|number| evaluation.request(system.space(), number as u32))
            .collect::<Result<Vec<Request>, EvaluationError>>()?;
        let on_screened = |done| call(ScreenedProgress { screened: base + done as u64, confirmed });
        let Some(selection) =
            screen(screening, &requests, is_flagged, sample_rate, &mut sample, &on_screened)?
        else {
            return Ok(report);
        };
        let mut done = confirmed;
        let mut repeat = |indices: &[usize]| -> Result<Option<Repeated>, EvaluationError> {
            let mut repeated = Repeated::default();
            for indices in indices.chunks(evaluation.batch.max(1)) {
                let requests: Vec<Request> = indices.iter().map(|index| requests[*index].clone()).collect();
                simulate(system, &requests)?.iter().for_each(|episode| repeated.add(episode));
                done += indices.len() as u64;
                if !call(ScreenedProgress { screened: base + count, confirmed: done }) {
                    return Ok(None);
                }
            }
            Ok(Some(repeated))
        };
        let (Some(flagged), Some(sampled)) = (repeat(&selection.flagged)?, repeat(&selection.sampled)?)
        else {
            // A part of a chunk would be biased: its flagged simulations are repeated first.
            return Ok(report);
        };
        report.add(count, &selection, flagged, sampled);
    }
    report.is_complete = true;
    Ok(report)
}
