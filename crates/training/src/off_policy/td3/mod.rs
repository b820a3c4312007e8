//! Twin delayed deep deterministic policy gradient (TD3).
//!
//! ```text
//! a' = clip(μ'(s_k) + clip(σ z, -c, c), -1, 1)
//! y = Σ_{i<k} γ^i r_i + γ^k min(Q₁'(s_k, a'), Q₂'(s_k, a'))
//! minimize  mean (Q₁(s, a) - y)² + mean (Q₂(s, a) - y)²
//! every d-th update:  maximize  mean Q₁(s, μ(s)),   θ' ← (1 - τ) θ' + τ θ for all three networks
//! ```
//!
//! Targets use n-step returns and bootstrap truncated episodes from their final observation.
//! Environments explore with different standard deviations.
//!
//! # Reference
//! Fujimoto, van Hoof and Meger, "Addressing Function Approximation Error in Actor-Critic Methods",
//! ICML 2018.

mod loss;
mod settings;
mod train;

pub use loss::{CriticLoss, CriticScratch, TargetSmoothing};
pub use settings::Td3Settings;
pub(crate) use train::Td3;
