//! Optimizers, moments and policies in a checkpoint.

use mishandle_controllers::Policy;
use mishandle_network::{Adam, Mlp, Moments};

use super::Checkpoint;
use crate::TrainingError;

impl Checkpoint {
    /// Adds the state of an optimizer.
    pub fn put_adam(&mut self, name: &str, adam: &Adam<f32>) {
        self.put(&format!("{name}.first_moments"), adam.first_moments().to_vec());
        self.put(&format!("{name}.second_moments"), adam.second_moments().to_vec());
        self.put(&format!("{name}.learning_rate"), vec![adam.learning_rate]);
        self.put(&format!("{name}.steps"), vec![adam.steps()]);
    }

    /// Returns the optimizer `name` of `count` parameters.
    ///
    /// # Errors
    /// If the checkpoint has no such optimizer.
    pub fn adam(&self, name: &str, count: usize) -> Result<Adam<f32>, TrainingError> {
        let first = self.f32s(&format!("{name}.first_moments"), count)?.to_vec();
        let second = self.f32s(&format!("{name}.second_moments"), count)?.to_vec();
        let learning_rate = self.f64s(&format!("{name}.learning_rate"), 1)?[0];
        Ok(Adam::resume(learning_rate, first, second, self.u64s(&format!("{name}.steps"), 1)?[0])?)
    }

    /// Adds the moments of a normalizer.
    pub fn put_moments(&mut self, name: &str, moments: &Moments) {
        self.put(&format!("{name}.count"), vec![moments.count()]);
        self.put(&format!("{name}.mean"), moments.mean().to_vec());
        self.put(&format!("{name}.squares"), moments.squares().to_vec());
    }

    /// Returns the moments `name` of `columns` columns.
    ///
    /// # Errors
    /// If the checkpoint has no such moments.
    pub fn moments(&self, name: &str, columns: usize) -> Result<Moments, TrainingError> {
        let count = self.f64s(&format!("{name}.count"), 1)?[0];
        let mean = self.f64s(&format!("{name}.mean"), columns)?.to_vec();
        Ok(Moments::resume(count, mean, self.f64s(&format!("{name}.squares"), columns)?.to_vec())?)
    }

    /// Adds a policy.
    pub fn put_policy(&mut self, name: &str, policy: &Policy) {
        self.put(&format!("{name}.mean"), policy.mean().to_vec());
        self.put(&format!("{name}.variance"), policy.variance().to_vec());
        self.put(&format!("{name}.parameters"), policy.network().parameters().to_vec());
        self.put(&format!("{name}.log_std"), policy.log_std().to_vec());
        if policy.history().length() > 0 {
            self.put(&format!("{name}.history"), vec![policy.history().length() as u64]);
        }
    }

    /// Returns the policy `name` with the sizes of `like`.
    ///
    /// # Errors
    /// If the checkpoint has no such policy.
    pub fn policy(&self, name: &str, like: &Mlp<f32>) -> Result<Policy, TrainingError> {
        let mut network = Mlp::new(like.sizes(), like.hidden_activation(), like.output_activation())?;
        let parameters = self.f32s(&format!("{name}.parameters"), network.parameter_count())?;
        network.update(|own| own.copy_from_slice(parameters));
        let history = format!("{name}.history");
        let log_std = format!("{name}.log_std");
        let history = if self.contains(&history) { self.u64s(&history, 1)?[0] as usize } else { 0 };
        let is_squashed = self.f32s(&log_std, 0).is_ok();
        let actions = like.output_size() / if is_squashed { 2 } else { 1 };
        // The inputs are an observation, and one with an action for each step of the history.
        let past_actions = history.saturating_mul(actions);
        let columns = like.input_size().saturating_sub(past_actions) / history.saturating_add(1);
        let mean = self.f64s(&format!("{name}.mean"), columns)?.to_vec();
        let variance = self.f64s(&format!("{name}.variance"), columns)?.to_vec();
        let log_std =
            if is_squashed { None } else { Some(self.f32s(&log_std, like.output_size())?.to_vec()) };
        Ok(Policy::with_history(history, mean, variance, network, log_std)?)
    }
}
