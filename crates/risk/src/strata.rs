//! Interior, faces and corners of the distribution.

use mishandle_random::Sequence;

use crate::{Draw, Scenarios, normal};

/// Probability of the interior.
const INTERIOR: f64 = 0.7;

/// A partition of the latent space by the number of extreme coordinates: none (interior), one
/// (faces), and several (edges and corners).
///
/// A coordinate is extreme if its quantile is in the outermost parts at both ends, which are so
/// small that the interior has the probability 0.7 in every dimension.
pub(crate) struct Strata {
    /// A coordinate with a larger absolute value is extreme.
    threshold: f64,
    /// Probability of each stratum.
    probabilities: Vec<f64>,
}

impl Strata {
    pub(crate) fn new(dimension: usize) -> Strata {
        let inner = INTERIOR.powf(1.0 / dimension.max(1) as f64);
        let face = dimension as f64 * (1.0 - inner) * inner.powf(dimension as f64 - 1.0);
        let probabilities = match dimension {
            0 => vec![1.0],
            1 => vec![INTERIOR, face],
            _ => vec![INTERIOR, face, 1.0 - INTERIOR - face],
        };
        Strata { threshold: normal::quantile(0.5 + 0.5 * inner), probabilities }
    }

    /// Returns a single stratum, which is everything.
    #[cfg(test)]
    pub(crate) fn whole() -> Strata {
        Strata { threshold: f64::INFINITY, probabilities: vec![1.0] }
    }

    /// Returns the index of the stratum of a latent point.
    fn of(&self, latent: &[f64]) -> usize {
        let extreme = latent.iter().filter(|z| z.abs() > self.threshold).count();
        extreme.min(self.probabilities.len() - 1)
    }

    /// Draws `n` particles, as many in each stratum up to one, with their weights: the probability
    /// of the stratum divided by its share of the particles. The sum of the weights is `n`.
    pub(crate) fn population(
        &self,
        scenarios: &Scenarios,
        n: u64,
        random: &mut Sequence,
    ) -> Vec<(Draw, f64)> {
        let strata = self.probabilities.len() as u64;
        let share = |stratum: u64| n / strata + u64::from(stratum < n % strata);
        let mut particles = Vec::new();
        for stratum in 0..strata {
            let weight = self.probabilities[stratum as usize] * n as f64 / share(stratum).max(1) as f64;
            for _ in 0..share(stratum) {
                let mut draw = scenarios.draw(random);
                while self.of(&draw.latent) != stratum as usize {
                    draw = scenarios.draw(random);
                }
                particles.push((draw, weight));
            }
        }
        particles
    }
}
