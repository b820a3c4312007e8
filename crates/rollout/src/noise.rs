use crate::{RolloutError, Seed, Stream};

/// Gaussian noise on what passes between controller and environment: standard deviations, never variances.
///
/// Action noise is in units of the normalised action. It is added after the action has been clipped to [-1, 1], and
/// the sum is not clipped again. Observation noise is added to what the controller sees, in the observation's units.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Noise {
    /// Standard deviation of the noise on each action.
    pub action_std: f64,
    /// Standard deviation of the noise on each observation.
    pub observation_std: f64,
}

impl Noise {
    /// Checks both levels.
    ///
    /// # Errors
    /// If one is negative, NaN or infinite.
    pub fn check(&self) -> Result<(), RolloutError> {
        for (what, value) in [("action noise", self.action_std), ("observation noise", self.observation_std)]
        {
            if !(value >= 0.0 && value.is_finite()) {
                return Err(RolloutError::Noise { what, value });
            }
        }
        Ok(())
    }

    /// Adds the noise of control step `step` to a clipped action; `draws` is scratch of the same length, and `explicit`
    /// may replace what was drawn.
    pub(crate) fn on_action(
        &self,
        seed: Seed,
        step: u64,
        action: &mut [f64],
        draws: &mut [f64],
        explicit: impl FnOnce(&mut [f64]),
    ) {
        if self.action_std > 0.0 {
            seed.normals(Stream::ActionNoise, step, draws);
            explicit(draws);
            for (a, z) in action.iter_mut().zip(draws) {
                *a += self.action_std * *z;
            }
        }
    }

    /// Adds the noise of sample `step` to what the controller sees; `draws` is scratch of the same length.
    pub(crate) fn on_observation(&self, seed: Seed, step: u64, observation: &mut [f32], draws: &mut [f64]) {
        if self.observation_std > 0.0 {
            seed.normals(Stream::ObservationNoise, step, draws);
            for (o, z) in observation.iter_mut().zip(draws) {
                *o += (self.observation_std * *z) as f32;
            }
        }
    }
}
