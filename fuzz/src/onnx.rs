//! ONNX models.

use mishandle::controllers::{ControllerFile, Entry, Header, Layout, Policy, TrainingRecord};
use mishandle::interchange::{OnnxPolicy, onnx_bytes};
use mishandle::rollout::{Controller, Seed};
use mishandle_network::{Activation, Mlp};

/// Checks that a model which is loaded computes actions: the same for the same observations and
/// state, whatever the other rows are. A number that is not finite is allowed, because it ends a
/// simulation.
pub fn check(bytes: &[u8]) {
    let Ok(policy) = OnnxPolicy::from_bytes(bytes, None, &["toy"], &layout()) else { return };
    let observations = [0.5, -2.0, 1.5, 0.25];
    let act = |rows: usize, from: usize| {
        let mut states = vec![0.0; rows * policy.state_size()];
        let mut actions = vec![0.0; rows];
        let mut worker = policy.worker();
        worker.reset(&mut states, Seed(0));
        worker.act(rows, &observations[2 * from..][..2 * rows], &mut states, &mut actions);
        actions.into_iter().map(f32::to_bits).collect::<Vec<u32>>()
    };
    assert_eq!(act(2, 0), [act(1, 0), act(1, 1)].concat());
}

fn layout() -> Layout {
    let entry = |name: &str, size| vec![Entry { name: name.into(), unit: "m".into(), size }];
    Layout { observation: entry("ball", 2), action: entry("push", 1) }
}

pub fn seeds() -> Vec<Vec<u8>> {
    let header = Header {
        task: "toy".into(),
        algorithm: "ppo".into(),
        preset: "paper".into(),
        reward: "shaped".into(),
        layout: layout(),
        action_interface: None,
        task_hash: String::new(),
        training: TrainingRecord::default(),
    };
    let activations = [Activation::Elu, Activation::Gelu, Activation::LeakyRelu];
    let mut seeds: Vec<Vec<u8>> = activations
        .into_iter()
        .map(|activation| {
            let mut network = Mlp::new(&[2, 2, 1], activation, Activation::Identity)
                .expect("valid sizes")
                .with_affine_layer_norm();
            network.update(|parameters| parameters.fill(0.5));
            let policy = Policy::new(vec![0.25; 2], vec![1.0; 2], network, vec![-0.5]).expect("valid sizes");
            onnx_bytes(&ControllerFile { header: header.clone(), policy }, "0.1.0")
        })
        .collect();
    // A recurrent model, with the state in its metadata.
    seeds.push(include_bytes!("../../crates/interchange/tests/data/lstm.onnx").to_vec());
    seeds
}
