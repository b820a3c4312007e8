//! A policy with a history learns a task that one observation does not determine.

use std::sync::Arc;

use crate::toy::{Toy, names, space};
use mishandle_controllers::Policy;
use mishandle_rollout::{
    Controller, EnvironmentFacts, EnvironmentWorker, Sample, Scenario, Seed, StepStatus,
};
use mishandle_training::{
    AlgorithmSettings, Checkpoint, Observer, Origin, TrainingControl, TrainingProgress, Validation,
};

/// Control steps of an episode.
const STEPS: usize = 3;

/// Environment that shows the sign of its only axis in the first observation, then 0. The reward of
/// a step is this sign times the action.
#[derive(Clone)]
struct Cue;

fn cue() -> Arc<Toy<Cue>> {
    Arc::new(Toy {
        facts: EnvironmentFacts {
            name: "cue".to_string(),
            space: space(&[("side", -1.0, 1.0)]),
            signals: names(&["sign"]),
            reward_terms: names(&["agreement"]).to_vec(),
            observation_size: 1,
            exact_size: 0,
            action_size: 1,
            state_size: 1,
            episode_steps: STEPS,
            action_limit: 1.0,
            control_dt: 0.1,
        },
        worker: Cue,
    })
}

impl EnvironmentWorker for Cue {
    fn reset(
        &mut self,
        scenario: &Scenario,
        _seed: Seed,
        state: &mut [f64],
        sample: Sample<'_>,
    ) -> StepStatus {
        state[0] = scenario.get(0).unwrap().signum();
        sample.observation[0] = state[0] as f32;
        sample.rewards.fill(0.0);
        StepStatus::Running
    }

    fn step(&mut self, action: &[f64], state: &mut [f64], sample: Sample<'_>) -> StepStatus {
        sample.observation[0] = 0.0;
        sample.rewards[0] = state[0] * action[0].clamp(-1.0, 1.0);
        StepStatus::Running
    }
}

struct Silent;

impl Observer for Silent {
    fn validate(&mut self, _policy: &Policy, _episodes: usize) -> Option<Validation> {
        None
    }
    fn iteration_finished(&mut self, _progress: &TrainingProgress) -> TrainingControl {
        TrainingControl::Continue
    }
    fn save_checkpoint(&mut self, _checkpoint: &Checkpoint) {}
}

/// Returns the mean reward of each control step over both signs.
fn rewards(policy: &Policy) -> [f32; STEPS] {
    let mut worker = policy.worker();
    let mut state = vec![0.0; policy.state_size()];
    let mut rewards = [0.0; STEPS];
    for sign in [-1.0, 1.0] {
        worker.reset(&mut state, Seed(0));
        for (step, reward) in rewards.iter_mut().enumerate() {
            let mut action = [0.0];
            worker.act(1, &[if step == 0 { sign } else { 0.0 }], &mut state, &mut action);
            *reward += 0.5 * sign * action[0].clamp(-1.0, 1.0);
        }
    }
    rewards
}

#[test]
fn a_history_whose_controller_would_be_too_large_is_an_error() {
    for algorithm in ["ppo", "sac"] {
        let train = |text: &str| {
            let settings = AlgorithmSettings::from_toml(algorithm, text).unwrap()?;
            settings.train(&cue(), Seed(2), Origin::New, &mut Silent).map(|_| ())
        };
        // 1 + 500 · 2 inputs.
        let error = train("policy = { history = 500, hidden = [10_000] }").unwrap_err().to_string();
        let expected = "the setting `policy.history` must be so short that the first layer of the policy has at most 10^7 weights";
        assert!(error.contains(expected), "{error}");
    }
}

#[test]
fn each_algorithm_learns_to_remember() {
    for algorithm in ["ppo", "trpo", "sac", "td3", "ddpg"] {
        let own = match algorithm {
            "ppo" => "rollout_steps = 15\nminibatch_size = 240",
            "trpo" => "rollout_steps = 15",
            _ => {
                "steps_per_iteration = 15\ntau = 0.02\npolicy.learning_rate = 0.003\n\
                 replay = { n_steps = 1, warmup_steps = 500, batch_size = 64, updates_per_step = 0.25, reward_scale = 1.0 }"
            }
        };
        let train = |history: usize| {
            let text = format!(
                "{own}\npolicy.history = {history}\nrun.total_steps = 15_000\nepisodes.environments = 16\ngamma = 0.5\n\
                 policy.hidden = [16]\ncritic.hidden = [16]"
            );
            let settings = AlgorithmSettings::from_toml(algorithm, &text).unwrap().unwrap();
            settings.train(&cue(), Seed(2), Origin::New, &mut Silent).unwrap().last
        };
        let with = rewards(&train(2));
        let without = rewards(&train(0));
        assert!(with.iter().all(|reward| *reward > 0.8), "{algorithm}: {with:?}");
        // Without a memory, the later actions are the same for both signs.
        assert!(without[0] > 0.8 && without[1..] == [0.0, 0.0], "{algorithm}: {without:?}");
    }
}
