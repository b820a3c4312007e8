//! Twin delayed deep deterministic policy gradient.
//!
//! ```text
//! a' = clip(μ'(s_k) + clip(σ z, -c, c), -1, 1)
//! y = Σ_{i<k} γ^i r_i + γ^k min(Q₁'(s_k, a'), Q₂'(s_k, a'))
//! minimise  mean (Q₁(s, a) - y)² + mean (Q₂(s, a) - y)²
//! every d-th time:  maximise  mean Q₁(s, μ(s)),   θ' ← (1 - τ) θ' + τ θ for all three networks
//! ```
//!
//! Returns are those of some steps, with the true last observation where the clock ends an episode. Rows explore with
//! different deviations.
//!
//! # Reference
//! Fujimoto, van Hoof and Meger, "Addressing Function Approximation Error in Actor-Critic Methods", ICML 2018.

mod config;
mod loss;
mod train;

pub use config::Td3Config;
pub use loss::{CriticLoss, CriticScratch, Smoothing};
pub(crate) use train::Td3;
