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
    pool.install(|| config.train(&Line::new(0.05), Seed(5), resume, watch)).unwrap()
}

/// Checks that a training comes to the same bits on 1, 2 and 4 threads; gives its number of iterations.
#[track_caller]
pub fn check_threads(config: &Config) -> usize {
    let mut one = Watch::default();
    let trained = run(1, config, None, &mut one);
    for threads in [2, 4] {
        let mut many = Watch::default();
        let again = run(threads, config, None, &mut many);
        assert_eq!(trained.last.hash(), again.last.hash(), "{}, {threads} threads", config.algorithm());
        assert_eq!(trained.best.hash(), again.best.hash(), "{}, {threads} threads", config.algorithm());
        assert_eq!(facts(&one), facts(&many), "{}, {threads} threads", config.algorithm());
    }
    one.told.len()
}

/// Checks that a training that is stopped after so many iterations, and saved, goes on to the same bits; gives its number of
/// iterations.
#[track_caller]
pub fn check_resumption(config: &Config, stops: &[u64]) -> usize {
    let mut whole = Watch::default();
    let trained = run(2, config, None, &mut whole);
    for stop in stops {
        let mut first = Watch { stop_after: Some(*stop), ..Watch::default() };
        run(2, config, None, &mut first);
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("line.checkpoint");
        first.checkpoint.unwrap().save(&path).unwrap();
        let mut second = Watch::default();
        let resumed = run(3, config, Some(&Checkpoint::load(&path).unwrap()), &mut second);
        assert_eq!(resumed.last.hash(), trained.last.hash(), "{}", config.algorithm());
        assert_eq!(resumed.best.hash(), trained.best.hash(), "{}", config.algorithm());
        assert_eq!(resumed.environment_steps, trained.environment_steps);
        assert_eq!(facts(&second), facts(&whole)[*stop as usize..], "{}", config.algorithm());
    }
    whole.told.len()
}

/// Mean return on the windless line from starts of its own, by hand: no batch, no training code.
pub fn mean_return(controller: &dyn Controller, episodes: usize) -> f64 {
    let line = Line::new(0.0);
    let mut actor = controller.worker();
    let mut sum = 0.0;
    for index in 0..episodes as u64 {
        let scenario = line.space().sample(Seed(99), index);
        let (mut x, goal) = (scenario.get(0).unwrap(), scenario.get(1).unwrap());
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
        let scenario = line.space().sample(Seed(99), index);
        let mut distance = (scenario.get(0).unwrap() - scenario.get(1).unwrap()).abs();
        for _ in 0..40 {
            distance = (distance - 0.1).max(0.0);
            sum += 1.0 - distance;
        }
    }
    sum / episodes as f64
}

/// All that a run tells, but for times.
fn facts(watch: &Watch) -> Vec<String> {
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
