//! Makes a policy of named tensors and of facts about them.

use mishandle_controllers::Policy;
use mishandle_network::{Activation, Mlp, Tensor};

use super::chain::Chain;
use super::import::{ImportOptions, Imported, Normalization};
use super::normalizer::ObservationNormalizer;
use super::tensor::NamedTensor;
use crate::{PolicyPart, TorchProblem};

/// A kind of checkpoint.
#[derive(Clone, Copy)]
pub(super) struct Kind {
    /// Program that wrote the file.
    pub source: &'static str,
    /// Prefixes of the names of the hidden layers and of the last layer.
    pub layers: &'static [&'static str],
    /// The name of the tensor with the logarithms of standard deviations.
    pub log_std: Option<&'static str>,
}

/// An activation as far as a file says it.
pub(super) enum Stated {
    /// The file says it, so that another one is a mistake.
    Known(Activation),
    /// The file suggests it; the user may know better.
    Assumed(Activation),
    /// The file does not say it, for this reason.
    Unknown(String),
}

/// log σ of a policy without standard deviations: its sampled actions are its means.
const NO_NOISE: f32 = -20.0;

/// Largest number of layers, as in controller files, and of inputs and outputs of a layer.
const MAX_LAYERS: usize = 101;
const MAX_SIZE: usize = 10_000;

/// The names of the activations that an import can be given.
pub const ACTIVATIONS: &[&str] = &["elu", "relu", "tanh", "silu", "gelu", "leaky_relu", "identity"];

impl Stated {
    /// Returns the activation, or the one that the user gave.
    fn or_given(self, given: Option<Activation>, what: PolicyPart) -> Result<Activation, TorchProblem> {
        match (self, given) {
            (Stated::Known(known), Some(given)) if known != given => {
                Err(TorchProblem::Contradiction { what, found: known.to_string(), given: given.to_string() })
            }
            (_, Some(given)) => Ok(given),
            (Stated::Known(known) | Stated::Assumed(known), None) => Ok(known),
            (Stated::Unknown(because), None) => Err(TorchProblem::Unknown { what, because }),
        }
    }
}

/// Makes the policy of the layers whose names start with the prefixes of `kind`.
pub(super) fn assemble(
    kind: &Kind,
    tensors: &[NamedTensor],
    hidden: Stated,
    output: Stated,
    options: &ImportOptions,
) -> Result<Imported, TorchProblem> {
    let named = kind.layers.iter().flat_map(|prefix| {
        tensors
            .iter()
            .filter(move |tensor| tensor.name.starts_with(prefix) && !tensor.name.starts_with("log_std"))
    });
    let named: Vec<&NamedTensor> = named.collect();
    let Chain { linear, norms } =
        Chain::new(&named).map_err(|problem| layers(format!("{problem}; {}", listed(tensors))))?;
    let is_deep = linear.len() > 1;
    let hidden = if is_deep { hidden } else { Stated::Assumed(Activation::Identity) };
    let hidden = hidden.or_given(options.activation, PolicyPart::HiddenActivation)?;
    let output = output.or_given(options.output_activation, PolicyPart::OutputActivation)?;
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
    for (infix, pairs) in [("", &linear), ("norm.", &norms)] {
        for (l, (weight, bias)) in pairs.iter().enumerate() {
            parts.push((format!("layers.{l}.{infix}weight"), weight.shape.clone(), values(weight)));
            parts.push((format!("layers.{l}.{infix}bias"), bias.shape.clone(), values(bias)));
        }
    }
    let parts: Vec<Tensor<'_, f32>> = parts
        .iter()
        .map(|(name, shape, values)| Tensor { name: name.clone(), shape: shape.clone(), values })
        .collect();
    network.set_tensors(&parts).map_err(error)?;
    let actions = network.output_size();
    let log_std = kind.log_std.and_then(|name| tensors.iter().find(|tensor| &*tensor.name == name));
    let log_std = log_std.filter(|tensor| tensor.numbers.len() == actions && output == Activation::Identity);
    let log_std = log_std.map_or(vec![NO_NOISE; actions], values);
    let normalizer = match &options.normalizer {
        Normalization::Given(normalizer) => normalizer.clone(),
        Normalization::OfFile | Normalization::Nothing => {
            ObservationNormalizer::identity(network.input_size())
        }
    };
    let variance = normalizer.own_variance();
    let policy =
        Policy::new(normalizer.mean, variance, network, log_std)?.with_observation_clip(normalizer.clip)?;
    Ok(Imported { policy, source: kind.source })
}

pub(super) fn layers(reason: String) -> TorchProblem {
    TorchProblem::Layers { reason }
}

/// Returns the names and shapes of the first tensors.
pub(super) fn listed(tensors: &[NamedTensor]) -> String {
    let names: Vec<String> =
        tensors.iter().take(20).map(|tensor| format!("{} {:?}", tensor.name, tensor.shape)).collect();
    format!("found: {}", names.join(", "))
}
