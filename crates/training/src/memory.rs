//! How much memory a training takes.

use mishandle_rollout::EnvironmentSpec;

use crate::Config;

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
    pub fn memory_needs(&self, environment: &EnvironmentSpec) -> Vec<MemoryNeed> {
        let (seen, done) = (environment.observation_size as f64, environment.action_size as f64);
        let (states, signals) = (environment.state_size as f64, environment.signal_count as f64);
        let episodes = self.episodes().environments as f64;
        // States, signals and actions are f64, what is seen is kept as f32 twice.
        let simulation = 8.0 * (states + signals + done) + 4.0 * 2.0 * seen;
        let validations = self.run().validation_episodes as f64;
        let trace = 8.0 * signals * (environment.episode_steps + 1) as f64;
        let networks = self.hidden().into_iter().map(|hidden| parameters(seen, hidden)).sum::<f64>();
        let need = |settings, bytes| MemoryNeed { settings, bytes };
        let mut needs = vec![
            need("episodes.environments", episodes * simulation),
            need("run.validation_episodes", validations * trace),
            need("policy.hidden and critic.hidden", networks * PARAMETER),
        ];
        needs.extend(self.experience_memory(environment));
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
