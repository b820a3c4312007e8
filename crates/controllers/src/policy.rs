//! A learned Gaussian policy.

use std::sync::Arc;

use mishandle_network::{Mlp, Normalizer, Workspace};
use mishandle_rollout::{Actor, Controller, Seed, Stream};
use sha2::{Digest, Sha256};

use crate::ControllerError;
use crate::layout::hexadecimal;

/// A Gaussian policy: a frozen normaliser, a network that gives the mean, and a standard deviation for each action.
///
/// ```text
/// μ(o) = network(clamp((o - mean) / (√variance + 1e-8), -5, 5)),   a ~ N(μ(o), diag(e^log_std)²)
/// ```
///
/// As a [`Controller`] it gives the mean; [`sampling`](Self::sampling) gives one that draws, from
/// [`Stream::Policy`] of each simulation's seed. Actions are not clipped here.
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
/// policy.actor().act(1, &[12.0], &mut [], &mut action);
/// assert_eq!(action, [3.5]);
/// # Ok::<(), mishandle_controllers::ControllerError>(())
/// ```
#[derive(Clone, Debug)]
pub struct Policy {
    mean: Vec<f64>,
    variance: Vec<f64>,
    log_std: Vec<f32>,
    core: Arc<Core>,
    samples: bool,
}

/// What every actor reads.
#[derive(Debug)]
struct Core {
    normalizer: Normalizer<f32>,
    network: Mlp<f32>,
    std: Vec<f32>,
}

impl Policy {
    /// A policy that scales observations by `mean` and `variance` (one number for each of the network's inputs), and
    /// whose actions have the standard deviations e^`log_std` (one for each output).
    ///
    /// # Errors
    /// If a length is not the network's, or a number is not finite, or a variance negative.
    pub fn new(
        mean: Vec<f64>,
        variance: Vec<f64>,
        network: Mlp<f32>,
        log_std: Vec<f32>,
    ) -> Result<Policy, ControllerError> {
        for (what, wanted, found) in [
            ("normaliser", network.input_size(), mean.len()),
            ("`log_std`", network.output_size(), log_std.len()),
        ] {
            if wanted != found {
                return Err(ControllerError::Size { what, wanted, found });
            }
        }
        if let Some((index, found)) = log_std.iter().enumerate().find(|(_, x)| !x.is_finite()) {
            return Err(ControllerError::LogStd { index, found: *found });
        }
        // A network that was set from tensors holds finite numbers alone; one that was trained may not.
        network.clone().set_tensors(&network.tensors())?;
        let normalizer = Normalizer::new(&mean, &variance)?;
        let std = log_std.iter().map(|x| x.exp()).collect();
        let core = Arc::new(Core { normalizer, network, std });
        Ok(Policy { mean, variance, log_std, core, samples: false })
    }

    /// The same policy, drawing its actions if `samples`, giving their mean if not.
    #[must_use]
    pub fn sampling(mut self, samples: bool) -> Policy {
        self.samples = samples;
        self
    }

    /// Mean of each observation, by which it is scaled.
    pub fn mean(&self) -> &[f64] {
        &self.mean
    }

    /// Variance of each observation, by which it is scaled.
    pub fn variance(&self) -> &[f64] {
        &self.variance
    }

    /// The network that gives the mean action.
    pub fn network(&self) -> &Mlp<f32> {
        &self.core.network
    }

    /// Logarithms of the standard deviations of the actions.
    pub fn log_std(&self) -> &[f32] {
        &self.log_std
    }

    /// A hash of all that decides its actions: the first 16 bytes of a SHA-256, in hexadecimal.
    ///
    /// Policies with the same weights have the same, whenever, wherever and for how long they were trained.
    pub fn hash(&self) -> String {
        let network = self.network();
        let mut digest = Sha256::new();
        digest.update(format!(
            "gaussian\0{:?}\0{}\0{}\0{}\n",
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
        hexadecimal(&digest.finalize()[..16])
    }
}

/// Numbers of a sampling policy's memory: two halves of the seed, each exact in an `f64`, and the control step.
const MEMORY: usize = 3;

impl Controller for Policy {
    fn observation_size(&self) -> usize {
        self.network().input_size()
    }

    fn action_size(&self) -> usize {
        self.network().output_size()
    }

    fn state_size(&self) -> usize {
        if self.samples { MEMORY } else { 0 }
    }

    fn actor(&self) -> Box<dyn Actor> {
        Box::new(PolicyActor {
            core: self.core.clone(),
            samples: self.samples,
            workspace: Workspace::default(),
            inputs: Vec::new(),
            draws: vec![0.0; self.action_size()],
        })
    }
}

struct PolicyActor {
    core: Arc<Core>,
    samples: bool,
    workspace: Workspace<f32>,
    inputs: Vec<f32>,
    draws: Vec<f64>,
}

impl Actor for PolicyActor {
    fn reset(&mut self, state: &mut [f64], seed: Seed) {
        if self.samples {
            state.copy_from_slice(&[f64::from(seed.0 as u32), f64::from((seed.0 >> 32) as u32), 0.0]);
        }
    }

    fn act(&mut self, rows: usize, observations: &[f32], states: &mut [f64], actions: &mut [f32]) {
        let Core { normalizer, network, std } = self.core.as_ref();
        self.inputs.clear();
        self.inputs.extend_from_slice(&observations[..rows * network.input_size()]);
        normalizer.normalize(&mut self.inputs);
        actions.copy_from_slice(network.forward(&self.inputs, &mut self.workspace));
        if self.samples {
            for (memory, action) in states.chunks_mut(MEMORY).zip(actions.chunks_mut(std.len())) {
                let seed = Seed(memory[0] as u64 | (memory[1] as u64) << 32);
                seed.normals(Stream::Policy, memory[2] as u64, &mut self.draws);
                memory[2] += 1.0;
                for ((a, std), z) in action.iter_mut().zip(std).zip(&self.draws) {
                    *a += std * *z as f32;
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mishandle_network::Activation;

    /// Two observations, three actions, weights drawn from `seed`.
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
    fn a_row_is_the_same_alone_and_among_others() {
        let policy = policy(1).sampling(true);
        let observations: Vec<f32> = (0..2 * 37).map(|i| (i as f32 * 0.7).sin()).collect();
        let mut actor = policy.actor();
        let mut states = vec![0.0; 37 * MEMORY];
        for (row, state) in states.chunks_mut(MEMORY).enumerate() {
            actor.reset(state, Seed(u64::MAX - row as u64));
        }
        let mut alone_states = states.clone();
        let (mut together, mut alone) = (vec![0.0; 3 * 37], vec![0.0; 3 * 37]);
        for _step in 0..2 {
            actor.act(37, &observations, &mut states, &mut together);
            for row in 0..37 {
                let memory = &mut alone_states[row * MEMORY..][..MEMORY];
                actor.act(1, &observations[2 * row..][..2], memory, &mut alone[3 * row..][..3]);
            }
            assert_eq!(together, alone);
            assert_eq!(states, alone_states);
        }
    }

    #[test]
    fn draws_have_the_mean_and_the_deviations_that_were_asked_for() {
        let policy = policy(2);
        let mut mean = [0.0; 3];
        policy.actor().act(1, &[0.3, 0.4], &mut [], &mut mean);
        let rows = 20_000;
        let (mut actor, mut states) = (policy.sampling(true).actor(), vec![0.0; rows * MEMORY]);
        for (row, state) in states.chunks_mut(MEMORY).enumerate() {
            actor.reset(state, Seed(row as u64));
        }
        let mut actions = vec![0.0; 3 * rows];
        actor.act(rows, &[0.3, 0.4].repeat(rows), &mut states, &mut actions);
        for (i, log_std) in [-1.0_f64, 0.0, 0.5].into_iter().enumerate() {
            let deviations = actions.chunks(3).map(|row| f64::from(row[i] - mean[i]));
            let (std, n) = (log_std.exp(), rows as f64);
            // Five standard errors.
            assert!((deviations.clone().sum::<f64>() / n).abs() < 5.0 * std / n.sqrt());
            let variance = deviations.map(|x| x * x).sum::<f64>() / n;
            assert!((variance / (std * std) - 1.0).abs() < 5.0 * (2.0 / n).sqrt());
        }
    }

    #[test]
    fn the_hash_sees_every_part() {
        let (a, b) = (policy(1), policy(2));
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
    }

    #[test]
    fn parts_that_do_not_fit_or_are_not_numbers_are_refused() {
        let network = policy(1).network().clone();
        let make = |mean: Vec<f64>, network: Mlp<f32>, log_std: Vec<f32>| {
            Policy::new(mean, vec![1.0; 2], network, log_std).unwrap_err().to_string()
        };
        assert_eq!(
            make(vec![0.0], network.clone(), vec![0.0; 3]),
            "the policy's normaliser has 1 numbers, its network 2"
        );
        assert_eq!(
            make(vec![0.0; 2], network.clone(), vec![0.0, f32::NAN, 0.0]),
            "the policy's `log_std` must be finite; number 1 is NaN"
        );
        let mut damaged = network;
        damaged.update(|parameters| parameters[4] = f32::NAN);
        assert_eq!(
            make(vec![0.0; 2], damaged, vec![0.0; 3]),
            "`layers.0.weight` must be finite; number 4 is NaN"
        );
    }
}
