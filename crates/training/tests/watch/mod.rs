//! What the tests of all algorithms look at.

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

use mishandle_controllers::Policy;
use mishandle_rollout::{Controller, Environment, Seed};
use mishandle_training::{Checkpoint, Config, Flow, Observer, Progress, Trained, Validation};

use crate::line::Line;

/// Validates by the mean reward, keeps checkpoints, and stops after an iteration if it is told to.
#[derive(Default)]
pub struct Watch {
    pub stop_after: Option<u64>,
    /// Iteration after which a checkpoint is asked for, besides those that the settings say.
    pub save_after: Option<u64>,
    pub checkpoint: Option<Checkpoint>,
    pub first_checkpoint: Option<Checkpoint>,
    pub told: Vec<Progress>,
}

impl Observer for Watch {
    fn validate(&mut self, policy: &Policy, episodes: usize) -> Option<Validation> {
        let mean_return = mean_return(policy, episodes);
        let success_rate = (mean_return / 40.0).clamp(0.0, 1.0);
        Some(Validation { success_rate, strict_success_rate: 0.0, mean_return })
    }
    fn progress(&mut self, progress: &Progress) -> Flow {
        self.told.push(progress.clone());
        match Some(progress.iteration) {
            now if now == self.stop_after => Flow::Stop,
            now if now == self.save_after => Flow::Save,
            _ => Flow::Continue,
        }
    }
    fn checkpoint(&mut self, checkpoint: &Checkpoint) {
        self.first_checkpoint.get_or_insert_with(|| checkpoint.clone());
        self.checkpoint = Some(checkpoint.clone());
    }
}

/// Trains on a windy line.
pub fn run(threads: usize, config: &Config, resume: Option<&Checkpoint>, watch: &mut Watch) -> Trained {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
    pool.install(|| config.train(Line::new(0.05), Seed(5), resume, watch)).unwrap()
}

/// Mean return on the windless line from starts of its own, by hand: no batch, no training code.
pub fn mean_return(controller: &dyn Controller, episodes: usize) -> f64 {
    let line = Line::new(0.0);
    let mut actor = controller.actor();
    let mut sum = 0.0;
    for index in 0..episodes as u64 {
        let x0 = line.initial_box().sample(Seed(99), index);
        let (mut x, goal) = (x0[0], x0[1]);
        for _ in 0..40 {
            let mut action = [0.0];
            actor.act(1, &[x as f32, goal as f32], &mut [], &mut action);
            x += 0.1 * f64::from(action[0]).clamp(-1.0, 1.0);
            sum += 1.0 - (x - goal).abs();
        }
    }
    sum / episodes as f64
}

/// The best return there is from the same starts: straight to the goal at full speed.
pub fn best_return(episodes: usize) -> f64 {
    let line = Line::new(0.0);
    let mut sum = 0.0;
    for index in 0..episodes as u64 {
        let x0 = line.initial_box().sample(Seed(99), index);
        let mut distance = (x0[0] - x0[1]).abs();
        for _ in 0..40 {
            distance = (distance - 0.1).max(0.0);
            sum += 1.0 - distance;
        }
    }
    sum / episodes as f64
}

/// All that a run tells, but for times.
pub fn facts(watch: &Watch) -> Vec<String> {
    let fact = |p: &Progress| {
        format!(
            "{} {} {:?} {:?} {:?} {:?} {:?} {:?} {:?} {}",
            p.iteration,
            p.environment_steps,
            p.mean_return,
            p.mean_episode_steps,
            p.terminated_rate,
            p.reward_terms,
            p.validation,
            p.kl,
            p.entropy,
            p.learning_rate
        )
    };
    watch.told.iter().map(fact).collect()
}
