//! Models that get images: what they see, what they do not get, and what is refused.

use crate::graph::{Attribute, Of, bytes, integer, integers, node, node_with, typed, value, weights};
use crate::processor_time::processor_secs;
use mishandle_controllers::{Entry, Layout};
use mishandle_interchange::{Interface, OnnxPolicy};
use mishandle_rollout::{Controller, Image};

/// An observation of three joints, two numbers of an object and one of a hand.
fn layout(action: usize) -> Layout {
    let entry = |name: &str, size| Entry { name: name.into(), unit: String::new(), size };
    Layout {
        observation: vec![entry("joints", 3), entry("object", 2), entry("hand", 1)],
        action: vec![entry("x", action)],
    }
}

/// Loads a model of opset 13 with the output `a`.
fn load(parts: &[Vec<u8>], side: &str, action: usize) -> Result<OnnxPolicy, String> {
    let graph = [parts.concat(), value(12, "a", &[1, action as i64])].concat();
    let model = [integer(1, 8), bytes(7, &graph), bytes(8, &integer(2, 13))].concat();
    let interface = Interface::from_json(side).unwrap();
    OnnxPolicy::from_bytes(&model, Some(interface), &["test"], &layout(action)).map_err(|e| e.to_string())
}

/// Numbers that look random, from -1 to 1.
fn numbers(count: usize, seed: usize) -> Vec<f32> {
    (0..count).map(|i| (1.7 * (i + 31 * seed) as f32 + (i * i) as f32).sin()).collect()
}

fn rgb(pixels: usize, seed: usize) -> Vec<u8> {
    numbers(3 * pixels, seed).into_iter().map(|x| (127.5 * (x + 1.0)) as u8).collect()
}

fn act(policy: &OnnxPolicy, rows: usize, observations: &[f32], images: &[u8]) -> Vec<f32> {
    let mut worker = policy.worker();
    let mut actions = vec![0.0; rows * policy.action_size()];
    worker.look(rows, images);
    worker.act(rows, observations, &mut vec![0.0; rows * policy.state_size()], &mut actions);
    actions
}

const SIDE: &str = r#"{"parts": ["hand", "joints"], "images": [["i", "over"]]}"#;

/// The weights and operators of a small network: an image and four numbers to two actions.
fn network() -> Vec<Vec<u8>> {
    let ints = |name, numbers: &[i64]| (name, Of::Numbers(numbers.to_vec()));
    vec![
        value(11, "o", &[1, 4]),
        value(11, "i", &[1, 3, 8, 12]),
        weights("k", &[5, 3, 3, 3], &numbers(135, 1)),
        weights("m", &[2, 9], &numbers(18, 2)),
        node_with(
            "Conv",
            &["i", "k"],
            &["c"],
            &[ints("kernel_shape", &[3, 3]), ints("strides", &[2, 2]), ints("pads", &[1, 1, 1, 1])],
        ),
        node("Relu", &["c"], &["r"]),
        node("GlobalAveragePool", &["r"], &["g"]),
        node("Flatten", &["g"], &["f"]),
        node_with("Concat", &["f", "o"], &["h"], &[("axis", Of::Number(1))]),
        node_with("Gemm", &["h", "m"], &["a"], &[("transB", Of::Number(1))]),
    ]
}

#[test]
fn a_part_that_is_not_declared_changes_no_bit() {
    let policy = load(&network(), SIDE, 2).unwrap();
    assert_eq!(policy.sees(), [Image { camera: "over".into(), width: 12, height: 8 }]);
    assert_eq!(policy.observation_size(), 6);
    let image = rgb(96, 3);
    let of = |observation: [f32; 6]| act(&policy, 1, &observation, &image);
    let before = of([0.1, 0.2, 0.3, 0.4, 0.5, 0.6]);
    assert_eq!(before, of([0.1, 0.2, 0.3, -7.0, 1e6, 0.6]));
    assert_eq!(before, of([0.1, 0.2, 0.3, f32::NAN, f32::INFINITY, 0.6]));
    // The others and the image do change it.
    for changed in [[0.0, 0.2, 0.3, 0.4, 0.5, 0.6], [0.1, 0.2, 0.3, 0.4, 0.5, 0.0]] {
        assert_ne!(before, of(changed));
    }
    assert_ne!(before, act(&policy, 1, &[0.1, 0.2, 0.3, 0.4, 0.5, 0.6], &rgb(96, 4)));
}

#[test]
fn parts_arrive_in_the_order_of_the_description() {
    let parts = [value(11, "o", &[1, 4]), node("Identity", &["o"], &["a"])];
    let policy = load(&parts, r#"{"parts": ["hand", "joints"]}"#, 4).unwrap();
    assert_eq!(act(&policy, 1, &[1.0, 2.0, 3.0, 4.0, 5.0, 6.0], &[]), [6.0, 1.0, 2.0, 3.0]);
}

#[test]
fn the_bits_of_a_row_do_not_depend_on_the_batch() {
    let policy = load(&network(), SIDE, 2).unwrap();
    let rows = 7;
    let observations = numbers(6 * rows, 5);
    let images = rgb(96 * rows, 6);
    let all = act(&policy, rows, &observations, &images);
    for row in 0..rows {
        let alone = act(&policy, 1, &observations[6 * row..][..6], &images[288 * row..][..288]);
        assert_eq!(alone, all[2 * row..][..2], "row {row}");
    }
}

/// The mean of the pixels of each channel, through the input with this shape and type.
fn means(shape: &[i64], kind: i64) -> OnnxPolicy {
    let channels_last = shape.last() == Some(&3);
    let mut parts = vec![typed(11, "i", shape, kind)];
    let cast = if kind == 2 { "f" } else { "i" };
    if kind == 2 {
        parts.push(node_with("Cast", &["i"], &["f"], &[("to", Of::Number(1))]));
    }
    let axes = if channels_last { vec![1, 2] } else { vec![2, 3] };
    let axes = if shape.len() == 3 { axes.into_iter().map(|axis| axis - 1).collect() } else { axes };
    parts.push(node_with(
        "ReduceMean",
        &[cast],
        &["m"],
        &[("axes", Of::Numbers(axes)), ("keepdims", Of::Number(0))],
    ));
    parts.push(integers("s", &[1, 3]));
    parts.push(node("Reshape", &["m", "s"], &["a"]));
    load(&parts, r#"{"images": [["i", "wrist"]]}"#, 3).unwrap()
}

#[test]
fn an_image_arrives_with_each_order_of_channels_and_each_type() {
    let image = rgb(96, 9);
    let mean = |channel: usize| {
        image.iter().skip(channel).step_by(3).map(|byte| f64::from(*byte)).sum::<f64>() / 96.0
    };
    for shape in [&[1, 3, 8, 12][..], &[1, 8, 12, 3], &[3, 8, 12], &[8, 12, 3]] {
        for (kind, white) in [(1, 255.0), (2, 1.0)] {
            let found = act(&means(shape, kind), 1, &[0.0; 6], &image);
            for (channel, found) in found.iter().enumerate() {
                let expected = mean(channel) / white;
                assert!((f64::from(*found) - expected).abs() < 1e-5 * expected, "{shape:?} {kind}");
            }
        }
    }
}

/// A window operator on an image [1, 4, 7, 9], and the sums of its definition.
struct Windows {
    operator: &'static str,
    kernel: [usize; 2],
    strides: [usize; 2],
    /// Top, left, bottom, right.
    pads: [usize; 4],
    dilations: [usize; 2],
    /// Groups and outputs of a convolution.
    groups: usize,
    outputs: usize,
}

impl Windows {
    const SIDES: [usize; 2] = [7, 9];
    const CHANNELS: usize = 4;

    fn size(&self, i: usize) -> usize {
        let window = self.dilations[i] * (self.kernel[i] - 1) + 1;
        (Self::SIDES[i] + self.pads[i] + self.pads[2 + i] - window) / self.strides[i] + 1
    }

    /// Computes the operator by its definition, in 64 bits.
    fn expected(&self, image: &[f64], kernel: &[f32]) -> Vec<f64> {
        let [height, width] = Self::SIDES;
        let is_conv = self.operator == "Conv";
        let own = if is_conv { Self::CHANNELS / self.groups } else { 1 };
        let mut all = Vec::new();
        for output in 0..self.outputs {
            let first = if is_conv { output / (self.outputs / self.groups) * own } else { output };
            for y in 0..self.size(0) {
                for x in 0..self.size(1) {
                    let mut values = Vec::new();
                    let mut sum = 0.0;
                    for channel in 0..own {
                        for j in 0..self.kernel[0] {
                            for i in 0..self.kernel[1] {
                                let row =
                                    (y * self.strides[0] + j * self.dilations[0]).wrapping_sub(self.pads[0]);
                                let column =
                                    (x * self.strides[1] + i * self.dilations[1]).wrapping_sub(self.pads[1]);
                                if row >= height || column >= width {
                                    continue;
                                }
                                let pixel = image[((first + channel) * height + row) * width + column];
                                values.push(pixel);
                                let place =
                                    ((output * own + channel) * self.kernel[0] + j) * self.kernel[1] + i;
                                sum += if is_conv { pixel * f64::from(kernel[place]) } else { pixel };
                            }
                        }
                    }
                    all.push(match self.operator {
                        "Conv" => sum,
                        "MaxPool" => values.into_iter().fold(f64::NEG_INFINITY, f64::max),
                        _ => sum / values.len() as f64,
                    });
                }
            }
        }
        all
    }

    /// Returns the numbers that the operator gives for the state `s`, an image.
    fn found(&self, image: &[f64], kernel: &[f32]) -> Vec<f32> {
        let [height, width] = Self::SIDES.map(|side| side as i64);
        let channels = Self::CHANNELS as i64;
        let shape = [1, channels, height, width];
        let count = self.outputs * self.size(0) * self.size(1);
        let list = |name: &'static str, numbers: &[usize]| -> Attribute<'static> {
            (name, Of::Numbers(numbers.iter().map(|n| *n as i64).collect()))
        };
        let mut attributes = vec![
            list("kernel_shape", &self.kernel),
            list("strides", &self.strides),
            list("pads", &self.pads),
        ];
        let mut inputs = vec!["s"];
        let mut parts = vec![value(11, "s", &shape), value(11, "o", &[1, 6])];
        if self.operator == "Conv" {
            attributes.push(list("dilations", &self.dilations));
            attributes.push(("group", Of::Number(self.groups as i64)));
            let own = (Self::CHANNELS / self.groups) as i64;
            let [a, b] = self.kernel.map(|side| side as i64);
            parts.push(weights("k", &[self.outputs as i64, own, a, b], kernel));
            inputs.push("k");
        }
        parts.push(node_with(self.operator, &inputs, &["w"], &attributes));
        parts.push(integers("shape", &[1, count as i64]));
        parts.push(node("Reshape", &["w", "shape"], &["a"]));
        parts.push(value(12, "t", &shape));
        parts.push(node("Identity", &["s"], &["t"]));
        let policy = load(&parts, r#"{"action": "a", "state": [["s", "t"]]}"#, count).unwrap();
        let mut actions = vec![0.0; count];
        policy.worker().act(1, &[0.0; 6], &mut image.to_vec(), &mut actions);
        actions
    }
}

#[test]
fn convolutions_and_pools_agree_with_their_definition() {
    let conv = |kernel, strides, pads, dilations, groups, outputs| Windows {
        operator: "Conv",
        kernel,
        strides,
        pads,
        dilations,
        groups,
        outputs,
    };
    let pool = |operator, kernel, strides, pads| Windows {
        operator,
        kernel,
        strides,
        pads,
        dilations: [1, 1],
        groups: 1,
        outputs: Windows::CHANNELS,
    };
    for windows in [
        conv([3, 3], [1, 1], [1, 1, 1, 1], [1, 1], 1, 5),
        conv([3, 3], [2, 2], [0, 0, 0, 0], [1, 1], 1, 2),
        conv([5, 2], [2, 1], [2, 0, 1, 1], [1, 1], 1, 3),
        conv([2, 3], [1, 2], [1, 2, 0, 1], [2, 3], 1, 3),
        conv([1, 1], [1, 1], [0, 0, 0, 0], [1, 1], 1, 6),
        conv([1, 1], [2, 3], [0, 0, 0, 0], [1, 1], 1, 6),
        conv([3, 3], [1, 2], [1, 1, 1, 1], [1, 1], 2, 6),
        conv([3, 3], [2, 1], [1, 1, 1, 1], [1, 2], 4, 4),
        conv([3, 2], [1, 1], [1, 0, 1, 0], [1, 1], 4, 8),
        pool("MaxPool", [2, 2], [2, 2], [0, 0, 0, 0]),
        pool("MaxPool", [3, 2], [1, 2], [1, 0, 1, 1]),
        pool("AveragePool", [2, 3], [1, 2], [0, 0, 0, 0]),
        pool("AveragePool", [3, 3], [2, 2], [1, 1, 1, 1]),
    ] {
        let image: Vec<f64> = numbers(4 * 63, 8).into_iter().map(f64::from).collect();
        let own = Windows::CHANNELS / windows.groups;
        let kernel = numbers(windows.outputs * own * windows.kernel[0] * windows.kernel[1], 2);
        let expected = windows.expected(&image, &kernel);
        let found = windows.found(&image, &kernel);
        assert_eq!(expected.len(), found.len());
        for (expected, found) in expected.iter().zip(&found) {
            assert!(
                (expected - f64::from(*found)).abs() < 1e-5,
                "{} {:?} {:?} {:?} {:?} {}: {expected} {found}",
                windows.operator,
                windows.kernel,
                windows.strides,
                windows.pads,
                windows.dilations,
                windows.groups
            );
        }
    }
}

/// Returns the message of a model with a convolution or a pool of the image `i`.
fn refused(shape: &[i64], kernel: Option<&[i64]>, attributes: &[Attribute<'_>]) -> String {
    let mut parts = vec![typed(11, "i", shape, 1)];
    match kernel {
        Some(kernel) => {
            // A kernel of any size that takes no space in the file.
            parts.extend([integers("ks", kernel), node("ConstantOfShape", &["ks"], &["k"])]);
            parts.push(node_with("Conv", &["i", "k"], &["c"], attributes));
        }
        None => parts.push(node_with("MaxPool", &["i"], &["c"], attributes)),
    }
    parts.extend([node("GlobalAveragePool", &["c"], &["g"]), node("Flatten", &["g"], &["a"])]);
    load(&parts, r#"{"images": [["i", "over"]]}"#, 3).unwrap_err()
}

#[test]
fn hostile_convolutions_are_refused_before_they_run() {
    let list = |name: &'static str, numbers: &[i64]| (name, Of::Numbers(numbers.to_vec()));
    let image = [1, 3, 64, 64];
    let started = processor_secs();
    for (kernel, attributes) in [
        // Too many products.
        (Some(&[8192, 3, 32, 32][..]), vec![list("kernel_shape", &[32, 32])]),
        // A kernel larger than the image, or larger than the limit.
        (Some(&[3, 3, 65, 65]), vec![list("kernel_shape", &[65, 65])]),
        (Some(&[3, 3, 512, 512]), vec![list("kernel_shape", &[512, 512]), list("pads", &[250; 4])]),
        // Pads, strides and dilations out of range.
        (Some(&[3, 3, 3, 3]), vec![list("kernel_shape", &[3, 3]), list("pads", &[1 << 40; 4])]),
        (Some(&[3, 3, 3, 3]), vec![list("kernel_shape", &[3, 3]), list("pads", &[-1; 4])]),
        (Some(&[3, 3, 3, 3]), vec![list("kernel_shape", &[3, 3]), list("pads", &[1; 3])]),
        (Some(&[3, 3, 3, 3]), vec![list("kernel_shape", &[3, 3]), list("strides", &[0, 1])]),
        (Some(&[3, 3, 3, 3]), vec![list("kernel_shape", &[3, 3]), list("strides", &[1, i64::MAX])]),
        (Some(&[3, 3, 3, 3]), vec![list("kernel_shape", &[3, 3]), list("dilations", &[0, 0])]),
        (Some(&[3, 3, 3, 3]), vec![list("kernel_shape", &[3, 3]), list("dilations", &[200, 1])]),
        // Sizes that do not agree.
        (Some(&[3, 3, 3, 3]), vec![list("kernel_shape", &[5, 5])]),
        (Some(&[3, 3, 3, 3]), vec![]),
        (Some(&[3, 4, 3, 3]), vec![list("kernel_shape", &[3, 3])]),
        (Some(&[3, 1, 3, 3]), vec![list("kernel_shape", &[3, 3]), ("group", Of::Number(0))]),
        (Some(&[4, 1, 3, 3]), vec![list("kernel_shape", &[3, 3]), ("group", Of::Number(3))]),
        (Some(&[3, 1, 3, 3]), vec![list("kernel_shape", &[3, 3]), ("group", Of::Number(-3))]),
        (Some(&[3, 3, 3]), vec![list("kernel_shape", &[3])]),
        (None, vec![list("kernel_shape", &[0, 2])]),
        (None, vec![list("kernel_shape", &[65, 1])]),
        (None, vec![list("kernel_shape", &[2, 2]), list("pads", &[1 << 60; 4])]),
        (None, vec![list("kernel_shape", &[200, 200]), list("pads", &[256; 4])]),
    ] {
        let message = refused(&image, kernel, &attributes);
        let expected = ["has inputs of other shapes", "not a valid ONNX model"];
        assert!(expected.iter().any(|words| message.contains(words)), "{kernel:?}: {message}");
    }
    for (attribute, words) in [
        (("auto_pad", Of::Text("SAME_LOWER")), "pads an image by `auto_pad`"),
        (("ceil_mode", Of::Number(1)), "rounds the number of windows up"),
    ] {
        let message = refused(&image, None, &[list("kernel_shape", &[2, 2]), attribute]);
        assert!(message.contains(words), "{message}");
    }
    assert!(processor_secs() - started < 10.0, "{} s", processor_secs() - started);
}

#[test]
fn an_image_that_does_not_fit_is_an_error() {
    let message = |input: Vec<u8>, side: &str, operator: &str| {
        let parts = [input, node(operator, &["i"], &["x"]), node("Flatten", &["x"], &["a"])];
        load(&parts, side, 3).unwrap_err()
    };
    let side = r#"{"images": [["i", "over"]]}"#;
    for shape in [&[1, 4, 8, 8][..], &[2, 3, 8, 8], &[1, 3, 8], &[1, 3, 2, 8], &[1, 3, 8, 1024]] {
        let message = message(value(11, "i", shape), side, "Neg");
        assert!(message.contains("the image `i` has the shape"), "{shape:?}: {message}");
    }
    let found = message(typed(11, "i", &[1, 3, 8, 8], 6), side, "Neg");
    assert!(found.contains("the image `i` of the type INT32"), "{found}");
    let found = message(typed(11, "i", &[1, 3, 8, 8], 2), side, "Neg");
    assert!(found.contains("the operator `Neg` of the bytes of an image"), "{found}");
    let found = message(value(11, "o", &[1, 6]), side, "Neg");
    assert!(found.contains("no input `i`"), "{found}");
    let found = message(value(11, "i", &[1, 1]), r#"{"parts": ["hnd"]}"#, "Neg");
    assert!(found.contains("the part `hnd` is unknown; the parts: joints, object, hand"), "{found}");
    let found = message(value(11, "i", &[1, 2]), r#"{"parts": ["hand", "hand"]}"#, "Neg");
    assert!(found.contains("the part `hand` is named twice"), "{found}");
    let found = message(value(11, "i", &[1, 6]), r#"{"parts": ["joints"]}"#, "Neg");
    assert!(found.contains("has the shape [1, 6]"), "{found}");
}
