//! The layers of a policy in a checkpoint.

use mishandle_controllers::Policy;
use mishandle_network::{Activation, Mlp, Tensor};

use super::normalizer::ObservationNormalizer;
use super::pickle::Value;
use super::tensor::{Checkpoint, NamedTensor};
use super::zip::Archive;
use crate::TorchProblem;

/// Facts that a checkpoint does not contain.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ImportOptions {
    /// The activation of the hidden layers; by default that of the file, if it says so.
    pub activation: Option<Activation>,
    /// The activation of the last layer; by default that of the algorithm.
    pub output_activation: Option<Activation>,
    /// The statistics that normalize observations; by default those of the file, or none.
    pub normalizer: Option<ObservationNormalizer>,
}

/// An imported policy.
#[derive(Clone, Debug)]
pub struct Imported {
    /// The policy.
    pub policy: Policy,
    /// Program that wrote the file, such as `Stable-Baselines3 PPO or A2C`.
    pub source: &'static str,
}

/// A kind of checkpoint, recognized by the names of its tensors.
struct Kind {
    source: &'static str,
    /// The start of the name of a tensor that only this kind has, if an archive can have several
    /// kinds.
    mark: &'static str,
    /// Prefixes of the names of the hidden layers and of the last layer.
    layers: &'static [&'static str],
    hidden: Option<Activation>,
    output: Option<Activation>,
    log_std: Option<&'static str>,
}

/// The kinds of models of Stable-Baselines3. The activations are its defaults.
const STABLE_BASELINES: [Kind; 3] = [
    Kind {
        source: "Stable-Baselines3 PPO or A2C",
        mark: "action_net.",
        layers: &["mlp_extractor.policy_net.", "action_net."],
        hidden: Some(Activation::Tanh),
        output: Some(Activation::Identity),
        log_std: Some("log_std"),
    },
    Kind {
        source: "Stable-Baselines3 SAC",
        mark: "actor.latent_pi.",
        layers: &["actor.latent_pi.", "actor.mu."],
        hidden: Some(Activation::Relu),
        output: Some(Activation::Tanh),
        log_std: None,
    },
    Kind {
        source: "Stable-Baselines3 TD3 or DDPG",
        mark: "actor.mu.",
        layers: &["actor.mu."],
        hidden: Some(Activation::Relu),
        output: Some(Activation::Tanh),
        log_std: None,
    },
];

const LOG_STD_PARAMETER: &str = "log_std_parameter";

const SKRL: Kind = Kind {
    source: "skrl",
    mark: "",
    layers: &["net_container.", "policy_layer."],
    hidden: None,
    output: None,
    log_std: Some(LOG_STD_PARAMETER),
};

const SEQUENTIAL: Kind = Kind {
    source: "a state dictionary of PyTorch",
    mark: "",
    layers: &[""],
    hidden: None,
    output: None,
    log_std: None,
};

/// log σ of a policy without standard deviations: its sampled actions are its means.
const NO_NOISE: f32 = -20.0;

/// Largest number of layers, as in controller files, and of inputs and outputs of a layer.
const MAX_LAYERS: usize = 101;
const MAX_SIZE: usize = 10_000;

/// The names of the activations that `--activation` allows.
const ACTIVATIONS: [&str; 7] = ["elu", "relu", "tanh", "silu", "gelu", "leaky_relu", "identity"];

/// Reads the policy in a model of Stable-Baselines3 (`.zip`), a checkpoint of skrl or a state
/// dictionary (`.pt`).
///
/// Only weights are read, and texts that name activations. Nothing is unpickled; see the module
/// `pickle`.
///
/// # Errors
/// If the file is damaged, contains more than weights, or is not a multi-layer perceptron, or if it
/// does not say which activation it has and `options` do not either.
pub fn import(bytes: &[u8], options: &ImportOptions) -> Result<Imported, TorchProblem> {
    let archive = Archive::read(bytes)?;
    match archive.entry("policy.pth") {
        Some(weights) => {
            let data = archive.entry("data").and_then(|data| serde_json::from_slice(data).ok());
            stable_baselines(weights, &data.unwrap_or_default(), options)
        }
        None => checkpoint(&Checkpoint::of_archive(archive)?, options),
    }
}

fn stable_baselines(
    weights: &[u8],
    data: &serde_json::Value,
    options: &ImportOptions,
) -> Result<Imported, TorchProblem> {
    let checkpoint = Checkpoint::read(weights)?;
    let tensors = root_tensors(&checkpoint)?;
    let has = |prefix: &str| tensors.iter().any(|tensor| tensor.name.starts_with(prefix));
    let Some(kind) = STABLE_BASELINES.iter().find(|kind| has(kind.mark)) else {
        return Err(layers(format!("expected a policy of PPO, A2C, SAC, TD3 or DDPG, {}", listed(&tensors))));
    };
    if has("features_extractor.") || has("actor.features_extractor.") {
        return Err(layers("it has a features extractor with weights, such as that of images".to_string()));
    }
    if has("lstm_") || has("mlp_extractor.shared_net.") {
        return Err(layers("it is recurrent or has layers that the critic shares".to_string()));
    }
    if kind.log_std.is_some_and(|name| !has(name)) {
        return Err(layers("its actions are discrete, but those of the tasks are continuous".to_string()));
    }
    // Texts in a JSON file; the pickled values beside them are not read.
    let described = &data["policy_kwargs"]["activation_fn"];
    let hidden = match described.as_str().map(|text| (text, activation_of_class(text))) {
        Some((text, None)) if options.activation.is_none() => {
            return Err(layers(format!("the activation {text} is not supported")));
        }
        Some((_, found)) => found,
        None => kind.hidden,
    };
    let is_squashed = data["policy_kwargs"]["squash_output"].as_bool() == Some(true);
    let output = if is_squashed { Some(Activation::Tanh) } else { kind.output };
    assemble(kind, &tensors, hidden, output, options)
}

/// Returns the activation of a text such as `<class 'torch.nn.modules.activation.ELU'>`.
fn activation_of_class(text: &str) -> Option<Activation> {
    let class = text.rsplit_once('.')?.1.trim_end_matches("'>");
    Some(match class {
        "ELU" => Activation::Elu,
        "ReLU" => Activation::Relu,
        "Tanh" => Activation::Tanh,
        "SiLU" => Activation::Silu,
        "GELU" => Activation::Gelu,
        "LeakyReLU" => Activation::LeakyRelu,
        "Identity" => Activation::Identity,
        _ => return None,
    })
}

/// Reads a checkpoint of skrl, whose dictionaries are those of its modules, or a state dictionary.
fn checkpoint(checkpoint: &Checkpoint<'_>, options: &ImportOptions) -> Result<Imported, TorchProblem> {
    let Value::Dictionary(root, _) = &checkpoint.value else {
        return Err(layers("the file has no dictionary of tensors".to_string()));
    };
    let module = |names: &[&str]| {
        root.iter().rev().find(|(name, _)| names.contains(&&**name)).and_then(|(_, value)| match value {
            Value::Dictionary(dictionary, _) => Some(dictionary),
            _ => None,
        })
    };
    let Some(policy) = module(&["policy"]) else {
        let tensors = checkpoint.tensors(root)?;
        if tensors.is_empty() {
            let keys: Vec<&str> = root.iter().take(20).map(|(name, _)| &**name).collect();
            return Err(layers(format!(
                "expected tensors, or the key `policy` of skrl; found the keys: {}; save `model.state_dict()` alone",
                keys.join(", ")
            )));
        }
        return assemble(&SEQUENTIAL, &tensors, None, None, options);
    };
    let mut options = options.clone();
    if let Some(scaler) =
        module(&["observation_preprocessor", "state_preprocessor"]).filter(|_| options.normalizer.is_none())
    {
        options.normalizer = running_standard_scaler(&checkpoint.tensors(scaler)?);
    }
    let tensors = checkpoint.tensors(policy)?;
    let has = |prefix: &str| tensors.iter().any(|tensor| tensor.name.starts_with(prefix));
    // The mean of a Gaussian has no activation, unless the user chose one.
    let output = has(LOG_STD_PARAMETER).then_some(Activation::Identity);
    // A model of the user's own has layers with any names.
    let own = Kind { layers: SEQUENTIAL.layers, ..SKRL };
    let kind = if has(SKRL.layers[0]) { &SKRL } else { &own };
    assemble(kind, &tensors, None, output, &options)
}

/// Returns the statistics of skrl's `RunningStandardScaler`: clamp((o - mean) / (√variance +
/// 1e-8), -5, 5).
fn running_standard_scaler(tensors: &[NamedTensor]) -> Option<ObservationNormalizer> {
    let find =
        |name: &str| tensors.iter().find(|tensor| &*tensor.name == name).map(|tensor| tensor.numbers.clone());
    let (mean, variance) = (find("running_mean")?, find("running_variance")?);
    // √v + 1e-8 = √(v'), with which `own_variance` returns v.
    let variance = variance.iter().map(|v| (v.sqrt() + 1e-8).powi(2)).collect();
    Some(ObservationNormalizer { mean, variance, epsilon: 0.0, clip: Some(5.0) })
}

fn root_tensors(checkpoint: &Checkpoint<'_>) -> Result<Vec<NamedTensor>, TorchProblem> {
    match &checkpoint.value {
        Value::Dictionary(root, _) => checkpoint.tensors(root),
        _ => Err(layers("the file has no dictionary of tensors".to_string())),
    }
}

fn layers(reason: String) -> TorchProblem {
    TorchProblem::Layers { reason }
}

fn listed(tensors: &[NamedTensor]) -> String {
    let names: Vec<String> =
        tensors.iter().take(20).map(|tensor| format!("{} {:?}", tensor.name, tensor.shape)).collect();
    format!("found: {}", names.join(", "))
}

/// Makes the policy of the layers whose names start with the prefixes of `kind`.
fn assemble(
    kind: &Kind,
    tensors: &[NamedTensor],
    hidden: Option<Activation>,
    output: Option<Activation>,
    options: &ImportOptions,
) -> Result<Imported, TorchProblem> {
    let named = kind.layers.iter().flat_map(|prefix| {
        tensors
            .iter()
            .filter(move |tensor| tensor.name.starts_with(prefix) && !tensor.name.starts_with("log_std"))
    });
    let named: Vec<&NamedTensor> = named.collect();
    let (linear, norms) = split(&named)
        .ok_or_else(|| layers(format!("its layers do not form a chain; {}", listed(tensors))))?;
    let known = ACTIVATIONS.to_vec();
    let unknown = |what, flag| TorchProblem::Unknown { what, flag, known: known.clone() };
    let is_deep = linear.len() > 1;
    let hidden = options.activation.or(hidden).or((!is_deep).then_some(Activation::Identity));
    let hidden = hidden.ok_or_else(|| unknown("activation of the hidden layers", "activation"))?;
    let output = options.output_activation.or(output);
    let output = output.ok_or_else(|| unknown("activation of the last layer", "output-activation"))?;
    let mut sizes = vec![linear[0].0.shape[1]];
    sizes.extend(linear.iter().map(|(weight, _)| weight.shape[0]));
    // Layers are padded in memory, which multiplies the size of layers that are long and thin.
    if sizes.len() > MAX_LAYERS + 1 || sizes.iter().any(|size| *size > MAX_SIZE) {
        return Err(layers(format!(
            "it has more than {MAX_LAYERS} layers, or more than {MAX_SIZE} numbers in a layer"
        )));
    }
    let error = |error: mishandle_network::NetworkError| TorchProblem::Controller(error.into());
    let mut network = Mlp::<f32>::new(&sizes, hidden, output).map_err(error)?;
    if !norms.is_empty() {
        network = network.with_affine_layer_norm();
    }
    let values = |tensor: &NamedTensor| tensor.numbers.iter().map(|x| *x as f32).collect::<Vec<f32>>();
    let mut parts: Vec<(String, Vec<usize>, Vec<f32>)> = Vec::new();
    for (l, (weight, bias)) in linear.iter().enumerate() {
        parts.push((format!("layers.{l}.weight"), weight.shape.clone(), values(weight)));
        parts.push((format!("layers.{l}.bias"), bias.shape.clone(), values(bias)));
    }
    for (l, (gain, shift)) in norms.iter().enumerate() {
        parts.push((format!("layers.{l}.norm.weight"), gain.shape.clone(), values(gain)));
        parts.push((format!("layers.{l}.norm.bias"), shift.shape.clone(), values(shift)));
    }
    let parts: Vec<Tensor<'_, f32>> = parts
        .iter()
        .map(|(name, shape, values)| Tensor { name: name.clone(), shape: shape.clone(), values })
        .collect();
    network.set_tensors(&parts).map_err(error)?;
    let actions = network.output_size();
    // The noise of gSDE has one number per feature and action, and depends on the observation.
    let log_std = kind.log_std.and_then(|name| tensors.iter().find(|tensor| &*tensor.name == name));
    let log_std = log_std.filter(|tensor| tensor.numbers.len() == actions && output == Activation::Identity);
    let log_std = log_std.map_or(vec![NO_NOISE; actions], values);
    let normalizer =
        options.normalizer.clone().unwrap_or_else(|| ObservationNormalizer::identity(network.input_size()));
    let variance = normalizer.own_variance();
    let policy =
        Policy::new(normalizer.mean, variance, network, log_std)?.with_observation_clip(normalizer.clip)?;
    Ok(Imported { policy, source: kind.source })
}

type Pair<'t> = (&'t NamedTensor, &'t NamedTensor);

/// Splits tensors in the order of a `Sequential` into linear layers and layer normalizations, one
/// after each hidden layer or none; `None` if they are something else.
fn split<'t>(tensors: &[&'t NamedTensor]) -> Option<(Vec<Pair<'t>>, Vec<Pair<'t>>)> {
    let (mut linear, mut norms): (Vec<Pair<'t>>, Vec<Pair<'t>>) = (Vec::new(), Vec::new());
    for pair in tensors.chunks(2) {
        let &[weight, bias] = pair else { return None };
        let layer = weight.name.strip_suffix("weight")?;
        if bias.name.strip_suffix("bias") != Some(layer) {
            return None;
        }
        match weight.shape[..] {
            [outputs, inputs] if bias.shape == [outputs] => {
                if linear.last().is_some_and(|(before, _)| before.shape[0] != inputs) {
                    return None;
                }
                linear.push((weight, bias));
            }
            [size] if bias.shape == [size] && linear.len() == norms.len() + 1 => norms.push((weight, bias)),
            _ => return None,
        }
    }
    let is_whole = !linear.is_empty() && (norms.is_empty() || norms.len() + 1 == linear.len());
    is_whole.then_some((linear, norms))
}
