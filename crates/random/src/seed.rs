use crate::philox::{halves, joined, philox4x32, unit};

/// A random seed of 64 bits, from which random numbers and child seeds are derived without state.
///
/// Every number is a pure function of (seed, stream, step, index): the output of Philox4x32-10 with
/// the seed as key and the rest as counter. So the order of threads or calls cannot change a
/// number, and streams are independent.
///
/// # Example
/// ```
/// use mishandle_random::{Seed, Stream};
/// let simulation = Seed(7).child(0).child(12); // run 7, trial 0, simulation 12
/// let mut noise = [0.0; 3];
/// simulation.normals(Stream::ActionNoise, 41, &mut noise);
/// let mut again = [0.0; 3];
/// simulation.normals(Stream::ActionNoise, 41, &mut again);
/// assert_eq!(noise, again);
/// ```
///
/// # Reference
/// Salmon, Moraes, Dror and Shaw, "Parallel random numbers: as easy as 1, 2, 3", SC 2011.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Seed(pub u64);

/// The use of random numbers. The discriminants never change: a new use gets a new discriminant.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[repr(u32)]
pub enum Stream {
    /// Noise added to actions.
    ActionNoise = 0,
    /// Noise added to observations.
    ObservationNoise = 1,
    /// Random numbers of an environment's reset.
    Reset = 2,
    /// Delays of actions or observations.
    Delay = 3,
    /// External pushes.
    Push = 4,
    /// Action samples of a stochastic policy.
    Policy = 5,
    /// Child seeds.
    Child = 6,
    /// Initial states sampled by a training run or an evaluation.
    InitialConfiguration = 7,
    /// Initial weights of a network.
    Weights = 8,
    /// Shuffling of minibatches.
    Shuffle = 9,
    /// Noise of a sensor, whose standard deviation is part of the scenario.
    SensorNoise = 10,
    /// Losses and late commands of a fault, whose probability is part of the scenario.
    Fault = 11,
    /// Choice of the scenario of a training episode.
    Scenario = 12,
    /// Disturbances that a proposal of importance sampling chooses while the simulation runs.
    Steering = 13,
    /// Noise of a camera's sensor, whose standard deviation is part of the scenario.
    CameraNoise = 14,
}

impl Seed {
    /// Returns child seed `index`, for example the seed of a trial in a run or of a simulation in a
    /// trial.
    pub fn child(self, index: u64) -> Seed {
        let [a, b, _, _] = self.block(Stream::Child, index, 0);
        Seed(joined(a, b))
    }

    /// Returns a uniform random number in [0, 1) with 53 random bits.
    pub fn uniform(self, stream: Stream, step: u64, index: u32) -> f64 {
        let [a, b, _, _] = self.block(stream, step, index);
        unit(joined(a, b))
    }

    /// Fills `out` with independent standard normal numbers by the Box-Muller transform.
    ///
    /// # Reference
    /// Box and Muller, "A Note on the Generation of Random Normal Deviates", The Annals of
    /// Mathematical Statistics 29, 1958.
    pub fn normals(self, stream: Stream, step: u64, out: &mut [f64]) {
        for (pair, index) in out.chunks_mut(2).zip(0..) {
            let [a, b, c, d] = self.block(stream, step, index);
            // 1 - u lies in (0, 1], where the logarithm is finite.
            let radius = (-2.0 * (1.0 - unit(joined(a, b))).ln()).sqrt();
            let (sin, cos) = (std::f64::consts::TAU * unit(joined(c, d))).sin_cos();
            pair[0] = radius * cos;
            if let Some(second) = pair.get_mut(1) {
                *second = radius * sin;
            }
        }
    }

    /// Returns 128 random bits, for whoever needs many numbers of few bits.
    pub fn block(self, stream: Stream, step: u64, index: u32) -> [u32; 4] {
        let [low, high] = halves(step);
        philox4x32([index, stream as u32, low, high], halves(self.0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn normals_have_mean_zero_and_variance_one() {
        let mut out = vec![0.0; 200_000];
        Seed(3).normals(Stream::ActionNoise, 0, &mut out);
        let n = out.len() as f64;
        let mean = out.iter().sum::<f64>() / n;
        let variance = out.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / n;
        // Five standard errors: 5 / sqrt(n) for the mean, 5 sqrt(2 / n) for the variance.
        assert!(mean.abs() < 5.0 / n.sqrt(), "mean {mean}");
        assert!((variance - 1.0).abs() < 5.0 * (2.0 / n).sqrt(), "variance {variance}");
    }

    #[test]
    fn streams_steps_and_children_differ() {
        let seed = Seed(1);
        let mut seen = std::collections::HashSet::new();
        for step in 0..100 {
            for stream in [Stream::ActionNoise, Stream::Reset, Stream::Policy] {
                assert!(seen.insert(seed.uniform(stream, step, 0).to_bits()));
                assert!(seen.insert(seed.child(step + 1).uniform(stream, step, 0).to_bits()));
            }
        }
    }
}
