//! Scenarios of training episodes.

use std::ops::RangeInclusive;
use std::sync::Arc;

use crate::{
    Axis, AxisKind, BatchFactory, Disturbance, EnvironmentBatch, EnvironmentSpec, Interface, RolloutError,
    Scenario, Seed, Space, Stream, Supervisor,
};

/// The scenarios from which training and validation draw.
#[derive(Clone, Debug)]
pub struct TrainingScenarios {
    /// Axes of the environment and of disturbances.
    pub space: Space,
    /// Disturbances that the axes of the space may belong to.
    pub disturbances: Vec<Disturbance>,
    /// Given scenarios of the space, each with its weight.
    pub given: Vec<(Scenario, f64)>,
    /// Sets of axes, each with its weight. A random scenario and a corner draw one of the sets, and
    /// the axes outside of it are nominal; those of the initial state belong to each set. Empty
    /// means one set of all axes.
    pub mixture: Vec<(AxisSet, f64)>,
}

/// A set of axes: whether each axis of a space belongs to it.
pub type AxisSet = Vec<bool>;

/// Index of the draw of a set of axes.
const SETS: u64 = 2 << 32;

impl TrainingScenarios {
    /// Returns the scenarios of an environment with this space, without disturbances.
    pub fn of(space: Space) -> TrainingScenarios {
        TrainingScenarios { space, disturbances: Vec::new(), given: Vec::new(), mixture: Vec::new() }
    }

    /// Returns a random start, number `index` of `seed`, without any disturbance: all axes besides
    /// those of the initial state are nominal.
    ///
    /// The starts are those of [`random`](Self::random) with the same numbers.
    pub fn nominal(&self, seed: Seed, index: u64) -> Scenario {
        let nothing = vec![false; self.space.dimension()];
        self.space.canonical(within(&self.space, &nothing, &self.space.draw(seed, index)))
    }

    /// Returns random scenario number `index` of `seed`.
    pub fn random(&self, seed: Seed, index: u64) -> Scenario {
        self.space.canonical(self.mixed(self.space.draw(seed, index), seed, index))
    }

    /// Returns random corner number `index` of `seed`: each axis is at its lower or upper bound,
    /// with equal probability.
    pub fn corner(&self, seed: Seed, index: u64) -> Scenario {
        self.space.canonical(self.mixed(self.space.random_corner(seed, index), seed, index))
    }

    /// Draws a set of axes and makes the axes outside of it nominal.
    pub(crate) fn mixed(&self, drawn: Scenario, seed: Seed, index: u64) -> Scenario {
        match chosen(&self.mixture, seed.uniform(Stream::Scenario, SETS + index, 0)) {
            Some(set) => within(&self.space, set, &drawn),
            None => drawn,
        }
    }

    /// Returns one of the given scenarios for a uniform number from \[0, 1); `None` if there is
    /// none. Their probabilities are proportional to their weights.
    pub fn given(&self, uniform: f64) -> Option<&Scenario> {
        chosen(&self.given, uniform)
    }

    /// Returns the disturbances between an environment with this space and a policy.
    ///
    /// # Errors
    /// If the name of an axis is unknown, or an axis of the environment is missing.
    pub fn interface(&self, environment: &Space, action_size: usize) -> Result<Interface, RolloutError> {
        Interface::around(environment, &self.space, &self.disturbances, action_size)
    }

    /// Returns the first axis under which a fault may show NaN to the policy, with the values under
    /// which it does not. No policy can learn from NaN.
    pub fn not_a_number(&self) -> Option<(&Axis, RangeInclusive<f64>)> {
        self.space.axes().iter().find_map(|axis| {
            let disturbance = self.disturbances.iter().find(|known| known.axis.name == axis.name)?;
            let first = disturbance.effect.first_not_a_number()?;
            // The numbers of categories remain those of the whole axis.
            (axis.high >= first).then_some((axis, disturbance.axis.low..=first - 1.0))
        })
    }
}

/// Returns the element for a uniform number from \[0, 1), with probabilities proportional to the
/// weights; `None` without elements.
fn chosen<T>(weighted: &[(T, f64)], uniform: f64) -> Option<&T> {
    let mut left = uniform * weighted.iter().map(|(_, weight)| weight).sum::<f64>();
    let chosen = weighted.iter().find(|(_, weight)| {
        left -= weight;
        left < 0.0
    });
    // Rounding can leave a rest after the last one.
    chosen.or(weighted.last()).map(|(element, _)| element)
}

/// Returns a scenario whose axes outside of a set are nominal, except those of the initial state.
fn within(space: &Space, set: &[bool], drawn: &Scenario) -> Scenario {
    let axes = space.axes().iter().zip(set).zip(drawn.values());
    let value = |((axis, inside), drawn): ((&Axis, &bool), &Option<f64>)| match axis.kind {
        AxisKind::Start => *drawn,
        _ if *inside => *drawn,
        _ => axis.nominal,
    };
    Scenario::new(axes.map(value).collect())
}

/// Batches with other scenarios than those of their space.
pub struct ScenarioBatches<B> {
    /// The batches. Their space is the environment's part of the space of the scenarios.
    pub batches: B,
    /// The scenarios.
    pub scenarios: TrainingScenarios,
    /// Who supervises the policy. It must not be privileged: batches have no signals.
    pub supervisor: Option<Arc<dyn Supervisor>>,
}

impl<B> ScenarioBatches<B> {
    /// Returns batches with these scenarios, without a supervisor.
    pub fn new(batches: B, scenarios: TrainingScenarios) -> ScenarioBatches<B> {
        ScenarioBatches { batches, scenarios, supervisor: None }
    }
}

impl<B: BatchFactory> BatchFactory for ScenarioBatches<B> {
    fn spec(&self) -> EnvironmentSpec {
        self.batches.spec()
    }

    fn batch(&self, rows: usize) -> Result<Box<dyn EnvironmentBatch>, RolloutError> {
        self.batches.batch(rows)
    }

    fn scenarios(&self) -> TrainingScenarios {
        self.scenarios.clone()
    }

    fn supervisor(&self) -> Option<Arc<dyn Supervisor>> {
        self.supervisor.clone()
    }
}

impl BatchFactory for Arc<dyn BatchFactory> {
    fn spec(&self) -> EnvironmentSpec {
        (**self).spec()
    }

    fn batch(&self, rows: usize) -> Result<Box<dyn EnvironmentBatch>, RolloutError> {
        (**self).batch(rows)
    }

    fn scenarios(&self) -> TrainingScenarios {
        (**self).scenarios()
    }

    fn supervisor(&self) -> Option<Arc<dyn Supervisor>> {
        (**self).supervisor()
    }
}
