//! A target under other settings of its physics solver, to check that a failure does not depend on
//! them.

use std::sync::Arc;

use crate::{System, SystemFactory};

/// Distance by which [`SolverChange::MovedStart`] moves each coordinate of the start, rad or m.
pub const START_OFFSET: f64 = 1e-6;

/// A change of a simulation that no real robot would notice. A failure that vanishes under one of
/// them depends on the solver of the physics.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SolverChange {
    /// Half the physics step.
    HalfStep,
    /// The other collision detection of convex shapes.
    OtherCollider,
    /// The start moved by [`START_OFFSET`].
    MovedStart,
}

impl SolverChange {
    /// All changes, in the order in which they are checked.
    pub const ALL: [SolverChange; 3] =
        [SolverChange::HalfStep, SolverChange::OtherCollider, SolverChange::MovedStart];
}

/// A change and the system of a target under it.
pub type SolverSystem = (SolverChange, Box<dyn System>);

/// A target under one change of its physics.
#[derive(Clone)]
pub struct SolverVariant {
    /// The change.
    pub change: SolverChange,
    /// Makes its systems, whose spaces and specifications are those of the target.
    pub factory: Arc<SystemFactory>,
}

impl SolverVariant {
    /// Returns the variants of a target for which `make` returns the factory under each change.
    pub fn all(make: impl Fn(SolverChange) -> Arc<SystemFactory>) -> Vec<SolverVariant> {
        let variant = |change| SolverVariant { change, factory: make(change) };
        SolverChange::ALL.map(variant).into()
    }
}
