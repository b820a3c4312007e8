//! A recurrent ONNX model against the actions of ONNX Runtime, and an exported history against our
//! own. Other models:
//! `python/tests/test_onnx.py`.

use crate::graph::{Of, bytes, integer, integers, node, node_with, value, weights};
use crate::processor_time::processor_secs;
use mishandle_controllers::{ControllerFile, Entry, Header, Layout, Policy, TrainingRecord};
use mishandle_interchange::{OnnxPolicy, onnx_bytes};
use mishandle_network::{Activation, Mlp};
use mishandle_rollout::{Controller, Seed};

pub fn layout(observation: usize, action: usize) -> Layout {
    let entry = |size| vec![Entry { name: "x".into(), unit: String::new(), size }];
    Layout { observation: entry(observation), action: entry(action) }
}

#[test]
fn a_recurrent_model_keeps_its_state_for_each_row() {
    let bytes = std::fs::read(concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data/lstm.onnx")).unwrap();
    let policy = OnnxPolicy::from_bytes(&bytes, None, &["test"], &layout(2, 1)).unwrap();
    assert_eq!(policy.state_size(), 6);
    let mut worker = policy.worker();
    // Two rows; the second starts one step later.
    let mut states = vec![1.0; 12];
    worker.reset(&mut states[..6], Seed(0));
    let observations = [[0.3, -0.7], [1.5, 0.2], [-4.0, 2.5]];
    let expected = [0.021_155_043, -0.118_453_15, -0.001_905_530_7];
    let mut found = Vec::new();
    for step in 0..3 {
        if step == 1 {
            worker.reset(&mut states[6..], Seed(1));
        }
        let both = [observations[step], observations[step.saturating_sub(1)]].concat();
        let mut actions = [0.0; 2];
        worker.act(2, &both, &mut states, &mut actions);
        found.push(actions);
    }
    for (step, expected) in expected.into_iter().enumerate() {
        assert!((found[step][0] - expected).abs() < 1e-6_f32, "step {step}: {found:?}");
    }
    // The same bits, whatever the other row does.
    assert_eq!([found[1][1], found[2][1]], [found[0][0], found[1][0]]);
}

#[test]
fn the_state_of_isaac_labs_recurrent_exports_is_known_by_its_names() {
    let model = |input: &str| {
        let values = [value(11, input, &[1, 1]), value(12, "h_out", &[1, 1])].concat();
        load(&[values, node("Add", &["o", input], &["h_out"]), node("Neg", &["h_out"], &["a"])], "[]")
    };
    let policy = model("h_in").unwrap();
    let mut state = [0.0];
    let mut action = [0.0];
    let mut worker = policy.worker();
    worker.reset(&mut state, Seed(0));
    for expected in [-2.0, -4.0] {
        worker.act(1, &[2.0], &mut state, &mut action);
        assert_eq!(action, [expected]);
    }
    let error = model("memory").err().unwrap().to_string();
    assert!(error.contains("nothing says what the input `o` is"), "{error}");
}

#[test]
fn an_exported_history_acts_as_that_of_the_controller() {
    for (length, clip) in [(1, None), (3, Some(5.0)), (2, Some(0.5))] {
        let mut network = Mlp::new(&[2 + length * 3, 16, 1], Activation::Elu, Activation::Identity).unwrap();
        network.update(|parameters| {
            parameters.iter_mut().zip(0..).for_each(|(x, i)| *x = (1.7 * i as f32).sin());
        });
        let mean = vec![0.5, -1.0];
        let variance = vec![0.25, 4.0];
        let policy = Policy::with_history(length, mean, variance, network, Some(vec![0.0])).unwrap();
        let policy = policy.with_observation_clip(clip).unwrap();
        let header = Header {
            task: "test".into(),
            algorithm: "ppo".into(),
            preset: String::new(),
            reward: String::new(),
            layout: layout(2, 1),
            action_interface: None,
            task_hash: String::new(),
            training: TrainingRecord::default(),
        };
        let bytes = onnx_bytes(&ControllerFile { header, policy: policy.clone() }, "0.1.0");
        let model = OnnxPolicy::from_bytes(&bytes, None, &["test"], &layout(2, 1)).unwrap();
        assert_eq!(model.state_size(), 3 * length);
        let mut ours = policy.worker();
        let mut theirs = model.worker();
        let mut states = [vec![7.0; 6 * length], vec![7.0; 6 * length]];
        let mut largest = 0.0_f32;
        for step in 0..20 {
            // The second row starts again within its episode.
            for row in (0..2).filter(|row| step == 0 || (step, *row) == (7, 1)) {
                let own = row * 3 * length..(row + 1) * 3 * length;
                ours.reset(&mut states[0][own.clone()], Seed(0));
                theirs.reset(&mut states[1][own], Seed(0));
            }
            let observations: Vec<f32> = (0..4).map(|i| 3.0 * ((i + 4 * step) as f32).sin()).collect();
            let mut expected = [0.0; 2];
            let mut found = [0.0; 2];
            ours.act(2, &observations, &mut states[0], &mut expected);
            theirs.act(2, &observations, &mut states[1], &mut found);
            for (expected, found) in expected.iter().zip(found) {
                largest = largest.max(expected.abs());
                assert!((expected.clamp(-1.0, 1.0) - found).abs() < 1e-5, "{step}: {expected} {found}");
            }
        }
        assert!(largest > 1.0, "{largest}: the history has clipped actions");
    }
}

#[test]
fn a_model_that_does_not_fit_is_an_error() {
    let bytes = std::fs::read(concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data/lstm.onnx")).unwrap();
    let message =
        |layout: &Layout| OnnxPolicy::from_bytes(&bytes, None, &["test"], layout).unwrap_err().to_string();
    assert!(
        message(&layout(3, 1))
            .contains("its observation `obs` has the shape [N, 2], but the task has 3 numbers")
    );
    assert!(
        message(&layout(2, 4))
            .contains("its action `actions` has the shape [1, 1], but the task has 4 numbers")
    );
    let is_read =
        |length: &usize| OnnxPolicy::from_bytes(&bytes[..*length], None, &["test"], &layout(2, 1)).is_ok();
    // Without its metadata the model is whole, and the names of its state are known.
    let metadata = bytes.windows(10).position(|part| part == b"mishandle.").unwrap();
    let read: Vec<usize> = (0..bytes.len()).filter(is_read).collect();
    assert!(read.iter().all(|length| *length + 4 >= metadata), "{read:?}, {metadata}");
    assert!(read.len() <= 3, "{read:?}");
}

#[test]
fn tensors_whose_size_overflows_are_errors() {
    // Model (field 7) > graph (5) > tensor (1: sizes, 2: type).
    let huge = [0x08, 0x80, 0x80, 0x80, 0x80, 0x10]; // 2^32
    for sizes in [[&huge[..], &huge[..]], [&[0x08, 0x00][..], &huge[..]]] {
        let tensor = [sizes[0], sizes[1], &[0x10, 1]].concat();
        let graph = [&[0x2A, tensor.len() as u8][..], &tensor].concat();
        let model = [&[0x3A, graph.len() as u8][..], &graph].concat();
        let error = OnnxPolicy::from_bytes(&model, None, &["test"], &layout(1, 1)).unwrap_err().to_string();
        assert!(error.contains("the limit is 67108864 elements"), "{error}");
    }
}

#[test]
fn nested_messages_and_lengths_beyond_the_file_are_errors() {
    let message =
        |bytes: &[u8]| OnnxPolicy::from_bytes(bytes, None, &["test"], &layout(1, 1)).unwrap_err().to_string();
    // The graph's length is 2^62.
    let long = [0x3A, 0x80, 0x80, 0x80, 0x80, 0x80, 0x80, 0x80, 0x80, 0x40];
    assert!(message(&long).contains("damaged"), "{}", message(&long));
    // The same for the bytes of a tensor in a graph.
    let inside = [&[0x3A, 13, 0x2A, 11, 0x4A][..], &long[1..], &[0]].concat();
    assert!(message(&inside).contains("damaged"), "{}", message(&inside));
    // A node with an attribute with a graph with a node …, 50,000 deep.
    let mut nested: Vec<u8> = Vec::new();
    for _level in 0..50_000 {
        for field in [6_u8, 5, 1] {
            let mut length = nested.len();
            let mut head = vec![field << 3 | 2];
            while length >= 0x80 {
                head.push(length as u8 | 0x80);
                length >>= 7;
            }
            head.push(length as u8);
            // Written back to front, since prepending is slow.
            nested.extend(head.iter().rev());
        }
    }
    let mut length = nested.len();
    nested.reverse();
    let mut whole = vec![0x3A];
    while length >= 0x80 {
        whole.push(length as u8 | 0x80);
        length >>= 7;
    }
    whole.push(length as u8);
    whole.extend(nested);
    assert!(message(&whole).contains("subgraph"), "{}", message(&whole));
}

/// Loads a model of opset 13 with the input `o` and the output `a`, one number each, these parts of
/// a graph, and a state.
fn load(parts: &[Vec<u8>], state: &str) -> Result<OnnxPolicy, mishandle_interchange::OnnxProblem> {
    load_opset(13, parts, state)
}

fn load_opset(
    opset: i64,
    parts: &[Vec<u8>],
    state: &str,
) -> Result<OnnxPolicy, mishandle_interchange::OnnxProblem> {
    let graph = [parts.concat(), value(11, "o", &[1, 1]), value(12, "a", &[1, 1])].concat();
    let state = [bytes(1, b"mishandle.state"), bytes(2, state.as_bytes())].concat();
    let model = [integer(1, 8), bytes(7, &graph), bytes(8, &integer(2, opset)), bytes(14, &state)].concat();
    OnnxPolicy::from_bytes(&model, None, &["test"], &layout(1, 1))
}

/// Returns the action of a model without a state.
fn action_of(policy: &OnnxPolicy, observation: f32) -> f32 {
    let mut action = [0.0];
    policy.worker().act(1, &[observation], &mut [], &mut action);
    action[0]
}

/// The results of NumPy, by which the ONNX standard defines these operators.
#[test]
fn nan_in_an_observation_is_nan_in_the_action() {
    let one = [
        "Abs",
        "Acos",
        "Asin",
        "Atan",
        "Ceil",
        "Clip",
        "Cos",
        "Elu",
        "Erf",
        "Exp",
        "Floor",
        "HardSigmoid",
        "HardSwish",
        "Identity",
        "LeakyRelu",
        "Log",
        "Mish",
        "Neg",
        "Reciprocal",
        "ReduceL2",
        "ReduceMax",
        "ReduceMean",
        "ReduceMin",
        "ReduceProd",
        "Relu",
        "Round",
        "Sigmoid",
        "Sign",
        "Sin",
        "Softmax",
        "Softplus",
        "Softsign",
        "Sqrt",
        "Tan",
        "Tanh",
    ];
    let two = ["Add", "Div", "Max", "Mean", "Min", "Mul", "Pow", "PRelu", "Sub", "Sum"];
    let bounds = || weights("low", &[], &[-1.0]).into_iter().chain(weights("high", &[], &[2.0])).collect();
    let models = one
        .iter()
        .map(|name| (*name, vec![node(name, &["o"], &["a"])]))
        .chain(two.iter().map(|name| (*name, vec![bounds(), node(name, &["o", "high"], &["a"])])))
        .chain([("Clip", vec![bounds(), node("Clip", &["o", "low", "high"], &["a"])])]);
    let mut lost = Vec::new();
    for (name, parts) in models {
        let opset = if name == "HardSwish" { 14 } else { 13 };
        let policy = load_opset(opset, &parts, "[]").unwrap();
        if !action_of(&policy, f32::NAN).is_nan() {
            lost.push(name);
        }
    }
    assert!(lost.is_empty(), "{lost:?}");
}

#[test]
fn bounds_are_those_of_the_standard() {
    let weights = [weights("low", &[], &[-1.0]), weights("high", &[], &[2.0])].concat();
    let clip = |inputs: &[&str]| load(&[weights.clone(), node("Clip", inputs, &["a"])], "[]").unwrap();
    let attributes = [("min", Of::Real(-1.0)), ("max", Of::Real(2.0))];
    let old = load_opset(10, &[node_with("Clip", &["o"], &["a"], &attributes)], "[]").unwrap();
    let relu = load(&[node("Relu", &["o"], &["a"])], "[]").unwrap();
    let infinity = f32::INFINITY;
    for (policy, [low, high]) in [
        (relu, [0.0, infinity]),
        (clip(&["o"]), [-infinity, infinity]),
        (clip(&["o", "low"]), [-1.0, infinity]),
        (clip(&["o", "", "high"]), [-infinity, 2.0]),
        (clip(&["o", "low", "high"]), [-1.0, 2.0]),
        (old, [-1.0, 2.0]),
    ] {
        for x in [-infinity, -3.0, -1.0, -0.5, 0.0, 1.5, 2.0, 7.0, infinity] {
            assert_eq!(action_of(&policy, x), x.max(low).min(high), "{x} between {low} and {high}");
        }
    }
    // The names of values in a model can be those that the replacement would take.
    let named = [
        weights.clone(),
        node("Clip", &["o", "low", "high"], &["own 1"]),
        node("Relu", &["own 1"], &["own 2"]),
        node("Clip", &["own 2", "low", "high"], &["a"]),
    ];
    assert_eq!(action_of(&load(&named, "[]").unwrap(), 5.0), 2.0);
}

#[test]
fn models_that_would_take_long_or_much_memory_are_errors() {
    let relu = || node("Relu", &["o"], &["a"]);
    load(&[relu()], "[]").unwrap();
    let message = |parts: &[Vec<u8>], state: &str| load(parts, state).unwrap_err().to_string();
    let names: Vec<String> = (0..10_001).map(|i| i.to_string()).collect();
    let outputs: Vec<&str> = names.iter().map(String::as_str).collect();
    let many = message(&[relu(), node("Split", &["o"], &outputs)], "[]");
    assert!(many.contains("10002 outputs of operators; the limit is 10000"), "{many}");
    let weights: Vec<Vec<u8>> = names.iter().map(|name| integers(name, &[])).collect();
    assert!(message(&[relu(), weights.concat()], "[]").contains("10001 tensors of weights"));
    let inputs: Vec<Vec<u8>> = names.iter().map(|name| value(11, name, &[1])).collect();
    assert!(message(&[relu(), inputs.concat()], "[]").contains("10002 inputs"));
    // A state of 2^40 numbers, of which each row of a batch would have one.
    let state =
        [relu(), value(11, "s", &[1 << 20, 1 << 20]), value(12, "t", &[1, 1]), node("Relu", &["s"], &["t"])];
    assert!(message(&state, r#"[["s", "t"]]"#).contains("its state has more than 65536 numbers"));
    let pairs = vec![r#"["s", "t"]"#; 101].join(",");
    assert!(message(&state, &format!("[{pairs}]")).contains("the state has 101 tensors; the limit is 100"));
}

#[test]
fn borders_and_slices_of_any_size_are_bounded_before_they_are_computed() {
    let message =
        |parts: &[Vec<u8>]| load(&[node("Relu", &["o"], &["a"]), parts.concat()], "[]").unwrap_err();
    let large = 1 << 30;
    let pad =
        |pads: &[i64]| message(&[integers("pads", pads), node("Pad", &["o", "pads"], &["x"])]).to_string();
    for pads in [&[0, large, 0, large][..], &[i64::from(i32::MAX); 4], &[1, 1]] {
        assert!(pad(pads).contains("`Pad` of `x` has inputs of other shapes, more than"), "{}", pad(pads));
    }
    let wide = || [integers("size", &[1 << 12, 1]), node("Expand", &["o", "size"], &["x"])].concat();
    let rows = || [integers("zero", &[0]), integers("rows", &[1 << 14, 1])].concat();
    let index = || node("Expand", &["zero", "rows"], &["i"]);
    let turned = || node("Transpose", &["x"], &["y"]);
    let slices =
        message(&[wide(), rows(), index(), turned(), node("GatherND", &["y", "i"], &["z"])]).to_string();
    assert!(slices.contains("`GatherND` of `z` has inputs of other shapes, more than"), "{slices}");
    let own = [node_with("Cast", &["o"], &["i"], &[("to", Of::Number(7))]), node("Pad", &["o", "i"], &["x"])];
    let own = message(&own).to_string();
    assert!(own.contains("`Pad` of `x`, whose shape depends on the observation"), "{own}");
}

#[test]
fn values_that_wait_for_operators_have_a_limit() {
    let sizes =
        || [integers("one", &[1]), integers("size", &[1 << 24]), node("Relu", &["o"], &["a"])].concat();
    let names: Vec<String> = (0..5).map(|i| format!("x{i}")).collect();
    let expand = |name: &String| node("Expand", &["one", "size"], &[name.as_str()]);
    let all: Vec<u8> = names.iter().flat_map(expand).collect();
    // No operator reads them, so each is dropped at once.
    load(&[sizes(), all.clone()], "[]").unwrap();
    let read: Vec<&str> = names.iter().map(String::as_str).collect();
    let message = load(&[sizes(), all, node("Sum", &read, &["sum"])], "[]").unwrap_err().to_string();
    assert!(
        message.contains("`Expand` of `x4`") && message.contains("or 67108864 numbers at a time"),
        "{message}"
    );
}

#[test]
fn a_split_into_many_parts_is_computed_once() {
    // 9,000 parts of 1,000 numbers each. Once per part, it would take 8.1e10 copies.
    let names: Vec<String> = (0..9000).map(|i| i.to_string()).collect();
    let outputs: Vec<&str> = names.iter().map(String::as_str).collect();
    let started = processor_secs();
    let parts = [
        integers("one", &[1]),
        integers("size", &[9_000_000]),
        node("Expand", &["one", "size"], &["all"]),
        node("Split", &["all"], &outputs),
        node("Relu", &["o"], &["a"]),
    ];
    load(&parts, "[]").unwrap();
    assert!(processor_secs() - started < 20.0, "{} s", processor_secs() - started);
}

#[test]
fn numbers_for_which_the_runtime_panics_and_missing_outputs_are_errors() {
    let message = |parts: &[Vec<u8>]| load(parts, "[]").unwrap_err().to_string();
    let least = integers("least", &[i64::from(i32::MIN)]);
    let divided =
        [least, integers("one", &[-1]), node("Div", &["least", "one"], &["x"]), node("Relu", &["o"], &["a"])];
    assert!(message(&divided).contains("`Div` of `x`: the ONNX runtime failed"), "{}", message(&divided));
    assert!(message(&[node("Relu", &["o"], &["b"])]).contains("no operator writes the output `a`"));
    assert!(message(&[node("Relu", &["o"], &["o"])]).contains("two values have the name `o`"));
}

/// Returns `count` operators that each negate the value before: `o` → `x1` → `x2` … → `a`.
fn chain(count: usize) -> Vec<Vec<u8>> {
    let name = |number: usize| match number {
        0 => "o".to_string(),
        _ if number == count => "a".to_string(),
        _ => format!("x{number}"),
    };
    (0..count).map(|number| node("Neg", &[&name(number)], &[&name(number + 1)])).collect()
}

#[track_caller]
fn act(policy: &OnnxPolicy, observation: f32) -> f32 {
    let mut action = [0.0];
    policy.worker().act(1, &[observation], &mut [], &mut action);
    action[0]
}

#[test]
fn chains_of_any_length_run_in_threads_with_small_stacks() {
    let run = || {
        for count in [1, 499, 500, 501, 1000, 6501, 9999, 10_000] {
            let sign = if count % 2 == 0 { 1.0 } else { -1.0 };
            assert_eq!(act(&load(&chain(count), "[]").unwrap(), 0.5), 0.5 * sign, "{count}");
        }
        let message = load(&chain(10_001), "[]").unwrap_err().to_string();
        assert!(message.contains("10001 operators; the limit is 10000"), "{message}");
    };
    std::thread::Builder::new().stack_size(1 << 19).spawn(run).unwrap().join().unwrap();
}

#[test]
fn deep_and_wide_graphs_act_as_their_sums() {
    // A ladder: two chains whose rungs add them. 2,000 levels of three operators.
    let mut parts = vec![node("Identity", &["o"], &["l0"]), node("Identity", &["o"], &["r0"])];
    for level in 0..2000 {
        let (next, name) = (level + 1, |side: &str, level: usize| format!("{side}{level}"));
        let l = name("l", level);
        let r = name("r", level);
        let m = name("m", level);
        parts.push(node("Mean", &[&l, &r], &[&m]));
        parts.push(node("Identity", &[&m], &[&name("l", next)]));
        parts.push(node("Max", &[&m, &r], &[&name("r", next)]));
    }
    parts.push(node("Add", &["l2000", "r2000"], &["a"]));
    assert_eq!(act(&load(&parts, "[]").unwrap(), 0.75), 1.5);
    // 18 chains of 500 operators and a sum of them.
    let mut parts = Vec::new();
    let ends: Vec<String> = (0..18).map(|chain| format!("c{chain}x500")).collect();
    for chain in 0..18 {
        parts.push(node("Identity", &["o"], &[&format!("c{chain}x0")]));
        for number in 0..500 {
            let from = format!("c{chain}x{number}");
            let to = format!("c{chain}x{}", number + 1);
            parts.push(node("Neg", &[&from], &[&to]));
        }
    }
    let ends: Vec<&str> = ends.iter().map(String::as_str).collect();
    parts.push(node("Sum", &ends, &["a"]));
    assert_eq!(act(&load(&parts, "[]").unwrap(), 0.25), 18.0 * 0.25);
    // 9,998 operators side by side.
    let names: Vec<String> = (0..9998).map(|number| format!("w{number}")).collect();
    let mut parts: Vec<Vec<u8>> = names.iter().map(|name| node("Neg", &["o"], &[name])).collect();
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    parts.push(node("Max", &names, &["a"]));
    assert_eq!(act(&load(&parts, "[]").unwrap(), 0.25), -0.25);
}

#[test]
fn operators_in_another_order_are_errors() {
    let mut reversed = chain(10_000);
    reversed.reverse();
    let message = load(&reversed, "[]").unwrap_err().to_string();
    assert!(message.contains("`Neg` of `a` reads `x9999` before an operator writes it"), "{message}");
}

/// Loads a model of the observation `o` with the outputs of these operators, one number each unless
/// the operator is `Shape`.
fn load_outputs(outputs: &[(&str, &str)], side: &str, opset: i64) -> Result<OnnxPolicy, String> {
    let nodes = outputs.iter().flat_map(|(operator, name)| node(operator, &["o"], &[name]));
    let values = outputs.iter().flat_map(|(_, name)| value(12, name, &[1, 1]));
    let graph = [nodes.chain(values).collect(), value(11, "o", &[1, 1])].concat();
    let model = [integer(1, 8), bytes(7, &graph), bytes(8, &integer(2, opset))].concat();
    let interface = mishandle_interchange::Interface::from_json(side).unwrap();
    OnnxPolicy::from_bytes(&model, Some(interface), &["test"], &layout(1, 1))
        .map_err(|error| error.to_string())
}

#[test]
fn one_of_several_outputs_is_the_action_only_if_something_says_so() {
    // By its size, by its name, by the description.
    for (outputs, side) in [
        (&[("Shape", "sizes"), ("Neg", "mean")][..], "{}"),
        (&[("Abs", "value"), ("Neg", "actions"), ("Relu", "log_prob")], "{}"),
        (&[("Abs", "value"), ("Neg", "mean")], r#"{"action": "mean"}"#),
    ] {
        assert_eq!(act(&load_outputs(outputs, side, 17).unwrap(), 0.5), -0.5, "{outputs:?}");
    }
    let message = load_outputs(&[("Abs", "value"), ("Neg", "mean")], "{}", 17).unwrap_err();
    assert!(
        message.contains("nothing says which output is the action: value, mean; several of them"),
        "{message}"
    );
    assert!(message.contains("name it by `action` in the metadata or in a side file"), "{message}");
    let message = load_outputs(&[("Shape", "action")], "{}", 17).unwrap_err();
    assert!(message.contains("its action `action` has the shape [2] of integers"), "{message}");
}

#[test]
fn opsets_that_were_not_compared_are_errors() {
    let load = |opset| load_outputs(&[("Neg", "a")], "{}", opset);
    for opset in 7..=22 {
        assert_eq!(act(&load(opset).unwrap(), 0.5), -0.5);
    }
    for opset in [1, 6, 23, 99] {
        let message = load(opset).unwrap_err();
        assert!(message.contains(&format!("has the opset {opset}, which is not supported")), "{message}");
        assert!(message.contains("opset_version=20"), "{message}");
    }
}
