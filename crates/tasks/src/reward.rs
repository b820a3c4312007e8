//! Terms that several rewards share.

use crate::robot::ARM_JOINTS;

/// A small cost of moving: -0.01 times the mean of the arm's squared actions.
pub fn effort(action: &[f64]) -> f64 {
    -0.01 * action[..ARM_JOINTS].iter().map(|a| a * a).sum::<f64>() / ARM_JOINTS as f64
}
