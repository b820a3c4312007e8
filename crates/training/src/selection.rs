//! Which policy of a training is kept, and when it is good enough.

use mishandle_controllers::Policy;
use mishandle_network::Mlp;

use crate::{Checkpoint, TrainingError, Validation};

/// Keeps the best policy so far, and counts validations in a row that reached what was asked for.
#[derive(Clone, Debug)]
pub struct Selection {
    stop_success: Option<f64>,
    stop_strict: Option<f64>,
    stop_validations: u64,
    best: Option<Best>,
    streak: u64,
}

/// The best policy so far.
#[derive(Clone, Debug)]
pub struct Best {
    /// The policy.
    pub policy: Policy,
    /// What its validation found.
    pub validation: Validation,
    /// Environment steps until it.
    pub environment_steps: u64,
}

impl Selection {
    /// A selection that is content after `stop_validations` validations in a row with at least these rates; never if
    /// both are `None`.
    pub fn new(stop_success: Option<f64>, stop_strict: Option<f64>, stop_validations: u64) -> Selection {
        Selection { stop_success, stop_strict, stop_validations, best: None, streak: 0 }
    }

    /// Takes in a validated policy.
    pub fn offer(&mut self, policy: &Policy, validation: Validation, environment_steps: u64) {
        let reached = |wanted: Option<f64>, rate: f64| wanted.is_none_or(|wanted| rate >= wanted);
        let good = reached(self.stop_success, validation.success_rate)
            && reached(self.stop_strict, validation.strict_success_rate);
        self.streak = if good { self.streak + 1 } else { 0 };
        if self.best.as_ref().is_none_or(|best| better(&validation, &best.validation)) {
            self.best = Some(Best { policy: policy.clone(), validation, environment_steps });
        }
    }

    /// Whether enough validations in a row were good enough.
    pub fn content(&self) -> bool {
        let asked = self.stop_success.is_some() || self.stop_strict.is_some();
        asked && self.streak >= self.stop_validations
    }

    /// The best policy so far.
    pub fn best(&self) -> Option<&Best> {
        self.best.as_ref()
    }

    /// Puts the best policy and the count into a checkpoint.
    pub fn save(&self, checkpoint: &mut Checkpoint) {
        checkpoint.put("selection.streak", vec![self.streak]);
        if let Some(Best { policy, validation, environment_steps }) = &self.best {
            checkpoint.put_policy("selection.best", policy);
            let Validation { success_rate, strict_success_rate, mean_return } = *validation;
            checkpoint.put("selection.validation", vec![success_rate, strict_success_rate, mean_return]);
            checkpoint.put("selection.environment_steps", vec![*environment_steps]);
        }
    }

    /// Goes on where a checkpoint was taken; policies have the sizes of `like`.
    ///
    /// # Errors
    /// If the checkpoint holds policies of other sizes.
    pub fn load(&mut self, checkpoint: &Checkpoint, like: &Mlp<f32>) -> Result<(), TrainingError> {
        self.streak = checkpoint.u64s("selection.streak", 1)?[0];
        if checkpoint.holds("selection.validation") {
            let rates = checkpoint.f64s("selection.validation", 3)?;
            self.best = Some(Best {
                policy: checkpoint.policy("selection.best", like)?,
                validation: Validation {
                    success_rate: rates[0],
                    strict_success_rate: rates[1],
                    mean_return: rates[2],
                },
                environment_steps: checkpoint.u64s("selection.environment_steps", 1)?[0],
            });
        }
        Ok(())
    }
}

/// Strict success decides, then success, then the return; a later policy does not replace an equal one.
fn better(new: &Validation, old: &Validation) -> bool {
    let key = |v: &Validation| (v.strict_success_rate, v.success_rate, v.mean_return);
    key(new) > key(old)
}

#[cfg(test)]
mod tests {
    use super::*;
    use mishandle_network::Activation;

    fn policy(bias: f32) -> Policy {
        let mut network = Mlp::new(&[1, 1], Activation::Elu, Activation::Identity).unwrap();
        network.update(|parameters| parameters[1] = bias);
        Policy::new(vec![0.0], vec![1.0], network, vec![0.0]).unwrap()
    }

    fn found(success_rate: f64, strict_success_rate: f64, mean_return: f64) -> Validation {
        Validation { success_rate, strict_success_rate, mean_return }
    }

    #[test]
    fn strict_success_comes_before_success_and_both_before_the_return() {
        let mut selection = Selection::new(None, None, 1);
        let offers = [found(0.5, 0.5, 9.0), found(0.9, 0.4, 9.0), found(0.6, 0.5, 1.0), found(0.6, 0.5, 1.0)];
        for (offer, number) in offers.into_iter().zip(0..) {
            selection.offer(&policy(number as f32), offer, number);
        }
        assert_eq!(selection.best().unwrap().environment_steps, 2);
        assert!(!selection.content());
    }

    #[test]
    fn content_after_enough_good_validations_in_a_row() {
        let mut selection = Selection::new(Some(0.9), Some(0.5), 2);
        let mut seen = vec![];
        for (success, strict) in [(0.95, 0.6), (0.95, 0.4), (0.95, 0.5), (0.9, 0.5)] {
            selection.offer(&policy(0.0), found(success, strict, 0.0), 0);
            seen.push(selection.content());
        }
        assert_eq!(seen, [false, false, false, true]);
    }

    #[test]
    fn a_selection_goes_on_after_a_checkpoint() {
        let mut selection = Selection::new(Some(0.9), None, 2);
        selection.offer(&policy(0.25), found(0.95, 0.1, 3.0), 77);
        let mut checkpoint = Checkpoint::new("ppo", "toy", 0, "");
        selection.save(&mut checkpoint);
        let mut resumed = Selection::new(Some(0.9), None, 2);
        resumed.load(&checkpoint, policy(0.0).network()).unwrap();
        assert_eq!(resumed.best().unwrap().policy.hash(), policy(0.25).hash());
        assert_eq!(resumed.best().unwrap().environment_steps, 77);
        resumed.offer(&policy(0.0), found(0.9, 0.0, 0.0), 78);
        assert!(resumed.content());
    }
}
