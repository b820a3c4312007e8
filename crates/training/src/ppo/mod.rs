//! Proximal policy optimisation.
//!
//! ```text
//! r = π(a|s) / π_old(a|s)
//! maximise  mean min(r A, clip(r, 1-ε, 1+ε) A) + entropy_coef H(π)
//! minimise  mean ½ (V(s) - (A + V_old(s)))²
//! ```
//!
//! By default, advantages come from [`gae`](crate::gae) with the value of the true last observation where the clock
//! ended an episode, and are normalised in each minibatch. Policy and critic are two networks with an optimiser and a
//! limit on the gradient's norm each, so that a weight between the two losses would change nothing. Minibatches are
//! shuffled anew in each epoch. Observations are scaled by running moments, which are held while a rollout and its
//! learning last, so that the first ratios are exactly 1.
//!
//! The preset `skrl-0.10` makes it the PPO of skrl 0.10.2, which differs in most of these points: `docs/presets.md`.
//!
//! # Reference
//! Schulman, Wolski, Dhariwal, Radford and Klimov, "Proximal Policy Optimization Algorithms", 2017.
//! Andrychowicz et al., "What Matters for On-Policy Deep Actor-Critic Methods?", ICLR 2021.

mod config;
mod loss;
mod train;

pub use config::{GradNorm, PpoConfig, Reduction, Schedule, Standardized};
pub use loss::{Surrogate, clipped_value_loss, surrogate};
pub(crate) use train::Ppo;
