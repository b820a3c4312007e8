//! Falsification problems of the ARCH competition (Applied Verification for Continuous and Hybrid
//! Systems) whose equations are published, as targets.
//!
//! - `inputs`: signals of knots, as the competition constrains them
//! - `integration`: fixed steps of the classical Runge-Kutta method, and events inside a step
//! - `chasing_cars`: five cars, problems CC1 to CC5 and CCx
//! - `fuel_control`: a controller of fuel, problems AFC27, AFC29 and AFC33
//! - `steam_condenser`: a recurrent network that holds a pressure, problem SC
//!
//! The models are implemented again from their equations: no code of the competition is used.
//! docs/reference/arch.md states sources, differences and the comparison with another integrator.
//!
//! # Example
//! At full throttle the cars drift apart:
//! ```
//! use mishandle_rollout::{Request, Scenario, Seed, Specification};
//! use mishandle_stl::Formula;
//! let target = mishandle_toys::arch::target("arch/cc1").unwrap()?;
//! let specification = Specification::new(Formula::parse(&target.formulas[0].text).unwrap());
//! let space = target.space("instance-2")?;
//! let mut system = target.system(&space, &specification)?;
//! let throttle = space.axes().iter().map(|axis| f64::from(axis.name.starts_with("throttle")));
//! let scenario = Scenario::new(throttle.map(Some).collect());
//! let episodes = system.rollout(&[Request::new(scenario, Seed(0))])?;
//! assert!(episodes[0].is_violated());
//! # Ok::<(), mishandle_rollout::RolloutError>(())
//! ```

mod chasing_cars;
mod fuel_control;
mod inputs;
mod integration;
mod steam_condenser;

use crate::Toy;
use mishandle_rollout::{RolloutError, Target};

use chasing_cars::{ChasingCars, Problem};
use fuel_control::FuelControl;
use steam_condenser::SteamCondenser;

/// The kind of these targets, a prefix of their names in plans.
pub const KIND: &str = "arch";

/// All problems, in the order of the list.
pub static PROBLEMS: &[&dyn Toy] = &[
    &ChasingCars(Problem::Cc1),
    &ChasingCars(Problem::Cc2),
    &ChasingCars(Problem::Cc3),
    &ChasingCars(Problem::Cc4),
    &ChasingCars(Problem::Cc5),
    &ChasingCars(Problem::Ccx),
    &FuelControl(fuel_control::Problem::Afc27),
    &FuelControl(fuel_control::Problem::Afc29),
    &FuelControl(fuel_control::Problem::Afc33),
    &SteamCondenser,
];

/// Returns the target with this name, including the prefix `arch/`; `None` if there is no such
/// problem.
///
/// # Errors
/// If the problem's axes do not form valid spaces.
pub fn target(name: &str) -> Option<Result<Target, RolloutError>> {
    crate::target_among(KIND, PROBLEMS, name)
}
