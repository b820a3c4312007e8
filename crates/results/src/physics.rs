use serde::{Deserialize, Serialize};

use crate::word::words;
use crate::{Number, Scenario};

words! {
    /// A change of a simulation that no failure may depend on.
    pub enum SolverChange {
        HalfStep = "half step", OtherCollider = "other collider", MovedStart = "moved start",
    }
}

impl SolverChange {
    /// Returns what is changed, in words that follow "with".
    pub fn words(self) -> &'static str {
        match self {
            SolverChange::HalfStep => "half the physics step",
            SolverChange::OtherCollider => "another collision algorithm",
            SolverChange::MovedStart => "the start moved by 1e-6 m or rad",
        }
    }
}

/// The check of the physics of a failure: its simulation again under each change.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct PhysicsCheck {
    /// Whether the violation vanishes in any of the simulations. One without a verdict does not
    /// confirm it.
    pub depends_on_solver: bool,
    /// The simulations. They belong to no run and count in no rate.
    pub simulations: Vec<SolverSimulation>,
}

/// The simulation of a failure under a change of its physics.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct SolverSimulation {
    /// `half step`: half the physics step; `other collider`: the other collision detection of
    /// convex shapes, libccd instead of MuJoCo's native one; `moved start`: every joint coordinate
    /// of the start moved by 1e-6 rad or m, in alternating directions.
    pub change: SolverChange,
    /// Robustness of the requirement; `null` without a verdict.
    pub robustness: Option<Number>,
    /// Whether the requirement is violated; `null` without a verdict.
    pub violated: Option<bool>,
}

impl PhysicsCheck {
    /// Makes the check of these simulations.
    pub fn new(simulations: Vec<SolverSimulation>) -> PhysicsCheck {
        let vanishes = |simulation: &SolverSimulation| simulation.violated != Some(true);
        PhysicsCheck { depends_on_solver: simulations.iter().any(vanishes), simulations }
    }

    /// Returns the simulations in which the violation vanishes.
    pub fn vanishing(&self) -> impl Iterator<Item = &SolverSimulation> {
        self.simulations.iter().filter(|simulation| simulation.violated != Some(true))
    }
}

/// A failure whose physics was checked.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct CheckedFailure {
    /// Scenario by axis.
    pub scenario: Scenario,
    /// Its robustness.
    pub robustness: Number,
    /// The check.
    pub physics: PhysicsCheck,
}
