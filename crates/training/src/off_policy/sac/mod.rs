//! Soft actor-critic (SAC).
//!
//! ```text
//! a' ~ π(·|s_k)
//! y = Σ_{i<k} γ^i r_i + γ^k (min(Q₁'(s_k, a'), Q₂'(s_k, a')) - α log π(a'|s_k))
//! minimize  mean ½ (Q₁(s, a) - y)² + mean ½ (Q₂(s, a) - y)²
//! minimize  mean α log π(a|s) - min(Q₁(s, a), Q₂(s, a)),   a ~ π(·|s) reparameterized
//! minimize  -log α (mean log π(a|s) + H̄)
//! θ' ← (1 - τ) θ' + τ θ for both critics
//! ```
//!
//! The policy is a squashed Gaussian ([`SquashedSample`]) whose mean and standard deviation are
//! outputs of one network. As in skrl, it can also be a clipped Gaussian with a state-independent
//! standard deviation.
//!
//! Differences from the paper: with k > 1, the entropy of the steps before s_k is omitted, as is
//! common. The temperature loss is linear in log α, not in α. The target entropy H̄ is that of a
//! Gaussian with the standard deviation `target_std` in each action dimension. For truncated
//! episodes, s_k is the final observation.
//!
//! # Reference
//! Haarnoja, Zhou, Abbeel and Levine, "Soft Actor-Critic: Off-Policy Maximum Entropy Deep
//! Reinforcement Learning with a Stochastic Actor", ICML 2018. The temperature: Haarnoja et al.,
//! "Soft Actor-Critic Algorithms and Applications", 2018.

mod distribution;
mod loss;
mod settings;
mod squashed_sample;
mod train;

pub use distribution::{Actor, Distribution};
pub use loss::{CriticLoss, CriticScratch, PolicyLoss, PolicyScratch, temperature_loss};
pub use settings::SacSettings;
pub use squashed_sample::{CLIPPED_LOG_STD_RANGE, SquashedSample};
pub(crate) use train::Sac;
