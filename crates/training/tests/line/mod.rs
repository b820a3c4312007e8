//! A toy that every algorithm has to learn.

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

use std::sync::Arc;

use mishandle_rollout::{Axis, Environment, InitialBox, Sample, Seed, Status, Stream, Worker};

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
