//! Rate of an event whose cheap indicator is known for every trial, and which is observed for some
//! of them.

use crate::{EndCounts, Estimate, clopper_pearson};

/// Share of the probability of a miss for each of the three intervals that [`TwoPhase::estimate`]
/// combines.
const SHARES: [f64; 3] = [0.5, 0.4, 0.1];

/// Size of a sample of the trials that are not flagged that is reached even if chance selects
/// fewer: without any there is no estimate.
const FEWEST_SAMPLED: usize = 20;

/// Random sample of the trials that are not flagged. The first ones that chance leaves out make up
/// for a sample of fewer than 20. As these trials are alike, the share of events in the sample
/// stays unbiased.
#[derive(Default)]
pub(crate) struct OthersSample<T> {
    sampled: Vec<T>,
    spare: Vec<T>,
}

impl<T> OthersSample<T> {
    /// Adds a trial that is not flagged. `is_sampled` must not depend on its outcome.
    pub(crate) fn add(&mut self, trial: T, is_sampled: bool) {
        if is_sampled {
            self.sampled.push(trial);
        } else if self.spare.len() < FEWEST_SAMPLED {
            self.spare.push(trial);
        }
    }

    /// Returns the trials of the sample.
    pub(crate) fn finish(self) -> Vec<T> {
        let OthersSample { mut sampled, spare } = self;
        let missing = FEWEST_SAMPLED.saturating_sub(sampled.len());
        sampled.extend(spare.into_iter().take(missing));
        sampled
    }
}

/// Counts of a two-phase sample. The first phase applies a cheap indicator to independent trials.
/// The second phase observes the event itself in every trial that the indicator flags, and in a
/// random sample of the trials that are not flagged.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct TwoPhase {
    /// Number of trials of the first phase.
    pub trials: u64,
    /// Number of trials that the indicator flags.
    pub flagged: u64,
    /// Number of flagged trials with the event.
    pub flagged_events: u64,
    /// Number of trials in the sample of those that are not flagged.
    pub sampled: u64,
    /// Number of sampled trials with the event: the indicator missed them.
    pub sampled_events: u64,
}

impl TwoPhase {
    /// Returns the counts without some flagged and sampled trials, which are not of the population
    /// that the rate is about.
    pub fn without(&self, flagged: u64, sampled: u64) -> TwoPhase {
        TwoPhase {
            trials: self.trials - flagged - sampled,
            flagged: self.flagged - flagged,
            sampled: self.sampled - sampled,
            ..*self
        }
    }

    /// Returns the estimated fraction of the started simulations without a verdict, from the ends
    /// of the flagged and of the sampled ones; `None` without an estimate.
    pub fn share_without_verdict(&self, [flagged, sampled]: [EndCounts; 2]) -> Option<f64> {
        let events = TwoPhase { flagged_events: flagged.total(), sampled_events: sampled.total(), ..*self };
        events.without(flagged.invalid_starts, sampled.invalid_starts).estimate(0.95).value
    }

    /// Returns the rate of the event with an interval that contains the true rate with a
    /// probability of at least `confidence`.
    ///
    /// The estimate, flagged events / n + (1 - flagged / n) * sampled events / sampled, is unbiased
    /// whatever the indicator is worth. A useless indicator makes the interval wide, not wrong. The
    /// interval adds exact intervals of the rate of flagged events and of the event among the
    /// trials that are not flagged, each with a share of the probability of a miss. It does not
    /// assume that any count is large. Without events in the sample, that of the trials that are
    /// not flagged adds about 4.6 / sampled to the upper bound. If the sample contains all of
    /// these, it is the exact interval of all trials.
    ///
    /// The estimate is `None` if there are other trials and no sample of them.
    ///
    /// # Example
    /// ```
    /// use mishandle_evaluation::TwoPhase;
    /// // 1,000 of 100,000 trials are flagged, 900 of them rightly. The indicator missed 2 events of 10,000 sampled trials.
    /// let counts =
    ///     TwoPhase { trials: 100_000, flagged: 1_000, flagged_events: 900, sampled: 10_000, sampled_events: 2 };
    /// let rate = counts.estimate(0.95);
    /// assert!((rate.value.unwrap() - (0.009 + 0.99 * 0.0002)).abs() < 1e-12);
    /// assert!(rate.low.unwrap() > 0.008 && rate.high.unwrap() < 0.011);
    /// ```
    ///
    /// # Reference
    /// Neyman, "Contribution to the Theory of Sampling Human Populations", Journal of the American
    /// Statistical Association 33, 1938 (double sampling).
    pub fn estimate(&self, confidence: f64) -> Estimate {
        let TwoPhase { trials, flagged, flagged_events, sampled, sampled_events } = *self;
        let others = trials - flagged;
        let unknown = Estimate { value: None, low: None, high: None, n: trials };
        if trials == 0 || (others > 0 && sampled == 0) {
            return unknown;
        }
        let n = trials as f64;
        let share = if sampled == 0 { 0.0 } else { sampled_events as f64 / sampled as f64 };
        let value = flagged_events as f64 / n + others as f64 / n * share;
        if sampled == others {
            return clopper_pearson(flagged_events + sampled_events, trials, confidence);
        }
        let miss = 1.0 - confidence;
        let [first, second, third] = [
            clopper_pearson(flagged_events, trials, 1.0 - SHARES[0] * miss),
            clopper_pearson(sampled_events, sampled, 1.0 - SHARES[1] * miss),
            clopper_pearson(others, trials, 1.0 - SHARES[2] * miss),
        ];
        let sum = |bound: fn(&Estimate) -> Option<f64>| {
            Some(bound(&first)? + bound(&second)? * bound(&third)?).map(|rate| rate.clamp(0.0, 1.0))
        };
        Estimate { value: Some(value), low: sum(|e| e.low), high: sum(|e| e.high), n: trials }
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use mishandle_random::Sequence;

    use super::*;

    /// A fifth of the scenarios cannot start, and a tenth of the others has no verdict, of which
    /// the indicator flags 70 %.
    #[test]
    fn the_share_without_a_verdict_stands_for_the_simulations_that_are_not_repeated() {
        let mut random = Sequence::new(3, 0);
        let mut sum = 0.0;
        for _ in 0..200 {
            let mut counts = TwoPhase { trials: 3000, ..TwoPhase::default() };
            let mut ends = [EndCounts::default(); 2];
            let mut others = OthersSample::default();
            let add = |ends: &mut EndCounts, [starts, decides]: [bool; 2]| {
                ends.invalid_starts += u64::from(!starts);
                ends.simulations += u64::from(starts);
                ends.undecided += u64::from(starts && !decides);
            };
            for _ in 0..counts.trials {
                let [starts, decides] = [0.8, 0.9].map(|rate| random.uniform() < rate);
                let is_flagged = random.uniform() < if !starts || decides { 0.05 } else { 0.7 };
                let is_sampled = random.uniform() < 0.1;
                if is_flagged || !starts {
                    counts.flagged += 1;
                    add(&mut ends[0], [starts, decides]);
                } else {
                    others.add([starts, decides], is_sampled);
                }
            }
            for trial in others.finish() {
                counts.sampled += 1;
                add(&mut ends[1], trial);
            }
            sum += counts.share_without_verdict(ends).unwrap();
        }
        // The standard deviation of the mean is 0.0008.
        assert!((sum / 200.0 - 0.1).abs() < 0.003, "{}", sum / 200.0);
        assert_eq!(TwoPhase::default().share_without_verdict([EndCounts::default(); 2]), None);
    }

    /// Draws counts: an event has probability `rate`. The indicator flags an event with probability
    /// `power`, and another trial with probability `false_rate`.
    fn draw(random: &mut Sequence, trials: u64, [rate, power, false_rate, sample]: [f64; 4]) -> TwoPhase {
        let mut counts = TwoPhase { trials, ..TwoPhase::default() };
        let mut others = OthersSample::default();
        for _ in 0..trials {
            let is_event = random.uniform() < rate;
            let is_flagged = random.uniform() < if is_event { power } else { false_rate };
            let is_sampled = random.uniform() < sample;
            let event = u64::from(is_event);
            if is_flagged {
                counts.flagged += 1;
                counts.flagged_events += event;
            } else {
                others.add(event, is_sampled);
            }
        }
        let sample = others.finish();
        TwoPhase { sampled: sample.len() as u64, sampled_events: sample.iter().sum(), ..counts }
    }

    #[test]
    fn a_sample_of_all_others_gives_the_exact_interval_of_all_trials() {
        let counts = TwoPhase { trials: 100, flagged: 12, flagged_events: 9, sampled: 88, sampled_events: 2 };
        assert_eq!(counts.estimate(0.95), clopper_pearson(11, 100, 0.95));
    }

    #[test]
    fn the_estimate_is_unbiased_and_its_interval_covers_for_good_and_useless_indicators() {
        let mut random = Sequence::new(5, 0);
        for (case, rate) in [
            ([0.02, 0.95, 0.001, 0.1], 0.02),
            ([0.02, 0.3, 0.05, 0.1], 0.02),
            ([0.3, 0.0, 0.0, 0.2], 0.3),
            ([0.001, 1.0, 0.0, 0.05], 0.001),
            ([0.5, 0.99, 0.02, 0.05], 0.5),
            // About 20 others, of which all or almost all are repeated.
            ([0.98, 1.0, 0.0, 0.01], 0.98),
            ([0.5, 0.99, 0.97, 0.01], 0.5),
            // Fewer than 20 in the sample.
            ([0.1, 0.5, 0.1, 0.001], 0.1),
        ] {
            let replications = 1000;
            let mut covered = 0;
            let mut sum = 0.0;
            for _ in 0..replications {
                let estimate = draw(&mut random, 1000, case).estimate(0.95);
                sum += estimate.value.unwrap();
                covered += u32::from(estimate.low.unwrap() <= rate && rate <= estimate.high.unwrap());
            }
            let mean = sum / f64::from(replications);
            // Three standard errors of the mean, with the variance of the sampled part.
            let deviation = (rate / 1000.0 + rate * (1.0 - case[1]) / (1000.0 * case[3])).sqrt();
            assert!(
                (mean - rate).abs() < 3.0 * deviation / f64::from(replications).sqrt(),
                "{case:?}: {mean}"
            );
            assert!(covered >= 950, "{case:?}: {covered} of {replications}");
        }
    }

    #[test]
    fn without_a_sample_of_the_others_there_is_no_estimate() {
        let counts = TwoPhase { trials: 10, flagged: 4, flagged_events: 3, ..TwoPhase::default() };
        assert_eq!(counts.estimate(0.95).value, None);
        let all = TwoPhase { trials: 4, ..counts };
        assert_eq!(all.estimate(0.95), clopper_pearson(3, 4, 0.95));
    }
}
