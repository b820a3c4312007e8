//! Saves episodes to a checkpoint and restores them.

use mishandle_rollout::{EnvironmentSpec, RolloutError};

use super::{Episodes, RowState, episode_seed};
use crate::{Checkpoint, TrainingError};

impl Episodes {
    /// Saves all environments to a checkpoint.
    ///
    /// # Errors
    /// If the batch fails.
    pub fn save(&mut self, checkpoint: &mut Checkpoint) -> Result<(), RolloutError> {
        let mut states = vec![0.0; self.rows() * self.spec.state_size];
        self.batch.read_states(&mut states)?;
        checkpoint.put("episodes.states", states);
        checkpoint.put("episodes.observations", self.batch.observations().to_vec());
        if let Some(disturbed) = &mut self.disturbed {
            disturbed.save(checkpoint);
        }
        if let Some(remembered) = &self.remembered {
            remembered.save(checkpoint);
        }
        if let Some(supervised) = &self.supervised {
            supervised.save(checkpoint);
        }
        if let Some(privileged) = &self.privileged {
            privileged.save(checkpoint);
        }
        let row_states = || self.row_states.iter();
        checkpoint.put("episodes.episode", row_states().map(|c| c.episode).collect::<Vec<_>>());
        checkpoint.put("episodes.step", row_states().map(|c| c.step).collect::<Vec<_>>());
        checkpoint.put("episodes.elapsed", row_states().map(|c| c.elapsed as u64).collect::<Vec<_>>());
        checkpoint.put("episodes.total_reward", row_states().map(|c| c.total_reward).collect::<Vec<_>>());
        Ok(())
    }

    /// Restores all environments from a checkpoint. Statistics start at 0.
    ///
    /// # Errors
    /// If the checkpoint contains arrays of other sizes, or the batch fails.
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
            self.row_states[row] = RowState {
                episode: episode[row],
                step: step[row],
                elapsed: elapsed[row] as usize,
                total_reward: total_reward[row],
            };
        }
        if let Some(supervised) = &mut self.supervised {
            supervised.load(checkpoint)?;
        }
        let Episodes { batch, disturbed, remembered, privileged, row_states, seed, .. } = self;
        if let Some(privileged) = privileged {
            privileged.load(checkpoint, batch.observations())?;
        }
        if let Some(disturbed) = disturbed {
            disturbed.load(checkpoint, |row| episode_seed(*seed, row, row_states[row].episode))?;
        }
        let observations =
            disturbed.as_ref().map_or(batch.observations(), |disturbed| disturbed.observations());
        remembered.as_mut().map_or(Ok(()), |remembered| remembered.load(checkpoint, observations))
    }
}
