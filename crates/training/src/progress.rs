//! What a training tells while it runs, and what it gives in the end.

use std::fmt;

use mishandle_controllers::Policy;

use crate::Checkpoint;

/// Where a training stands after an iteration.
#[derive(Clone, Debug, PartialEq)]
pub struct Progress {
    /// Iterations done.
    pub iteration: u64,
    /// Environment steps done: control steps times rows.
    pub environment_steps: u64,
    /// Environment steps that the settings ask for.
    pub total_steps: u64,
    /// Environment steps per second over this run so far, learning and validation included.
    pub steps_per_second: f64,
    /// Duration of the training so far, of resumed runs together, s.
    pub wall_clock_secs: f64,
    /// Mean sum of rewards over the episodes that ended in this iteration, if any did.
    pub mean_return: Option<f64>,
    /// Mean control steps of these episodes.
    pub mean_episode_steps: Option<f64>,
    /// Share of these episodes that the task ended.
    pub terminated_rate: Option<f64>,
    /// How many of these episodes ended because their numbers stopped being finite.
    pub diverged: u64,
    /// Mean of each reward term per control step in this iteration, in the environment's order.
    pub reward_terms: Vec<f64>,
    /// What the last validation found, if there was one.
    pub validation: Option<Validation>,
    /// Whether that validation belongs to this iteration.
    pub validation_is_fresh: bool,
    /// Mean Kullback-Leibler divergence of the new policy from the old one; `None` where it is not measured, off policy.
    pub kl: Option<f64>,
    /// Entropy of the policy; `None` for one that has none, and before the first update off policy.
    pub entropy: Option<f64>,
    /// Step length of the policy's optimiser; in TRPO, which has none, the share of the longest step that was taken.
    pub learning_rate: f64,
    /// Where the time of this iteration went.
    pub shares: Shares,
}

impl Progress {
    /// What steps are counted in, and its letter: thousands for short trainings, else millions.
    fn unit(&self) -> (f64, &'static str) {
        if self.total_steps < 1_000_000 { (1e3, "k") } else { (1e6, "M") }
    }

    /// Environment steps done, for people.
    pub fn steps_done(&self) -> String {
        let (unit, letter) = self.unit();
        format!("{:.2}{letter}", self.environment_steps as f64 / unit)
    }

    /// Time left at the present speed, s.
    pub fn seconds_left(&self) -> f64 {
        self.total_steps.saturating_sub(self.environment_steps) as f64 / self.steps_per_second
    }
}

/// One line for people.
impl fmt::Display for Progress {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (unit, letter) = self.unit();
        let total = (self.total_steps as f64 / unit * 100.0).round() / 100.0;
        write!(f, "{} of {total}{letter} steps, ", self.steps_done())?;
        match self.steps_per_second {
            fast if fast >= 1e3 => write!(f, "{:.1}k steps/s", fast / 1e3)?,
            slow => write!(f, "{slow:.0} steps/s")?,
        }
        if let Some(mean_return) = self.mean_return {
            write!(f, ", return {mean_return:.1}")?;
        }
        if let Some(Validation { success_rate, strict_success_rate, .. }) = self.validation {
            let (success, strict) = (100.0 * success_rate, 100.0 * strict_success_rate);
            write!(f, ", success {success:.1} %, strict {strict:.1} %")?;
        }
        if self.diverged > 0 {
            write!(f, ", {} diverged", self.diverged)?;
        }
        write!(f, ", {} left", clock(self.seconds_left()))
    }
}

/// A duration as a clock shows it: 1:05, or 2:01:05 from an hour on.
pub fn clock(secs: f64) -> String {
    let secs = secs.round() as u64;
    let (hours, minutes, secs) = (secs / 3600, secs / 60 % 60, secs % 60);
    if hours > 0 { format!("{hours}:{minutes:02}:{secs:02}") } else { format!("{minutes}:{secs:02}") }
}

/// Shares of an iteration's time; they add up to 1.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Shares {
    /// Stepping the environment: physics, observation, reward.
    pub physics: f64,
    /// Choosing actions.
    pub inference: f64,
    /// Values, advantages, gradients.
    pub learning: f64,
}

impl Shares {
    /// From the seconds of physics, of acting with physics, and of the whole iteration.
    pub(crate) fn new(physics: f64, acting: f64, total: f64) -> Shares {
        Shares {
            physics: physics / total,
            inference: (acting - physics) / total,
            learning: (total - acting) / total,
        }
    }
}

/// What a validation found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Validation {
    /// Share of the episodes that met the success formula.
    pub success_rate: f64,
    /// Share that met the strict one.
    pub strict_success_rate: f64,
    /// Mean sum of rewards.
    pub mean_return: f64,
}

/// Whether to go on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Flow {
    /// Go on.
    Continue,
    /// Go on, and give a checkpoint now.
    Save,
    /// End after this iteration.
    Stop,
}

/// Who watches a training.
pub trait Observer {
    /// Called before the first iteration, when all has been checked: how many environment steps are done and wanted.
    fn begins(&mut self, _done: u64, _total: u64) {}

    /// Measures a policy on `episodes` episodes of its own, whose starts must not be those of any evaluation; `None`
    /// if it cannot. Asked as often as the settings say.
    fn validate(&mut self, policy: &Policy, episodes: usize) -> Option<Validation>;

    /// Called after each iteration. [`Flow::Stop`] ends the training.
    fn progress(&mut self, progress: &Progress) -> Flow;

    /// Called as often as the settings say, when [`Flow::Save`] asks for it, and at the end. A failure to write it does not end a training: tell it.
    fn checkpoint(&mut self, _checkpoint: &Checkpoint) {}
}

/// What a training gives.
#[derive(Clone, Debug)]
pub struct Trained {
    /// The best policy by validation: strict success, then success, then return; the last if there was no validation.
    pub best: Policy,
    /// What its validation found.
    pub best_validation: Option<Validation>,
    /// Environment steps until the best policy.
    pub best_environment_steps: u64,
    /// The policy after the last iteration.
    pub last: Policy,
    /// What its validation found, if it had one.
    pub last_validation: Option<Validation>,
    /// Environment steps.
    pub environment_steps: u64,
    /// Duration, of resumed runs together, s.
    pub wall_clock_secs: f64,
    /// Whether the rates that the settings ask for were reached, in as many validations in a row.
    pub reached: bool,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_for_people() {
        let progress = Progress {
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
            validation: Some(Validation {
                success_rate: 0.985,
                strict_success_rate: 0.9,
                mean_return: 100.0,
            }),
            validation_is_fresh: false,
            kl: Some(0.01),
            entropy: Some(2.0),
            learning_rate: 1e-3,
            shares: Shares::default(),
        };
        // 18.5 M steps at 50 k/s are 370 s.
        assert_eq!(
            progress.to_string(),
            "1.50M of 20M steps, 50.0k steps/s, return 101.3, success 98.5 %, strict 90.0 %, 6:10 left"
        );
        // 18.5 M steps at 500 a second are 37,000 s: 10 h, 16 min, 40 s.
        let slow = Progress { steps_per_second: 500.0, ..progress.clone() }.to_string();
        assert!(slow.contains(" steps, 500 steps/s, ") && slow.ends_with(", 10:16:40 left"), "{slow}");
        let short = Progress { environment_steps: 1024, total_steps: 2048, diverged: 1, ..progress };
        assert!(short.to_string().starts_with("1.02k of 2.05k steps, "), "{short}");
    }
}
