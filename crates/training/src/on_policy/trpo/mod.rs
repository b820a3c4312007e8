//! Trust region policy optimization (TRPO).
//!
//! ```text
//! maximize  L(θ) = mean r A,   r = π_θ(a|s) / π_old(a|s),   subject to  mean KL(π_old ‖ π_θ) <= δ
//! g = ∇L(θ_old),   H = ∇² mean KL at θ_old,   x ≈ (H + damping)⁻¹ g by conjugate gradients
//! θ = θ_old + ½^i √(2 δ / xᵀ(H + damping) x) x,   the first i that improves L enough within the trust region
//! ```
//!
//! H is never built. For a diagonal Gaussian with state-independent standard deviations, H is the
//! Fisher information matrix, and its product with a direction v needs one tangent pass and one
//! reverse pass, without approximation:
//!
//! ```text
//! H v = mean Jᵀ diag(1/σ²) J v  for the network's parameters,   2 v  for log σ,   J = ∂μ/∂θ
//! ```
//!
//! Advantages, critic and observation normalizer are those of [`ppo`](crate::ppo), except that
//! advantages are normalized over the whole rollout, which is one batch. The critic is trained on
//! shuffled minibatches after each policy step.
//!
//! The base `skrl-0.10` reproduces the TRPO of skrl 0.10.2; see `docs/reference/bases.md`.
//!
//! # Reference
//! Schulman, Levine, Moritz, Jordan and Abbeel, "Trust Region Policy Optimization", ICML 2015, with
//! its appendix C.

pub(crate) mod conjugate_gradient;
mod loss;
mod settings;
mod train;

pub use settings::{ExpectedImprovement, LineSearchKl, TrpoSettings};
pub(crate) use train::Trpo;
