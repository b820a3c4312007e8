//! Soft actor-critic.
//!
//! ```text
//! a' ~ π(·|s_k)
//! y = Σ_{i<k} γ^i r_i + γ^k (min(Q₁'(s_k, a'), Q₂'(s_k, a')) - α log π(a'|s_k))
//! minimise  mean ½ (Q₁(s, a) - y)² + mean ½ (Q₂(s, a) - y)²
//! minimise  mean α log π(a|s) - min(Q₁(s, a), Q₂(s, a)),   a ~ π(·|s) reparameterised
//! minimise  -log α (mean log π(a|s) + H̄)
//! θ' ← (1 - τ) θ' + τ θ for both critics
//! ```
//!
//! The policy is a [squashed](crate::drawn) Gaussian whose mean and deviation are outputs of one network, or, as in skrl, a
//! clipped one whose deviation is the same whatever is seen. With k > 1 the entropy of the steps before s_k is left out, as
//! is usual. The temperature's loss is linear in log α, not in α as in the paper. H̄ is the entropy of a Gaussian with the
//! deviation `target_std` in each action. Where the clock ends an episode, s_k is its true last observation.
//!
//! # Reference
//! Haarnoja et al., "Soft Actor-Critic Algorithms and Applications", 2018.

mod config;
mod loss;
mod train;

pub use crate::distribution::{Actor, Distribution};
pub use config::SacConfig;
pub use loss::{CriticLoss, CriticScratch, PolicyLoss, PolicyScratch, temperature_loss};
pub(crate) use train::Sac;
