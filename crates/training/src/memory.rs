//! How much memory a training takes.

use mishandle_rollout::Environment;

use crate::Config;
use crate::off_policy_settings::ReplaySettings;

/// What a part of a training takes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MemoryNeed {
    /// The settings that decide it.
    pub settings: &'static str,
    /// At least so many bytes; as settings may be any numbers, so may this.
    pub bytes: f64,
}

/// Bytes of a parameter: itself, its gradient, and Adam's two moments.
const PARAMETER: f64 = 4.0 * 4.0;

impl Config {
    /// What each part of a training in `environment` takes: its large arrays, so somewhat less than all.
    pub fn memory_needs(&self, environment: &dyn Environment) -> Vec<MemoryNeed> {
        let (seen, done) = (environment.observation_size() as f64, environment.action_size() as f64);
        let (states, signals) = (environment.state_size() as f64, environment.signals().len() as f64);
        let episodes = self.episodes().environments as f64;
        // States, signals and actions are f64, what is seen is kept as f32 twice.
        let simulation = 8.0 * (states + signals + done) + 4.0 * 2.0 * seen;
        let validations = self.run().validation_episodes as f64;
        let trace = 8.0 * signals * (environment.episode_steps() + 1) as f64;
        let networks = self.hidden().into_iter().map(|hidden| parameters(seen, hidden)).sum::<f64>();
        let experience = match self {
            Config::Ppo(own) => rollout(own.rollout_steps, episodes, seen + done),
            Config::Trpo(own) => rollout(own.rollout_steps, episodes, seen + done),
            Config::Sac(own) => replay(&own.replay, own.run.total_steps, seen, done),
            Config::Td3(own) => replay(&own.replay, own.run.total_steps, seen, done),
            Config::Ddpg(own) => replay(&own.replay, own.run.total_steps, seen, done),
        };
        let need = |settings, bytes| MemoryNeed { settings, bytes };
        let mut needs = vec![
            need("episodes.environments", episodes * simulation),
            need("run.validation_episodes", validations * trace),
            need("policy.hidden and critic.hidden", networks * PARAMETER),
        ];
        needs.extend(experience);
        needs
    }
}

/// Parameters of a network without its last layer.
fn parameters(inputs: f64, hidden: &[usize]) -> f64 {
    let mut inputs = inputs;
    let layer = |outputs: &usize| {
        let outputs = *outputs as f64;
        let count = (inputs + 1.0) * outputs;
        inputs = outputs;
        count
    };
    hidden.iter().map(layer).sum()
}

/// A [`Buffer`](crate::Buffer): what was seen and done, and six f64 and a place in the order of minibatches beside it.
fn rollout(steps: usize, episodes: f64, columns: f64) -> Vec<MemoryNeed> {
    let row = 4.0 * columns + 6.0 * 8.0 + 4.0;
    let bytes = steps as f64 * episodes * row;
    vec![MemoryNeed { settings: "rollout_steps and episodes.environments", bytes }]
}

/// A [`Replay`](crate::replay::Replay), and what is filled of it thrice while a checkpoint is written: as numbers, as the
/// bytes of each, and as those of the file; and a batch of it: what was seen before and after, and what was done.
fn replay(settings: &ReplaySettings, total_steps: u64, seen: f64, done: f64) -> Vec<MemoryNeed> {
    let capacity = settings.capacity as f64;
    let filled = capacity.min(total_steps as f64);
    let entry = 4.0 * (seen + done + 1.0) + 1.0;
    let batch = settings.batch_rows as f64 * 4.0 * (2.0 * seen + done);
    vec![
        MemoryNeed { settings: "replay.capacity", bytes: (capacity + 3.0 * filled) * entry },
        MemoryNeed { settings: "replay.batch_rows", bytes: batch },
    ]
}
