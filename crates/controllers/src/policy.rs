//! Neural-network policies: Gaussian, or squashed Gaussian with actions in [-1, 1].

use std::sync::Arc;

use mishandle_network::elementary::tanh;
use mishandle_network::{Mlp, Normalizer, Workspace};
use mishandle_rollout::{Controller, ControllerWorker, Seed, Stream};
use sha2::{Digest, Sha256};

use crate::layout::hexadecimal;
use crate::{ControllerError, History, squashed};

/// A policy: a normalizer with fixed statistics, followed by a network.
///
/// ```text
/// x = clamp((o - mean) / (√variance + 1e-8), -clip, clip),   clip = 5
/// Gaussian:            μ = network(x),               a ~ N(μ, diag(e^log_std)²)
/// squashed Gaussian:   (μ, h) = network(x),          a = tanh(u), u ~ N(μ, diag(σ(h))²)
/// ```
///
/// By default the policy is deterministic: as a [`Controller`] it returns μ or tanh μ.
/// [`sampling`](Self::sampling) makes it stochastic, with random numbers from [`Stream::Policy`] of
/// each simulation's seed. Actions are not clipped. σ(h) is defined in [`squashed`]. A policy
/// [with a history](Self::with_history) also sees its last observations and actions. A
/// deterministic policy (DDPG, TD3) is stored as a Gaussian whose network ends in tanh and whose
/// standard deviation is its exploration noise.
///
/// # Reference
/// Squashed Gaussian: Haarnoja, Zhou, Abbeel and Levine, "Soft Actor-Critic: Off-Policy Maximum
/// Entropy Deep Reinforcement Learning with a Stochastic Actor", ICML 2018.
///
/// # Example
/// ```
/// use mishandle_controllers::Policy;
/// use mishandle_network::{Activation, Mlp};
/// use mishandle_rollout::Controller;
///
/// let mut network = Mlp::new(&[1, 1], Activation::Elu, Activation::Identity)?;
/// network.update(|parameters| parameters.copy_from_slice(&[3.0, 0.5])); // 3 x + 0.5
/// let policy = Policy::new(vec![10.0], vec![4.0], network, vec![0.0])?; // x = (o - 10) / 2
/// let mut action = [0.0];
/// policy.worker().act(1, &[12.0], &mut [], &mut action);
/// assert_eq!(action, [3.5]);
/// # Ok::<(), mishandle_controllers::ControllerError>(())
/// ```
#[derive(Clone, Debug)]
pub struct Policy {
    mean: Vec<f64>,
    variance: Vec<f64>,
    log_std: Vec<f32>,
    clip: Option<f64>,
    core: Arc<Core>,
    samples: bool,
}

/// Normalized observations are clipped to ± this number, if a policy sets no other.
pub(crate) const DEFAULT_CLIP: Option<f64> = Some(5.0);

/// The data that all workers share.
#[derive(Clone, Debug)]
struct Core {
    history: History,
    /// Normalizes whole inputs of the network.
    normalizer: Normalizer<f32>,
    network: Mlp<f32>,
    kind: Kind,
}

/// How the network's outputs define actions.
#[derive(Clone, Debug)]
enum Kind {
    /// The outputs are the means; these are the standard deviations.
    Gaussian { std: Vec<f32> },
    /// The first half of the outputs is μ, the second h.
    Squashed,
}

impl Policy {
    /// Creates a Gaussian policy. `mean` and `variance` normalize observations, with one number per
    /// network input. Actions have the standard deviations e^`log_std`, with one number per network
    /// output.
    ///
    /// # Errors
    /// If a length does not match the network, a number is not finite, or a variance is negative.
    pub fn new(
        mean: Vec<f64>,
        variance: Vec<f64>,
        network: Mlp<f32>,
        log_std: Vec<f32>,
    ) -> Result<Policy, ControllerError> {
        Self::with_history(0, mean, variance, network, Some(log_std))
    }

    /// Creates a squashed Gaussian policy. `mean` and `variance` normalize observations. The
    /// network outputs μ of all actions, then h of all actions.
    ///
    /// # Errors
    /// If a length does not match the network, the number of outputs is odd, a number is not
    /// finite, or a variance is negative.
    ///
    /// # Example
    /// ```
    /// use mishandle_controllers::Policy;
    /// use mishandle_network::{Activation, Mlp};
    /// use mishandle_rollout::Controller;
    ///
    /// let mut network = Mlp::new(&[1, 2], Activation::Elu, Activation::Identity)?;
    /// network.update(|parameters| parameters.copy_from_slice(&[3.0, 0.0, 0.5, 0.0])); // μ = 3 x + 0.5, h = 0
    /// let policy = Policy::squashed(vec![0.0], vec![1.0], network)?;
    /// let mut action = [0.0];
    /// policy.worker().act(1, &[0.25], &mut [], &mut action);
    /// assert!((action[0] - 1.25_f32.tanh()).abs() < 1e-6);
    /// # Ok::<(), mishandle_controllers::ControllerError>(())
    /// ```
    pub fn squashed(
        mean: Vec<f64>,
        variance: Vec<f64>,
        network: Mlp<f32>,
    ) -> Result<Policy, ControllerError> {
        Self::with_history(0, mean, variance, network, None)
    }

    /// Creates a policy whose network sees the last `length` observations and actions of the policy
    /// besides the present observation, as [`History`] describes: a Gaussian policy with `log_std`,
    /// a squashed one without. `mean` and `variance` normalize every observation.
    ///
    /// # Errors
    /// As for [`new`](Self::new) and [`squashed`](Self::squashed).
    ///
    /// # Example
    /// ```
    /// use mishandle_controllers::Policy;
    /// use mishandle_network::{Activation, Mlp};
    /// use mishandle_rollout::{Controller, Seed};
    ///
    /// let mut network = Mlp::new(&[3, 1], Activation::Elu, Activation::Identity)?;
    /// network.update(|parameters| parameters.copy_from_slice(&[0.5, 0.25, 1.0, 0.0]));
    /// let policy = Policy::with_history(1, vec![0.0], vec![1.0], network, Some(vec![0.0]))?;
    /// let (mut worker, mut state, mut action) = (policy.worker(), vec![0.0; policy.state_size()], [0.0]);
    /// worker.reset(&mut state, Seed(0));
    /// worker.act(1, &[0.5], &mut state, &mut action);
    /// assert_eq!(action, [0.25]); // 0.5 · 0.5
    /// worker.act(1, &[0.0], &mut state, &mut action);
    /// assert_eq!(action, [0.375]); // 0.5 · 0 + 0.25 · 0.5 + 1 · 0.25
    /// # Ok::<(), mishandle_controllers::ControllerError>(())
    /// ```
    pub fn with_history(
        length: usize,
        mean: Vec<f64>,
        variance: Vec<f64>,
        network: Mlp<f32>,
        log_std: Option<Vec<f32>>,
    ) -> Result<Policy, ControllerError> {
        let inputs = network.input_size();
        let outputs = network.output_size();
        let (action_size, rule) = match &log_std {
            Some(log_std) => (outputs, ("`log_std`", outputs, log_std.len())),
            None => (outputs / 2, ("pairs of outputs", outputs, outputs / 2 * 2)),
        };
        let history = History::new(length, mean.len(), action_size);
        let what = if length == 0 { "normalizer" } else { "observation with its history" };
        for (what, expected, found) in [(what, inputs, history.input_size()), rule] {
            if expected != found {
                return Err(ControllerError::Size { what, expected, found });
            }
        }
        let log_std_or_none = log_std.as_deref().unwrap_or_default();
        if let Some((index, found)) = log_std_or_none.iter().enumerate().find(|(_, x)| !x.is_finite()) {
            return Err(ControllerError::LogStd { index, found: *found });
        }
        // A network from a file has finite parameters; those of a trained network may be NaN.
        network.clone().set_tensors(&network.tensors())?;
        let normalizer = history.normalizer(Normalizer::new(&mean, &variance)?);
        let kind = match &log_std {
            Some(log_std) => Kind::Gaussian { std: log_std.iter().map(|x| x.exp()).collect() },
            None => Kind::Squashed,
        };
        let log_std = log_std.unwrap_or_default();
        let core = Arc::new(Core { history, normalizer, network, kind });
        Ok(Policy { mean, variance, log_std, clip: DEFAULT_CLIP, core, samples: false })
    }

    /// Returns the policy with a history of `length` observations and actions, of which it uses
    /// only those that it used before: the network has weights of 0 for the others. So the actions
    /// are the same up to rounding, and training can start from it.
    ///
    /// # Errors
    /// If its history is longer.
    ///
    /// # Example
    /// ```
    /// use mishandle_controllers::Policy;
    /// use mishandle_network::{Activation, Mlp};
    ///
    /// let mut network = Mlp::new(&[1, 1], Activation::Elu, Activation::Identity)?;
    /// network.update(|parameters| parameters.copy_from_slice(&[3.0, 0.5]));
    /// let policy = Policy::new(vec![0.0], vec![1.0], network, vec![0.0])?.remembering(1)?;
    /// assert_eq!(policy.history().length(), 1);
    /// // Observation, earlier observation, earlier action.
    /// assert_eq!(policy.network().parameters(), [3.0, 0.0, 0.0, 0.5]);
    /// assert!(policy.remembering(0).is_err());
    /// # Ok::<(), mishandle_controllers::ControllerError>(())
    /// ```
    pub fn remembering(&self, length: usize) -> Result<Policy, ControllerError> {
        let own = self.history();
        let longer = History::new(length, own.observation_size(), own.action_size());
        let Some(count) = longer.input_size().checked_sub(own.input_size()) else {
            let what = "the history";
            let expected = own.length();
            let found = length;
            return Err(ControllerError::Size { what, expected, found });
        };
        let log_std = (!self.is_squashed()).then(|| self.log_std.clone());
        let network = self.network().with_more_inputs(count);
        let policy =
            Policy::with_history(length, self.mean.clone(), self.variance.clone(), network, log_std)?;
        Ok(policy.with_observation_clip(self.clip)?.sampling(self.samples))
    }

    /// Returns the policy with stochastic actions if `samples` is true, otherwise with
    /// deterministic actions.
    #[must_use]
    pub fn sampling(mut self, samples: bool) -> Policy {
        self.samples = samples;
        self
    }

    /// Returns the policy with normalized observations clipped to ±`clip` instead of ±5, or not
    /// clipped.
    ///
    /// # Errors
    /// If `clip` is not a positive number.
    pub fn with_observation_clip(mut self, clip: Option<f64>) -> Result<Policy, ControllerError> {
        if let Some(found) = clip.filter(|clip| !(*clip > 0.0 && clip.is_finite())) {
            return Err(ControllerError::Clip { found });
        }
        let mut core = (*self.core).clone();
        let normalizer = Normalizer::new(&self.mean, &self.variance)?;
        core.normalizer = core.history.normalizer(normalizer.with_clip(clip.unwrap_or(f64::INFINITY)));
        (self.core, self.clip) = (Arc::new(core), clip);
        Ok(self)
    }

    /// Returns the largest absolute value of a normalized observation; `None` if it is not clipped.
    pub fn observation_clip(&self) -> Option<f64> {
        self.clip
    }

    /// Returns the mean of each observation component, used for normalization.
    pub fn mean(&self) -> &[f64] {
        &self.mean
    }

    /// Returns the variance of each observation component, used for normalization.
    pub fn variance(&self) -> &[f64] {
        &self.variance
    }

    /// Returns the layout of the network's input.
    pub fn history(&self) -> History {
        self.core.history
    }

    /// Returns the network, which takes normalized inputs.
    pub fn network(&self) -> &Mlp<f32> {
        &self.core.network
    }

    /// Returns the logarithms of the actions' standard deviations; empty for a squashed policy,
    /// whose network outputs them.
    pub fn log_std(&self) -> &[f32] {
        &self.log_std
    }

    /// Returns whether the policy is squashed.
    pub fn is_squashed(&self) -> bool {
        matches!(self.core.kind, Kind::Squashed)
    }

    /// Returns the name of the kind of policy as stored in files.
    pub fn kind(&self) -> &'static str {
        if self.is_squashed() { SQUASHED } else { GAUSSIAN }
    }

    /// Returns a hash of everything that determines the actions: the first 16 bytes of a SHA-256,
    /// in hexadecimal.
    ///
    /// It does not depend on the training record.
    pub fn hash(&self) -> String {
        let network = self.network();
        let mut digest = Sha256::new();
        digest.update(format!(
            "{}\0{:?}\0{}\0{}\0{}\n",
            self.kind(),
            network.sizes(),
            network.hidden_activation(),
            network.output_activation(),
            self.samples
        ));
        for number in self.mean.iter().chain(&self.variance) {
            digest.update(number.to_le_bytes());
        }
        for number in network.parameters().iter().chain(&self.log_std) {
            digest.update(number.to_le_bytes());
        }
        // Not in the hash of policies without them, whose hashes are in old run files.
        if network.has_layer_norm() {
            digest.update("layer norm\n");
            for tensor in network.tensors().iter().filter(|tensor| tensor.name.contains(".norm.")) {
                tensor.values.iter().for_each(|number| digest.update(number.to_le_bytes()));
            }
        }
        if self.clip != DEFAULT_CLIP {
            digest.update(format!("clip {:?}\n", self.clip));
        }
        if self.core.history.length() > 0 {
            digest.update(format!("history {}\n", self.core.history.length()));
        }
        hexadecimal(&digest.finalize()[..16])
    }
}

/// The names of the kinds of policies in files.
pub(crate) const GAUSSIAN: &str = "gaussian";
pub(crate) const SQUASHED: &str = "squashed-gaussian";

/// The state of the samples of a stochastic policy: two halves of the seed, each exact in an `f64`,
/// and the control step.
const SAMPLING_STATE: usize = 3;

impl Controller for Policy {
    fn observation_size(&self) -> usize {
        self.core.history.observation_size()
    }

    fn action_size(&self) -> usize {
        let outputs = self.network().output_size();
        if self.is_squashed() { outputs / 2 } else { outputs }
    }

    /// The memory of the history, then the state of the samples.
    fn state_size(&self) -> usize {
        self.core.history.memory_size() + if self.samples { SAMPLING_STATE } else { 0 }
    }

    fn worker(&self) -> Box<dyn ControllerWorker> {
        Box::new(PolicyWorker {
            core: self.core.clone(),
            samples: self.samples,
            workspace: Workspace::default(),
            inputs: Vec::new(),
            noise: vec![0.0; self.action_size()],
            state_size: self.state_size(),
        })
    }
}

struct PolicyWorker {
    core: Arc<Core>,
    samples: bool,
    workspace: Workspace<f32>,
    inputs: Vec<f32>,
    noise: Vec<f64>,
    state_size: usize,
}

impl ControllerWorker for PolicyWorker {
    fn reset(&mut self, state: &mut [f64], seed: Seed) {
        let (memory, samples) = state.split_at_mut(self.core.history.memory_size());
        memory.fill(0.0);
        if self.samples {
            samples.copy_from_slice(&[f64::from(seed.0 as u32), f64::from((seed.0 >> 32) as u32), 0.0]);
        }
    }

    fn act(&mut self, rows: usize, observations: &[f32], states: &mut [f64], actions: &mut [f32]) {
        let Core { history, normalizer, network, kind } = self.core.as_ref();
        let columns = history.observation_size();
        let inputs = history.input_size();
        let memory = history.memory_size();
        self.inputs.resize(rows * inputs, 0.0);
        for (row, input) in self.inputs.chunks_exact_mut(inputs).enumerate() {
            let state = &states[row * self.state_size..][..memory];
            history.write_input(&observations[row * columns..][..columns], state, input);
        }
        normalizer.normalize(&mut self.inputs);
        let outputs = network.forward(&self.inputs, &mut self.workspace);
        let size = self.noise.len();
        for (row, action) in actions.chunks_exact_mut(size).enumerate() {
            let state = &mut states[row * self.state_size..][..self.state_size];
            let (memory, samples) = state.split_at_mut(memory);
            if let [low, high, step] = samples {
                let seed = Seed(*low as u64 | (*high as u64) << 32);
                seed.normals(Stream::Policy, *step as u64, &mut self.noise);
                *step += 1.0;
            }
            match kind {
                Kind::Gaussian { std } => {
                    let outputs = &outputs[row * size..][..size];
                    for (((a, output), std), z) in action.iter_mut().zip(outputs).zip(std).zip(&self.noise) {
                        *a = if self.samples { output + std * *z as f32 } else { *output };
                    }
                }
                Kind::Squashed => {
                    let (means, raw) = outputs[row * 2 * size..][..2 * size].split_at(size);
                    for (((a, mean), raw), z) in action.iter_mut().zip(means).zip(raw).zip(&self.noise) {
                        let u = if self.samples {
                            f64::from(*mean) + squashed::log_std(f64::from(*raw)).exp() * z
                        } else {
                            f64::from(*mean)
                        };
                        *a = tanh(u as f32);
                    }
                }
            }
            history.push(memory, &observations[row * columns..][..columns], action);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mishandle_network::Activation;

    /// Returns a policy with two observations, three actions and random weights.
    fn policy(seed: u64) -> Policy {
        let mut network = Mlp::new(&[2, 20, 3], Activation::Elu, Activation::Identity).unwrap();
        let mut index = 0;
        network.initialize_uniform(|| {
            index += 1;
            Seed(seed).uniform(Stream::Weights, 0, index)
        });
        Policy::new(vec![0.1, -0.2], vec![0.5, 2.0], network, vec![-1.0, 0.0, 0.5]).unwrap()
    }

    #[test]
    fn a_row_does_not_depend_on_the_batch_size() {
        let policy = policy(1).sampling(true);
        let observations: Vec<f32> = (0..2 * 37).map(|i| (i as f32 * 0.7).sin()).collect();
        let mut worker = policy.worker();
        let mut states = vec![0.0; 37 * SAMPLING_STATE];
        for (row, state) in states.chunks_mut(SAMPLING_STATE).enumerate() {
            worker.reset(state, Seed(u64::MAX - row as u64));
        }
        let mut alone_states = states.clone();
        let mut together = vec![0.0; 3 * 37];
        let mut alone = vec![0.0; 3 * 37];
        for _step in 0..2 {
            worker.act(37, &observations, &mut states, &mut together);
            for row in 0..37 {
                let state = &mut alone_states[row * SAMPLING_STATE..][..SAMPLING_STATE];
                worker.act(1, &observations[2 * row..][..2], state, &mut alone[3 * row..][..3]);
            }
            assert_eq!(together, alone);
            assert_eq!(states, alone_states);
        }
    }

    /// Returns a policy with a history of 2, two observations and one action, and the policy
    /// without a history whose observations are the whole inputs of the same network.
    fn with_history_and_without() -> (Policy, Policy) {
        let mut network = Mlp::new(&[8, 20, 1], Activation::Elu, Activation::Identity).unwrap();
        let mut index = 0;
        network.initialize_uniform(|| {
            index += 1;
            Seed(5).uniform(Stream::Weights, 0, index)
        });
        let mean = vec![0.1, -0.2];
        let variance = vec![0.25, 4.0];
        let wide = |observation: &[f64], action: f64| {
            [observation, observation, &[action], observation, &[action]].concat()
        };
        let plain = Policy::new(wide(&mean, 0.0), wide(&variance, 1.0), network.clone(), vec![1.0]).unwrap();
        (Policy::with_history(2, mean, variance, network, Some(vec![1.0])).unwrap(), plain)
    }

    #[test]
    fn a_history_is_the_input_of_the_last_observations_and_clipped_actions() {
        let (policy, plain) = with_history_and_without();
        assert_eq!((policy.observation_size(), policy.action_size(), policy.state_size()), (2, 1, 6));
        for samples in [false, true] {
            let policy = policy.clone().sampling(samples);
            let plain = plain.clone().sampling(samples);
            let mut worker = policy.worker();
            let mut expected = plain.worker();
            let mut state = vec![7.0; policy.state_size()];
            let mut plain_state = vec![7.0; plain.state_size()];
            worker.reset(&mut state, Seed(3));
            expected.reset(&mut plain_state, Seed(3));
            let mut past = vec![0.0; 6];
            for step in 0..40 {
                let observation = [(step as f32 * 0.7).sin(), 9.0 * (step as f32 * 0.3).cos()];
                let mut action = [0.0];
                let mut other = [0.0];
                worker.act(1, &observation, &mut state, &mut action);
                expected.act(1, &[&observation[..], &past].concat(), &mut plain_state, &mut other);
                assert_eq!(action, other, "{step}");
                past = [&observation[..], &[action[0].clamp(-1.0, 1.0)], &past[..3]].concat();
            }
        }
    }

    #[test]
    fn a_row_with_a_history_does_not_depend_on_the_batch_or_on_episodes_before() {
        let policy = with_history_and_without().0.sampling(true);
        let mut worker = policy.worker();
        let size = policy.state_size();
        let rows = 19;
        let mut states = vec![0.5; rows * size];
        for (row, state) in states.chunks_mut(size).enumerate() {
            worker.reset(state, Seed(row as u64));
        }
        let mut alone_states = states.clone();
        let mut together = vec![0.0; rows];
        let mut alone = vec![0.0; rows];
        let mut first = Vec::new();
        for step in 0..5 {
            let observations: Vec<f32> = (0..2 * rows).map(|i| ((i + 7 * step) as f32).sin()).collect();
            worker.act(rows, &observations, &mut states, &mut together);
            for row in 0..rows {
                let state = &mut alone_states[row * size..][..size];
                worker.act(1, &observations[2 * row..][..2], state, &mut alone[row..][..1]);
            }
            assert_eq!(together, alone);
            assert_eq!(states, alone_states);
            first.push((observations[..2].to_vec(), together[0]));
        }
        worker.reset(&mut states[..size], Seed(0));
        for (observation, expected) in first {
            let mut action = [0.0];
            worker.act(1, &observation, &mut states[..size], &mut action);
            assert_eq!(action, [expected]);
        }
    }

    #[test]
    fn the_clip_of_observations_holds_for_those_of_the_history_and_for_no_action() {
        // The output is the sum of the inputs.
        let mut network = Mlp::new(&[3, 1], Activation::Elu, Activation::Identity).unwrap();
        network.update(|parameters| parameters.copy_from_slice(&[1.0, 1.0, 1.0, 0.0]));
        let policy = Policy::with_history(1, vec![0.0], vec![1.0], network, Some(vec![0.0])).unwrap();
        let policy = policy.with_observation_clip(Some(0.25)).unwrap();
        let mut worker = policy.worker();
        let mut state = [0.0; 2];
        let mut action = [0.0];
        let mut act = |observation| {
            worker.act(1, &[observation], &mut state, &mut action);
            action[0]
        };
        // 0.25; 0.25 + 0.25 + 0.25; 0 + 0.25 + 0.75; 0.25 + 0 + 1, which is kept as 1: 0 + 0.25 +
        // 1.
        assert_eq!([3.0, 8.0, 0.0, 0.25, 0.0].map(&mut act), [0.25, 0.75, 1.0, 1.25, 1.25]);
    }

    #[test]
    fn samples_have_the_specified_mean_and_standard_deviation() {
        let policy = policy(2);
        let mut mean = [0.0; 3];
        policy.worker().act(1, &[0.3, 0.4], &mut [], &mut mean);
        let rows = 20_000;
        let mut worker = policy.sampling(true).worker();
        let mut states = vec![0.0; rows * SAMPLING_STATE];
        for (row, state) in states.chunks_mut(SAMPLING_STATE).enumerate() {
            worker.reset(state, Seed(row as u64));
        }
        let mut actions = vec![0.0; 3 * rows];
        worker.act(rows, &[0.3, 0.4].repeat(rows), &mut states, &mut actions);
        for (i, log_std) in [-1.0_f64, 0.0, 0.5].into_iter().enumerate() {
            let deviations = actions.chunks(3).map(|row| f64::from(row[i] - mean[i]));
            let std = log_std.exp();
            let n = rows as f64;
            // Five standard errors.
            assert!((deviations.clone().sum::<f64>() / n).abs() < 5.0 * std / n.sqrt());
            let variance = deviations.map(|x| x * x).sum::<f64>() / n;
            assert!((variance / (std * std) - 1.0).abs() < 5.0 * (2.0 / n).sqrt());
        }
    }

    #[test]
    fn squashed_samples_are_the_tanh_of_gaussian_samples() {
        let mut network = Mlp::new(&[1, 2], Activation::Elu, Activation::Identity).unwrap();
        network.update(|parameters| parameters.copy_from_slice(&[0.0, 0.0, 0.3, 0.25]));
        let policy = Policy::squashed(vec![0.0], vec![1.0], network).unwrap();
        assert_eq!((policy.action_size(), policy.log_std().len()), (1, 0));
        let rows = 20_000;
        let mut worker = policy.clone().sampling(true).worker();
        let mut states = vec![0.0; rows * SAMPLING_STATE];
        for (row, state) in states.chunks_mut(SAMPLING_STATE).enumerate() {
            worker.reset(state, Seed(row as u64));
        }
        let mut actions = vec![0.0; rows];
        worker.act(rows, &vec![0.7; rows], &mut states, &mut actions);
        // log σ = -5 + 3.5 (1 + tanh 0.25) = -0.64279
        let std = (-0.64279_f64).exp();
        let n = rows as f64;
        let deviations = actions.iter().map(|a| f64::from(*a).atanh() - 0.3);
        assert!((deviations.clone().sum::<f64>() / n).abs() < 5.0 * std / n.sqrt());
        let variance = deviations.map(|x| x * x).sum::<f64>() / n;
        assert!((variance / (std * std) - 1.0).abs() < 5.0 * (2.0 / n).sqrt());
        assert_ne!(policy.hash(), policy.clone().sampling(true).hash());
        let odd = Mlp::new(&[1, 3], Activation::Elu, Activation::Identity).unwrap();
        let message = Policy::squashed(vec![0.0], vec![1.0], odd).unwrap_err().to_string();
        assert_eq!(message, "the policy's pairs of outputs has 2 numbers; its network needs 3");
    }

    #[test]
    fn the_hash_depends_on_every_part() {
        let a = policy(1);
        let b = policy(2);
        assert_eq!(a.hash(), policy(1).hash());
        let rebuilt = |mean: Vec<f64>, log_std: Vec<f32>| {
            Policy::new(mean, a.variance().to_vec(), a.network().clone(), log_std).unwrap()
        };
        let others = [
            b,
            rebuilt(vec![0.1, -0.3], a.log_std().to_vec()),
            rebuilt(a.mean().to_vec(), vec![-1.0, 0.0, 0.4]),
            a.clone().sampling(true),
        ];
        others.iter().for_each(|other| assert_ne!(a.hash(), other.hash()));
        let (with, without) = with_history_and_without();
        assert_ne!(with.hash(), without.hash());
    }

    #[test]
    fn the_clip_and_the_gains_of_layers_change_actions_and_hash() {
        let act = |policy: &Policy| {
            let mut action = [0.0; 3];
            policy.worker().act(1, &[30.0, 0.0], &mut [], &mut action);
            action
        };
        let usual = policy(1);
        let same = usual.clone().with_observation_clip(Some(5.0)).unwrap();
        assert_eq!((act(&same), same.hash()), (act(&usual), usual.hash()));
        let free = usual.clone().with_observation_clip(None).unwrap();
        assert_ne!(act(&free), act(&usual));
        assert_ne!(free.hash(), usual.hash());
        let message = usual.clone().with_observation_clip(Some(0.0)).unwrap_err().to_string();
        assert_eq!(
            message,
            "normalized observations cannot be clipped to ±0; give a positive number, or none"
        );
        let normed = |network: Mlp<f32>| {
            Policy::new(usual.mean().to_vec(), usual.variance().to_vec(), network, vec![0.0; 3]).unwrap()
        };
        let plain = normed(usual.network().clone().with_layer_norm());
        let affine = normed(usual.network().clone().with_affine_layer_norm());
        // Gains of 1 and shifts of 0 change no action.
        assert_eq!(act(&affine), act(&plain));
        assert_ne!(act(&plain), act(&usual));
        assert_ne!(affine.hash(), plain.hash());
    }

    #[test]
    fn parts_of_the_wrong_length_and_nan_are_errors() {
        let network = policy(1).network().clone();
        let make = |mean: Vec<f64>, network: Mlp<f32>, log_std: Vec<f32>| {
            Policy::new(mean, vec![1.0; 2], network, log_std).unwrap_err().to_string()
        };
        assert_eq!(
            make(vec![0.0], network.clone(), vec![0.0; 3]),
            "the policy's normalizer has 1 numbers; its network needs 2"
        );
        assert_eq!(
            make(vec![0.0; 2], network.clone(), vec![0.0, f32::NAN, 0.0]),
            "number 1 of the policy's `log_std` is NaN; it must be finite"
        );
        let with_history = |length| {
            let policy =
                Policy::with_history(length, vec![0.0], vec![1.0], network.clone(), Some(vec![0.0; 3]));
            policy.unwrap_err().to_string()
        };
        for (length, found) in [(1, 5), (usize::MAX, usize::MAX)] {
            assert_eq!(
                with_history(length),
                format!("the policy's observation with its history has {found} numbers; its network needs 2")
            );
        }
        let mut damaged = network;
        damaged.update(|parameters| parameters[4] = f32::NAN);
        assert_eq!(
            make(vec![0.0; 2], damaged, vec![0.0; 3]),
            "number 4 of `layers.0.weight` is NaN; it must be finite"
        );
    }
}
