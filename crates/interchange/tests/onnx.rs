//! A recurrent ONNX model against the actions of ONNX Runtime. Other models: `python/tests/test_onnx.py`.

#![allow(clippy::unwrap_used)]

use mishandle_controllers::{Entry, Layout};
use mishandle_interchange::OnnxPolicy;
use mishandle_rollout::{Controller, Seed};

fn layout(observation: usize, action: usize) -> Layout {
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
    let (observations, expected) =
        ([[0.3, -0.7], [1.5, 0.2], [-4.0, 2.5]], [0.021_155_043, -0.118_453_15, -0.001_905_530_7]);
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
    for length in 0..bytes.len() {
        assert!(
            OnnxPolicy::from_bytes(&bytes[..length], None, &["test"], &layout(2, 1)).is_err(),
            "{length}"
        );
    }
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
