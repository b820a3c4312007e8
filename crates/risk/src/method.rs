//! The parts of an estimation.

use std::str::FromStr;

/// Which parts an estimation has. Each has Monte Carlo.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Method {
    /// All parts.
    #[default]
    Auto,
    /// Nothing but Monte Carlo.
    MonteCarlo,
    /// Importance sampling.
    Importance,
    /// Multilevel splitting.
    Splitting,
    /// Importance sampling that chooses the disturbances of actions while a simulation runs.
    Sequence,
}

/// Fractions of the simulations. What is left belongs to the last part.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Shares {
    pub monte_carlo: f64,
    pub exploration: f64,
    pub splitting: f64,
    pub fitting: f64,
    pub importance: f64,
}

impl Method {
    /// All methods with their names.
    pub const ALL: [(Method, &'static str); 5] = [
        (Method::Auto, "auto"),
        (Method::MonteCarlo, "monte-carlo"),
        (Method::Importance, "importance"),
        (Method::Splitting, "splitting"),
        (Method::Sequence, "sequence"),
    ];

    /// Returns the name.
    pub fn name(self) -> &'static str {
        Self::ALL.iter().find(|(method, _)| *method == self).map_or("", |(_, name)| name)
    }

    pub(crate) fn shares(self) -> Shares {
        let [monte_carlo, exploration, splitting, fitting, importance] = match self {
            Method::Auto => [0.25, 0.1, 0.35, 0.1, 0.2],
            Method::MonteCarlo => [1.0, 0.0, 0.0, 0.0, 0.0],
            Method::Importance => [0.25, 0.25, 0.0, 0.15, 0.35],
            Method::Splitting => [0.25, 0.0, 0.75, 0.0, 0.0],
            Method::Sequence => [0.25, 0.0, 0.0, 0.35, 0.4],
        };
        Shares { monte_carlo, exploration, splitting, fitting, importance }
    }
}

impl FromStr for Method {
    type Err = ();

    fn from_str(name: &str) -> Result<Method, ()> {
        Self::ALL.iter().find(|(_, known)| *known == name).map(|(method, _)| *method).ok_or(())
    }
}
