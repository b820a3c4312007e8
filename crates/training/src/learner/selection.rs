//! Selection of the best policy, and early stopping.

use mishandle_controllers::Policy;
use mishandle_network::Mlp;

use crate::{Checkpoint, PartValidation, Rates, SelectionWeights, TrainingError, Validation};

/// Keeps the best policy and the last validation, and counts consecutive validations that reached
/// the target rates.
#[derive(Clone, Debug)]
pub struct PolicySelection {
    stop_success: Option<f64>,
    stop_strict: Option<f64>,
    stop_validations: u64,
    weights: SelectionWeights,
    best: Option<BestPolicy>,
    /// The last validation and its environment steps.
    last: Option<(Validation, u64)>,
    streak: u64,
}

/// The best policy so far, with its validation.
#[derive(Clone, Debug)]
pub struct BestPolicy {
    /// The policy.
    pub policy: Policy,
    /// Its validation.
    pub validation: Validation,
    /// Environment steps at its validation.
    pub environment_steps: u64,
}

impl PolicySelection {
    /// Creates a selection whose target is `stop_validations` consecutive validations with at least
    /// these rates; without a target if both are `None`.
    pub fn new(
        stop_success: Option<f64>,
        stop_strict: Option<f64>,
        stop_validations: u64,
    ) -> PolicySelection {
        PolicySelection {
            stop_success,
            stop_strict,
            stop_validations,
            weights: SelectionWeights::default(),
            best: None,
            last: None,
            streak: 0,
        }
    }

    /// Returns the selection by another [mixture](Validation::mixture) of the validations.
    pub fn with_weights(self, weights: SelectionWeights) -> PolicySelection {
        PolicySelection { weights, ..self }
    }

    /// Records a validated policy.
    pub fn record(&mut self, policy: &Policy, validation: Validation, environment_steps: u64) {
        let reached = |target: Option<f64>, rate: f64| target.is_none_or(|target| rate >= target);
        let rates = validation.mixture(&self.weights);
        let both_reached = reached(self.stop_success, rates.success_rate)
            && reached(self.stop_strict, rates.strict_success_rate);
        self.streak = if both_reached { self.streak + 1 } else { 0 };
        self.last = Some((validation, environment_steps));
        if self.best.as_ref().is_none_or(|best| better(rates, best.validation.mixture(&self.weights))) {
            self.best = Some(BestPolicy { policy: policy.clone(), validation, environment_steps });
        }
    }

    /// Returns whether enough consecutive validations reached the target rates.
    pub fn target_reached(&self) -> bool {
        let has_target = self.stop_success.is_some() || self.stop_strict.is_some();
        has_target && self.streak >= self.stop_validations
    }

    /// Returns the best policy so far.
    pub fn best(&self) -> Option<&BestPolicy> {
        self.best.as_ref()
    }

    /// Returns the last validation, if there was one.
    pub fn last_validation(&self) -> Option<Validation> {
        self.last.map(|(validation, _)| validation)
    }

    /// Returns the last validation if it happened after `environment_steps`.
    pub fn validation_at(&self, environment_steps: u64) -> Option<Validation> {
        self.last.filter(|(_, steps)| *steps == environment_steps).map(|(validation, _)| validation)
    }

    /// Saves the best policy, the last validation and the streak to a checkpoint.
    pub fn save(&self, checkpoint: &mut Checkpoint) {
        checkpoint.put("selection.streak", vec![self.streak]);
        if let Some(BestPolicy { policy, validation, environment_steps }) = &self.best {
            checkpoint.put_policy("selection.best", policy);
            put(checkpoint, "selection.validation", validation);
            checkpoint.put("selection.environment_steps", vec![*environment_steps]);
        }
        if let Some((validation, environment_steps)) = &self.last {
            put(checkpoint, "selection.last_validation", validation);
            checkpoint.put("selection.last_environment_steps", vec![*environment_steps]);
        }
    }

    /// Restores the selection from a checkpoint; policies have the sizes of `like`.
    ///
    /// # Errors
    /// If the checkpoint contains policies of other sizes.
    pub fn load(&mut self, checkpoint: &Checkpoint, like: &Mlp<f32>) -> Result<(), TrainingError> {
        self.streak = checkpoint.u64s("selection.streak", 1)?[0];
        if checkpoint.contains("selection.validation") {
            self.best = Some(BestPolicy {
                policy: checkpoint.policy("selection.best", like)?,
                validation: validation(checkpoint, "selection.validation")?,
                environment_steps: checkpoint.u64s("selection.environment_steps", 1)?[0],
            });
            self.last = self.best.as_ref().map(|best| (best.validation, best.environment_steps));
        }
        // Early checkpoints do not contain the last validation.
        if checkpoint.contains("selection.last_validation") {
            let environment_steps = checkpoint.u64s("selection.last_environment_steps", 1)?[0];
            self.last = Some((validation(checkpoint, "selection.last_validation")?, environment_steps));
        }
        Ok(())
    }
}

/// Adds a validation to a checkpoint.
fn put(checkpoint: &mut Checkpoint, name: &str, validation: &Validation) {
    let parts = [
        ("", Some(validation.nominal())),
        (".space", validation.space),
        (".corners", validation.corners),
        (".part", validation.part.map(|part| part.rates)),
    ];
    for (part, rates) in parts {
        if let Some(Rates { success_rate, strict_success_rate, mean_return }) = rates {
            checkpoint.put(&format!("{name}{part}"), vec![success_rate, strict_success_rate, mean_return]);
        }
    }
    if let Some(PartValidation { share, .. }) = validation.part {
        checkpoint.put(&format!("{name}.share"), vec![share]);
    }
}

fn validation(checkpoint: &Checkpoint, name: &str) -> Result<Validation, TrainingError> {
    let rates = |name: &str| -> Result<Rates, TrainingError> {
        let rates = checkpoint.f64s(name, 3)?;
        Ok(Rates { success_rate: rates[0], strict_success_rate: rates[1], mean_return: rates[2] })
    };
    let optional = |part: &str| {
        let name = format!("{name}.{part}");
        checkpoint.contains(&name).then(|| rates(&name)).transpose()
    };
    let space = optional("space")?;
    let corners = optional("corners")?;
    let part = match optional("part")? {
        Some(rates) => {
            Some(PartValidation { share: checkpoint.f64s(&format!("{name}.share"), 1)?[0], rates })
        }
        None => None,
    };
    Ok(Validation { space, corners, part, ..Validation::of_starts(rates(name)?) })
}

/// Compares by strict success, then success, then return. A later policy does not replace an equal
/// one, and no verdict is worse than any.
fn better(new: Rates, old: Rates) -> bool {
    let rate = |rate: f64| if rate.is_nan() { f64::NEG_INFINITY } else { rate };
    let key = |v: Rates| (rate(v.strict_success_rate), rate(v.success_rate), v.mean_return);
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

    fn validation_of(success_rate: f64, strict_success_rate: f64, mean_return: f64) -> Validation {
        Validation::of_starts(Rates { success_rate, strict_success_rate, mean_return })
    }

    #[test]
    fn a_policy_without_a_verdict_is_worse_than_any_other() {
        let unknown = Rates { success_rate: f64::NAN, strict_success_rate: f64::NAN, mean_return: 9.0 };
        let failing = Rates { success_rate: 0.0, strict_success_rate: 0.0, mean_return: -9.0 };
        assert!(better(failing, unknown) && !better(unknown, failing) && !better(unknown, unknown));
        let mut selection = PolicySelection::new(Some(0.0), None, 1);
        selection.record(&policy(0.0), Validation::of_starts(unknown), 0);
        assert!(!selection.target_reached());
    }

    #[test]
    fn policies_are_ranked_by_strict_success_then_success_then_return() {
        let mut selection = PolicySelection::new(None, None, 1);
        let validations = [
            validation_of(0.5, 0.5, 9.0),
            validation_of(0.9, 0.4, 9.0),
            validation_of(0.6, 0.5, 1.0),
            validation_of(0.6, 0.5, 1.0),
        ];
        for (validation, number) in validations.into_iter().zip(0..) {
            selection.record(&policy(number as f32), validation, number);
        }
        assert_eq!(selection.best().unwrap().environment_steps, 2);
        assert!(!selection.target_reached());
    }

    #[test]
    fn the_mixture_of_the_validations_decides() {
        // Policy 1 is better without disturbances, policy 0 in the space.
        let validations = [(0.8, 0.6), (0.9, 0.3)].map(|(nominal, space)| Validation {
            space: Some(validation_of(space, 0.0, 0.0).nominal()),
            ..validation_of(nominal, 0.0, 0.0)
        });
        for (nominal, space, best) in [(0.5, 0.5, 0), (1.0, 0.0, 1), (0.9, 0.1, 1), (0.0, 1.0, 0)] {
            let weights = SelectionWeights { nominal, space, corners: 0.0 };
            let mut selection = PolicySelection::new(Some(0.5), None, 2).with_weights(weights);
            for (validation, number) in validations.into_iter().zip(0..) {
                selection.record(&policy(0.0), validation, number);
            }
            assert_eq!(selection.best().unwrap().environment_steps, best);
            assert_eq!(selection.target_reached(), space < 1.0, "the second has 0.3 in the space");
        }
    }

    #[test]
    fn target_is_reached_after_enough_consecutive_validations() {
        let mut selection = PolicySelection::new(Some(0.9), Some(0.5), 2);
        let mut reached = vec![];
        for (success, strict) in [(0.95, 0.6), (0.95, 0.4), (0.95, 0.5), (0.9, 0.5)] {
            selection.record(&policy(0.0), validation_of(success, strict, 0.0), 0);
            reached.push(selection.target_reached());
        }
        assert_eq!(reached, [false, false, false, true]);
    }

    #[test]
    fn a_selection_is_restored_from_a_checkpoint() {
        let mut selection = PolicySelection::new(Some(0.9), None, 3);
        selection.record(&policy(0.25), validation_of(0.95, 0.1, 3.0), 77);
        let space = Some(Rates { success_rate: 0.92, strict_success_rate: 0.0, mean_return: 4.0 });
        let part = Some(PartValidation { share: 0.3, rates: Rates::default() });
        let last = Validation { space, part, ..validation_of(0.92, 0.1, 4.0) };
        selection.record(&policy(0.5), last, 90);
        let mut checkpoint = Checkpoint::new("ppo", "toy", 0, "");
        selection.save(&mut checkpoint);
        let mut resumed = PolicySelection::new(Some(0.9), None, 3);
        resumed.load(&checkpoint, policy(0.0).network()).unwrap();
        assert_eq!(resumed.best().unwrap().policy.hash(), policy(0.25).hash());
        assert_eq!(resumed.best().unwrap().environment_steps, 77);
        assert_eq!(resumed.last_validation(), Some(last));
        assert_eq!((resumed.validation_at(90), resumed.validation_at(77)), (resumed.last_validation(), None));
        resumed.record(&policy(0.0), validation_of(0.9, 0.0, 0.0), 91);
        assert!(resumed.target_reached());
    }
}
