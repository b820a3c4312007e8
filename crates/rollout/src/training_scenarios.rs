//! Scenarios of training episodes.

use std::ops::RangeInclusive;

use crate::{
    Axis, AxisKind, BatchFactory, Disturbance, EnvironmentBatch, EnvironmentSpec, Interface, RolloutError,
    Scenario, Seed, Space,
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
}

impl TrainingScenarios {
    /// Returns the scenarios of an environment with this space, without disturbances.
    pub fn of(space: Space) -> TrainingScenarios {
        TrainingScenarios { space, disturbances: Vec::new(), given: Vec::new() }
    }

    /// Returns a random start, number `index` of `seed`, without any disturbance: all axes besides
    /// those of the initial state are nominal.
    ///
    /// The starts are those of [`random`](Self::random) with the same numbers.
    pub fn nominal(&self, seed: Seed, index: u64) -> Scenario {
        let drawn = self.random(seed, index);
        let axes = self.space.axes().iter().zip(drawn.values());
        let value = |(axis, drawn): (&Axis, &Option<f64>)| match axis.kind {
            AxisKind::Start => *drawn,
            _ => axis.nominal,
        };
        self.space.canonical(Scenario::new(axes.map(value).collect()))
    }

    /// Returns random scenario number `index` of `seed`.
    pub fn random(&self, seed: Seed, index: u64) -> Scenario {
        self.space.sample(seed, index)
    }

    /// Returns random corner number `index` of `seed`: each axis is at its lower or upper bound,
    /// with equal probability.
    pub fn corner(&self, seed: Seed, index: u64) -> Scenario {
        self.space.random_corner(seed, index)
    }

    /// Returns one of the given scenarios for a uniform number from \[0, 1); `None` if there is
    /// none. Their probabilities are proportional to their weights.
    pub fn given(&self, uniform: f64) -> Option<&Scenario> {
        let mut left = uniform * self.given.iter().map(|(_, weight)| weight).sum::<f64>();
        let chosen = self.given.iter().find(|(_, weight)| {
            left -= weight;
            left < 0.0
        });
        // Rounding can leave a rest after the last one.
        chosen.or(self.given.last()).map(|(scenario, _)| scenario)
    }

    /// Returns the disturbances between an environment with this space and a policy; `None` if no
    /// axis belongs to one.
    ///
    /// # Errors
    /// If the name of an axis is unknown, or an axis of the environment is missing.
    pub fn interface(
        &self,
        environment: &Space,
        action_size: usize,
    ) -> Result<Option<Interface>, RolloutError> {
        let interface = Interface::around(environment, &self.space, &self.disturbances, action_size)?;
        Ok(Some(interface).filter(Interface::has_effects))
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

/// Batches with other scenarios than those of their space.
pub struct ScenarioBatches<B> {
    /// The batches. Their space is the environment's part of the space of the scenarios.
    pub batches: B,
    /// The scenarios.
    pub scenarios: TrainingScenarios,
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
}

impl<B: BatchFactory + ?Sized> BatchFactory for Box<B> {
    fn spec(&self) -> EnvironmentSpec {
        (**self).spec()
    }

    fn batch(&self, rows: usize) -> Result<Box<dyn EnvironmentBatch>, RolloutError> {
        (**self).batch(rows)
    }

    fn scenarios(&self) -> TrainingScenarios {
        (**self).scenarios()
    }
}
