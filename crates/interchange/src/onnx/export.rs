//! Writes a controller as an ONNX model.

use mishandle_controllers::{ControllerFile, History};
use mishandle_network::{Activation, LEAKY_SLOPE};

use super::message::Message;
use super::{PREFIX, PROVENANCE};

/// Versions of the file format and of the operators: those of ONNX 1.12, which every current
/// runtime reads.
const IR_VERSION: i64 = 8;
const OPSET: i64 = 17;

const FLOAT: i64 = 1;
const INT64: i64 = 7;

/// The input and the output for the history of a controller that keeps one.
const HISTORY: [&str; 2] = ["history", "next_history"];

/// Returns the bytes of an ONNX model of a controller.
///
/// The input `observation` `[N, size]` is in the units of the task. The output `action` `[N, size]`
/// is clipped to [-1, 1], as the task does before it executes an action. The output
/// `unclipped_action` is the controller's own. Both are deterministic: the mean of a stochastic
/// policy. The metadata has the task, the layout and the hash of the controller.
///
/// A controller with a history has one more input, `history`, and one more output, `next_history`,
/// both `[N, k (observation size + action size)]`. They are a state as that of recurrent models: 0
/// at the start of an episode, and then what the last control step returned. So the model computes
/// the history as the controller does, and a runtime only hands it on.
///
/// # Example
/// ```
/// use mishandle_controllers::{ControllerFile, Header, Layout, Policy};
/// # use mishandle_network::{Activation, Mlp};
/// # let policy = Policy::new(vec![0.0], vec![1.0], Mlp::new(&[1, 1], Activation::Elu, Activation::Identity)?, vec![0.0])?;
/// # let header = Header {
/// #     task: "ball-pushing".into(), algorithm: "ppo".into(), preset: String::new(), reward: String::new(),
/// #     layout: Layout::default(), action_interface: None, task_hash: String::new(), training: Default::default(),
/// # };
/// let bytes = mishandle_interchange::onnx_bytes(&ControllerFile { header, policy }, "0.1.0");
/// assert!(bytes.windows(6).any(|text| text == b"action"));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn onnx_bytes(file: &ControllerFile, version: &str) -> Vec<u8> {
    let header = &file.header;
    let policy = &file.policy;
    let layout = serde_json::to_string(&header.layout).unwrap_or_default();
    let [algorithm, hash, program] = PROVENANCE;
    let policy_hash = file.hash();
    let state = format!("[[\"{}\", \"{}\"]]", HISTORY[0], HISTORY[1]);
    let state = (policy.history().length() > 0).then_some(("state", state.as_str()));
    let interface = header.action_interface.as_ref().map(serde_json::to_string);
    let interface = interface.transpose().unwrap_or_default();
    let interface = interface.as_deref().map(|interface| ("action_interface", interface));
    let metadata = [
        ("task", header.task.as_str()),
        ("observation", "observation"),
        ("action", "action"),
        ("layout", &layout),
        (algorithm, &header.algorithm),
        (hash, &policy_hash),
        (program, version),
    ];
    let model = Message::default()
        .integer(1, IR_VERSION)
        .text(2, "mishandle")
        .text(3, version)
        .message(7, &graph(file))
        .message(8, &Message::default().text(1, "").integer(2, OPSET));
    let entry = |(key, value)| Message::default().text(1, &format!("{PREFIX}{key}")).text(2, value);
    let entries: Vec<Message> = metadata.into_iter().chain(state).chain(interface).map(entry).collect();
    entries.iter().fold(model, |model, entry| model.message(14, entry)).into_bytes()
}

/// A graph in the making.
struct Graph {
    message: Message,
    /// The name of the last value.
    last: String,
    nodes: usize,
}

impl Graph {
    fn weight(&mut self, name: &str, shape: &[usize], numbers: &[f32]) {
        let bytes: Vec<u8> = numbers.iter().flat_map(|x| x.to_le_bytes()).collect();
        self.tensor(name, shape, FLOAT, &bytes);
    }

    /// Adds a list with one index.
    fn index(&mut self, name: &str, index: usize) {
        self.tensor(name, &[1], INT64, &(index as i64).to_le_bytes());
    }

    fn tensor(&mut self, name: &str, shape: &[usize], kind: i64, bytes: &[u8]) {
        let tensor = shape.iter().fold(Message::default(), |tensor, size| tensor.integer(1, *size as i64));
        self.add(5, &tensor.integer(2, kind).text(8, name).bytes(9, bytes));
    }

    /// Appends an operator on the last value and other inputs; `output` is the name of its result.
    fn node(&mut self, operator: &str, others: &[&str], attributes: &[Message], output: Option<&str>) {
        let output = output.map_or_else(|| format!("value_{}", self.nodes), String::from);
        let node = Message::default().text(1, &self.last);
        let node = others.iter().fold(node, |node, name| node.text(1, name));
        let node = node.text(2, &output).text(3, &format!("node_{}", self.nodes)).text(4, operator);
        let node = attributes.iter().fold(node, |node, attribute| node.message(5, attribute));
        self.add(1, &node);
        self.nodes += 1;
        self.last = output;
    }

    fn add(&mut self, number: u64, message: &Message) {
        self.message = std::mem::take(&mut self.message).message(number, message);
    }

    fn value(&mut self, number: u64, name: &str, size: usize) {
        let dims = Message::default()
            .message(1, &Message::default().text(2, "N"))
            .message(1, &Message::default().integer(1, size as i64));
        let tensor = Message::default().integer(1, FLOAT).message(2, &dims);
        let value = Message::default().text(1, name).message(2, &Message::default().message(1, &tensor));
        self.add(number, &value);
    }

    fn activation(&mut self, activation: Activation, output: Option<&str>) {
        match activation {
            Activation::Elu => self.node("Elu", &[], &[], output),
            Activation::Tanh => self.node("Tanh", &[], &[], output),
            Activation::Relu => self.node("Relu", &[], &[], output),
            Activation::LeakyRelu => {
                let slope = Message::default().text(1, "alpha").float(2, LEAKY_SLOPE).integer(20, 1);
                self.node("LeakyRelu", &[], &[slope], output);
            }
            Activation::Silu => {
                let x = self.last.clone();
                self.node("Sigmoid", &[], &[], None);
                self.node("Mul", &[&x], &[], output);
            }
            // The operator `Gelu` needs opset 20.
            Activation::Gelu => {
                let x = self.last.clone();
                let names = ["sqrt_half", "one", "half"].map(|name| format!("{name}_{}", self.nodes));
                for (name, number) in names.iter().zip([std::f32::consts::FRAC_1_SQRT_2, 1.0, 0.5]) {
                    self.weight(name, &[], &[number]);
                }
                self.node("Mul", &[&names[0]], &[], None);
                self.node("Erf", &[], &[], None);
                self.node("Add", &[&names[1]], &[], None);
                self.node("Mul", &[&x], &[], None);
                self.node("Mul", &[&names[2]], &[], output);
            }
            Activation::Identity => self.node("Identity", &[], &[], output),
        }
    }
}

fn graph(file: &ControllerFile) -> Message {
    let policy = &file.policy;
    let network = policy.network();
    let history = policy.history();
    let actions = file.header.layout.action_size();
    let message = Message::default().text(2, &format!("{} {}", file.header.task, file.header.algorithm));
    let mut graph = Graph { message, last: "observation".to_string(), nodes: 0 };
    graph.value(11, "observation", history.observation_size());
    if history.length() > 0 {
        graph.value(11, HISTORY[0], history.memory_size());
        graph.node("Concat", &[HISTORY[0]], &[columns_axis()], None);
    }
    // The numbers of an observation, and again for each step of the history with those of its
    // action.
    let whole = |of_observation: Vec<f32>, of_action: f32| {
        let past = [&of_observation[..], &vec![of_action; actions]].concat();
        [of_observation, past.repeat(history.length())].concat()
    };
    let inputs = history.input_size();
    let mean = policy.mean().iter().map(|x| *x as f32).collect();
    let scale = policy.variance().iter().map(|x| x.sqrt() as f32 + 1e-8).collect();
    graph.weight("normalizer.mean", &[inputs], &whole(mean, 0.0));
    graph.weight("normalizer.scale", &[inputs], &whole(scale, 1.0));
    graph.node("Sub", &["normalizer.mean"], &[], None);
    graph.node("Div", &["normalizer.scale"], &[], None);
    if let Some(clip) = policy.observation_clip() {
        let limits = [("normalizer.low", -clip as f32, "Max"), ("normalizer.high", clip as f32, "Min")];
        for (name, limit, operator) in limits {
            if history.length() == 0 {
                graph.weight(name, &[], &[limit]);
                continue;
            }
            // `Clip` has one limit for all columns, but actions are not clipped again.
            let of_observation = vec![limit; history.observation_size()];
            graph.weight(name, &[inputs], &whole(of_observation, limit.signum()));
            graph.node(operator, &[name], &[], None);
        }
        if history.length() == 0 {
            graph.node("Clip", &["normalizer.low", "normalizer.high"], &[], None);
        }
    }
    let tensors = network.tensors();
    let layers = network.sizes().len() - 1;
    for index in 0..layers {
        let find = |part: &str| tensors.iter().find(|tensor| tensor.name == format!("layers.{index}.{part}"));
        let (Some(weight), Some(bias)) = (find("weight"), find("bias")) else { continue };
        let is_last = index + 1 == layers;
        // A squashed policy outputs the means, then what determines the standard deviations.
        let outputs = if is_last { actions.min(bias.values.len()) } else { bias.values.len() };
        let columns = weight.shape[1];
        graph.weight(&weight.name, &[outputs, columns], &weight.values[..outputs * columns]);
        graph.weight(&bias.name, &[outputs], &bias.values[..outputs]);
        let transposed = Message::default().text(1, "transB").integer(3, 1).integer(20, 2);
        graph.node("Gemm", &[&weight.name, &bias.name], &[transposed], None);
        if network.has_layer_norm() && !is_last {
            let names = ["weight", "bias"].map(|part| format!("layers.{index}.norm.{part}"));
            for (name, (part, default)) in names.iter().zip([("norm.weight", 1.0), ("norm.bias", 0.0)]) {
                let values = find(part).map_or(vec![default; outputs], |tensor| tensor.values.to_vec());
                graph.weight(name, &[outputs], &values);
            }
            let epsilon = Message::default().text(1, "epsilon").float(2, 1e-5).integer(20, 1);
            graph.node("LayerNormalization", &[&names[0], &names[1]], &[epsilon], None);
        }
        if is_last {
            let activation =
                if policy.is_squashed() { Activation::Tanh } else { network.output_activation() };
            graph.activation(activation, Some("unclipped_action"));
        } else {
            graph.activation(network.hidden_activation(), None);
        }
    }
    graph.weight("action.low", &[], &[-1.0]);
    graph.weight("action.high", &[], &[1.0]);
    graph.node("Clip", &["action.low", "action.high"], &[], Some("action"));
    graph.value(12, "action", actions);
    graph.value(12, "unclipped_action", actions);
    if history.length() > 0 {
        add_history(&mut graph, history);
    }
    graph.message
}

/// Adds the next history: the observation and the action, then the history without its oldest.
fn add_history(graph: &mut Graph, history: History) {
    let kept = history.memory_size() / history.length() * (history.length() - 1);
    let mut parts = vec!["action"];
    if kept > 0 {
        for (name, index) in [("history.start", 0), ("history.end", kept), ("history.axis", 1)] {
            graph.index(name, index);
        }
        graph.last = HISTORY[0].to_string();
        graph.node("Slice", &["history.start", "history.end", "history.axis"], &[], Some("kept_history"));
        parts.push("kept_history");
    }
    graph.last = "observation".to_string();
    graph.node("Concat", &parts, &[columns_axis()], Some(HISTORY[1]));
    graph.value(12, HISTORY[1], history.memory_size());
}

/// The attribute `axis` = 1.
fn columns_axis() -> Message {
    Message::default().text(1, "axis").integer(3, 1).integer(20, 2)
}
