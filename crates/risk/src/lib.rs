//! Estimates the probability that a system violates its requirement under a distribution of
//! scenarios.
//!
//! [`risk()`] combines three estimators. Plain Monte Carlo has an exact interval and needs about
//! 100 / p simulations. Importance sampling needs a few thousand for any p, once searches have
//! found the failure modes; its interval holds for the failures in its regions. Multilevel
//! splitting needs no failure to begin with, and can lose a mode, so its independent chains must
//! agree with each other and with the other estimators.
//!
//! [`Scenarios`] is the distribution: a [`Marginal`] for each axis. All estimators work in its
//! latent space, in which each axis is standard normal.
//!
//! # Example
//! A system with the robustness 3 - x for a standard normal x fails with the probability 0.00135:
//! ```
//! use std::ops::ControlFlow;
//! use mishandle_random::Seed;
//! use mishandle_risk::{Method, Scenarios, Settings, risk};
//! use mishandle_rollout::{Axis, AxisKind, Space};
//! use mishandle_toys::{FunctionSystem, SimulatedEnd};
//!
//! let axis = Axis::new(AxisKind::Model, "x", "", [-8.0, 8.0], Some(0.0));
//! let space = Space::new("model", vec![axis]).unwrap();
//! let declared = [("x".to_string(), "normal:0:1".parse().unwrap())];
//! let scenarios = Scenarios::new(&space, declared.iter().map(|(name, marginal)| (name, marginal)), false)?;
//! let outcome = |request: &mishandle_rollout::Request| {
//!     SimulatedEnd::Robustness(3.0 - request.scenario.get(0).unwrap())
//! };
//! let mut system = FunctionSystem::new(space, outcome);
//! let settings = Settings { simulations: 4000, method: Method::Auto, seed: Seed(1), batch: 64 };
//! let report = risk(&mut system, &scenarios, &settings, |_| ControlFlow::Continue(()))?;
//! assert!((report.answer.estimate.value.unwrap() / 1.35e-3 - 1.0).abs() < 0.2);
//! # Ok::<(), mishandle_risk::RiskError>(())
//! ```

mod answer;
mod error;
mod experiment;
mod explore;
mod features;
mod gaussian;
mod importance;
mod marginal;
mod method;
mod monte_carlo;
mod moves;
mod normal;
mod policy;
mod proposal;
mod risk;
mod scenarios;
mod screened;
mod sequence;
mod sequence_proposal;
mod splitting;
mod strata;

pub use answer::{Answer, Refusal, Source};
pub use error::RiskError;
pub use experiment::Failure;
pub use importance::Importance;
pub use marginal::Marginal;
pub use method::Method;
pub use monte_carlo::MonteCarlo;
pub use risk::{FREQUENT, Report, Settings, risk};
pub use scenarios::{Draw, Scenarios};
pub use screened::{ScreenedReport, ScreenedSettings, screened_risk};
pub use sequence::check_steerable;
pub use splitting::{CHAINS, Disagreement, LARGEST_RATIO, Splitting};

/// Confidence of intervals.
const CONFIDENCE: f64 = 0.95;
