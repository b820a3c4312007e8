//! Recognizes a checkpoint, and reads those of skrl and plain PyTorch.

use std::rc::Rc;

use mishandle_controllers::Policy;
use mishandle_network::Activation;

use super::assemble::{Kind, Stated, assemble, layers};
use super::normalizer::ObservationNormalizer;
use super::pickle::Value;
use super::stable_baselines;
use super::tensor::{Checkpoint, NamedTensor};
use super::zip::Archive;
use crate::TorchProblem;

/// Facts that a checkpoint does not contain.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ImportOptions {
    /// The activation of the hidden layers; by default that of the file, if it says so.
    pub activation: Option<Activation>,
    /// The activation of the last layer; by default that of the algorithm, if the file shows it.
    pub output_activation: Option<Activation>,
    /// The statistics that normalize observations.
    pub normalizer: Normalization,
}

/// Where the statistics that normalize observations are from.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum Normalization {
    /// From the checkpoint, if it has any.
    #[default]
    OfFile,
    /// Observations are not normalized, whatever the checkpoint has.
    Nothing,
    /// From the user.
    Given(ObservationNormalizer),
}

/// An imported policy.
#[derive(Clone, Debug)]
pub struct Imported {
    /// The policy.
    pub policy: Policy,
    /// Program that wrote the file, such as `Stable-Baselines3 PPO or A2C`.
    pub source: &'static str,
}

const LOG_STD_PARAMETER: &str = "log_std_parameter";

/// A policy that skrl made from its settings.
const SKRL: Kind =
    Kind { source: "skrl", layers: &["net_container.", "policy_layer."], log_std: Some(LOG_STD_PARAMETER) };

const SEQUENTIAL: Kind = Kind { source: "a state dictionary of PyTorch", layers: &[""], log_std: None };

/// The entries of a checkpoint of skrl that do not change the actions of its policy.
const SKRL_ENTRIES: [&str; 19] = [
    "critic",
    "critic_1",
    "critic_2",
    "critic_optimizer",
    "discriminator",
    "entropy_optimizer",
    "optimizer",
    "policy",
    "policy_optimizer",
    "amp_observation_preprocessor",
    "amp_state_preprocessor",
    "target_critic",
    "target_critic_1",
    "target_critic_2",
    "target_policy",
    "target_value",
    "value",
    "value_optimizer",
    "value_preprocessor",
];

/// The entries with the statistics of a policy's observations: of skrl 2, and of skrl 1. Skrl 2 has
/// both if a critic has observations of its own.
const SKRL_NORMALIZERS: [&str; 2] = ["observation_preprocessor", "state_preprocessor"];

/// Reads the policy in a model of Stable-Baselines3 (`.zip`), a checkpoint of skrl or a state
/// dictionary (`.pt`).
///
/// Weights are read, and the texts that describe a policy of Stable-Baselines3. Nothing is
/// unpickled; see the module `pickle`.
///
/// # Errors
/// If the file is damaged, contains more than weights, or is not a multi-layer perceptron; if it
/// does not say how the policy acts and `options` do not either; or if it says that the policy acts
/// in a way that a controller cannot follow.
pub fn import(bytes: &[u8], options: &ImportOptions) -> Result<Imported, TorchProblem> {
    let archive = Archive::read(bytes)?;
    match archive.entry("policy.pth") {
        Some(weights) => stable_baselines::read(weights, archive.entry("data"), options),
        None => checkpoint(&Checkpoint::of_archive(archive)?, options),
    }
}

/// Reads a checkpoint of skrl, whose dictionaries are those of its modules, or a state dictionary.
fn checkpoint(checkpoint: &Checkpoint<'_>, options: &ImportOptions) -> Result<Imported, TorchProblem> {
    let Value::Dictionary(root, _) = &checkpoint.value else {
        return Err(layers("the file has no dictionary of tensors".to_string()));
    };
    let unknown = || Stated::Unknown(String::new());
    let Some(policy) = module(root, "policy") else {
        let tensors = checkpoint.tensors(root)?;
        if tensors.is_empty() {
            let keys: Vec<&str> = root.iter().take(20).map(|(name, _)| &**name).collect();
            return Err(layers(format!(
                "expected tensors, or the key `policy` of skrl; found the keys: {}; save `model.state_dict()` alone",
                keys.join(", ")
            )));
        }
        return assemble(&SEQUENTIAL, &tensors, unknown(), unknown(), options);
    };
    let known = |name: &str| SKRL_ENTRIES.contains(&name) || SKRL_NORMALIZERS.contains(&name);
    if let Some((name, _)) = root.iter().find(|(name, _)| !known(name)) {
        return Err(TorchProblem::Differs {
            reason: format!("it has the entry `{name}` beside its policy, which may change the actions"),
            way_out: "save the state dictionary of the policy alone (docs/guide/import.md)".into(),
        });
    }
    let mut options = options.clone();
    let scaler = SKRL_NORMALIZERS.iter().find_map(|name| module(root, name));
    if let Some(scaler) = scaler.filter(|_| options.normalizer == Normalization::OfFile) {
        options.normalizer = Normalization::Given(running_standard_scaler(&checkpoint.tensors(scaler)?)?);
    }
    let tensors = checkpoint.tensors(policy)?;
    let is_generated = tensors.iter().any(|tensor| tensor.name.starts_with(SKRL.layers[0]));
    // A model of the user's own has layers with any names.
    let kind = if is_generated { SKRL } else { Kind { layers: SEQUENTIAL.layers, ..SKRL } };
    let is_part =
        |name: &str| name == LOG_STD_PARAMETER || kind.layers.iter().any(|part| name.starts_with(part));
    if let Some(tensor) = tensors.iter().find(|tensor| !is_part(&tensor.name)) {
        return Err(layers(format!("it has the tensor `{}`, which such a policy lacks", tensor.name)));
    }
    // The text after the last layer, such as `tanh(ACTIONS)`, is in the settings of skrl alone.
    let because =
        || " (it is in the settings or the code of the model, not in a checkpoint of skrl)".to_string();
    assemble(&kind, &tensors, Stated::Unknown(because()), Stated::Unknown(because()), &options)
}

/// Returns the last entry of a dictionary with this name, if it is a dictionary.
fn module<'v>(root: &'v [(Rc<str>, Value)], name: &str) -> Option<&'v [(Rc<str>, Value)]> {
    match root.iter().rev().find(|(key, _)| &**key == name)?.1 {
        Value::Dictionary(ref dictionary, _) => Some(dictionary),
        _ => None,
    }
}

/// Returns the statistics of skrl's `RunningStandardScaler`: clamp((o - mean) / (√variance +
/// 1e-8), -5, 5).
fn running_standard_scaler(tensors: &[NamedTensor]) -> Result<ObservationNormalizer, TorchProblem> {
    let find = |name: &str| tensors.iter().find(|tensor| &*tensor.name == name).map(|tensor| &tensor.numbers);
    let Some((mean, variance)) = find("running_mean").zip(find("running_variance")) else {
        return Err(TorchProblem::Preprocessor);
    };
    // √v + 1e-8 = √(v'), with which `own_variance` returns v.
    let variance = variance.iter().map(|v| (v.sqrt() + 1e-8).powi(2)).collect();
    Ok(ObservationNormalizer { mean: mean.clone(), variance, epsilon: 0.0, clip: Some(5.0) })
}
