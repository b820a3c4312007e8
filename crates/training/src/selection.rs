//! Which policy of a training is kept, and when it is good enough.

use mishandle_controllers::Policy;
use mishandle_network::Mlp;

use crate::{Checkpoint, TrainingError, Validation};

/// Keeps the best policy so far and what the last validation found, and counts validations in a row that reached what was asked for.
#[derive(Clone, Debug)]
pub struct Selection {
    stop_success: Option<f64>,
    stop_strict: Option<f64>,
    stop_validations: u64,
    best: Option<Best>,
    /// What the last validation found, and the environment steps until it.
    last: Option<(Validation, u64)>,
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
        Selection { stop_success, stop_strict, stop_validations, best: None, last: None, streak: 0 }
    }

    /// Takes in a validated policy.
    pub fn offer(&mut self, policy: &Policy, validation: Validation, environment_steps: u64) {
        let reached = |wanted: Option<f64>, rate: f64| wanted.is_none_or(|wanted| rate >= wanted);
        let good = reached(self.stop_success, validation.success_rate)
            && reached(self.stop_strict, validation.strict_success_rate);
        self.streak = if good { self.streak + 1 } else { 0 };
        self.last = Some((validation, environment_steps));
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

    /// What the last validation found, if there was one.
    pub fn last(&self) -> Option<Validation> {
        self.last.map(|(validation, _)| validation)
    }

    /// What the validation after `environment_steps` found, if it was the last.
    pub fn last_at(&self, environment_steps: u64) -> Option<Validation> {
        self.last.filter(|(_, steps)| *steps == environment_steps).map(|(validation, _)| validation)
    }

    /// Puts the best policy, the last validation and the count into a checkpoint.
    pub fn save(&self, checkpoint: &mut Checkpoint) {
        checkpoint.put("selection.streak", vec![self.streak]);
        if let Some(Best { policy, validation, environment_steps }) = &self.best {
            checkpoint.put_policy("selection.best", policy);
            checkpoint.put("selection.validation", rates(validation));
            checkpoint.put("selection.environment_steps", vec![*environment_steps]);
        }
        if let Some((validation, environment_steps)) = &self.last {
            checkpoint.put("selection.last_validation", rates(validation));
            checkpoint.put("selection.last_environment_steps", vec![*environment_steps]);
        }
    }

    /// Goes on where a checkpoint was taken; policies have the sizes of `like`.
    ///
    /// # Errors
    /// If the checkpoint holds policies of other sizes.
    pub fn load(&mut self, checkpoint: &Checkpoint, like: &Mlp<f32>) -> Result<(), TrainingError> {
        self.streak = checkpoint.u64s("selection.streak", 1)?[0];
        if checkpoint.holds("selection.validation") {
            self.best = Some(Best {
                policy: checkpoint.policy("selection.best", like)?,
                validation: validation(checkpoint, "selection.validation")?,
                environment_steps: checkpoint.u64s("selection.environment_steps", 1)?[0],
            });
            self.last = self.best.as_ref().map(|best| (best.validation, best.environment_steps));
        }
        // Checkpoints from before it was kept have none.
        if checkpoint.holds("selection.last_validation") {
            let environment_steps = checkpoint.u64s("selection.last_environment_steps", 1)?[0];
            self.last = Some((validation(checkpoint, "selection.last_validation")?, environment_steps));
        }
        Ok(())
    }
}

/// A validation as a checkpoint has it.
fn rates(validation: &Validation) -> Vec<f64> {
    let Validation { success_rate, strict_success_rate, mean_return } = *validation;
    vec![success_rate, strict_success_rate, mean_return]
}

fn validation(checkpoint: &Checkpoint, name: &str) -> Result<Validation, TrainingError> {
    let rates = checkpoint.f64s(name, 3)?;
    Ok(Validation { success_rate: rates[0], strict_success_rate: rates[1], mean_return: rates[2] })
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
        let mut selection = Selection::new(Some(0.9), None, 3);
        selection.offer(&policy(0.25), found(0.95, 0.1, 3.0), 77);
        selection.offer(&policy(0.5), found(0.92, 0.1, 4.0), 90);
        let mut checkpoint = Checkpoint::new("ppo", "toy", 0, "");
        selection.save(&mut checkpoint);
        let mut resumed = Selection::new(Some(0.9), None, 3);
        resumed.load(&checkpoint, policy(0.0).network()).unwrap();
        assert_eq!(resumed.best().unwrap().policy.hash(), policy(0.25).hash());
        assert_eq!(resumed.best().unwrap().environment_steps, 77);
        assert_eq!(resumed.last(), Some(found(0.92, 0.1, 4.0)));
        assert_eq!((resumed.last_at(90), resumed.last_at(77)), (resumed.last(), None));
        resumed.offer(&policy(0.0), found(0.9, 0.0, 0.0), 91);
        assert!(resumed.content());
    }
}
