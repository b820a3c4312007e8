//! Deep deterministic policy gradient.
//!
//! ```text
//! y = Σ_{i<k} γ^i r_i + γ^k Q'(s_k, μ'(s_k))
//! minimise  mean (Q(s, a) - y)²,   maximise  mean Q(s, μ(s)),   θ' ← (1 - τ) θ' + τ θ for both networks
//! ```
//!
//! One critic, no smoothing of its target, no delay of the policy: that is what tells it from [TD3](crate::td3). All else
//! is shared: a large replay, returns of some steps that bootstrap from the true last observation where the clock ends an
//! episode, scaled observations, and rows that explore with different deviations (instead of the paper's
//! Ornstein-Uhlenbeck process).
//!
//! # Reference
//! Lillicrap et al., "Continuous control with deep reinforcement learning", ICLR 2016.

mod config;
mod loss;
mod train;

pub use config::DdpgConfig;
pub use loss::{CriticLoss, CriticScratch};
pub(crate) use train::Ddpg;
