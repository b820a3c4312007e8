//! A model of Stable-Baselines3: the facts in its JSON text `data`, and its tensors.
//!
//! The text names the class of the policy, its arguments and its spaces, and each of them can
//! change the actions. What this module does not know to leave the actions as they are is an error.

use mishandle_network::Activation;
use serde_json::Value;

use super::assemble::{Kind, Stated, assemble, layers, listed};
use super::import::{ImportOptions, Imported, Normalization};
use super::tensor::{Checkpoint, NamedTensor};
use crate::{PolicyPart, TorchProblem};

/// A kind of policy.
struct Family {
    kind: Kind,
    /// The start of the name of a tensor that only this family has.
    mark: &'static str,
    /// The modules and names of its classes.
    classes: &'static [(&'static str, &'static str)],
    /// The starts of the names of tensors that do not change the actions.
    idle: &'static [&'static str],
    /// The activation of the hidden layers if the arguments name none.
    hidden: Activation,
    /// The activation after the last layer; predictions scale those of tanh to the action box.
    output: Activation,
    /// Whether a model keeps raw observations only if a `VecNormalize` was used.
    shows_normalizer: bool,
}

const FAMILIES: [Family; 3] = [
    Family {
        kind: Kind {
            source: "Stable-Baselines3 PPO or A2C",
            layers: &["mlp_extractor.policy_net.", "action_net."],
            log_std: Some("log_std"),
        },
        mark: "action_net.",
        classes: &[("stable_baselines3.common.policies", "ActorCriticPolicy")],
        idle: &["log_std", "mlp_extractor.value_net.", "value_net."],
        hidden: Activation::Tanh,
        output: Activation::Identity,
        shows_normalizer: true,
    },
    Family {
        kind: Kind {
            source: "Stable-Baselines3 SAC",
            layers: &["actor.latent_pi.", "actor.mu."],
            log_std: None,
        },
        mark: "actor.log_std",
        classes: &[
            ("stable_baselines3.sac.policies", "SACPolicy"),
            ("sb3_contrib.tqc.policies", "TQCPolicy"),
        ],
        idle: &["actor.log_std", "critic.", "critic_target."],
        hidden: Activation::Relu,
        output: Activation::Tanh,
        shows_normalizer: false,
    },
    Family {
        kind: Kind { source: "Stable-Baselines3 TD3 or DDPG", layers: &["actor.mu."], log_std: None },
        mark: "actor.mu.",
        classes: &[("stable_baselines3.td3.policies", "TD3Policy")],
        idle: &["actor_target.", "critic.", "critic_target."],
        hidden: Activation::Relu,
        output: Activation::Tanh,
        shows_normalizer: false,
    },
];

/// Arguments of a policy that change neither its layers' order nor its mean action, or that this
/// module follows.
const ARGUMENTS: [&str; 17] = [
    "activation_fn",
    "clip_mean",
    "features_extractor_class",
    "features_extractor_kwargs",
    "full_std",
    "log_std_init",
    "n_critics",
    "n_quantiles",
    "net_arch",
    "normalize_images",
    "optimizer_class",
    "optimizer_kwargs",
    "ortho_init",
    "share_features_extractor",
    "squash_output",
    "use_expln",
    "use_sde",
];

/// Members of a class of the user's own that leave open only the activation of its layers.
const HARMLESS_MEMBERS: [&str; 6] = [
    "_abc_impl",
    "_build_mlp_extractor",
    "_get_constructor_parameters",
    "evaluate_actions",
    "get_value",
    "predict_values",
];

const EXPORT: &str = "export it as ONNX instead (docs/guide/onnx.md)";

/// Makes a policy of the entries `policy.pth` and `data` of a model.
pub(super) fn read(
    weights: &[u8],
    data: Option<&[u8]>,
    options: &ImportOptions,
) -> Result<Imported, TorchProblem> {
    let tensors = Checkpoint::read(weights)?.root_tensors()?;
    let data = json(data)?;
    let facts = Facts { data: &data };
    let actions = facts.action_space()?;
    let observations = facts.observation_space()?;
    let has = |prefix: &str| tensors.iter().any(|tensor| tensor.name.starts_with(prefix));
    let Some(family) = FAMILIES.iter().find(|family| has(family.mark)) else {
        return Err(layers(format!("expected a policy of PPO, A2C, SAC, TD3 or DDPG, {}", listed(&tensors))));
    };
    let class = facts.class(family)?;
    facts.check_arguments()?;
    family.check_tensors(&tensors)?;
    let uses_sde = facts.flag("use_sde", &data["use_sde"])? | facts.argument_flag("use_sde")?;
    family.check_means(&facts, uses_sde, &tensors)?;
    let is_squashed = facts.argument_flag("squash_output")?;
    let output = if is_squashed { Activation::Tanh } else { family.output };
    let (hidden, output) = match &class {
        Class::Known => (facts.activation(family.hidden)?, Stated::Known(output)),
        Class::Own(because) => (Stated::Unknown(because.clone()), Stated::Assumed(output)),
    };
    if family.shows_normalizer
        && options.normalizer == Normalization::OfFile
        && !data["_last_original_obs"].is_null()
    {
        return Err(TorchProblem::Unknown {
            what: PolicyPart::Normalizer,
            because: " (it was trained with VecNormalize, whose statistics are in a file of their own)"
                .into(),
        });
    }
    // The noise of gSDE depends on the observation.
    let kind = if uses_sde { Kind { log_std: None, ..family.kind } } else { family.kind };
    let imported = assemble(&kind, &tensors, hidden, output, options)?;
    let network = imported.policy.network();
    for (what, expected, found) in
        [("observation", observations, network.input_size()), ("action", actions, network.output_size())]
    {
        if expected != found {
            return Err(layers(format!(
                "its {what} space has {expected} numbers, but its layers have {found}"
            )));
        }
    }
    Ok(imported)
}

/// The class of a policy.
enum Class {
    /// A class of the library, which does what the library documents.
    Known,
    /// A class of the user's own, with the reason why its activation is unknown.
    Own(String),
}

impl Family {
    /// Checks that every tensor is of a part of the policy that this module knows.
    fn check_tensors(&self, tensors: &[NamedTensor]) -> Result<(), TorchProblem> {
        let has = |prefix: &str| tensors.iter().any(|tensor| tensor.name.starts_with(prefix));
        if has("features_extractor.") || has("actor.features_extractor.") || has("pi_features_extractor.") {
            return Err(layers(
                "it has a features extractor with weights, such as that of images".to_string(),
            ));
        }
        if has("lstm_") || has("mlp_extractor.shared_net.") {
            return Err(layers("it is recurrent or has layers that the critic shares".to_string()));
        }
        let known = |name: &str| self.kind.layers.iter().chain(self.idle).any(|part| name.starts_with(part));
        match tensors.iter().find(|tensor| !known(&tensor.name)) {
            Some(tensor) => {
                Err(layers(format!("it has the tensor `{}`, which such a policy lacks", tensor.name)))
            }
            None => Ok(()),
        }
    }

    /// Checks that means are not clipped, as SAC and TQC do with gSDE.
    fn check_means(
        &self,
        facts: &Facts<'_>,
        uses_sde: bool,
        tensors: &[NamedTensor],
    ) -> Result<(), TorchProblem> {
        let is_module = tensors.iter().any(|tensor| &*tensor.name == "actor.mu.0.weight");
        let clip = &facts.arguments()["clip_mean"];
        let clips = uses_sde && clip.as_f64() != Some(0.0) || is_module;
        if self.mark == "actor.log_std" && clips {
            let clip = if clip.is_null() { "2.0".to_string() } else { text_of(clip) };
            return Err(differs(format!("gSDE clips its means to ±{clip} before tanh (clip_mean)"), EXPORT));
        }
        Ok(())
    }
}

/// The entry `data` of a model.
struct Facts<'d> {
    data: &'d Value,
}

impl<'d> Facts<'d> {
    fn arguments(&self) -> &'d Value {
        &self.data["policy_kwargs"]
    }

    /// Returns the number of actions of the action space, a box from -1 to 1.
    fn action_space(&self) -> Result<usize, TorchProblem> {
        let space = &self.data["action_space"];
        let (kind, size) = self.space("action")?;
        if kind != "Box" {
            return Err(layers(format!(
                "its actions are discrete or no box (the space {kind}), but those of the tasks are continuous"
            )));
        }
        for (side, bound) in [("low", -1.0), ("high", 1.0)] {
            let numbers = numbers(&space[side]);
            if numbers.len() != size || numbers.iter().any(|number| *number != bound) {
                let low = bound_text(&space["low"]);
                let high = bound_text(&space["high"]);
                return Err(differs(
                    format!("its actions are from {low} to {high}, but those of the tasks are from -1 to 1"),
                    "train it with actions from -1 to 1, or export it as ONNX with the scaling to them in the model \
                     (docs/guide/onnx.md)",
                ));
            }
        }
        Ok(size)
    }

    /// Returns the number of observations of the observation space, a box.
    fn observation_space(&self) -> Result<usize, TorchProblem> {
        let (kind, size) = self.space("observation")?;
        if kind != "Box" {
            return Err(differs(
                format!("its observations are of the space {kind}, but those of the tasks are a vector"),
                "train it on a vector of observations",
            ));
        }
        Ok(size)
    }

    /// Returns the kind of a space and its number of numbers, if it is a box of one dimension.
    fn space(&self, what: &str) -> Result<(&'d str, usize), TorchProblem> {
        let space = &self.data[format!("{what}_space")];
        let Some(class) = space[":type:"].as_str() else {
            return Err(differs(
                format!("its `data` has no {what} space"),
                "save it with `model.save` without `exclude`",
            ));
        };
        let module = class.trim_start_matches("<class '").trim_end_matches("'>");
        let kind = module.rsplit('.').next().unwrap_or_default();
        if kind != "Box" {
            return Ok((kind, 0));
        }
        if !matches!(module, "gymnasium.spaces.box.Box" | "gym.spaces.box.Box") {
            return Err(differs(format!("its {what} space is of the class {}", short(module)), EXPORT));
        }
        let shape = space["_shape"].as_array().map(Vec::as_slice).unwrap_or_default();
        let is_float = space["dtype"].as_str().is_some_and(|name| name.starts_with("float"));
        match shape {
            [size] if is_float => Ok((kind, size.as_u64().map_or(0, |size| size as usize))),
            _ => Err(differs(
                format!(
                    "its {what} space is a box of the shape {} and the type {}, not a vector of real numbers",
                    text_of(&space["_shape"]),
                    text_of(&space["dtype"])
                ),
                EXPORT,
            )),
        }
    }

    /// Returns the class of the policy.
    fn class(&self, family: &Family) -> Result<Class, TorchProblem> {
        let Some(members) = self.data["policy_class"].as_object() else {
            return Ok(Class::Own(" (its `data` does not name the class of the policy)".to_string()));
        };
        let module = self.data["policy_class"]["__module__"].as_str().unwrap_or_default();
        // The text of a method is such as `<function SACPolicy.forward at 0x7f2a3778f880>`.
        let owners = members.values().filter_map(|text| {
            let text = text.as_str()?;
            let text = text.strip_prefix("<staticmethod(").unwrap_or(text);
            Some(text.strip_prefix("<function ")?.split(['.', ' ']).next().unwrap_or_default())
        });
        let owners: Vec<&str> = owners.collect();
        let is_of = |name: &str| !owners.is_empty() && owners.iter().all(|owner| *owner == name);
        let known = family.classes.iter();
        if known.clone().any(|(of_module, name)| *of_module == module && is_of(name)) {
            return Ok(Class::Known);
        }
        let name = owners.first().copied().unwrap_or("a class");
        let is_library =
            ["stable_baselines3", "sb3_contrib"].contains(&module.split('.').next().unwrap_or(""));
        if is_library {
            return Err(differs(
                format!("its class {} of {} is not supported", short(name), short(module)),
                EXPORT,
            ));
        }
        let changed = members.keys().find(|member| {
            !member.starts_with("__")
                && *member != ":type:"
                && *member != ":serialized:"
                && !HARMLESS_MEMBERS.contains(&member.as_str())
        });
        if let Some(member) = changed {
            return Err(differs(
                format!("its class of the module {} has a {} of its own", short(module), short(member)),
                EXPORT,
            ));
        }
        Ok(Class::Own(format!(
            " (its class is of the module {}, not of Stable-Baselines3, and may have a network of its own)",
            short(module)
        )))
    }

    /// Checks that every argument of the policy is one that this module knows.
    fn check_arguments(&self) -> Result<(), TorchProblem> {
        let arguments = self.arguments();
        let names = arguments.as_object().map(|object| object.keys()).into_iter().flatten();
        let known = |name: &str| ARGUMENTS.contains(&name) || [":type:", ":serialized:"].contains(&name);
        if !arguments.is_object() && !arguments.is_null() {
            return Err(differs("its `policy_kwargs` are no dictionary".to_string(), EXPORT));
        }
        if let Some(name) = names.into_iter().find(|name| !known(name)) {
            return Err(differs(format!("its policy has the argument {}", short(name)), EXPORT));
        }
        let extractor = &arguments["features_extractor_class"];
        let flatten = "<class 'stable_baselines3.common.torch_layers.FlattenExtractor'>";
        if !extractor.is_null() && extractor != flatten {
            return Err(differs(
                format!(
                    "it has the features extractor {}, whose code is not in the file",
                    text_of(extractor)
                ),
                EXPORT,
            ));
        }
        Ok(())
    }

    fn argument_flag(&self, name: &str) -> Result<bool, TorchProblem> {
        self.flag(name, &self.arguments()[name])
    }

    /// Returns a flag; the text of a flag of NumPy is `True`.
    fn flag(&self, name: &str, value: &Value) -> Result<bool, TorchProblem> {
        match (value, value.as_str()) {
            (Value::Null | Value::Bool(false), _) | (_, Some("False")) => Ok(false),
            (Value::Bool(true), _) | (_, Some("True")) => Ok(true),
            _ => Err(differs(format!("its `{name}` is {}, not true or false", text_of(value)), EXPORT)),
        }
    }

    /// Returns the activation that the arguments name, or the default of the class.
    fn activation(&self, default: Activation) -> Result<Stated, TorchProblem> {
        let value = &self.arguments()["activation_fn"];
        if value.is_null() {
            return Ok(Stated::Known(default));
        }
        let text = value.as_str().unwrap_or_default();
        let class = text.strip_prefix("<class '").and_then(|class| class.strip_suffix("'>"));
        if let Some(known) = class.and_then(activation_of_class) {
            return Ok(Stated::Known(known));
        }
        if text.contains("torch.nn.") {
            return Err(layers(format!("the activation {} is not supported", text_of(value))));
        }
        Ok(Stated::Unknown(format!(" (it names {}, which is not of PyTorch)", text_of(value))))
    }
}

/// Returns the activation of a class of PyTorch, whose arguments have their defaults.
fn activation_of_class(class: &str) -> Option<Activation> {
    Some(match class {
        "torch.nn.modules.activation.ELU" => Activation::Elu,
        "torch.nn.modules.activation.ReLU" => Activation::Relu,
        "torch.nn.modules.activation.Tanh" => Activation::Tanh,
        "torch.nn.modules.activation.SiLU" => Activation::Silu,
        "torch.nn.modules.activation.GELU" => Activation::Gelu,
        "torch.nn.modules.activation.LeakyReLU" => Activation::LeakyRelu,
        "torch.nn.modules.linear.Identity" => Activation::Identity,
        _ => return None,
    })
}

/// Parses the JSON of Python. It has numbers that JSON lacks, such as `NaN`, which become 0: no
/// argument that is read here can be one.
fn json(data: Option<&[u8]>) -> Result<Value, TorchProblem> {
    let archive = |reason: String| TorchProblem::Archive { reason };
    let data =
        data.ok_or_else(|| archive("it has no entry `data`; save it with `model.save`".to_string()))?;
    let mut text = data.to_vec();
    let mut index = 0;
    let mut is_text = false;
    while index < text.len() {
        match text[index] {
            b'"' => is_text = !is_text,
            b'\\' => index += 1,
            _ if is_text => {}
            _ => {
                for name in [&b"-Infinity"[..], b"Infinity", b"NaN"] {
                    if text[index..].starts_with(name) {
                        text[index..][..name.len()].fill(b' ');
                        text[index] = b'0';
                        index += name.len() - 1;
                        break;
                    }
                }
            }
        }
        index += 1;
    }
    serde_json::from_slice(&text).map_err(|error| archive(format!("its entry `data` is not JSON: {error}")))
}

/// Returns the numbers of the text of an array of NumPy, such as `[-1. -1.]`; none if it is
/// shortened.
fn numbers(value: &Value) -> Vec<f64> {
    let text = value.as_str().unwrap_or_default();
    let inner = text.strip_prefix('[').and_then(|text| text.strip_suffix(']')).unwrap_or_default();
    let numbers: Option<Vec<f64>> = inner.split_whitespace().map(|number| number.parse().ok()).collect();
    numbers.unwrap_or_default()
}

/// Returns the one number of an array, or its text.
fn bound_text(value: &Value) -> String {
    let numbers = numbers(value);
    match numbers.first() {
        Some(first) if numbers.iter().all(|number| number == first) => first.to_string(),
        _ => text_of(value),
    }
}

fn differs(reason: String, way_out: &str) -> TorchProblem {
    TorchProblem::Differs { reason, way_out: way_out.to_string() }
}

/// Returns a value of a file as a short text for a message.
fn text_of(value: &Value) -> String {
    match value {
        Value::Null => "unknown".to_string(),
        Value::String(text) => short(text),
        other => short(&other.to_string()),
    }
}

/// Returns the first 80 characters of a text on one line, as a message quotes it.
fn short(text: &str) -> String {
    let words: Vec<&str> = text.split_whitespace().take(40).collect();
    let text = words.join(" ");
    match text.char_indices().nth(80) {
        Some((end, _)) => format!("`{}…`", &text[..end]),
        None => format!("`{text}`"),
    }
}
