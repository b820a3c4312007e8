//! A toy that every algorithm has to learn, and what the tests of all algorithms look at.

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

use std::sync::Arc;

use mishandle_controllers::Policy;
use mishandle_rollout::{Axis, Controller, Environment, InitialBox, Sample, Seed, Status, Stream, Worker};
use mishandle_training::{Checkpoint, Flow, Observer, Progress, Validation};

/// A point on a line that has to go to a goal: x moves by a tenth of the action, which is clipped to [-1, 1].
///
/// The reward is 1 - |x - goal|; the point is lost beyond ±1.5. Every start has a random push at each step of up to
/// `wind`, drawn from the simulation's seed.
pub struct Line {
    initial_box: InitialBox,
    signals: Arc<[String]>,
    reward_terms: Vec<String>,
    wind: f64,
}

impl Line {
    pub fn new(wind: f64) -> Arc<Line> {
        let axis = |name: &str| Axis { name: name.into(), unit: "m".into(), low: -1.0, high: 1.0 };
        Arc::new(Line {
            initial_box: InitialBox::new(vec![axis("start"), axis("goal")]).unwrap(),
            signals: Arc::from(["distance".to_string()]),
            reward_terms: vec!["there".to_string(), "far".to_string()],
            wind,
        })
    }
}

impl Environment for Line {
    fn name(&self) -> &str {
        "line"
    }
    fn initial_box(&self) -> &InitialBox {
        &self.initial_box
    }
    fn signals(&self) -> &Arc<[String]> {
        &self.signals
    }
    fn reward_terms(&self) -> &[String] {
        &self.reward_terms
    }
    fn observation_size(&self) -> usize {
        2
    }
    fn action_size(&self) -> usize {
        1
    }
    fn state_size(&self) -> usize {
        5
    }
    fn control_dt(&self) -> f64 {
        0.1
    }
    fn episode_steps(&self) -> usize {
        40
    }
    fn worker(&self) -> Box<dyn Worker> {
        Box::new(LineWorker { wind: self.wind })
    }
}

struct LineWorker {
    wind: f64,
}

impl LineWorker {
    fn show(state: &[f64], sample: &mut Sample<'_>) {
        sample.observation.copy_from_slice(&[state[0] as f32, state[1] as f32]);
        sample.signals[0] = (state[0] - state[1]).abs();
    }
}

impl Worker for LineWorker {
    fn reset(&mut self, x0: &[f64], seed: Seed, state: &mut [f64], mut sample: Sample<'_>) {
        let (low, high) = (f64::from(seed.0 as u32), f64::from((seed.0 >> 32) as u32));
        state.copy_from_slice(&[x0[0], x0[1], 0.0, low, high]);
        Self::show(state, &mut sample);
        sample.rewards.fill(0.0);
    }

    fn step(&mut self, action: &[f64], state: &mut [f64], mut sample: Sample<'_>) -> Status {
        let seed = Seed(state[3] as u64 | (state[4] as u64) << 32);
        let wind = self.wind * (2.0 * seed.uniform(Stream::Push, state[2] as u64, 0) - 1.0);
        state[2] += 1.0;
        state[0] += 0.1 * action[0].clamp(-1.0, 1.0) + wind;
        Self::show(state, &mut sample);
        sample.rewards.copy_from_slice(&[1.0, -sample.signals[0]]);
        // Now and then numbers run wild, as they do in physics.
        if seed.uniform(Stream::Push, state[2] as u64, 1) < 0.001 {
            state[0] = f64::NAN;
            sample.observation.fill(f32::NAN);
            sample.rewards.fill(f64::NAN);
            return Status::Diverged;
        }
        if state[0].abs() > 1.5 { Status::Terminated } else { Status::Running }
    }
}

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

/// Mean return on the windless line from starts of its own, by hand: no batch, no training code.
pub fn mean_return(controller: &dyn Controller, episodes: usize) -> f64 {
    let line = Line::new(0.0);
    let mut actor = controller.actor();
    let mut sum = 0.0;
    for index in 0..episodes as u64 {
        let x0 = line.initial_box.sample(Seed(99), index);
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
        let x0 = line.initial_box.sample(Seed(99), index);
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
            "{} {} {:?} {:?} {:?} {:?} {:?} {} {} {}",
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
