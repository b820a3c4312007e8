//! Outputs compared with plain loops; gradients and tangents compared with finite differences and
//! each other. All in f64.

use crate::reference::{CASES, Random, network};
use mishandle_network::{Activation, Mlp, Workspace};

const ROWS: usize = 11;

fn activate(activation: Activation, x: f64) -> f64 {
    match activation {
        Activation::Elu if x < 0.0 => x.exp_m1(),
        Activation::Relu => x.max(0.0),
        Activation::Tanh => x.tanh(),
        _ => x,
    }
}

fn standardize(z: &mut [f64]) {
    let n = z.len() as f64;
    let mean = z.iter().sum::<f64>() / n;
    let variance = z.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / n;
    z.iter_mut().for_each(|x| *x = (*x - mean) / (variance + 1e-5).sqrt());
}

/// Computes the outputs by the definition, one number at a time.
fn outputs_by_loops(network: &Mlp<f64>, inputs: &[f64]) -> Vec<f64> {
    let tensors = network.tensors();
    let layers = tensors.len() / 2;
    inputs
        .chunks(network.input_size())
        .flat_map(|row| {
            tensors.chunks(2).enumerate().fold(row.to_vec(), |x, (l, layer)| {
                let last = l + 1 == layers;
                let activation = if last { network.output_activation() } else { network.hidden_activation() };
                let weight = layer[0].values;
                let bias = layer[1].values;
                let rows = weight.chunks(x.len()).zip(bias);
                let mut z: Vec<f64> =
                    rows.map(|(w, b)| w.iter().zip(&x).map(|(w, x)| w * x).sum::<f64>() + b).collect();
                if network.has_layer_norm() && !last {
                    standardize(&mut z);
                }
                z.into_iter().map(|z| activate(activation, z)).collect()
            })
        })
        .collect()
}

#[track_caller]
fn close(what: &str, found: &[f64], expected: &[f64], tolerance: f64) {
    assert_eq!(found.len(), expected.len(), "{what}");
    for (i, (found, expected)) in found.iter().zip(expected).enumerate() {
        assert!(
            (found - expected).abs() < tolerance * expected.abs().max(1.0),
            "{what}[{i}]: found {found}, expected {expected}"
        );
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// (f(x + h d) − f(x − h d)) / 2h
fn central_difference(x: &[f64], direction: &[f64], f: impl Fn(&[f64]) -> Vec<f64>) -> Vec<f64> {
    const H: f64 = 1e-5;
    let moved = |h: f64| -> Vec<f64> { x.iter().zip(direction).map(|(x, d)| x + h * d).collect() };
    f(&moved(H)).iter().zip(f(&moved(-H))).map(|(plus, minus)| (plus - minus) / (2.0 * H)).collect()
}

#[test]
fn forward_pass_follows_the_definition() {
    let mut random = Random(1);
    for case in CASES {
        let network = network::<f64>(case, &mut random);
        let inputs = random.normals(ROWS * network.input_size());
        let mut workspace = Workspace::default();
        close(
            "outputs",
            network.forward(&inputs, &mut workspace),
            &outputs_by_loops(&network, &inputs),
            1e-13,
        );
        assert_eq!(workspace.rows(), ROWS);
    }
}

#[test]
fn tangents_equal_finite_differences() {
    let mut random = Random(2);
    for case in CASES {
        let network = network::<f64>(case, &mut random);
        let inputs: Vec<f64> = random.normals(ROWS * network.input_size());
        let parameter_direction: Vec<f64> = random.normals(network.parameter_count());
        let input_direction: Vec<f64> = random.normals(inputs.len());
        let mut workspace = Workspace::default();
        network.forward(&inputs, &mut workspace);

        let along_parameters = central_difference(network.parameters(), &parameter_direction, |parameters| {
            let mut moved = network.clone();
            moved.update(|own| own.copy_from_slice(parameters));
            outputs_by_loops(&moved, &inputs)
        });
        let found = network.tangent(Some(&parameter_direction), None, &mut workspace);
        close("along parameters", found, &along_parameters, 1e-6);

        let along_inputs =
            central_difference(&inputs, &input_direction, |inputs| outputs_by_loops(&network, inputs));
        close(
            "along inputs",
            network.tangent(None, Some(&input_direction), &mut workspace),
            &along_inputs,
            1e-6,
        );

        let both: Vec<f64> = along_parameters.iter().zip(&along_inputs).map(|(p, i)| p + i).collect();
        let found = network.tangent(Some(&parameter_direction), Some(&input_direction), &mut workspace);
        close("along both", found, &both, 1e-6);
        assert!(network.tangent(None, None, &mut workspace).iter().all(|tangent| *tangent == 0.0));
    }
}

#[test]
fn gradients_equal_finite_differences() {
    let mut random = Random(3);
    for case in CASES {
        let network = network::<f64>(case, &mut random);
        let inputs: Vec<f64> = random.normals(ROWS * network.input_size());
        let output_gradient: Vec<f64> = random.normals(ROWS * network.output_size());
        let (gradient, input_gradient) = gradients(&network, &inputs, &output_gradient);
        let unit = |i: usize, count: usize| -> Vec<f64> {
            (0..count).map(|j| f64::from(u8::from(i == j))).collect()
        };

        // Every thirteenth parameter with a varying start, so that all layers, weights and biases
        // are checked.
        for i in (case.0.len()..gradient.len()).step_by(13).chain([gradient.len() - 1]) {
            let difference =
                central_difference(network.parameters(), &unit(i, gradient.len()), |parameters| {
                    let mut moved = network.clone();
                    moved.update(|own| own.copy_from_slice(parameters));
                    vec![dot(&outputs_by_loops(&moved, &inputs), &output_gradient)]
                });
            close(&format!("parameter {i}"), &[gradient[i]], &difference, 1e-6);
        }
        for (i, gradient) in input_gradient.iter().enumerate() {
            let difference = central_difference(&inputs, &unit(i, inputs.len()), |inputs| {
                vec![dot(&outputs_by_loops(&network, inputs), &output_gradient)]
            });
            close(&format!("input {i}"), &[*gradient], &difference, 1e-6);
        }
    }
}

fn gradients(network: &Mlp<f64>, inputs: &[f64], output_gradient: &[f64]) -> (Vec<f64>, Vec<f64>) {
    let mut gradient = vec![0.0; network.parameter_count()];
    let mut input_gradient = vec![f64::NAN; inputs.len()];
    let mut workspace = Workspace::default();
    network.forward(inputs, &mut workspace);
    network.backward(output_gradient, &mut workspace, Some(&mut gradient), Some(&mut input_gradient));
    (gradient, input_gradient)
}

/// uᵀ (J v) = (Jᵀ u)ᵀ v, for parameters and inputs at once.
#[test]
fn tangents_and_gradients_are_adjoint() {
    let mut random = Random(4);
    for case in CASES {
        let network = network::<f64>(case, &mut random);
        let inputs: Vec<f64> = random.normals(ROWS * network.input_size());
        let u: Vec<f64> = random.normals(ROWS * network.output_size());
        let v_parameters = random.normals(network.parameter_count());
        let v_inputs = random.normals(inputs.len());
        let mut workspace = Workspace::default();
        network.forward(&inputs, &mut workspace);
        let forwards = dot(&u, network.tangent(Some(&v_parameters), Some(&v_inputs), &mut workspace));
        // The workspace keeps the forward pass, so a backward pass may follow a tangent.
        let mut gradient = vec![0.0; v_parameters.len()];
        let mut input_gradient = vec![0.0; v_inputs.len()];
        network.backward(&u, &mut workspace, Some(&mut gradient), Some(&mut input_gradient));
        let backwards = dot(&gradient, &v_parameters) + dot(&input_gradient, &v_inputs);
        close("uᵀ J v", &[forwards], &[backwards], 1e-12);
    }
}

#[test]
fn parameter_gradients_accumulate_and_each_gradient_is_optional() {
    let mut random = Random(5);
    let network = network::<f64>(CASES[3], &mut random);
    let inputs: Vec<f64> = random.normals(ROWS * network.input_size());
    let u: Vec<f64> = random.normals(ROWS * network.output_size());
    let (once, input_gradient) = gradients(&network, &inputs, &u);
    let mut workspace = Workspace::default();
    network.forward(&inputs, &mut workspace);
    let mut twice = once.clone();
    network.backward(&u, &mut workspace, Some(&mut twice), None);
    close("twice", &twice, &once.iter().map(|g| 2.0 * g).collect::<Vec<_>>(), 1e-15);
    let mut alone = vec![f64::NAN; inputs.len()];
    network.backward(&u, &mut workspace, None, Some(&mut alone));
    assert_eq!(alone, input_gradient);
}

#[test]
fn empty_batches_are_allowed() {
    let network = network::<f64>(CASES[0], &mut Random(6));
    let mut workspace = Workspace::default();
    assert!(network.forward(&[], &mut workspace).is_empty());
    let mut gradient = vec![1.0; network.parameter_count()];
    network.backward(&[], &mut workspace, Some(&mut gradient), Some(&mut []));
    assert!(gradient.iter().all(|g| *g == 1.0));
    assert!(network.tangent(Some(&gradient), Some(&[]), &mut workspace).is_empty());
}

#[test]
#[should_panic(expected = "no forward pass of this network")]
fn a_workspace_of_another_network_panics() {
    let mut workspace = Workspace::default();
    network::<f64>(CASES[0], &mut Random(7)).forward(&[1.0; 3], &mut workspace);
    network::<f64>(CASES[5], &mut Random(7)).backward(&[1.0; 9], &mut workspace, None, None);
}

#[test]
fn nan_inputs_propagate_to_the_outputs_of_their_row_only() {
    let mut random = Random(8);
    for case in CASES {
        let network = network::<f32>(case, &mut random);
        let mut inputs: Vec<f32> = random.normals(2 * network.input_size());
        inputs[0] = f32::NAN;
        let mut workspace = Workspace::default();
        let (broken, whole) = network.forward(&inputs, &mut workspace).split_at(network.output_size());
        assert!(broken.iter().all(|y| y.is_nan()), "{case:?}");
        assert!(whole.iter().all(|y| y.is_finite()), "{case:?}");
    }
}
