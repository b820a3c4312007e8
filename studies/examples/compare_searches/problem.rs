//! A problem, and its random instances.

use mishandle::random::Sequence;

/// The number of further random numbers of an instance.
const N_PARAMETERS: usize = 96;

/// The random part of a problem: each seed has its own.
pub struct Instance {
    /// A point of the box.
    pub target: Vec<f64>,
    /// Further numbers in [0, 1).
    pub parameters: Vec<f64>,
    /// A number that [`Problem::calibrated`] sets.
    pub level: f64,
}

/// A function with violations below 0.
#[derive(Clone, Copy)]
pub struct Problem {
    pub name: &'static str,
    /// The numbers of axes; empty if all requested ones.
    pub axes: &'static [usize],
    value: fn(&[f64], &Instance) -> f64,
    /// The share of the box that is violated, if `level` is chosen so.
    violated: Option<f64>,
}

impl Problem {
    /// A problem whose value needs no calibration, for any number of axes.
    pub const fn new(name: &'static str, value: fn(&[f64], &Instance) -> f64) -> Self {
        Self { name, axes: &[], value, violated: None }
    }

    /// The problem with these numbers of axes only.
    pub const fn with_axes(self, axes: &'static [usize]) -> Self {
        Self { axes, ..self }
    }

    /// The problem whose value is moved by a constant, so that about this share of random points
    /// violates.
    pub const fn calibrated(self, violated: f64) -> Self {
        Self { violated: Some(violated), ..self }
    }

    /// Returns the instance of a seed, and the seed of the search on it.
    pub fn instance(&self, d: usize, seed: u64) -> (Instance, u64) {
        let mut random = Sequence::new(seed, d as u64);
        let target: Vec<f64> = (0..d).map(|_| random.uniform()).collect();
        let search_seed = random.bits();
        let parameters = (0..N_PARAMETERS).map(|_| random.uniform()).collect();
        let mut instance = Instance { target, parameters, level: 0.0 };
        if let Some(share) = self.violated {
            // Ten violations are expected among the points of the quantile.
            let n = (10.0 / share) as usize;
            let mut values: Vec<f64> = (0..n)
                .map(|_| (self.value)(&(0..d).map(|_| random.uniform()).collect::<Vec<_>>(), &instance))
                .collect();
            values.sort_by(f64::total_cmp);
            instance.level = values[10];
        }
        (instance, search_seed)
    }

    /// Returns the value at a point.
    pub fn at(&self, u: &[f64], instance: &Instance) -> f64 {
        (self.value)(u, instance) - instance.level
    }
}
