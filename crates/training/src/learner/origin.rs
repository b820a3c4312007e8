//! Where a training run starts.

use mishandle_controllers::{History, Policy};
use mishandle_network::Mlp;

use crate::{Checkpoint, RunSettings, TrainingError};

/// Where a training run starts.
#[derive(Clone, Copy, Debug)]
pub enum Origin<'a> {
    /// With a random policy.
    New,
    /// From the policy of the controller that the setting `run.from` names.
    Policy(&'a Policy),
    /// Where an interrupted run with the same settings stopped.
    Checkpoint(&'a Checkpoint),
}

impl Origin<'_> {
    /// Checks that the origin is that of the settings.
    ///
    /// # Errors
    /// If one of them has a controller to start from and the other none.
    pub(super) fn check(&self, run: &RunSettings) -> Result<(), TrainingError> {
        let found = match (self, &run.from) {
            (Origin::Checkpoint(_), _) | (Origin::New, None) | (Origin::Policy(_), Some(_)) => {
                return Ok(());
            }
            (Origin::New, Some(_)) => "a random policy",
            (Origin::Policy(_), None) => "the policy of a controller",
        };
        let expected = run.from.as_ref().map_or("no controller".to_string(), |from| format!("`{from}`"));
        Err(TrainingError::OtherStart { expected, found })
    }
}

/// Returns a policy that can take the place of a learner's first one, with this network and
/// history: a policy with a shorter history gets a longer one, which it does not use yet.
///
/// # Errors
/// If sizes or activations differ, or the policy clips observations otherwise than training does.
pub(crate) fn first_policy(
    policy: &Policy,
    own: &Mlp<f32>,
    history: History,
) -> Result<Policy, TrainingError> {
    let policy = policy.remembering(policy.history().length().max(history.length()))?;
    let network = policy.network();
    let layers = |network: &Mlp<f32>| format!("{:?}", network.sizes());
    let activations = |network: &Mlp<f32>| {
        format!("{:?} and {:?} at the end", network.hidden_activation(), network.output_activation())
    };
    let clip = |clip: Option<f64>| clip.map_or("none".to_string(), |clip| clip.to_string());
    let fresh = Policy::new(
        vec![0.0; own.input_size()],
        vec![1.0; own.input_size()],
        own.clone(),
        vec![0.0; own.output_size()],
    )?;
    for (what, expected, found) in [
        ("history", history.length().to_string(), policy.history().length().to_string()),
        ("layers", layers(own), layers(network)),
        ("activation", activations(own), activations(network)),
        ("bound of normalized observations", clip(fresh.observation_clip()), clip(policy.observation_clip())),
    ] {
        if expected != found {
            return Err(TrainingError::OtherPolicy { what, expected, found });
        }
    }
    Ok(policy)
}
