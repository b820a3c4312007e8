use crate::{RolloutError, Seed, Stream};

/// Gaussian noise on actions and observations, given as standard deviations.
///
/// Action noise is in units of the normalized action. It is added after the action is clipped to
/// [-1, 1], and the sum is not clipped again. Observation noise is added to the controller's input,
/// in the units of the observation.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Noise {
    /// Standard deviation of the noise on each action.
    pub action_std: f64,
    /// Standard deviation of the noise on each observation.
    pub observation_std: f64,
}

impl Noise {
    /// Maximum standard deviation of both noises: ten times the largest action. Far larger noise is
    /// finite but leaves nothing of the controller, and a verdict on it would be meaningless.
    pub const MAX_STD: f64 = 10.0;

    /// Checks that both standard deviations are from 0 to [`MAX_STD`](Self::MAX_STD).
    ///
    /// # Errors
    /// [`RolloutError::Noise`] if one is not.
    pub fn check(&self) -> Result<(), RolloutError> {
        for (what, value) in [("action noise", self.action_std), ("observation noise", self.observation_std)]
        {
            if !(0.0..=Noise::MAX_STD).contains(&value) {
                return Err(RolloutError::Noise { what, value, max: Noise::MAX_STD });
            }
        }
        Ok(())
    }

    /// Adds the noise of control step `step` to a clipped action.
    ///
    /// `draws` is a scratch buffer of the same length. `explicit` may modify the standard normal
    /// draws in it.
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

    /// Adds the noise of sample `step` to an observation. `draws` is a scratch buffer of the same
    /// length.
    pub fn on_observation(&self, seed: Seed, step: u64, observation: &mut [f32], draws: &mut [f64]) {
        if self.observation_std > 0.0 {
            seed.normals(Stream::ObservationNoise, step, draws);
            for (o, z) in observation.iter_mut().zip(draws) {
                *o += (self.observation_std * *z) as f32;
            }
        }
    }
}
