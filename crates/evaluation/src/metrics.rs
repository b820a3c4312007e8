//! MetricCounter of a controller from the verdicts of its episodes.

use mishandle_results::{Estimate, Metrics};
use mishandle_rollout::{Episode, EpisodeEnd, Seed, Specification};
use mishandle_stl::is_satisfied;

use crate::betting::anytime_mean;
use crate::{anytime_rate, betting_mean, bootstrap_mean, complement, wilson};

/// The optional formulas of a specification. Each of them defines a metric.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FormulaRoles {
    /// Strict success.
    pub strict: bool,
    /// Careful success.
    pub careful: bool,
    /// The safe condition.
    pub safe: bool,
    /// Completion.
    pub completion: bool,
}

impl FormulaRoles {
    /// Returns the optional formulas of `specification`.
    pub fn of(specification: &Specification) -> FormulaRoles {
        FormulaRoles {
            strict: specification.strict.is_some(),
            careful: specification.careful.is_some(),
            safe: specification.safe.is_some(),
            completion: specification.completion.is_some(),
        }
    }
}

/// Simulations that succeed, and those with a verdict on it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Count {
    successes: u64,
    verdicts: u64,
}

impl Count {
    fn add(&mut self, is_success: bool, has_verdict: bool) {
        self.successes += u64::from(is_success);
        self.verdicts += u64::from(has_verdict);
    }

    /// Returns the rate among `n` simulations.
    fn rate(self, n: u64, interval: fn(u64, u64) -> Estimate) -> Estimate {
        if self.verdicts == 0 { Estimate { n, ..Estimate::default() } } else { interval(self.successes, n) }
    }
}

/// Returns the rate of successes among `n` simulations, of which `verdicts` have a verdict, with
/// its Wilson interval. Without any verdict nothing was measured, so there is no value.
pub fn rate(successes: u64, verdicts: u64, n: u64) -> Estimate {
    Count { successes, verdicts }.rate(n, wilson)
}

/// Returns the rate of `failures` among `n` simulations that started, `undecided` of them without a
/// verdict, with its Wilson interval. The lower bound takes those as passed and the upper bound as
/// failed, so it holds whatever they would have done. Without any verdict there is no value.
///
/// # Example
/// ```
/// use mishandle_evaluation::{failure_rate, wilson};
/// let found = failure_rate(1, 50, 100);
/// assert_eq!((found.value, found.n), (Some(0.01), 100));
/// let all_undecided_fail = wilson(51, 100).high.unwrap();
/// assert!((found.high.unwrap() - all_undecided_fail).abs() < 1e-12);
/// ```
pub fn failure_rate(failures: u64, undecided: u64, n: u64) -> Estimate {
    failure_rate_with(failures, undecided, n, wilson)
}

/// Like [`failure_rate`], with another interval of the rate of successes.
fn failure_rate_with(failures: u64, undecided: u64, n: u64, interval: fn(u64, u64) -> Estimate) -> Estimate {
    if undecided == n {
        return Estimate { n, ..Estimate::default() };
    }
    let failing = |failures: u64| complement(interval(n - failures, n));
    // Not 1 minus the rate of successes, which is rounded.
    let value = Some(failures as f64 / n as f64);
    Estimate { value, high: failing(failures + undecided).high, ..failing(failures) }
}

/// Returns whether an episode has a verdict on success.
pub fn decides_success(episode: &Episode) -> bool {
    episode.end.has_verdict() && episode.verdict.success.is_some()
}

/// Returns whether an episode has a verdict on strict success, which includes success.
pub fn decides_strict_success(episode: &Episode) -> bool {
    decides_both(episode, episode.verdict.strict)
}

/// Returns whether an episode has a verdict on careful success, which includes success.
pub fn decides_careful_success(episode: &Episode) -> bool {
    decides_both(episode, episode.verdict.careful)
}

/// A violated formula decides without the other one.
fn decides_both(episode: &Episode, other: Option<f64>) -> bool {
    let both = [episode.verdict.success, other];
    let is_violated = both.iter().flatten().any(|rho| !is_satisfied(*rho));
    episode.end.has_verdict() && (is_violated || both.iter().all(Option::is_some))
}

/// Accumulates the metrics of simulations, with at most 16 bytes per simulation.
///
/// # Example
/// ```
/// use mishandle_evaluation::{MetricCounter, FormulaRoles};
/// use mishandle_rollout::Seed;
/// let report = MetricCounter::new(FormulaRoles { strict: true, ..FormulaRoles::default() }).report(Seed(0));
/// assert_eq!((report.simulations, report.success_rate.value), (0, None));
/// assert!(report.strict_success_rate.is_some() && report.task_completion_time.is_none());
/// ```
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MetricCounter {
    simulations: u64,
    diverged: u64,
    invalid: u64,
    failed: u64,
    invalid_scenarios: u64,
    undecided: u64,
    strict_undecided: u64,
    careful_undecided: u64,
    violations: u64,
    /// Number of simulations with a robustness of the requirement.
    evaluated: u64,
    success: Count,
    strict: Count,
    careful: Count,
    dangerous_fractions: Vec<f64>,
    completion_steps: Vec<f64>,
    roles: FormulaRoles,
    counts_failures: bool,
    is_any_time: bool,
}

impl MetricCounter {
    /// Makes empty metrics.
    pub fn new(roles: FormulaRoles) -> MetricCounter {
        MetricCounter { roles, ..MetricCounter::default() }
    }

    /// Includes completion times of failed simulations if `counts_failures` is `true`, like the
    /// code of the original benchmark.
    pub fn with_completion_times_of_failures(self, counts_failures: bool) -> MetricCounter {
        MetricCounter { counts_failures, ..self }
    }

    /// Chooses intervals that hold at any time if `is_any_time` is `true`, because the results
    /// decide how many simulations there are. The completion time has none then.
    pub fn with_intervals_at_any_time(self, is_any_time: bool) -> MetricCounter {
        MetricCounter { is_any_time, ..self }
    }

    /// Returns the number of simulations.
    pub fn simulations(&self) -> u64 {
        self.simulations
    }

    /// Returns the number of simulations whose scenario is valid: those that the success rate
    /// counts.
    pub fn started(&self) -> u64 {
        self.simulations - self.invalid_scenarios
    }

    /// Returns the number of successes.
    pub fn successes(&self) -> u64 {
        self.success.successes
    }

    /// Returns the number of simulations with a verdict on success.
    pub fn verdicts(&self) -> u64 {
        self.success.verdicts
    }

    /// Returns the fraction of dangerous steps of each simulation that has one.
    pub fn dangerous_fractions(&self) -> &[f64] {
        &self.dangerous_fractions
    }

    /// Returns the completion step of each simulation that the completion time counts.
    pub fn completion_steps(&self) -> &[f64] {
        &self.completion_steps
    }

    /// Adds a simulation. It may come from a record.
    pub fn add(&mut self, episode: &Episode) {
        let verdict = &episode.verdict;
        self.simulations += 1;
        self.violations += u64::from(episode.is_violated());
        self.evaluated += u64::from(episode.robustness().is_some());
        if matches!(episode.end, EpisodeEnd::Diverged { .. }) {
            self.diverged += 1;
            return;
        }
        if episode.end.is_invalid() {
            self.invalid += 1;
            return;
        }
        if episode.end.is_failed() {
            self.failed += 1;
            self.invalid_scenarios += u64::from(!episode.end.counts_in_rates());
            return;
        }
        if matches!(episode.end, EpisodeEnd::Undefined { .. }) {
            self.undecided += 1;
            self.strict_undecided += 1;
            self.careful_undecided += 1;
            return;
        }
        self.undecided += u64::from(verdict.success.is_none());
        self.strict_undecided += u64::from(verdict.strict.is_none());
        self.careful_undecided += u64::from(verdict.careful.is_none());
        self.success.add(episode.is_success(), decides_success(episode));
        self.strict.add(episode.is_strict_success(), decides_strict_success(episode));
        self.careful.add(episode.is_careful_success(), decides_careful_success(episode));
        if let (Some(dangerous), true) = (verdict.dangerous_steps, episode.steps > 0) {
            self.dangerous_fractions.push(dangerous as f64 / episode.steps as f64);
        }
        if let (true, Some(step)) = (self.counts_failures || episode.is_success(), verdict.completion_step) {
            self.completion_steps.push(step as f64);
        }
    }

    /// Returns the metrics of all simulations. `seed` is the seed of the evaluation; the bootstrap
    /// draws depend on it.
    pub fn report(&self, seed: Seed) -> Metrics {
        let started = self.started();
        let interval = if self.is_any_time { anytime_rate } else { wilson };
        let fractions = if self.is_any_time { anytime_mean } else { betting_mean };
        let time = || match (self.is_any_time, bootstrap_mean(&self.completion_steps, seed)) {
            (true, time) => Estimate { low: None, high: None, ..time },
            (false, time) => time,
        };
        Metrics {
            simulations: self.simulations,
            diverged: self.diverged,
            invalid: self.invalid,
            failed: self.failed,
            invalid_starts: self.invalid_scenarios,
            undecided: self.undecided,
            strict_undecided: self.strict_undecided,
            careful_undecided: self.roles.careful.then_some(self.careful_undecided),
            violations: self.violations,
            requirement_undecided: started - self.evaluated,
            violation_rate: failure_rate_with(self.violations, started - self.evaluated, started, interval),
            success_rate: self.success.rate(started, interval),
            strict_success_rate: self.roles.strict.then(|| self.strict.rate(started, interval)),
            careful_success_rate: self.roles.careful.then(|| self.careful.rate(started, interval)),
            dangerous_behavior_rate: self.roles.safe.then(|| fractions(&self.dangerous_fractions)),
            dangerous_episode_rate: self.roles.safe.then(|| self.dangerous_episode_rate(interval)),
            task_completion_time: self.roles.completion.then(time),
        }
    }

    fn dangerous_episode_rate(&self, interval: fn(u64, u64) -> Estimate) -> Estimate {
        let dangerous = self.dangerous_fractions.iter().filter(|fraction| **fraction > 0.0).count();
        interval(dangerous as u64, self.dangerous_fractions.len() as u64)
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use mishandle_rollout::{Request, Verdict};
    use mishandle_stl::Trace;

    use super::*;

    const ALL: FormulaRoles = FormulaRoles { strict: true, careful: true, safe: true, completion: true };

    /// Makes a simulation of four control steps.
    fn episode(
        success: Option<f64>,
        strict: Option<f64>,
        dangerous: usize,
        completion: Option<usize>,
    ) -> Episode {
        let mut trace = Trace::new(Arc::from(["d".to_string()]));
        (0..5).for_each(|_| trace.push(&[0.0]));
        Episode {
            request: Request::new([0.5], Seed(0)),
            trace,
            trace_digest: None,
            steps: 4,
            verdict: Verdict {
                robustness: success,
                success,
                strict,
                careful: strict,
                dangerous_steps: Some(dangerous),
                completion_step: completion,
                ..Verdict::default()
            },
            reason: String::new(),
            total_reward: 0.0,
            end: EpisodeEnd::Completed,
        }
    }

    fn diverged() -> Episode {
        Episode { end: EpisodeEnd::Diverged { step: 3 }, ..episode(None, None, 0, None) }
    }

    fn report(episodes: &[Episode]) -> Metrics {
        let mut metrics = MetricCounter::new(ALL);
        episodes.iter().for_each(|episode| metrics.add(episode));
        metrics.report(Seed(0))
    }

    #[test]
    fn metrics_match_a_hand_calculation() {
        let report = report(&[
            episode(Some(0.2), Some(0.1), 0, Some(1)), // strict success after 1 step
            episode(Some(0.1), Some(-0.3), 1, Some(4)), // success after 4 steps, 1 of 4 samples dangerous
            episode(Some(0.1), Some(-0.3), 0, None),   // success without a completion time
            episode(Some(-0.5), Some(-0.9), 4, Some(2)), // failure: its completion step does not count
        ]);
        assert_eq!((report.simulations, report.diverged, report.undecided), (4, 0, 0));
        assert_eq!((report.success_rate.value, report.success_rate.n), (Some(0.75), 4));
        assert_eq!(
            (report.strict_success_rate.unwrap().value, report.strict_success_rate.unwrap().n),
            (Some(0.25), 4)
        );
        // (0 + 1/4 + 0 + 4/4) / 4
        assert_eq!(
            (report.dangerous_behavior_rate.unwrap().value, report.dangerous_behavior_rate.unwrap().n),
            (Some(0.3125), 4)
        );
        assert_eq!(report.dangerous_episode_rate, Some(wilson(2, 4)));
        // (1 + 4) / 2
        assert_eq!(
            (report.task_completion_time.unwrap().value, report.task_completion_time.unwrap().n),
            (Some(2.5), 2)
        );
    }

    #[test]
    fn a_strict_or_careful_success_without_success_does_not_count() {
        let report = report(&[
            episode(Some(-0.1), Some(0.2), 0, None),
            episode(None, Some(0.2), 0, None),
            episode(Some(0.1), Some(0.2), 0, None),
        ]);
        assert_eq!(report.success_rate, wilson(1, 3));
        assert_eq!(report.strict_success_rate, Some(wilson(1, 3)));
        assert_eq!(report.careful_success_rate, Some(wilson(1, 3)));
    }

    #[test]
    fn the_sign_of_a_zero_decides_success() {
        let rate = |rho: f64| report(&[episode(Some(rho), Some(rho), 0, Some(0))]).success_rate.value;
        assert_eq!((rate(0.0), rate(-0.0)), (Some(1.0), Some(0.0)));
    }

    #[test]
    fn a_diverged_simulation_is_a_failure_without_a_dangerous_fraction() {
        let report = report(&[episode(Some(1.0), Some(1.0), 2, Some(2)), diverged()]);
        assert_eq!((report.simulations, report.diverged, report.undecided), (2, 1, 0));
        assert_eq!((report.success_rate.value, report.success_rate.n), (Some(0.5), 2));
        assert_eq!(
            (report.dangerous_behavior_rate.unwrap().value, report.dangerous_behavior_rate.unwrap().n),
            (Some(0.5), 1)
        );
        assert_eq!(report.task_completion_time.unwrap().n, 1);
    }

    #[test]
    fn an_invalid_simulation_is_a_failure_without_a_dangerous_fraction() {
        let end = EpisodeEnd::InvalidAction { step: 3, index: 0 };
        let invalid = Episode { end, ..episode(None, None, 0, None) };
        let report = report(&[episode(Some(1.0), Some(1.0), 2, Some(2)), invalid]);
        assert_eq!((report.simulations, report.invalid, report.diverged, report.undecided), (2, 1, 0, 0));
        assert_eq!(report.strict_undecided, 0);
        assert_eq!((report.success_rate.value, report.dangerous_behavior_rate.unwrap().n), (Some(0.5), 1));
    }

    #[test]
    fn a_crash_is_a_failure_and_an_invalid_scenario_counts_in_no_rate() {
        let ended = |end| Episode { end, ..episode(None, None, 0, None) };
        let crashed = ended(EpisodeEnd::Crashed { step: 1 });
        let rejected = ended(EpisodeEnd::InvalidScenario);
        let report = report(&[episode(Some(1.0), Some(1.0), 2, Some(2)), crashed, rejected]);
        assert_eq!((report.simulations, report.failed), (3, 2));
        for rate in [report.success_rate, report.strict_success_rate.unwrap()] {
            assert_eq!((rate.value, rate.n), (Some(0.5), 2));
        }
    }

    /// Whatever the simulations without a verdict would have done, the interval has the one that
    /// then is known.
    #[test]
    fn the_interval_of_violations_holds_whatever_those_without_a_verdict_would_have_done() {
        for end in crate::ends::WITHOUT_VERDICT {
            let ended = |count: usize| vec![Episode { end, ..episode(None, None, 0, None) }; count];
            let decided = |count: usize, rho: f64| vec![episode(Some(rho), Some(rho), 0, None); count];
            for (violated, satisfied, unknown) in [(1, 49, 50), (0, 5, 5), (10, 0, 30), (3, 7, 1)] {
                let known = [decided(violated, -1.0), decided(satisfied, 1.0)].concat();
                let found = report(&[known.clone(), ended(unknown)].concat()).violation_rate;
                let starts = end != EpisodeEnd::InvalidScenario;
                let unknown = if starts { unknown } else { 0 };
                assert_eq!(found.n, (violated + satisfied + unknown) as u64, "{end:?}");
                for failing in 0..=unknown {
                    let would = [decided(failing, -1.0), decided(unknown - failing, 1.0)].concat();
                    let then = report(&[known.clone(), would].concat()).violation_rate;
                    assert!(found.low <= then.low && then.high <= found.high, "{end:?}: {found:?} {then:?}");
                }
            }
        }
    }

    #[test]
    fn without_any_verdict_no_success_rate_has_a_value() {
        let unknown = |n| Estimate { n, ..Estimate::default() };
        for end in crate::ends::WITHOUT_VERDICT {
            let found = report(&vec![Episode { end, ..episode(None, None, 0, None) }; 3]);
            let n = if end == EpisodeEnd::InvalidScenario { 0 } else { 3 };
            assert_eq!(found.success_rate, unknown(n), "{end:?}");
            assert_eq!(found.strict_success_rate, Some(unknown(n)), "{end:?}");
            assert_eq!(found.careful_success_rate, Some(unknown(n)), "{end:?}");
        }
        // A violated success decides the others, which include it.
        let found = report(&[episode(Some(-1.0), None, 0, None)]);
        assert_eq!(found.strict_success_rate, Some(wilson(0, 1)));
        let found = report(&[episode(Some(1.0), None, 0, None)]);
        assert_eq!((found.success_rate, found.strict_success_rate), (wilson(1, 1), Some(unknown(1))));
    }

    #[test]
    fn an_undecided_simulation_is_a_failure_with_a_dangerous_fraction() {
        let report = report(&[episode(None, Some(1.0), 4, Some(0)), episode(Some(1.0), None, 0, Some(0))]);
        assert_eq!((report.undecided, report.strict_undecided), (1, 1));
        assert_eq!(report.success_rate.value, Some(0.5));
        assert_eq!(report.strict_success_rate.unwrap().value, None, "neither has a strict verdict");
        assert_eq!(report.dangerous_behavior_rate.unwrap().value, Some(0.5));
        assert_eq!(report.task_completion_time.unwrap().n, 1);
    }

    #[test]
    fn a_simulation_with_an_undefined_formula_is_undecided_without_a_dangerous_fraction() {
        let undefined = Episode { end: EpisodeEnd::Undefined { step: 3 }, ..episode(None, None, 0, None) };
        let report = report(&[episode(Some(1.0), Some(1.0), 2, Some(2)), undefined]);
        assert_eq!((report.diverged, report.undecided, report.strict_undecided), (0, 1, 1));
        assert_eq!((report.success_rate.value, report.dangerous_behavior_rate.unwrap().n), (Some(0.5), 1));
    }

    #[test]
    fn completion_times_of_failures_count_only_if_requested() {
        let mut metrics = MetricCounter::new(ALL).with_completion_times_of_failures(true);
        metrics.add(&episode(Some(-0.5), Some(-0.9), 0, Some(2)));
        metrics.add(&episode(Some(0.5), Some(0.9), 0, Some(4)));
        let time = metrics.report(Seed(0)).task_completion_time.unwrap();
        assert_eq!((time.value, time.n), (Some(3.0), 2));
    }

    #[test]
    fn a_metric_without_its_formula_is_none() {
        let mut metrics = MetricCounter::new(FormulaRoles::default());
        metrics.add(&episode(Some(1.0), Some(1.0), 0, Some(1)));
        let report = metrics.report(Seed(0));
        assert_eq!(report.success_rate.value, Some(1.0));
        assert_eq!(report.strict_success_rate, None);
        assert_eq!((report.careful_success_rate, report.careful_undecided), (None, None));
        assert_eq!((report.dangerous_behavior_rate, report.dangerous_episode_rate), (None, None));
        assert_eq!(report.task_completion_time, None);
    }

    #[test]
    fn without_a_success_the_completion_time_is_empty() {
        let report = report(&[episode(Some(-1.0), Some(-1.0), 0, Some(1))]);
        assert_eq!(report.task_completion_time, Some(Estimate::default()));
    }
}
