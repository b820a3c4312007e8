use crate::{RolloutError, Seed, Stream};

/// One axis of an [`InitialBox`]: what may be chosen about the start, with its unit and bounds.
#[derive(Clone, Debug, PartialEq)]
pub struct Axis {
    /// Name, for instance `ball_x`.
    pub name: String,
    /// Unit, for instance `m`.
    pub unit: String,
    /// Smallest value.
    pub low: f64,
    /// Largest value.
    pub high: f64,
}

/// The set X₀ of initial configurations: a box, one [`Axis`] for each value of x₀.
///
/// This is the one place where a unit point u of \[0,1\]^d becomes metres and radians.
///
/// # Example
/// ```
/// use mishandle_rollout::{Axis, InitialBox};
/// let axis = |name: &str, low, high| Axis { name: name.into(), unit: "m".into(), low, high };
/// let initial_box = InitialBox::new(vec![axis("ball_x", 0.2, 0.5), axis("ball_y", -0.15, 0.15)]).unwrap();
/// assert_eq!(initial_box.at(&[0.0, 1.0]), [0.2, 0.15]);
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct InitialBox {
    axes: Vec<Axis>,
}

impl InitialBox {
    /// A box with these axes.
    ///
    /// # Errors
    /// If an axis's bounds are not finite or not in order.
    pub fn new(axes: Vec<Axis>) -> Result<InitialBox, RolloutError> {
        for axis in &axes {
            if !(axis.low < axis.high && axis.low.is_finite() && axis.high.is_finite()) {
                return Err(RolloutError::Bounds { axis: axis.name.clone(), low: axis.low, high: axis.high });
            }
        }
        Ok(InitialBox { axes })
    }

    /// The axes, in the order of x₀'s values.
    pub fn axes(&self) -> &[Axis] {
        &self.axes
    }

    /// Number of axes.
    pub fn dimension(&self) -> usize {
        self.axes.len()
    }

    /// The initial configuration at unit point `u` of \[0,1\]^d; bounds are met exactly at 0 and 1.
    pub fn at(&self, u: &[f64]) -> Vec<f64> {
        self.axes.iter().zip(u).map(|(axis, u)| axis.low * (1.0 - u) + axis.high * u).collect()
    }

    /// The unit point of an initial configuration: the inverse of [`at`](Self::at), up to rounding.
    pub fn unit_point(&self, x0: &[f64]) -> Vec<f64> {
        self.axes.iter().zip(x0).map(|(axis, x)| (x - axis.low) / (axis.high - axis.low)).collect()
    }

    /// A uniformly drawn initial configuration, the `index`-th of `seed`.
    pub fn sample(&self, seed: Seed, index: u64) -> Vec<f64> {
        let u: Vec<f64> = (0..self.dimension() as u32)
            .map(|axis| seed.uniform(Stream::InitialConfiguration, index, axis))
            .collect();
        self.at(&u)
    }

    /// Checks that `x0` has a finite value for every axis. It may lie outside the box: tests do that on purpose.
    ///
    /// # Errors
    /// If the number of values is wrong, or one is NaN or infinite.
    pub fn check(&self, x0: &[f64]) -> Result<(), RolloutError> {
        if x0.len() != self.dimension() {
            let axes = self.axes.iter().map(|axis| axis.name.as_str()).collect::<Vec<_>>().join(", ");
            return Err(RolloutError::Dimension { wanted: self.dimension(), found: x0.len(), axes });
        }
        match self.axes.iter().zip(x0).find(|(_, value)| !value.is_finite()) {
            Some((axis, &value)) => Err(RolloutError::NotFinite { axis: axis.name.clone(), value }),
            None => Ok(()),
        }
    }
}
