//! Trust region policy optimisation.
//!
//! ```text
//! maximise  L(θ) = mean r A,   r = π_θ(a|s) / π_old(a|s),   subject to  mean KL(π_old ‖ π_θ) <= δ
//! g = ∇L(θ_old),   H = ∇² mean KL at θ_old,   x ≈ (H + damping)⁻¹ g by conjugate gradients
//! θ = θ_old + ½^i √(2 δ / xᵀ(H + damping) x) x,   the first i that improves L enough within the trust region
//! ```
//!
//! H is never built. Of a diagonal Gaussian with state-independent deviations it is the Fisher information, whose
//! product with a direction v is exact by one tangent and one reverse pass:
//!
//! ```text
//! H v = mean Jᵀ diag(1/σ²) J v  for the network's parameters,   2 v  for log σ,   J = ∂μ/∂θ
//! ```
//!
//! Advantages, the critic and the scale of observations are as in [`ppo`](crate::ppo), except that advantages are
//! normalised over the whole rollout, which is one batch. The critic learns by shuffled minibatches after each step.
//!
//! The preset `skrl-0.10` makes it the TRPO of skrl 0.10.2: `docs/presets.md`.
//!
//! # Reference
//! Schulman, Levine, Moritz, Jordan and Abbeel, "Trust Region Policy Optimization", ICML 2015, with its appendix C.

mod config;
mod loss;
mod train;

pub use config::{Distance, Expected, TrpoConfig};
pub(crate) use train::Trpo;
