//! An observer of training that only fails if a file cannot be written.

use mishandle::MishandleError;
use mishandle::train::TrainObserver;
use mishandle::training::{TrainingControl, TrainingProgress};

pub struct Silent;

impl TrainObserver for Silent {
    fn iteration_finished(&mut self, _progress: &TrainingProgress) -> TrainingControl {
        TrainingControl::Continue
    }

    fn write_failed(&mut self, error: &MishandleError) {
        panic!("{error}");
    }
}
