//! Markov chain moves that leave the distribution of scenarios invariant.

use mishandle_random::{Seed, Sequence};

use crate::Draw;

/// Smallest step of a move. The largest is 1, a fresh draw.
const SMALLEST: f64 = 0.03;

/// Probability that a move also draws another seed, if the seed has an effect.
const SEED: f64 = 0.5;

/// Returns a random move from `draw`:
///
/// ```text
/// zᵢ' = √(1 - β²) zᵢ + β ξᵢ,   ξᵢ standard normal, ln β uniform from ln 0.03 to 0
/// ```
///
/// for a random set of coordinates: all, each with probability 1/2, or a single one. The move is reversible under the standard normal
/// distribution (a preconditioned Crank-Nicolson step for each set and β), so accepting it exactly if its result is in a set leaves
/// the distribution within the set invariant. The random β and set need no adaptation to the set: some of the moves fit.
///
/// # Reference
/// Cotter, Roberts, Stuart and White, "MCMC methods for functions: modifying old algorithms to make them faster", Statistical Science
/// 28, 2013; single coordinates: Au and Beck, "Estimation of small failure probabilities in high dimensions by subset simulation",
/// Probabilistic Engineering Mechanics 16, 2001.
pub(crate) fn proposal(draw: &Draw, depends_on_seed: bool, random: &mut Sequence) -> Draw {
    let n = draw.latent.len() as u64;
    let mut latent = draw.latent.clone();
    if n > 0 {
        let beta = SMALLEST.powf(random.uniform());
        let keep = (1.0 - beta * beta).sqrt();
        let (kind, always) = (random.below(3), random.below(n) as usize);
        for (i, z) in latent.iter_mut().enumerate() {
            let is_moved = match kind {
                0 => true,
                1 => i == always || random.uniform() < 0.5,
                _ => i == always,
            };
            if is_moved {
                *z = keep * *z + beta * random.normal_pair().0;
            }
        }
    }
    let draws_seed = depends_on_seed && (n == 0 || random.uniform() < SEED);
    let seed = if draws_seed { Seed(random.bits()) } else { draw.seed };
    Draw { latent, seed }
}
