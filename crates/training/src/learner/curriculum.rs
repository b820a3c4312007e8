//! Curriculum: the share of the scenarios' ranges grows with success.

use mishandle_controllers::Policy;

use super::Learner;
use crate::{Checkpoint, CurriculumSettings, Observer, PartValidation, TrainingError, Validation};

/// The share of the range of each axis, around nominal, from which episodes draw.
#[derive(Debug)]
pub(super) struct Curriculum {
    settings: CurriculumSettings,
    /// How often the share has grown.
    growths: u64,
}

impl Curriculum {
    /// Starts a curriculum.
    pub fn new(settings: CurriculumSettings) -> Curriculum {
        Curriculum { settings, growths: 0 }
    }

    /// Returns the current share.
    pub fn share(&self) -> f64 {
        self.settings.share(self.growths)
    }

    /// Measures the policy over the current share, adds that to the validation, and grows the share
    /// of the learner's next episodes if the success rate reaches the threshold.
    pub fn validate(
        &mut self,
        policy: &Policy,
        episodes: usize,
        validation: &mut Validation,
        observer: &mut dyn Observer,
        learner: &mut dyn Learner,
    ) {
        let share = self.share();
        let rates =
            if share < 1.0 { observer.validate_part(policy, episodes, share) } else { validation.space };
        validation.part = rates.map(|rates| PartValidation { share, rates });
        let is_ready = rates.is_some_and(|rates| rates.success_rate >= self.settings.threshold);
        if share < 1.0 && is_ready {
            self.growths += 1;
            learner.set_scenario_share(self.share());
        }
    }

    /// Saves the state to a checkpoint.
    pub fn save(&self, checkpoint: &mut Checkpoint) {
        checkpoint.put("curriculum.growths", vec![self.growths]);
    }

    /// Restores the state from a checkpoint, also that of the learner.
    ///
    /// # Errors
    /// If the checkpoint has no such state.
    pub fn load(&mut self, checkpoint: &Checkpoint, learner: &mut dyn Learner) -> Result<(), TrainingError> {
        self.growths = checkpoint.u64s("curriculum.growths", 1)?[0];
        learner.set_scenario_share(self.share());
        Ok(())
    }
}
