//! The distribution of scenarios, and its latent space.

use mishandle_random::{Seed, Sequence};
use mishandle_rollout::{Axis, AxisValues, Scenario, Space};
use mishandle_search::Coordinate;

use crate::{Marginal, RiskError, normal};

/// A random scenario with the seed of its simulation.
#[derive(Clone, Debug, PartialEq)]
pub struct Draw {
    /// The latent point: one number for each free axis, standard normal under the distribution of
    /// the scenarios.
    pub latent: Vec<f64>,
    /// Seed of the simulation, which determines its noise.
    pub seed: Seed,
}

impl Draw {
    /// Returns the squared distance of the latent point from the center. The density decreases with
    /// it.
    pub(crate) fn squared_radius(&self) -> f64 {
        self.latent.iter().map(|z| z * z).sum()
    }
}

/// The distribution of scenarios: independent axes, each with its [`Marginal`].
///
/// Searches and chains move in a latent space in which each free axis is standard normal: the value
/// of an axis has the same quantile as its latent number.
#[derive(Clone, Debug)]
pub struct Scenarios {
    space: Space,
    marginals: Vec<Marginal>,
    /// Indices of the axes that are not fixed.
    free: Vec<usize>,
    depends_on_seed: bool,
}

impl Scenarios {
    /// Makes the distribution of the scenarios of a space. Axes that `declared` does not name have
    /// the distribution that they declare themselves. `depends_on_seed`: whether two simulations of
    /// a scenario with different seeds can differ.
    ///
    /// # Errors
    /// If there is no axis with a name, a distribution does not fit its axis, or nothing is random.
    pub fn new<'a>(
        space: &Space,
        declared: impl IntoIterator<Item = (&'a String, &'a Marginal)>,
        depends_on_seed: bool,
    ) -> Result<Scenarios, RiskError> {
        let axes = space.axes();
        let mut marginals: Vec<Marginal> = axes.iter().map(Marginal::of).collect();
        for (name, marginal) in declared {
            let index =
                axes.iter().position(|axis| axis.name == *name).ok_or_else(|| RiskError::UnknownAxis {
                    name: name.clone(),
                    known: axes.iter().map(|axis| axis.name.clone()).collect(),
                })?;
            marginal.check(&axes[index])?;
            marginals[index] = marginal.clone();
        }
        let free: Vec<usize> = (0..axes.len()).filter(|index| !axes[*index].is_fixed()).collect();
        if free.is_empty() && !depends_on_seed {
            return Err(RiskError::NothingRandom);
        }
        Ok(Scenarios { space: space.clone(), marginals, free, depends_on_seed })
    }

    /// Returns the axes with their distributions. The distribution of a fixed axis has no effect.
    pub fn axes(&self) -> impl Iterator<Item = (&Axis, &Marginal)> {
        self.space.axes().iter().zip(&self.marginals)
    }

    /// Describes distributions that are unlikely to be meant.
    pub fn warnings(&self) -> Vec<String> {
        self.axes().filter_map(|(axis, marginal)| marginal.warning(axis)).collect()
    }

    /// Returns the number of free axes.
    pub fn dimension(&self) -> usize {
        self.free.len()
    }

    /// Returns whether two simulations of a scenario with different seeds can differ.
    pub fn depends_on_seed(&self) -> bool {
        self.depends_on_seed
    }

    /// Draws a random scenario and a seed.
    pub(crate) fn draw(&self, random: &mut Sequence) -> Draw {
        Draw { latent: normals(self.dimension(), random), seed: Seed(random.bits()) }
    }

    /// Returns the scenario of a latent point.
    pub fn scenario(&self, latent: &[f64]) -> Scenario {
        let mut values: Vec<f64> = self.space.axes().iter().map(|axis| axis.low).collect();
        for (index, z) in self.free.iter().zip(latent) {
            values[*index] = self.value(*index, *z);
        }
        self.space.canonical(values.into())
    }

    /// Returns the indices of the free axes in the space, in the order of the latent numbers.
    pub(crate) fn free(&self) -> &[usize] {
        &self.free
    }

    /// Returns whether the value of an axis can be chosen after that of all others: it has real
    /// numbers, and no condition reads or restricts it.
    pub(crate) fn is_independent(&self, index: usize) -> bool {
        let axis = &self.space.axes()[index];
        let is_read = |other: &Axis| other.conditions.iter().any(|condition| condition.axis == axis.name);
        axis.levels().is_none() && axis.conditions.is_empty() && !self.space.axes().iter().any(is_read)
    }

    /// Returns the value of an axis with a latent number.
    pub(crate) fn value(&self, index: usize, z: f64) -> f64 {
        self.marginals[index].value(&self.space.axes()[index], z)
    }

    /// Returns the types of the coordinates of a search in the unit cube of quantiles.
    pub(crate) fn coordinates(&self) -> Vec<Coordinate> {
        let coordinate = |index: &usize| {
            let axis = &self.space.axes()[*index];
            match (&axis.values, axis.levels(), &self.marginals[*index]) {
                // Only then has each level an equal part of the quantiles.
                (AxisValues::Categorical(_), Some(levels), Marginal::Uniform) => {
                    Coordinate::Categorical { levels }
                }
                (_, Some(levels), Marginal::Uniform) => Coordinate::Integer { levels },
                _ => Coordinate::Continuous,
            }
        };
        self.free.iter().map(coordinate).collect()
    }
}

/// Returns independent standard normal numbers.
pub(crate) fn normals(n: usize, random: &mut Sequence) -> Vec<f64> {
    let mut numbers = Vec::with_capacity(n + 1);
    while numbers.len() < n {
        numbers.extend(<[f64; 2]>::from(random.normal_pair()));
    }
    numbers.truncate(n);
    numbers
}

/// Largest absolute latent number of a point of the unit cube. Beyond it, a quantile is as close as
/// 1e-9 to a bound.
const LARGEST: f64 = 6.0;

/// Returns the latent point of a point of quantiles in \[0, 1\]^d. Bounds are moved inward.
pub(crate) fn latent(quantiles: &[f64]) -> Vec<f64> {
    quantiles.iter().map(|u| normal::quantile(*u).clamp(-LARGEST, LARGEST)).collect()
}
