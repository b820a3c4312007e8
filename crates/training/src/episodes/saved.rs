//! Episodes in a checkpoint.

use mishandle_rollout::{EnvironmentSpec, RolloutError};

use super::{Clock, Episodes};
use crate::{Checkpoint, TrainingError};

impl Episodes {
    /// Puts all that the future depends on into a checkpoint.
    ///
    /// # Errors
    /// If the batch fails as a whole.
    pub fn save(&mut self, checkpoint: &mut Checkpoint) -> Result<(), RolloutError> {
        let mut states = vec![0.0; self.rows() * self.spec.state_size];
        self.batch.read_states(&mut states)?;
        checkpoint.put("episodes.states", states);
        checkpoint.put("episodes.observations", self.observations().to_vec());
        let clocks = || self.clocks.iter();
        checkpoint.put("episodes.episode", clocks().map(|c| c.episode).collect::<Vec<_>>());
        checkpoint.put("episodes.step", clocks().map(|c| c.step).collect::<Vec<_>>());
        checkpoint.put("episodes.elapsed", clocks().map(|c| c.elapsed as u64).collect::<Vec<_>>());
        checkpoint.put("episodes.total_reward", clocks().map(|c| c.total_reward).collect::<Vec<_>>());
        Ok(())
    }

    /// Goes on where a checkpoint was taken. Statistics begin anew.
    ///
    /// # Errors
    /// If the checkpoint holds other rows than these, or the batch fails as a whole.
    pub fn load(&mut self, checkpoint: &Checkpoint) -> Result<(), TrainingError> {
        let rows = self.rows();
        let EnvironmentSpec { state_size, observation_size, .. } = self.spec;
        let states = checkpoint.f64s("episodes.states", rows * state_size)?;
        let observations = checkpoint.f32s("episodes.observations", rows * observation_size)?;
        let episode = checkpoint.u64s("episodes.episode", rows)?;
        let step = checkpoint.u64s("episodes.step", rows)?;
        let elapsed = checkpoint.u64s("episodes.elapsed", rows)?;
        let total_reward = checkpoint.f64s("episodes.total_reward", rows)?;
        self.batch.write_states(states, observations)?;
        for row in 0..rows {
            self.clocks[row] = Clock {
                episode: episode[row],
                step: step[row],
                elapsed: elapsed[row] as usize,
                total_reward: total_reward[row],
            };
        }
        Ok(())
    }
}
