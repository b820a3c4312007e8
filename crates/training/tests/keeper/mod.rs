//! An observer of training runs that do not validate.

use mishandle_controllers::Policy;
use mishandle_training::{Checkpoint, Observer, TrainingControl, TrainingProgress, Validation};

/// Keeps the last checkpoint and stops after iteration `stop_after`.
#[derive(Default)]
pub struct Keeper {
    pub stop_after: Option<u64>,
    pub checkpoint: Option<Checkpoint>,
}

impl Observer for Keeper {
    fn validate(&mut self, _policy: &Policy, _episodes: usize) -> Option<Validation> {
        None
    }
    fn iteration_finished(&mut self, progress: &TrainingProgress) -> TrainingControl {
        if Some(progress.iteration) == self.stop_after {
            TrainingControl::Stop
        } else {
            TrainingControl::Continue
        }
    }
    fn save_checkpoint(&mut self, checkpoint: &Checkpoint) {
        self.checkpoint = Some(checkpoint.clone());
    }
}
