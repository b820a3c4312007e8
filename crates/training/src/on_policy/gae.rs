//! Generalized advantage estimation.

use crate::Boundary;

/// Computes the advantages of `steps` control steps in `rows` environments; terminations and
/// truncations differ.
///
/// ```text
/// δ_t = r_t + γ V(s_t+1) - V(s_t)        V(s_t+1) = 0 if the step terminated the episode
/// A_t = δ_t + γ λ A_t+1                  A_t = δ_t if the episode or the rollout ended with the step
/// ```
///
/// All slices have the shape `[steps, rows]`, time first. `next_values` are the values of the
/// observations after the steps. For a truncated episode, this is its final observation, not the
/// observation after the reset. The next value of a terminated step is ignored.
///
/// # Panics
/// If the lengths differ or are not a multiple of `rows`.
///
/// # Example
/// ```
/// use mishandle_training::{Boundary, gae::advantages};
/// let mut out = [0.0; 2];
/// let (rewards, values, next_values) = ([1.0, 2.0], [0.5, 0.5], [0.5, 9.0]);
/// advantages(0.5, 0.5, 1, &rewards, &values, &next_values, &[Boundary::Running, Boundary::Terminated], &mut out);
/// assert_eq!(out, [1.125, 1.5]); // 2 - 0.5; 1 + 0.5 0.5 - 0.5 + 0.5 0.5 1.5
/// ```
///
/// # Reference
/// Schulman, Moritz, Levine, Jordan and Abbeel, "High-Dimensional Continuous Control Using
/// Generalized Advantage Estimation", ICLR 2016. Pardo, Tavakoli, Levdik and Kormushev, "Time
/// Limits in Reinforcement Learning", ICML 2018.
#[expect(clippy::too_many_arguments, reason = "two constants and five arrays of one formula")]
pub fn advantages(
    gamma: f64,
    gae_lambda: f64,
    rows: usize,
    rewards: &[f64],
    values: &[f64],
    next_values: &[f64],
    boundaries: &[Boundary],
    out: &mut [f64],
) {
    let count = out.len();
    assert!(rows > 0 && count.is_multiple_of(rows), "{count} advantages for {rows} rows");
    let lengths = [rewards.len(), values.len(), next_values.len(), boundaries.len()];
    assert!(lengths == [count; 4], "arrays of {lengths:?} numbers, expected {count}");
    for i in (0..count).rev() {
        let bootstrap = if boundaries[i] == Boundary::Terminated { 0.0 } else { next_values[i] };
        let delta = rewards[i] + gamma * bootstrap - values[i];
        let continues = boundaries[i] == Boundary::Running && i + rows < count;
        out[i] = if continues { delta + gamma * gae_lambda * out[i + rows] } else { delta };
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use Boundary::{Running, Terminated, Truncated};

    /// One row, γ = 0.5 and λ = 0.5, so that γ λ = 1/4; rewards 1 2 4, values 1 1 1, next values 1
    /// 1 3.
    #[track_caller]
    fn check(boundaries: [Boundary; 3], expected: [f64; 3]) {
        let mut out = [0.0; 3];
        advantages(0.5, 0.5, 1, &[1.0, 2.0, 4.0], &[1.0; 3], &[1.0, 1.0, 3.0], &boundaries, &mut out);
        assert_eq!(out, expected);
    }

    #[test]
    fn advantage_of_a_running_episode_sums_all_later_deltas() {
        // δ = 1 + 0.5 - 1, 2 + 0.5 - 1, 4 + 1.5 - 1 = 0.5 1.5 4.5; A = 0.5 + (1.5 + 4.5 / 4) / 4,
        // 1.5 + 4.5 / 4, 4.5
        check([Running, Running, Running], [1.15625, 2.625, 4.5]);
    }

    #[test]
    fn value_after_a_termination_is_zero() {
        // The last δ is 4 - 1 = 3.
        check([Running, Running, Terminated], [0.5 + (1.5 + 0.75) / 4.0, 1.5 + 0.75, 3.0]);
        // The second step ends: δ = 2 - 1, and the next episode does not contribute.
        check([Running, Terminated, Running], [0.5 + 0.25, 1.0, 4.5]);
    }

    #[test]
    fn a_truncation_bootstraps_the_value_and_ends_the_sum() {
        check([Running, Truncated, Running], [0.5 + 1.5 / 4.0, 1.5, 4.5]);
        check([Running, Running, Truncated], [1.15625, 2.625, 4.5]);
    }

    #[test]
    fn rows_are_independent() {
        let mut out = [0.0; 4];
        let boundaries = [Running, Terminated, Running, Running];
        advantages(0.5, 0.5, 2, &[1.0, 2.0, 3.0, 4.0], &[0.0; 4], &[0.0; 4], &boundaries, &mut out);
        assert_eq!(out, [1.75, 2.0, 3.0, 4.0]);
    }

    #[test]
    fn with_lambda_one_the_advantage_is_the_return_minus_the_value() {
        let rewards = [0.3, -0.2, 0.7, 0.1];
        let values = [0.4, 0.1, -0.6, 0.2];
        let next_values = [0.1, -0.6, 0.2, 0.9];
        let mut out = [0.0; 4];
        advantages(0.9, 1.0, 1, &rewards, &values, &next_values, &[Running; 4], &mut out);
        let mut tail = 0.9;
        for i in (0..4).rev() {
            tail = rewards[i] + 0.9 * tail;
            assert!((out[i] - (tail - values[i])).abs() < 1e-15);
        }
    }
}
