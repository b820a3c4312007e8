//! Parameters: names, initialization, optimizer steps.

use crate::reference::{CASES, Random, network};
use mishandle_network::{Activation, Adam, Mlp, NetworkError, Tensor, clip_norm};

fn small() -> Mlp<f32> {
    Mlp::new(&[2, 3, 1], Activation::Elu, Activation::Identity).expect("a network")
}

#[test]
fn tensors_have_the_order_and_shapes_of_pytorch() {
    let mut network = small();
    network.update(|parameters| {
        for (i, parameter) in parameters.iter_mut().enumerate() {
            *parameter = i as f32;
        }
    });
    let found: Vec<(String, Vec<usize>, f32)> =
        network.tensors().into_iter().map(|tensor| (tensor.name, tensor.shape, tensor.values[0])).collect();
    let expected = [
        ("layers.0.weight", vec![3, 2], 0.0),
        ("layers.0.bias", vec![3], 6.0),
        ("layers.1.weight", vec![1, 3], 9.0),
        ("layers.1.bias", vec![1], 12.0),
    ];
    assert_eq!(found, expected.map(|(name, shape, first)| (name.to_string(), shape, first)));
}

#[test]
fn tensors_may_be_given_in_any_order() {
    let source = network::<f32>(CASES[3], &mut Random(1));
    let mut tensors = source.tensors();
    tensors.reverse();
    let mut copy = Mlp::new(source.sizes(), Activation::Elu, Activation::Tanh).expect("a network");
    copy.set_tensors(&tensors).expect("the tensors of the network");
    assert_eq!(copy.parameters(), source.parameters());
}

#[track_caller]
fn check_error(change: impl Fn(&mut Vec<Tensor<'_, f32>>), message: &str) {
    let source = small();
    let mut tensors = source.tensors();
    change(&mut tensors);
    let mut network =
        network::<f32>((&[2, 3, 1], Activation::Elu, Activation::Identity, false), &mut Random(2));
    let before = network.parameters().to_vec();
    let error = network.set_tensors(&tensors).expect_err("invalid");
    assert_eq!(error.to_string(), message);
    assert_eq!(network.parameters(), before, "an error changes nothing");
}

#[test]
fn missing_unexpected_and_malformed_tensors_are_errors() {
    check_error(
        |tensors| drop(tensors.remove(1)),
        "tensor `layers.0.bias` is missing; given tensors: layers.0.weight, layers.1.weight, layers.1.bias",
    );
    check_error(
        |tensors| tensors[1].name = "layers.7.bias".to_string(),
        "unexpected tensor `layers.7.bias`; this network has, once each: \
         layers.0.weight, layers.0.bias, layers.1.weight, layers.1.bias",
    );
    check_error(
        |tensors| tensors.push(tensors[0].clone()),
        "unexpected tensor `layers.0.weight`; this network has, once each: \
         layers.0.weight, layers.0.bias, layers.1.weight, layers.1.bias",
    );
    check_error(
        |tensors| tensors[0].shape.reverse(),
        "tensor `layers.0.weight` must have the shape [3, 2], found the shape [2, 3] with 6 numbers",
    );
    check_error(
        |tensors| tensors[0].values = &[1.0; 5],
        "tensor `layers.0.weight` must have the shape [3, 2], found the shape [3, 2] with 5 numbers",
    );
    check_error(
        |tensors| tensors[1].values = &[0.0, f32::NAN, 0.0],
        "number 1 of `layers.0.bias` is NaN; it must be finite",
    );
}

#[test]
fn invalid_sizes_are_errors() {
    for sizes in [&[][..], &[3], &[3, 0, 1]] {
        let error = Mlp::<f32>::new(sizes, Activation::Elu, Activation::Identity).expect_err("invalid");
        assert_eq!(error, NetworkError::Sizes { found: sizes.to_vec() });
    }
}

#[test]
fn orthogonal_weights_scale_lengths_by_the_gain() {
    let mut random = Random(3);
    let mut network =
        Mlp::<f64>::new(&[30, 64, 64, 9], Activation::Elu, Activation::Identity).expect("a network");
    network.initialize_orthogonal(&[2.0, 1.0, 0.01], || random.normal()).expect("a gain for each layer");
    for (tensor, gain) in network.tensors().iter().step_by(2).zip([2.0, 1.0, 0.01]) {
        let rows = tensor.shape[0];
        let columns = tensor.shape[1];
        let at = |r: usize, c: usize| tensor.values[r * columns + c];
        // W Wᵀ or Wᵀ W, whichever is smaller, is gain² times the identity matrix.
        for i in 0..rows.min(columns) {
            for j in 0..rows.min(columns) {
                let product: f64 = if rows <= columns {
                    (0..columns).map(|k| at(i, k) * at(j, k)).sum()
                } else {
                    (0..rows).map(|k| at(k, i) * at(k, j)).sum()
                };
                let expected = if i == j { gain * gain } else { 0.0 };
                assert!((product - expected).abs() < 1e-12, "{}: {i}, {j}: {product}", tensor.name);
            }
        }
    }
    let error = network.initialize_orthogonal(&[1.0], || 0.0).expect_err("invalid");
    assert_eq!(error.to_string(), "`gains` has 1 numbers; expected 3");
}

/// U(−b, b) has the mean 0 and the variance b² / 3.
#[test]
fn uniform_parameters_have_the_bound_of_pytorch() {
    let mut random = Random(4);
    let mut network = Mlp::<f64>::new(&[100, 400], Activation::Elu, Activation::Identity).expect("a network");
    network.initialize_uniform(|| random.uniform());
    let numbers = network.parameters();
    let count = numbers.len() as f64;
    assert!(numbers.iter().all(|x| x.abs() <= 0.1));
    let mean = numbers.iter().sum::<f64>() / count;
    let variance = numbers.iter().map(|x| x * x).sum::<f64>() / count;
    // Five standard errors: 0.1 / √3 / √40400 and 0.01 · √(4/45) / √40400.
    assert!(mean.abs() < 1.5e-3, "{mean}");
    assert!((variance - 0.01 / 3.0).abs() < 7.5e-5, "{variance}");
    assert!(network.tensors()[1].values.iter().any(|bias| *bias != 0.0));
}

#[test]
fn two_steps_of_adam_equal_values_computed_by_hand() {
    let mut adam = Adam::<f64>::new(1, 0.1);
    let mut theta = [1.0];
    // m = 0.1 · 2 = 0.2, v = 0.001 · 4 = 0.004; corrected: 2 and 4; θ = 1 − 0.1 · 2 / (2 + 1e-8).
    adam.step(&mut theta, &[2.0]);
    let first = 1.0 - 0.1 * 2.0 / (2.0 + 1e-8);
    assert!((theta[0] - first).abs() < 1e-15, "{}", theta[0]);
    // m = 0.9 · 0.2 + 0.1 · (−1) = 0.08, v = 0.999 · 0.004 + 0.001 · 1 = 0.004996;
    // corrected: 0.08 / 0.19 and 0.004996 / 0.001999; θ −= 0.1 · 0.421053 / (1.580899 + 1e-8).
    adam.step(&mut theta, &[-1.0]);
    let second = first - 0.1 * (0.08 / 0.19) / ((0.004_996_f64 / 0.001_999).sqrt() + 1e-8);
    assert!((theta[0] - second).abs() < 1e-15, "{}", theta[0]);
    assert!((adam.first_moments()[0] - 0.08).abs() < 1e-15);
    assert!((adam.second_moments()[0] - 0.004_996).abs() < 1e-15);
    assert_eq!(adam.steps(), 2);
}

#[test]
fn a_restored_adam_continues_bit_for_bit() {
    let mut random = Random(5);
    let gradients: Vec<Vec<f32>> = (0..6).map(|_| random.normals(20)).collect();
    let mut whole = Adam::new(20, 1e-3);
    let mut parameters = vec![0.5; 20];
    let mut resumed = Adam::new(20, 1e-3);
    let mut again = vec![0.5; 20];
    for gradient in &gradients {
        whole.step(&mut parameters, gradient);
        let m = resumed.first_moments().to_vec();
        let v = resumed.second_moments().to_vec();
        resumed = Adam::resume(1e-3, m, v, resumed.steps()).expect("valid moments");
        resumed.step(&mut again, gradient);
    }
    assert_eq!(parameters, again);
    assert_eq!(whole, resumed);
    assert!(Adam::resume(1e-3, vec![0.0_f32; 2], vec![0.0; 3], 1).is_err());
    assert!(Adam::resume(1e-3, vec![0.0_f32], vec![-1.0], 1).is_err());
    assert!(Adam::resume(1e-3, vec![f32::NAN], vec![1.0], 1).is_err());
}

#[test]
fn clipping_scales_only_gradients_above_the_limit() {
    let mut long: Vec<f64> = (1..=40).map(f64::from).collect();
    let norm = f64::from(40 * 41 * 81 / 6_u32).sqrt(); // Σ i² = n (n + 1) (2 n + 1) / 6
    assert!((clip_norm(&mut long, 1.0) - norm).abs() < 1e-12);
    let left = long.iter().map(|x| x * x).sum::<f64>().sqrt();
    assert!((left - norm / (norm + 1e-6)).abs() < 1e-12);
    let mut short = [0.3_f32, 0.4];
    assert!((clip_norm(&mut short, 1.0) - 0.5).abs() < 1e-7);
    assert_eq!(short, [0.3, 0.4]);
    let mut broken = [f32::NAN, 1.0];
    assert!(clip_norm(&mut broken, 0.1).is_nan());
    assert_eq!(broken[1], 1.0);
}
