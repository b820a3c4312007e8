//! Toy environment that every algorithm must learn.

use std::sync::Arc;

use mishandle_rollout::{EnvironmentFacts, EnvironmentWorker, Sample, Scenario, Seed, StepStatus, Stream};

use crate::toy::{Toy, names, space};

/// A point on a line must reach a goal: x changes by a tenth of the action, which is clipped to
/// [-1, 1].
///
/// The reward is 1 - |x - goal|. The episode terminates beyond ±1.5. Each step adds a random
/// disturbance of at most `wind`, drawn from the simulation's seed.
#[derive(Clone)]
pub struct Line {
    wind: f64,
}

impl Line {
    pub fn new(wind: f64) -> Arc<Toy<Line>> {
        Arc::new(Toy {
            facts: EnvironmentFacts {
                name: "line".to_string(),
                space: space(&[("start", -1.0, 1.0), ("goal", -1.0, 1.0)]),
                signals: names(&["distance"]),
                reward_terms: names(&["there", "far"]).to_vec(),
                observation_size: 2,
                exact_size: 0,
                action_size: 1,
                state_size: 5,
                episode_steps: 40,
                action_limit: 1.0,
                control_dt: 0.1,
            },
            worker: Line { wind },
        })
    }

    fn show(state: &[f64], sample: &mut Sample<'_>) {
        sample.observation.copy_from_slice(&[state[0] as f32, state[1] as f32]);
        sample.signals[0] = (state[0] - state[1]).abs();
    }
}

impl EnvironmentWorker for Line {
    fn reset(
        &mut self,
        scenario: &Scenario,
        seed: Seed,
        state: &mut [f64],
        mut sample: Sample<'_>,
    ) -> StepStatus {
        let low = f64::from(seed.0 as u32);
        let high = f64::from((seed.0 >> 32) as u32);
        state.copy_from_slice(&[scenario.get(0).unwrap(), scenario.get(1).unwrap(), 0.0, low, high]);
        Self::show(state, &mut sample);
        sample.rewards.fill(0.0);
        StepStatus::Running
    }

    fn step(&mut self, action: &[f64], state: &mut [f64], mut sample: Sample<'_>) -> StepStatus {
        let seed = Seed(state[3] as u64 | (state[4] as u64) << 32);
        let wind = self.wind * (2.0 * seed.uniform(Stream::Push, state[2] as u64, 0) - 1.0);
        state[2] += 1.0;
        state[0] += 0.1 * action[0].clamp(-1.0, 1.0) + wind;
        Self::show(state, &mut sample);
        sample.rewards.copy_from_slice(&[1.0, -sample.signals[0]]);
        // Rare divergence, as in a physics simulation.
        if seed.uniform(Stream::Push, state[2] as u64, 1) < 0.001 {
            state[0] = f64::NAN;
            sample.observation.fill(f32::NAN);
            sample.rewards.fill(f64::NAN);
            return StepStatus::Diverged;
        }
        if state[0].abs() > 1.5 { StepStatus::Terminated } else { StepStatus::Running }
    }
}
