//! Deep deterministic policy gradient (DDPG).
//!
//! ```text
//! y = Σ_{i<k} γ^i r_i + γ^k Q'(s_k, μ'(s_k))
//! minimize  mean (Q(s, a) - y)²,   maximize  mean Q(s, μ(s)),   θ' ← (1 - τ) θ' + τ θ for both networks
//! ```
//!
//! Differences from [TD3](crate::td3): one critic, no target policy smoothing, no policy delay. The
//! rest is the same: a large replay buffer, n-step returns that bootstrap truncated episodes from
//! their final observation, normalized observations, and environments that explore with different
//! standard deviations (the paper uses an Ornstein-Uhlenbeck process).
//!
//! # Reference
//! Lillicrap et al., "Continuous control with deep reinforcement learning", ICLR 2016.

mod loss;
mod settings;
mod train;

pub use loss::{CriticLoss, CriticScratch};
pub use settings::DdpgSettings;
pub(crate) use train::Ddpg;
