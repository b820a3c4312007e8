//! Reward terms of several tasks.

use crate::robot::ARM_JOINTS;

/// Returns a penalty for large actions: -0.01 times the mean of the arm's squared actions.
pub fn action_penalty(action: &[f64]) -> f64 {
    -0.01 * action[..ARM_JOINTS].iter().map(|a| a * a).sum::<f64>() / ARM_JOINTS as f64
}
