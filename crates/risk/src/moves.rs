//! Markov chain moves that leave the distribution of scenarios invariant.

use mishandle_random::{Seed, Sequence};

use crate::Draw;

/// Smallest size of steps. The largest is 1, a fresh draw.
const SMALLEST: f64 = 0.02;

/// Fraction of accepted moves that the size of the steps is adapted to.
const ACCEPTANCE: f64 = 0.35;

/// Largest factor by which the size of a step differs from the adapted one, so that modes of
/// several widths have moves that fit.
const VARIATION: f64 = 3.0;

/// Probability that a move also draws another seed, if the seed has an effect.
const SEED: f64 = 0.5;

/// A source of moves, and their adapted size.
#[derive(Clone, Debug)]
pub(crate) struct Walk {
    step: f64,
    depends_on_seed: bool,
}

impl Walk {
    pub(crate) fn new(depends_on_seed: bool) -> Walk {
        Walk { step: 1.0, depends_on_seed }
    }

    /// Returns a random move from `draw`:
    ///
    /// ```text
    /// zᵢ' = √(1 - β²) zᵢ + β ξᵢ,   ξᵢ standard normal
    /// ```
    ///
    /// for a random set of coordinates: all, each with probability 1/2, or a single one. For each β
    /// and set, the move is reversible under the standard normal distribution (a preconditioned
    /// Crank-Nicolson step), so accepting it exactly if its result is in a set leaves the
    /// distribution within the set invariant.
    ///
    /// # Reference
    /// Cotter, Roberts, Stuart and White, "MCMC methods for functions: modifying old algorithms to
    /// make them faster", Statistical Science 28, 2013. Adapted steps: Papaioannou, Betz,
    /// Zwirglmaier and Straub, "MCMC algorithms for subset simulation", Probabilistic Engineering
    /// Mechanics 41, 2015.
    pub(crate) fn proposal(&self, draw: &Draw, random: &mut Sequence) -> Draw {
        let n = draw.latent.len() as u64;
        let mut latent = draw.latent.clone();
        if n > 0 {
            let beta = (self.step * VARIATION.powf(2.0 * random.uniform() - 1.0)).min(1.0);
            let keep = (1.0 - beta * beta).sqrt();
            let kind = random.below(4);
            let always = random.below(n) as usize;
            for (i, z) in latent.iter_mut().enumerate() {
                let is_moved = match kind {
                    0 => i == always,
                    1 => i == always || random.uniform() < 0.5,
                    _ => true,
                };
                if is_moved {
                    *z = keep * *z + beta * random.normal_pair().0;
                }
            }
        }
        let draws_seed = self.depends_on_seed && (n == 0 || random.uniform() < SEED);
        let seed = if draws_seed { Seed(random.bits()) } else { draw.seed };
        Draw { latent, seed }
    }

    /// Adapts the size of the steps to the fraction of moves that were accepted.
    pub(crate) fn adapt(&mut self, acceptance: f64) {
        self.step = (self.step * (acceptance - ACCEPTANCE).exp()).clamp(SMALLEST, 1.0);
    }
}
