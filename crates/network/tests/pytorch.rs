//! Agreement with PyTorch: `tests/golden/pytorch/make.py` runs PyTorch and writes the golden file.

use mishandle_network::{Activation, Adam, Mlp, Scalar, Workspace, clip_norm};
use serde_json::Value;

fn cases() -> Value {
    serde_json::from_str(include_str!("golden/pytorch/cases.json")).expect("the golden file is JSON")
}

fn numbers<T: Scalar>(case: &Value, key: &str) -> Vec<T> {
    let array = case[key].as_array().unwrap_or_else(|| panic!("`{key}` is missing"));
    array.iter().map(|number| T::from_f64(number.as_f64().expect("a number"))).collect()
}

/// Checks that `found` is within `tolerance` of PyTorch's values, relative to max(1, |value|).
#[track_caller]
fn close<T: Scalar>(case: &Value, key: &str, found: &[T], tolerance: f64) {
    let expected = numbers::<f64>(case, key);
    assert_eq!(found.len(), expected.len(), "{key}");
    for (i, (found, expected)) in found.iter().zip(&expected).enumerate() {
        let error = (found.to_f64() - expected).abs() / expected.abs().max(1.0);
        assert!(error < tolerance, "{key}[{i}] of {}: {found:?}, PyTorch has {expected}", case["sizes"]);
    }
}

fn activation(case: &Value, key: &str) -> Activation {
    case[key].as_str().expect("a name").parse().expect("a known activation")
}

fn network<T: Scalar>(case: &Value) -> Mlp<T> {
    let sizes: Vec<usize> = numbers::<f64>(case, "sizes").iter().map(|size| *size as usize).collect();
    let hidden = activation(case, "hidden_activation");
    let output = activation(case, "output_activation");
    let mut network = Mlp::new(&sizes, hidden, output).expect("a network");
    network.update(|parameters| parameters.copy_from_slice(&numbers(case, "parameters")));
    network
}

fn check_passes<T: Scalar>(tolerance: f64) {
    for case in cases()["networks"].as_array().expect("cases") {
        let network = network::<T>(case);
        let inputs = numbers::<T>(case, "inputs");
        let mut workspace = Workspace::default();
        close(case, "outputs", network.forward(&inputs, &mut workspace), tolerance);

        let mut gradient = vec![T::ZERO; network.parameter_count()];
        let mut input_gradient = vec![T::ZERO; inputs.len()];
        let output_gradient = numbers::<T>(case, "output_gradient");
        network.backward(&output_gradient, &mut workspace, Some(&mut gradient), Some(&mut input_gradient));
        close(case, "parameter_gradient", &gradient, tolerance);
        close(case, "input_gradient", &input_gradient, tolerance);

        let parameters = numbers(case, "parameter_direction");
        let inputs = numbers(case, "input_direction");
        close(case, "tangent", network.tangent(Some(&parameters), Some(&inputs), &mut workspace), tolerance);
    }
}

#[test]
fn passes_agree_with_pytorch_in_f64() {
    check_passes::<f64>(1e-10);
}

#[test]
fn passes_agree_with_pytorch_in_f32() {
    check_passes::<f32>(1e-5);
}

fn check_adam<T: Scalar>(tolerance: f64) {
    let document = cases();
    let constant = |key: &str| document[key].as_f64().expect("a number");
    for case in document["networks"].as_array().expect("cases") {
        let mut network = network::<T>(case);
        let inputs = numbers::<T>(case, "inputs");
        let targets = numbers::<T>(case, "output_gradient");
        let mut adam = Adam::new(network.parameter_count(), constant("learning_rate"));
        let mut workspace = Workspace::default();
        let mut norms = Vec::new();
        for _ in 0..3 {
            let outputs = network.forward(&inputs, &mut workspace);
            let scale = T::from_f64(2.0 / targets.len() as f64);
            let error: Vec<T> = outputs.iter().zip(&targets).map(|(y, t)| (*y - *t) * scale).collect();
            let mut gradient = vec![T::ZERO; network.parameter_count()];
            network.backward(&error, &mut workspace, Some(&mut gradient), None);
            norms.push(clip_norm(&mut gradient, constant("max_norm")));
            network.update(|parameters| adam.step(parameters, &gradient));
        }
        close(case, "gradient_norms", &norms, tolerance);
        close(case, "parameters_after_adam", network.parameters(), tolerance);
    }
}

#[test]
fn clipping_and_adam_agree_with_pytorch_in_f64() {
    check_adam::<f64>(1e-9);
}

#[test]
fn clipping_and_adam_agree_with_pytorch_in_f32() {
    check_adam::<f32>(2e-5);
}

#[test]
fn orthogonal_initialization_agrees_with_pytorch() {
    for case in cases()["orthogonal"].as_array().expect("cases") {
        let size = |key: &str| case[key].as_u64().expect("a whole number") as usize;
        let sizes = [size("columns"), size("rows")];
        let mut network = Mlp::<f64>::new(&sizes, Activation::Elu, Activation::Identity).expect("a network");
        let mut normal = numbers::<f64>(case, "normal").into_iter();
        let gain = case["gain"].as_f64().expect("a number");
        network.initialize_orthogonal(&[gain], || normal.next().expect("enough numbers")).expect("one gain");
        assert!(normal.next().is_none(), "the initialization uses as many numbers as PyTorch's");
        close(case, "weight", network.tensors()[0].values, 1e-9);
        assert!(network.tensors()[1].values.iter().all(|bias| *bias == 0.0));
    }
}
