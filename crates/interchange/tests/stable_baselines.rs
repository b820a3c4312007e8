//! Models of Stable-Baselines3 that a generator draws: an import acts as the model does, or is
//! refused.
//!
//! The actions are computed here from the documentation of Stable-Baselines3, in 64 bits: features
//! extractor, layers, tanh, then the scaling or the clipping to the action box. The texts in `data`
//! are those that Stable-Baselines3 2.9.2 writes.

use crate::checkpoint::{Part, archive, state_dictionary};
use mishandle_interchange::{
    ImportOptions, Normalization, ObservationNormalizer, PolicyPart, TorchProblem, import,
};
use mishandle_network::Activation;
use mishandle_rollout::Controller;
use serde_json::{Value, json};

const INPUTS: usize = 3;
const ACTIONS: usize = 2;

/// Pseudo-random numbers of a linear congruential generator.
struct Random(u64);

impl Random {
    fn next(&mut self) -> usize {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 33) as usize
    }

    fn pick<T: Clone>(&mut self, choices: &[T]) -> T {
        choices[self.next() % choices.len()].clone()
    }

    /// Returns true in one of `n` draws.
    fn one_in(&mut self, n: usize) -> bool {
        self.next().is_multiple_of(n)
    }

    /// Returns the first choice in seven of eight draws, otherwise any.
    fn usually<T: Clone>(&mut self, choices: &[T]) -> T {
        if self.one_in(8) { self.pick(choices) } else { choices[0].clone() }
    }

    fn number(&mut self) -> f32 {
        (self.next() % 4001) as f32 / 1000.0 - 2.0
    }
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Class {
    ActorCritic,
    Sac,
    Tqc,
    Td3,
    /// An actor-critic class of the user's own, with the members of its class.
    Own(&'static [&'static str]),
    /// A class of the library with another name or of another module.
    Library(&'static str, &'static str),
    /// The file does not name it.
    Missing,
}

/// A model, with everything that determines its actions.
#[derive(Clone, Debug)]
struct Model {
    class: Class,
    /// The text of `activation_fn`; none if it is not an argument.
    activation: Option<&'static str>,
    /// The activation in the network of a class of the user's own.
    own_activation: Activation,
    boxes: (Vec<f64>, Vec<f64>),
    extractor: Option<&'static str>,
    /// Arguments of the policy, and the factor of the observations that an unknown one stands for.
    arguments: Vec<(&'static str, Value)>,
    uses_sde: bool,
    observations: Value,
    has_normalizer: bool,
    layers: Vec<(Vec<Vec<f32>>, Vec<f32>)>,
}

const EXTRACTORS: [Option<&str>; 3] = [
    None,
    Some("<class 'stable_baselines3.common.torch_layers.FlattenExtractor'>"),
    Some("<class '__main__.Tenth'>"),
];

const OWN_NAMES: [&str; 2] = ["<class '__main__.ReLU'>", "<function <lambda> at 0x7f1c2cb65ee0>"];

/// Texts of `activation_fn`.
const ACTIVATIONS: [&str; 12] = [
    "<class 'torch.nn.modules.activation.ELU'>",
    "<class 'torch.nn.modules.activation.ReLU'>",
    "<class 'torch.nn.modules.activation.Tanh'>",
    "<class 'torch.nn.modules.activation.SiLU'>",
    "<class 'torch.nn.modules.activation.LeakyReLU'>",
    "<class 'torch.nn.modules.linear.Identity'>",
    "<class 'torch.nn.modules.activation.Sigmoid'>",
    "<class 'torch.nn.modules.activation.Softsign'>",
    "functools.partial(<class 'torch.nn.modules.activation.LeakyReLU'>, 0.5)",
    OWN_NAMES[0],
    OWN_NAMES[1],
    "<class 'my_library.activation.ELU'>",
];

fn space(kind: &str, module: &str, shape: &Value, dtype: &str) -> Value {
    json!({":type:": format!("<class 'gymnasium.spaces.{module}.{kind}'>"), "_shape": shape, "dtype": dtype})
}

impl Model {
    fn draw(random: &mut Random) -> Model {
        let class = match random.next() % 4 {
            0 => random.pick(&[
                Class::Own(&[]),
                Class::Own(&["__init__"]),
                Class::Own(&["_build_mlp_extractor"]),
                Class::Own(&["_build_mlp_extractor", "_predict"]),
                Class::Library("stable_baselines3.common.policies", "MultiInputActorCriticPolicy"),
                Class::Library("sb3_contrib.common.recurrent.policies", "RecurrentActorCriticPolicy"),
                Class::Missing,
            ]),
            _ => random.pick(&[Class::ActorCritic, Class::Sac, Class::Tqc, Class::Td3]),
        };
        let ones = (vec![-1.0; ACTIONS], vec![1.0; ACTIONS]);
        let boxes = random.usually(&[
            ones.clone(),
            (vec![0.0; ACTIONS], vec![1.0; ACTIONS]),
            (vec![-2.0; ACTIONS], vec![2.0; ACTIONS]),
            (vec![-0.25; ACTIONS], vec![0.25; ACTIONS]),
            (vec![-1.0, 0.0], vec![1.0; ACTIONS]),
        ]);
        let uses_sde = random.one_in(8);
        let mut arguments = vec![("net_arch", json!([4]))];
        if uses_sde && random.one_in(2) {
            arguments.push(("use_sde", json!(true)));
            arguments.push(("clip_mean", json!(random.pick(&[0.0, 2.0]))));
            // Python's flags, and those of NumPy.
            let squash = random.pick(&[json!(false), json!(true), json!("True"), json!("False")]);
            arguments.push(("squash_output", squash));
        }
        if random.one_in(16) {
            arguments.push(("gain_of_inputs", json!(2.0)));
        }
        if random.one_in(8) {
            arguments.push(("log_std_init", json!(-1.0)));
            arguments.push(("share_features_extractor", json!(false)));
        }
        let shape = &json!([INPUTS]);
        let observations = random.usually(&[
            space("Box", "box", shape, "float32"),
            space("Box", "box", shape, "float64"),
            space("Box", "box", shape, "uint8"),
            space("Box", "box", &json!([1, INPUTS]), "float32"),
            space("Dict", "dict", &Value::Null, "None"),
            space("MultiBinary", "multi_binary", shape, "int8"),
            Value::Null,
        ]);
        let sizes =
            random.pick(&[vec![INPUTS, ACTIONS], vec![INPUTS, 4, ACTIONS], vec![INPUTS, 4, 3, ACTIONS]]);
        let layers = sizes.windows(2).map(|size| {
            let rows = (0..size[1]).map(|_| (0..size[0]).map(|_| random.number()).collect());
            let rows: Vec<Vec<f32>> = rows.collect();
            (rows, (0..size[1]).map(|_| random.number()).collect())
        });
        Model {
            layers: layers.collect(),
            class,
            activation: random.one_in(2).then(|| random.pick(&ACTIVATIONS)),
            own_activation: random.pick(&[Activation::Relu, Activation::Elu, Activation::Tanh]),
            boxes,
            extractor: random.usually(&EXTRACTORS),
            arguments,
            uses_sde,
            observations,
            has_normalizer: random.one_in(8),
        }
    }

    fn is_off_policy(&self) -> bool {
        matches!(self.class, Class::Sac | Class::Tqc | Class::Td3)
    }

    fn argument(&self, name: &str) -> Option<&Value> {
        self.arguments.iter().find(|(found, _)| *found == name).map(|(_, value)| value)
    }

    fn is_squashed(&self) -> bool {
        let flag = self.argument("squash_output");
        self.is_off_policy() || flag.is_some_and(|flag| *flag == json!(true) || *flag == json!("True"))
    }

    /// The limit of the means of SAC and TQC with gSDE.
    fn mean_clip(&self) -> Option<f64> {
        let uses = self.uses_sde && matches!(self.class, Class::Sac | Class::Tqc);
        let clip = self.argument("clip_mean").map_or(2.0, |clip| clip.as_f64().unwrap());
        (uses && clip > 0.0).then_some(clip)
    }

    fn hidden(&self, x: f64) -> f64 {
        let own = match self.own_activation {
            Activation::Relu => "ReLU",
            Activation::Elu => "ELU",
            _ => "Tanh",
        };
        let name = match (self.class, self.activation) {
            (Class::Own(_) | Class::Missing | Class::Library(..), _) => own,
            (_, Some(text)) if OWN_NAMES.contains(&text) => own,
            (_, Some(text)) if text.contains("partial") => "LeakyReLU of 0.5",
            (_, Some("<class 'my_library.activation.ELU'>")) => own,
            (_, Some(text)) => text.rsplit('.').next().unwrap().trim_end_matches("'>"),
            (Class::ActorCritic, None) => "Tanh",
            (_, None) => "ReLU",
        };
        match name {
            "ELU" => {
                if x > 0.0 {
                    x
                } else {
                    x.exp_m1()
                }
            }
            "ReLU" => x.max(0.0),
            "Tanh" => x.tanh(),
            "SiLU" => x / (1.0 + (-x).exp()),
            "LeakyReLU" => x.max(0.01 * x),
            "LeakyReLU of 0.5" => x.max(0.5 * x),
            "Identity" => x,
            "Sigmoid" => 1.0 / (1.0 + (-x).exp()),
            "Softsign" => x / (1.0 + x.abs()),
            other => panic!("{other}"),
        }
    }

    /// Returns the action of `model.predict(observation, deterministic=True)`.
    fn predict(&self, observation: &[f32]) -> Vec<f64> {
        let normalized = observation.iter().map(|o| {
            let o = f64::from(*o);
            let o =
                if self.has_normalizer { ((o - 0.5) / (4.0_f64 + 1e-8).sqrt()).clamp(-1.5, 1.5) } else { o };
            let tenth = if self.extractor == EXTRACTORS[2] { 0.1 } else { 1.0 };
            let own = if matches!(self.class, Class::Own(members) if members.contains(&"_predict")) {
                3.0
            } else {
                1.0
            };
            let gain = if self.argument("gain_of_inputs").is_some() { 2.0 } else { 1.0 };
            o * tenth * own * gain
        });
        let mut x: Vec<f64> = normalized.collect();
        let last = self.layers.len() - 1;
        for (number, (rows, bias)) in self.layers.iter().enumerate() {
            let sums = rows.iter().zip(bias).map(|(row, bias)| {
                let sum: f64 = row.iter().zip(&x).map(|(w, x)| f64::from(*w) * x).sum();
                let sum = sum + f64::from(*bias);
                if number < last { self.hidden(sum) } else { sum }
            });
            x = sums.collect();
        }
        let (low, high) = &self.boxes;
        let act = |(index, mean): (usize, f64)| {
            let mean = self.mean_clip().map_or(mean, |clip| mean.clamp(-clip, clip));
            let low = low[index];
            let high = high[index];
            if self.is_squashed() {
                low + 0.5 * (mean.tanh() + 1.0) * (high - low)
            } else {
                mean.clamp(low, high)
            }
        };
        x.into_iter().enumerate().map(act).collect()
    }

    /// Returns the file that `model.save` writes.
    fn file(&self) -> Vec<u8> {
        let (hidden, last) = match self.class {
            Class::Sac | Class::Tqc => ("actor.latent_pi", "actor.mu"),
            Class::Td3 => ("actor.mu", ""),
            _ => ("mlp_extractor.policy_net", "action_net"),
        };
        let count = self.layers.len();
        let mut parts: Vec<Part> = Vec::new();
        for (number, (rows, bias)) in self.layers.iter().enumerate() {
            let name = match (number + 1 == count, last) {
                (true, "actor.mu") if self.mean_clip().is_some() => "actor.mu.0".to_string(),
                (true, last) if !last.is_empty() => last.to_string(),
                _ => format!("{hidden}.{}", 2 * number),
            };
            let shape = vec![rows.len(), rows[0].len()];
            parts.push((format!("{name}.weight"), shape, rows.concat()));
            parts.push((format!("{name}.bias"), vec![bias.len()], bias.clone()));
        }
        // Tensors that do not act: noise, critics and targets.
        let idle: &[(&str, usize)] = match self.class {
            Class::Sac | Class::Tqc => &[("actor.log_std.weight", 1), ("critic.qf0.0.weight", 2)],
            Class::Td3 => &[("actor_target.mu.0.weight", 2), ("critic.qf0.0.weight", 2)],
            _ => &[("log_std", ACTIONS), ("mlp_extractor.value_net.0.weight", 2), ("value_net.bias", 1)],
        };
        parts.extend(idle.iter().map(|(name, size)| (name.to_string(), vec![*size], vec![-0.5; *size])));
        let data = serde_json::to_vec(&self.data()).unwrap();
        archive(&[("data", &data), ("policy.pth", &state_dictionary(&parts))], 0)
    }

    fn data(&self) -> Value {
        let method = |owner: &str, name: &str| format!("<function {owner}.{name} at 0x7f2a377be7a0>");
        let library = |module: &str, owner: &str| {
            json!({":type:": "<class 'abc.ABCMeta'>", "__module__": module, "__init__": method(owner, "__init__"),
                   "_predict": method(owner, "_predict"), "_abc_impl": "<_abc._abc_data object at 0x7f2a38807f80>"})
        };
        let class = match self.class {
            Class::ActorCritic => library("stable_baselines3.common.policies", "ActorCriticPolicy"),
            Class::Sac => library("stable_baselines3.sac.policies", "SACPolicy"),
            Class::Tqc => library("sb3_contrib.tqc.policies", "TQCPolicy"),
            Class::Td3 => library("stable_baselines3.td3.policies", "TD3Policy"),
            Class::Library(module, owner) => library(module, owner),
            Class::Own(members) => {
                let mut class = json!({":type:": "<class 'abc.ABCMeta'>", "__module__": "__main__",
                                       "__abstractmethods__": "frozenset()"});
                for member in members {
                    class[member] = json!(method("MyPolicy", member));
                }
                class
            }
            Class::Missing => Value::Null,
        };
        let mut arguments = json!({":type:": "<class 'dict'>"});
        for (name, value) in &self.arguments {
            arguments[name] = value.clone();
        }
        for (name, text) in [("activation_fn", self.activation), ("features_extractor_class", self.extractor)]
        {
            if let Some(text) = text {
                arguments[name] = json!(text);
            }
        }
        // As NumPy prints an array.
        let array = |numbers: &[f64]| {
            let numbers: Vec<String> = numbers
                .iter()
                .map(|x| if x.fract() == 0.0 { format!("{x}.") } else { format!("{x}") })
                .collect();
            format!("[{}]", numbers.join("  "))
        };
        let mut actions = space("Box", "box", &json!([ACTIONS]), "float32");
        actions["low"] = json!(array(&self.boxes.0));
        actions["high"] = json!(array(&self.boxes.1));
        // SAC and TD3 keep it without a normalizer, too.
        let original = self.has_normalizer || self.is_off_policy();
        let original = if original { json!({":type:": "<class 'numpy.ndarray'>"}) } else { Value::Null };
        json!({"policy_class": class, "policy_kwargs": arguments, "use_sde": self.uses_sde,
               "observation_space": self.observations, "action_space": actions, "_last_original_obs": original})
    }

    /// Returns what a user says who knows the model.
    fn truth(&self) -> ImportOptions {
        let text = r#"{"mean": [0.5, 0.5, 0.5], "variance": [4, 4, 4], "clip": 1.5}"#;
        let normalizer = if self.has_normalizer {
            Normalization::Given(ObservationNormalizer::from_json(text).unwrap())
        } else {
            Normalization::Nothing
        };
        let is_own = matches!(self.class, Class::Own(_) | Class::Missing);
        let is_named =
            self.activation.is_some_and(|text| OWN_NAMES.contains(&text) || text.contains("my_library"));
        let activation = (is_own || is_named).then_some(self.own_activation);
        ImportOptions { activation, output_activation: None, normalizer }
    }
}

/// Compares an import with the model. Returns the error of a refusal.
#[track_caller]
fn check(model: &Model, options: &ImportOptions) -> Option<TorchProblem> {
    let imported = match import(&model.file(), options) {
        Ok(imported) => imported,
        Err(problem) => return Some(problem),
    };
    for observation in [[0.3, -0.7, 1.5], [2.0, -3.0, 0.1], [-0.4, 0.2, -5.0]] {
        let mut actions = [0.0; ACTIONS];
        imported.policy.worker().act(1, &observation, &mut [], &mut actions);
        for (found, expected) in actions.iter().zip(model.predict(&observation)) {
            // The task clips actions to [-1, 1].
            let found = f64::from(*found).clamp(-1.0, 1.0);
            assert!((found - expected).abs() < 1e-5, "{found}, expected {expected}: {model:#?}");
        }
    }
    None
}

#[test]
fn an_import_acts_as_the_model_does_or_is_refused() {
    let mut accepted = 0;
    let mut refused = 0;
    for seed in 0..6000 {
        let mut model = Model::draw(&mut Random(seed));
        // Without a word of the user, SAC and TD3 do not say whether they had a normalizer.
        model.has_normalizer &= !model.is_off_policy();
        for options in [ImportOptions::default(), model.truth()] {
            match check(&model, &options) {
                None => accepted += 1,
                Some(problem) => {
                    refused += 1;
                    let can_be_stated = matches!(problem, TorchProblem::Unknown { .. });
                    let message = problem.to_string();
                    let way_out = ["ONNX", "train it", "model.save"];
                    assert!(
                        can_be_stated || way_out.iter().any(|words| message.contains(words)),
                        "{message}"
                    );
                }
            }
        }
    }
    assert!(accepted > 2000 && refused > 2000, "{accepted} accepted, {refused} refused");
}

fn ordinary(class: Class) -> Model {
    let mut model = Model::draw(&mut Random(4));
    let layer = |rows: usize, columns: usize| (vec![vec![0.5; columns]; rows], vec![0.25; rows]);
    model = Model {
        class,
        activation: None,
        boxes: (vec![-1.0; ACTIONS], vec![1.0; ACTIONS]),
        extractor: None,
        arguments: vec![("net_arch", json!([4]))],
        uses_sde: false,
        observations: space("Box", "box", &json!([INPUTS]), "float32"),
        has_normalizer: false,
        layers: vec![layer(4, INPUTS), layer(ACTIONS, 4)],
        ..model
    };
    model
}

/// The refusal of a change to an ordinary model of PPO says these words.
#[track_caller]
fn refusal(change: impl FnOnce(&mut Model), words: &[&str]) {
    let mut model = ordinary(Class::ActorCritic);
    change(&mut model);
    let message = check(&model, &ImportOptions::default()).expect("it was imported").to_string();
    for word in words {
        assert!(message.contains(word), "{word}: {message}");
    }
}

#[test]
fn ordinary_models_are_imported() {
    for class in [Class::ActorCritic, Class::Sac, Class::Tqc, Class::Td3] {
        for activation in [None].into_iter().chain(ACTIVATIONS[..6].iter().copied().map(Some)) {
            let model = Model { activation, ..ordinary(class) };
            assert!(check(&model, &ImportOptions::default()).is_none(), "{class:?}, {activation:?}");
        }
    }
}

#[test]
fn a_network_of_the_users_own_needs_its_activation() {
    let model = Model { class: Class::Own(&["_build_mlp_extractor"]), ..ordinary(Class::ActorCritic) };
    let problem = check(&model, &ImportOptions::default()).unwrap();
    assert!(matches!(problem, TorchProblem::Unknown { what: PolicyPart::HiddenActivation, .. }), "{problem}");
    assert!(problem.to_string().contains("class is of the module `__main__`"), "{problem}");
    assert!(check(&model, &model.truth()).is_none());
}

#[test]
fn refusals_name_what_changes_the_actions() {
    refusal(
        |model| model.extractor = EXTRACTORS[2],
        &["features extractor `<class '__main__.Tenth'>`", "ONNX"],
    );
    refusal(
        |model| model.boxes = (vec![0.0; ACTIONS], vec![1.0; ACTIONS]),
        &["its actions are from 0 to 1, but those of the tasks are from -1 to 1", "ONNX"],
    );
    refusal(|model| model.class = Class::Own(&["_predict"]), &["`__main__` has a `_predict` of its own"]);
    refusal(|model| model.arguments.push(("gain_of_inputs", json!(2))), &["the argument `gain_of_inputs`"]);
    refusal(
        |model| model.activation = Some("<class '__main__.ReLU'>"),
        &["it names `<class '__main__.ReLU'>`, which is not of PyTorch"],
    );
    refusal(
        |model| model.activation = Some("<class 'torch.nn.modules.activation.Mish'>"),
        &["Mish", "is not supported", "ONNX"],
    );
    refusal(
        |model| model.observations = space("Dict", "dict", &Value::Null, "None"),
        &["observations are of the space Dict"],
    );
    refusal(|model| model.has_normalizer = true, &["trained with VecNormalize"]);
    refusal(
        |model| model.arguments.push(("squash_output", json!("maybe"))),
        &["`squash_output` is `maybe`, not true or false"],
    );
    let sde = Model { uses_sde: true, ..ordinary(Class::Sac) };
    let message = check(&sde, &ImportOptions::default()).unwrap().to_string();
    assert!(message.contains("gSDE clips its means to ±2.0 before tanh"), "{message}");
}

#[test]
fn flags_that_contradict_the_file_are_refused() {
    let model = ordinary(Class::ActorCritic);
    let relu = Some(Activation::Relu);
    for (activation, output_activation, words) in [
        (relu, None, "the activation of the hidden layers is tanh, not relu"),
        (None, relu, "the activation of the last layer is identity, not relu"),
    ] {
        let options = ImportOptions { activation, output_activation, ..ImportOptions::default() };
        let message = check(&model, &options).unwrap().to_string();
        assert!(message.contains(words), "{message}");
    }
}

/// Returns the file of an ordinary model with other tensors, or other texts in `data`.
fn changed(data: &[u8], parts: &[Part]) -> Vec<u8> {
    archive(&[("data", data), ("policy.pth", &state_dictionary(parts))], 0)
}

#[test]
fn only_continuous_perceptrons_are_imported() {
    let linear = |name: &str| {
        [
            (format!("{name}.weight"), vec![ACTIONS, INPUTS], vec![0.5; ACTIONS * INPUTS]),
            (format!("{name}.bias"), vec![ACTIONS], vec![0.0; ACTIONS]),
        ]
    };
    let data = |change: &dyn Fn(&mut Value)| {
        let mut data = ordinary(Class::ActorCritic).data();
        change(&mut data);
        data.to_string()
    };
    let plain = data(&|_| {});
    let message = |data: &str, parts: &[Part]| match import(
        &changed(data.as_bytes(), parts),
        &ImportOptions::default(),
    ) {
        Ok(_) => "imported".to_string(),
        Err(problem) => problem.to_string(),
    };
    let action = linear("action_net");
    assert_eq!(message(&plain, &action), "imported");
    let with = |name: &str| [&action[..], &[(name.to_string(), vec![1], vec![0.5])]].concat();
    for (name, words) in [
        ("lstm_actor.weight_ih_l0", "it is recurrent"),
        ("mlp_extractor.shared_net.0.weight", "layers that the critic shares"),
        ("pi_features_extractor.cnn.0.weight", "features extractor with weights"),
        ("scale_of_actions", "the tensor `scale_of_actions`, which such a policy lacks"),
    ] {
        assert!(message(&plain, &with(name)).contains(words), "{}", message(&plain, &with(name)));
    }
    let dqn = message(&plain, &linear("q_net.q_net.0"));
    assert!(dqn.contains("expected a policy of PPO, A2C, SAC, TD3 or DDPG, found: q_net"), "{dqn}");
    let discrete = data(&|data| data["action_space"] = space("Discrete", "discrete", &json!([]), "int64"));
    assert!(message(&discrete, &action).contains("its actions are discrete"));
    let absent = data(&|data| data["action_space"] = Value::Null);
    assert!(message(&absent, &action).contains("has no action space; save it with `model.save`"));
    let wide = data(&|data| data["action_space"]["_shape"] = json!([3]));
    assert!(message(&wide, &action).contains("from -1 to 1"), "{}", message(&wide, &action));
    let small = data(&|data| data["observation_space"]["_shape"] = json!([2]));
    assert!(message(&small, &action).contains("its observation space has 2 numbers, but its layers have 3"));
    // Python writes numbers that JSON lacks.
    let infinite =
        plain.replacen('{', r#"{"max_grad_norm": Infinity, "a": -Infinity, "b": [NaN, "NaN\""], "#, 1);
    assert_eq!(message(&infinite, &action), "imported");
    assert!(message("{", &action).contains("its entry `data` is not JSON"));
    let none = archive(&[("policy.pth", &state_dictionary(&action))], 0);
    let none = import(&none, &ImportOptions::default()).unwrap_err().to_string();
    assert!(none.contains("it has no entry `data`"), "{none}");
}
