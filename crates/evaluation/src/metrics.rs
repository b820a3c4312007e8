//! From verdicts to the metrics of a controller in a task.

use mishandle_rollout::{Episode, EpisodeEnd, Seed, Specification};

use crate::{Estimate, bootstrap_mean, bootstrap_share, wilson};

/// How well and how safely a controller does its task, over all simulations of an evaluation.
///
/// A diverged simulation has not succeeded, so it counts among the `n` of both success rates and not among their
/// successes; the same holds for one that left the formula undecided. Leaving them out would reward a controller for
/// breaking the physics. Neither counts as falsified. What they would have shown cannot be averaged: a diverged
/// simulation is in neither of the other two metrics, and `diverged` and `undecided` say how many there are.
#[derive(Clone, Debug, PartialEq)]
pub struct Report {
    /// Simulations in all.
    pub simulations: u64,
    /// Those whose numbers stopped being finite.
    pub diverged: u64,
    /// Those that did not diverge and yet left success undecided.
    pub undecided: u64,
    /// Those that did not diverge and yet left strict success undecided.
    pub strict_undecided: u64,
    /// SR: share of all simulations whose robustness of success is above 0, with its Wilson interval.
    pub success_rate: Estimate,
    /// The same for strict success; `None` without such a formula.
    pub strict_success_rate: Option<Estimate>,
    /// DBR: mean over the simulations that did not diverge of the share of samples, the first one left out, at which
    /// the safe condition is violated. Bootstrap interval; `None` without such a condition.
    pub dangerous_behavior_rate: Option<Estimate>,
    /// TCT: mean number of control steps until completion first holds, its whole window inside the episode, over the
    /// successful simulations in which it does. Bootstrap interval; `None` without such a formula.
    pub task_completion_time: Option<Estimate>,
}

/// Which formulas there are beside the one for success: without one there is no such metric.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Roles {
    /// Strict success.
    pub strict: bool,
    /// The safe condition.
    pub safe: bool,
    /// Completion.
    pub completion: bool,
}

impl Roles {
    /// The roles that `specification` fills.
    pub fn of(specification: &Specification) -> Roles {
        Roles {
            strict: specification.strict.is_some(),
            safe: specification.safe.is_some(),
            completion: specification.completion.is_some(),
        }
    }
}

/// Adds up simulations one by one; 16 bytes a simulation at most.
///
/// # Example
/// ```
/// use mishandle_evaluation::{Metrics, Roles};
/// use mishandle_rollout::Seed;
/// let report = Metrics::new(Roles { strict: true, ..Roles::default() }).report(Seed(0));
/// assert_eq!((report.simulations, report.success_rate.value), (0, None));
/// assert!(report.strict_success_rate.is_some() && report.task_completion_time.is_none());
/// ```
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Metrics {
    simulations: u64,
    diverged: u64,
    undecided: u64,
    strict_undecided: u64,
    successes: u64,
    strict_successes: u64,
    dangerous_shares: Vec<f64>,
    completion_steps: Vec<f64>,
    roles: Roles,
    failures_complete: bool,
}

impl Metrics {
    /// Metrics of no simulation.
    pub fn new(roles: Roles) -> Metrics {
        Metrics { roles, ..Metrics::default() }
    }

    /// The same, but the completion time of a failed simulation counts, too, as in the original benchmark's code.
    pub fn with_failures_completing(self, failures_complete: bool) -> Metrics {
        Metrics { failures_complete, ..self }
    }

    /// How many simulations were added.
    pub fn simulations(&self) -> u64 {
        self.simulations
    }

    /// Adds a simulation, which may come from a record.
    pub fn add(&mut self, episode: &Episode) {
        let verdict = &episode.verdict;
        self.simulations += 1;
        if matches!(episode.end, EpisodeEnd::Diverged { .. }) {
            self.diverged += 1;
            return;
        }
        if matches!(episode.end, EpisodeEnd::Undefined { .. }) {
            self.undecided += 1;
            self.strict_undecided += 1;
            return;
        }
        let holds = |robustness: Option<f64>| robustness.is_some_and(|rho| rho > 0.0);
        self.undecided += u64::from(verdict.success.is_none());
        self.strict_undecided += u64::from(verdict.strict.is_none());
        self.successes += u64::from(holds(verdict.success));
        self.strict_successes += u64::from(holds(verdict.strict));
        if let (Some(dangerous), true) = (verdict.dangerous_steps, episode.steps > 0) {
            self.dangerous_shares.push(dangerous as f64 / episode.steps as f64);
        }
        if let (true, Some(step)) =
            (self.failures_complete || holds(verdict.success), verdict.completion_step)
        {
            self.completion_steps.push(step as f64);
        }
    }

    /// What they amount to; `seed` is that of the evaluation and decides the draws of the bootstrap.
    pub fn report(&self, seed: Seed) -> Report {
        Report {
            simulations: self.simulations,
            diverged: self.diverged,
            undecided: self.undecided,
            strict_undecided: self.strict_undecided,
            success_rate: wilson(self.successes, self.simulations),
            strict_success_rate: self.roles.strict.then(|| wilson(self.strict_successes, self.simulations)),
            dangerous_behavior_rate: self.roles.safe.then(|| bootstrap_share(&self.dangerous_shares, seed)),
            task_completion_time: self.roles.completion.then(|| bootstrap_mean(&self.completion_steps, seed)),
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use mishandle_rollout::{Request, Verdict};
    use mishandle_stl::Trace;

    use super::*;

    const ALL: Roles = Roles { strict: true, safe: true, completion: true };

    /// A simulation of four control steps.
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
            steps: 4,
            verdict: Verdict {
                robustness: success,
                success,
                strict,
                dangerous_steps: Some(dangerous),
                completion_step: completion,
                subformulas: Vec::new(),
            },
            total_reward: 0.0,
            end: EpisodeEnd::Completed,
        }
    }

    fn diverged() -> Episode {
        Episode { end: EpisodeEnd::Diverged { step: 3 }, ..episode(None, None, 0, None) }
    }

    fn report(episodes: &[Episode]) -> Report {
        let mut metrics = Metrics::new(ALL);
        episodes.iter().for_each(|episode| metrics.add(episode));
        metrics.report(Seed(0))
    }

    #[test]
    fn metrics_worked_out_by_hand() {
        let report = report(&[
            episode(Some(0.2), Some(0.1), 0, Some(1)), // done, well, safely, after 1 step
            episode(Some(0.1), Some(-0.3), 1, Some(4)), // done after 4 steps, 1 of 4 samples dangerous
            episode(Some(0.1), Some(-0.3), 0, None),   // done, yet completion never held: no completion time
            episode(Some(-0.5), Some(-0.9), 4, Some(2)), // failed: its completion step does not count
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
        // (1 + 4) / 2
        assert_eq!(
            (report.task_completion_time.unwrap().value, report.task_completion_time.unwrap().n),
            (Some(2.5), 2)
        );
    }

    #[test]
    fn a_robustness_of_zero_is_no_success() {
        assert_eq!(report(&[episode(Some(0.0), Some(0.0), 0, Some(0))]).success_rate.value, Some(0.0));
    }

    #[test]
    fn a_diverged_simulation_is_no_success_and_says_nothing_of_danger() {
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
    fn an_undecided_simulation_is_no_success_and_its_danger_counts() {
        let report = report(&[episode(None, Some(1.0), 4, Some(0)), episode(Some(1.0), None, 0, Some(0))]);
        assert_eq!((report.undecided, report.strict_undecided), (1, 1));
        assert_eq!(report.success_rate.value, Some(0.5));
        assert_eq!(report.strict_success_rate.unwrap().value, Some(0.5));
        assert_eq!(report.dangerous_behavior_rate.unwrap().value, Some(0.5));
        assert_eq!(report.task_completion_time.unwrap().n, 1);
    }

    #[test]
    fn a_simulation_without_a_formula_s_value_is_undecided_and_says_nothing_of_danger() {
        let undefined = Episode { end: EpisodeEnd::Undefined { step: 3 }, ..episode(None, None, 0, None) };
        let report = report(&[episode(Some(1.0), Some(1.0), 2, Some(2)), undefined]);
        assert_eq!((report.diverged, report.undecided, report.strict_undecided), (0, 1, 1));
        assert_eq!((report.success_rate.value, report.dangerous_behavior_rate.unwrap().n), (Some(0.5), 1));
    }

    #[test]
    fn the_completion_of_a_failure_counts_only_if_asked_for() {
        let mut metrics = Metrics::new(ALL).with_failures_completing(true);
        metrics.add(&episode(Some(-0.5), Some(-0.9), 0, Some(2)));
        metrics.add(&episode(Some(0.5), Some(0.9), 0, Some(4)));
        let time = metrics.report(Seed(0)).task_completion_time.unwrap();
        assert_eq!((time.value, time.n), (Some(3.0), 2));
    }

    #[test]
    fn a_metric_without_its_formula_is_left_out() {
        let mut metrics = Metrics::new(Roles::default());
        metrics.add(&episode(Some(1.0), Some(1.0), 0, Some(1)));
        let report = metrics.report(Seed(0));
        assert_eq!(report.success_rate.value, Some(1.0));
        assert_eq!(report.strict_success_rate, None);
        assert_eq!((report.dangerous_behavior_rate, report.task_completion_time), (None, None));
    }

    #[test]
    fn without_a_success_there_is_no_completion_time() {
        let report = report(&[episode(Some(-1.0), Some(-1.0), 0, Some(1))]);
        assert_eq!(report.task_completion_time, Some(Estimate::default()));
    }
}
