//! Proximal policy optimization (PPO).
//!
//! ```text
//! r = π(a|s) / π_old(a|s)
//! maximize  mean min(r A, clip(r, 1-ε, 1+ε) A) + entropy_coef H(π)
//! minimize  mean ½ (V(s) - (A + V_old(s)))²
//! ```
//!
//! Default settings:
//!
//! - Advantages come from [`gae`](crate::gae), bootstrap truncated episodes with the value of their
//!   final observation, and are normalized per minibatch.
//! - Policy and critic are separate networks with separate optimizers and separate gradient
//!   clipping, so a weight between the two losses has no effect.
//! - Minibatches are shuffled in each epoch.
//! - The observation normalizer is frozen during a rollout and its updates, so the initial ratios
//!   are exactly 1.
//!
//! The base `skrl-0.10` reproduces the PPO of skrl 0.10.2, which differs in most of these points;
//! see `docs/reference/bases.md`.
//!
//! # Reference
//! Schulman, Wolski, Dhariwal, Radford and Klimov, "Proximal Policy Optimization Algorithms", 2017.
//! Andrychowicz et al., "What Matters for On-Policy Deep Actor-Critic Methods?", ICLR 2021.

mod device;
mod loss;
mod settings;
mod train;

pub use loss::{Surrogate, clipped_value_loss, surrogate};
pub use settings::{
    AdvantageNormalization, EntropyReduction, GradientClipping, LearningRateSchedule, PpoSettings,
};
pub(crate) use train::Ppo;
