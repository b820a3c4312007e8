//! Faults of observations and actions with a life cycle: they begin, last and recover.
//!
//! A [`FaultSite`] is an observation or an action with its channels. It makes one axis for each
//! parameter of a fault. A fault acts between environment and controller, so it works for every
//! target that has control steps.

mod active;
mod kind;
mod life_cycle;
mod parameter;
mod site;
#[cfg(test)]
mod tests;

pub(crate) use active::ActiveFault;
pub use kind::{Description, FaultKind, Fill, Side};
pub use life_cycle::LifeCycle;
pub use parameter::Parameter;
pub use site::{Channel, FaultSite};
