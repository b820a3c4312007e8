//! Progress reports, the observer that receives them, and the result of a training run.

use std::fmt;

use mishandle_controllers::Policy;

use crate::{Checkpoint, SelectionWeights};

/// Progress of a training run after an iteration.
#[derive(Clone, Debug, PartialEq)]
pub struct TrainingProgress {
    /// Number of completed iterations.
    pub iteration: u64,
    /// Number of environment steps so far: control steps times environments.
    pub environment_steps: u64,
    /// Total number of environment steps in the settings.
    pub total_steps: u64,
    /// Throughput since this process started, including learning and validation.
    pub steps_per_second: f64,
    /// Wall-clock time so far, including the runs that this one resumes, s.
    pub wall_clock_secs: f64,
    /// Mean undiscounted return of the episodes that ended in this iteration; `None` if no episode
    /// ended.
    pub mean_return: Option<f64>,
    /// Mean length of these episodes in control steps.
    pub mean_episode_steps: Option<f64>,
    /// Fraction of these episodes that the task terminated.
    pub terminated_rate: Option<f64>,
    /// Number of these episodes that diverged (a state became NaN or infinite).
    pub diverged: u64,
    /// Mean of each reward term per control step in this iteration, in the environment's order.
    pub reward_terms: Vec<f64>,
    /// Result of the last validation; `None` before the first.
    pub validation: Option<Validation>,
    /// Whether that validation belongs to this iteration.
    pub validation_is_fresh: bool,
    /// Share of the range of each axis from which the episodes of this iteration drew when they
    /// started; `None` without a curriculum.
    pub scenario_share: Option<f64>,
    /// Mean Kullback-Leibler divergence of the new policy from the old one; `None` for off-policy
    /// algorithms.
    pub kl: Option<f64>,
    /// Entropy of the policy; `None` for a deterministic policy, and off-policy before the first
    /// update.
    pub entropy: Option<f64>,
    /// Learning rate of the policy. TRPO has none: the fraction of the full step that the line
    /// search accepted.
    pub learning_rate: f64,
    /// Time shares of this iteration.
    pub time_shares: TimeShares,
}

impl TrainingProgress {
    /// Returns the unit of displayed step counts and its letter: thousands for short runs,
    /// otherwise millions.
    fn unit(&self) -> (f64, &'static str) {
        if self.total_steps < 1_000_000 { (1e3, "k") } else { (1e6, "M") }
    }

    /// Returns the number of environment steps so far for display, as `1.50M`.
    pub fn steps_done(&self) -> String {
        let (unit, letter) = self.unit();
        format!("{:.2}{letter}", self.environment_steps as f64 / unit)
    }

    /// Returns the remaining time at the current throughput, s.
    pub fn seconds_left(&self) -> f64 {
        self.total_steps.saturating_sub(self.environment_steps) as f64 / self.steps_per_second
    }
}

/// One line for the terminal.
impl fmt::Display for TrainingProgress {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (unit, letter) = self.unit();
        // The last iteration may exceed the requested total.
        let total = self.total_steps.max(self.environment_steps);
        let total = (total as f64 / unit * 100.0).round() / 100.0;
        write!(f, "{} of {total}{letter} steps, ", self.steps_done())?;
        match self.steps_per_second {
            fast if fast >= 1e3 => write!(f, "{:.1}k steps/s", fast / 1e3)?,
            slow => write!(f, "{slow:.0} steps/s")?,
        }
        if let Some(mean_return) = self.mean_return {
            write!(f, ", return {mean_return:.1}")?;
        }
        if let Some(Validation { success_rate, strict_success_rate, space, corners, part, .. }) =
            self.validation
        {
            let success = percent(success_rate);
            let strict = percent(strict_success_rate);
            write!(f, ", success {success}, strict {strict}")?;
            for (name, rates) in [("space", space), ("corners", corners)] {
                if let Some(rates) = rates {
                    write!(f, ", {name} {}", percent(rates.success_rate))?;
                }
            }
            if let Some(PartValidation { share, rates }) = part {
                let success = percent(rates.success_rate);
                let share = 100.0 * share;
                write!(f, ", within {share:.0} % of the ranges {success}")?;
            }
        }
        if let Some(share) = self.scenario_share {
            write!(f, ", now {:.0} % of the ranges", 100.0 * share)?;
        }
        if self.diverged > 0 {
            write!(f, ", {} diverged", self.diverged)?;
        }
        write!(f, ", {} left", format_duration(self.seconds_left()))
    }
}

/// Formats a duration as minutes and seconds, 1:05, or with hours, 2:01:05.
pub fn format_duration(secs: f64) -> String {
    let secs = secs.round() as u64;
    let hours = secs / 3600;
    let minutes = secs / 60 % 60;
    let secs = secs % 60;
    if hours > 0 { format!("{hours}:{minutes:02}:{secs:02}") } else { format!("{minutes}:{secs:02}") }
}

/// TimeShares of an iteration's time; they add up to 1.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TimeShares {
    /// Stepping the environment: physics, observation, reward.
    pub physics: f64,
    /// Network inference and sampling of actions.
    pub inference: f64,
    /// Values, advantages, gradients.
    pub learning: f64,
}

impl TimeShares {
    /// Returns the shares for the seconds of physics, of physics and inference, and of the whole
    /// iteration.
    pub(crate) fn new(physics: f64, acting: f64, total: f64) -> TimeShares {
        TimeShares {
            physics: physics / total,
            inference: (acting - physics) / total,
            learning: (total - acting) / total,
        }
    }
}

/// Result of a validation: of random starts without disturbances, and of scenarios.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Validation {
    /// Fraction of the episodes that satisfied the success formula.
    pub success_rate: f64,
    /// Fraction of the episodes that satisfied the strict success formula.
    pub strict_success_rate: f64,
    /// Mean undiscounted return.
    pub mean_return: f64,
    /// Results of random scenarios of the space; `None` if training draws none.
    pub space: Option<Rates>,
    /// Results at corners of the space; `None` if training draws no scenarios.
    pub corners: Option<Rates>,
    /// Results of random scenarios of the part of the space that the curriculum has reached; `None`
    /// without a curriculum. They do not decide between policies.
    pub part: Option<PartValidation>,
}

/// Results of random scenarios of a part of the space.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PartValidation {
    /// Share of the range of each axis around its nominal value.
    pub share: f64,
    /// The results.
    pub rates: Rates,
}

/// Results of the episodes of a validation that can start.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Rates {
    /// Fraction that satisfied the success formula; NaN if none has a verdict.
    pub success_rate: f64,
    /// Fraction that satisfied the strict success formula; NaN if none has a verdict.
    pub strict_success_rate: f64,
    /// Mean undiscounted return.
    pub mean_return: f64,
}

impl Rates {
    /// Returns whether an episode has a verdict on success, and one on strict success.
    pub fn has_verdicts(&self) -> bool {
        !self.success_rate.is_nan() && !self.strict_success_rate.is_nan()
    }
}

/// Formats a rate; `-` without a verdict.
fn percent(rate: f64) -> String {
    if rate.is_nan() { "-".to_string() } else { format!("{:.1} %", 100.0 * rate) }
}

impl Validation {
    /// Makes the validation of a training run without scenarios.
    pub fn of_starts(nominal: Rates) -> Validation {
        let Rates { success_rate, strict_success_rate, mean_return } = nominal;
        Validation { success_rate, strict_success_rate, mean_return, space: None, corners: None, part: None }
    }

    /// Returns the results of random starts without disturbances.
    pub fn nominal(&self) -> Rates {
        let Validation { success_rate, strict_success_rate, mean_return, .. } = *self;
        Rates { success_rate, strict_success_rate, mean_return }
    }

    /// Returns the weighted mean of the results, which decides between policies; without weights,
    /// the nominal results.
    pub fn mixture(&self, weights: &SelectionWeights) -> Rates {
        let parts = [
            (Some(self.nominal()), weights.nominal),
            (self.space, weights.space),
            (self.corners, weights.corners),
        ];
        let parts = parts.into_iter().filter_map(|(rates, weight)| Some((rates?, weight)));
        let parts: Vec<(Rates, f64)> = parts.filter(|(_, weight)| *weight > 0.0).collect();
        let total = parts.iter().map(|(_, weight)| weight).sum::<f64>();
        match parts[..] {
            [] => self.nominal(),
            // Not rounded.
            [(rates, _)] => rates,
            _ => {
                let mean = |value: fn(&Rates) -> f64| {
                    parts.iter().map(|(rates, weight)| weight * value(rates)).sum::<f64>() / total
                };
                Rates {
                    success_rate: mean(|rates| rates.success_rate),
                    strict_success_rate: mean(|rates| rates.strict_success_rate),
                    mean_return: mean(|rates| rates.mean_return),
                }
            }
        }
    }
}

/// Decision of the training loop after an iteration.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TrainingControl {
    /// Continue with the next iteration.
    Continue,
    /// Create a checkpoint now, then continue.
    SaveCheckpoint,
    /// Create a checkpoint now, then stop.
    Stop,
}

/// Receives the progress of a training run and validates policies.
pub trait Observer {
    /// Called before the first iteration, after all checks, with the environment steps so far and
    /// in total.
    fn training_started(&mut self, _done: u64, _total: u64) {}

    /// Measures a policy on `episodes` episodes, or returns `None` if that fails. The initial
    /// states must differ from those of every evaluation. Called at the interval in the settings.
    fn validate(&mut self, policy: &Policy, episodes: usize) -> Option<Validation>;

    /// Measures a policy on `episodes` random scenarios within a share of the range of each axis
    /// around its nominal value; see [`ScenarioPart`](mishandle_rollout::ScenarioPart). Called after
    /// [`validate`](Self::validate), with a curriculum. `None`, the default: the share does not grow.
    fn validate_part(&mut self, _policy: &Policy, _episodes: usize, _share: f64) -> Option<Rates> {
        None
    }

    /// Called after each iteration.
    fn iteration_finished(&mut self, progress: &TrainingProgress) -> TrainingControl;

    /// Called at the interval in the settings, after [`TrainingControl::SaveCheckpoint`], and at
    /// the end. An observer that fails to write the checkpoint reports that itself; training
    /// continues.
    fn save_checkpoint(&mut self, _checkpoint: &Checkpoint) {}
}

/// Result of a training run.
#[derive(Clone, Debug)]
pub struct TrainingResult {
    /// The best policy by validation (strict success, then success, then return, each a mixture of
    /// the validations); the last policy without a validation.
    pub best: Policy,
    /// Validation of the best policy.
    pub best_validation: Option<Validation>,
    /// Environment steps at the best policy.
    pub best_environment_steps: u64,
    /// The policy after the last iteration.
    pub last: Policy,
    /// Validation of the last policy; `None` if it was not validated.
    pub last_validation: Option<Validation>,
    /// Environment steps.
    pub environment_steps: u64,
    /// Wall-clock time, including the runs that this one resumes, s.
    pub wall_clock_secs: f64,
    /// Whether enough consecutive validations reached the target rates of the settings.
    pub reached_target: bool,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn progress_is_displayed_as_one_line() {
        let progress = TrainingProgress {
            iteration: 3,
            environment_steps: 1_500_000,
            total_steps: 20_000_000,
            steps_per_second: 50_000.0,
            wall_clock_secs: 30.0,
            mean_return: Some(101.26),
            mean_episode_steps: Some(300.0),
            terminated_rate: Some(0.0),
            diverged: 0,
            reward_terms: vec![],
            validation: Some(Validation::of_starts(Rates {
                success_rate: 0.985,
                strict_success_rate: 0.9,
                mean_return: 100.0,
            })),
            validation_is_fresh: false,
            scenario_share: None,
            kl: Some(0.01),
            entropy: Some(2.0),
            learning_rate: 1e-3,
            time_shares: TimeShares::default(),
        };
        // 18.5 M steps at 50 k/s are 370 s.
        assert_eq!(
            progress.to_string(),
            "1.50M of 20M steps, 50.0k steps/s, return 101.3, success 98.5 %, strict 90.0 %, 6:10 left"
        );
        let part =
            Some(PartValidation { share: 0.3, rates: Rates { success_rate: 0.95, ..Rates::default() } });
        let mut growing = progress.clone();
        growing.validation = growing.validation.map(|validation| Validation { part, ..validation });
        growing.scenario_share = Some(0.4);
        let expected = ", strict 90.0 %, within 30 % of the ranges 95.0 %, now 40 % of the ranges, 6:10 left";
        assert!(growing.to_string().ends_with(expected), "{growing}");
        // 18.5 M steps at 500 a second are 37,000 s: 10 h, 16 min, 40 s.
        let slow = TrainingProgress { steps_per_second: 500.0, ..progress.clone() }.to_string();
        assert!(slow.contains(" steps, 500 steps/s, ") && slow.ends_with(", 10:16:40 left"), "{slow}");
        let short = TrainingProgress { environment_steps: 1024, total_steps: 2048, diverged: 1, ..progress };
        assert!(short.to_string().starts_with("1.02k of 2.05k steps, "), "{short}");
    }

    #[test]
    fn the_mixture_weighs_the_validations_that_exist() {
        let rates = |success_rate| Rates { success_rate, strict_success_rate: 0.1, mean_return: -3.0 };
        let starts = Validation::of_starts(rates(0.9));
        let all = Validation { space: Some(rates(0.5)), corners: Some(rates(0.1)), ..starts };
        let mixture = |validation: &Validation, nominal, space, corners| {
            validation.mixture(&SelectionWeights { nominal, space, corners }).success_rate
        };
        assert_eq!(mixture(&starts, 0.3, 0.7, 0.0), 0.9, "exactly");
        assert_eq!(mixture(&starts, 0.0, 1.0, 1.0), 0.9);
        // (1·0.9 + 2·0.5 + 1·0.1) / 4
        assert!((mixture(&all, 1.0, 2.0, 1.0) - 0.5).abs() < 1e-15);
        assert_eq!(mixture(&all, 0.0, 0.0, 3.0), 0.1);
    }
}
