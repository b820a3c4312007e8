//! Writes a controller as an ONNX model.

use mishandle_controllers::ControllerFile;
use mishandle_network::{Activation, LEAKY_SLOPE};

use super::message::Message;
use super::{PREFIX, PROVENANCE};

/// Versions of the file format and of the operators: those of ONNX 1.12, which every current
/// runtime reads.
const IR_VERSION: i64 = 8;
const OPSET: i64 = 17;

const FLOAT: i64 = 1;

/// Returns the bytes of an ONNX model of a controller.
///
/// The input `observation` `[N, size]` is in the units of the task. The output `action` `[N, size]`
/// is clipped to [-1, 1], as the task does before it executes an action. The output
/// `unclipped_action` is the controller's own. Both are deterministic: the mean of a stochastic
/// policy. The metadata has the task, the layout and the hash of the controller.
///
/// # Example
/// ```
/// use mishandle_controllers::{ControllerFile, Header, Layout, Policy};
/// # use mishandle_network::{Activation, Mlp};
/// # let policy = Policy::new(vec![0.0], vec![1.0], Mlp::new(&[1, 1], Activation::Elu, Activation::Identity)?, vec![0.0])?;
/// # let header = Header {
/// #     task: "ball-pushing".into(), algorithm: "ppo".into(), preset: String::new(), reward: String::new(),
/// #     layout: Layout::default(), task_hash: String::new(), training: Default::default(),
/// # };
/// let bytes = mishandle_interchange::onnx_bytes(&ControllerFile { header, policy }, "0.1.0");
/// assert!(bytes.windows(6).any(|text| text == b"action"));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn onnx_bytes(file: &ControllerFile, version: &str) -> Vec<u8> {
    let (header, policy) = (&file.header, &file.policy);
    let layout = serde_json::to_string(&header.layout).unwrap_or_default();
    let [algorithm, hash, program] = PROVENANCE;
    let policy_hash = policy.hash();
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
    metadata.map(entry).iter().fold(model, |model, entry| model.message(14, entry)).into_bytes()
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
        let tensor = shape.iter().fold(Message::default(), |tensor, size| tensor.integer(1, *size as i64));
        let tensor = tensor.integer(2, FLOAT).text(8, name).bytes(9, &bytes);
        self.add(5, &tensor);
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
    let (inputs, actions) = (network.input_size(), file.header.layout.action_size());
    let message = Message::default().text(2, &format!("{} {}", file.header.task, file.header.algorithm));
    let mut graph = Graph { message, last: "observation".to_string(), nodes: 0 };
    graph.value(11, "observation", inputs);
    let mean: Vec<f32> = policy.mean().iter().map(|x| *x as f32).collect();
    let scale: Vec<f32> = policy.variance().iter().map(|x| x.sqrt() as f32 + 1e-8).collect();
    graph.weight("normalizer.mean", &[inputs], &mean);
    graph.weight("normalizer.scale", &[inputs], &scale);
    graph.node("Sub", &["normalizer.mean"], &[], None);
    graph.node("Div", &["normalizer.scale"], &[], None);
    if let Some(clip) = policy.observation_clip() {
        graph.weight("normalizer.low", &[], &[-clip as f32]);
        graph.weight("normalizer.high", &[], &[clip as f32]);
        graph.node("Clip", &["normalizer.low", "normalizer.high"], &[], None);
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
    graph.message
}
