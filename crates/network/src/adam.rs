//! The optimizer Adam, and gradient clipping.

use crate::NetworkError;
use crate::scalar::Scalar;

/// The optimizer Adam, with PyTorch's defaults and order of operations.
///
/// ```text
/// m ← m + (1 − β₁)(g − m)          v ← β₂ v + (1 − β₂) g²
/// θ ← θ − α / (1 − β₁ᵗ) · m / (√v / √(1 − β₂ᵗ) + ε)
/// ```
///
/// α is the learning rate, β₁ = 0.9, β₂ = 0.999, ε = 1e-8; t counts steps from 1. There is no
/// weight decay.
///
/// # Example
/// ```
/// use mishandle_network::Adam;
/// let mut adam = Adam::<f64>::new(1, 0.1);
/// let mut parameters = [1.0];
/// adam.step(&mut parameters, &[5.0]); // the length of the first step is α for every gradient
/// assert!((parameters[0] - 0.9).abs() < 1e-9);
/// ```
///
/// # Reference
/// Kingma and Ba, "Adam: A Method for Stochastic Optimization", ICLR 2015.
#[derive(Debug, Clone, PartialEq)]
pub struct Adam<T> {
    /// The learning rate α, which may change between steps.
    pub learning_rate: f64,
    first_moments: Vec<T>,
    second_moments: Vec<T>,
    steps: u64,
}

const BETA_1: f64 = 0.9;
const BETA_2: f64 = 0.999;
const EPSILON: f64 = 1e-8;

impl<T: Scalar> Adam<T> {
    /// Creates an optimizer of `parameter_count` parameters.
    pub fn new(parameter_count: usize, learning_rate: f64) -> Adam<T> {
        let zeros = vec![T::ZERO; parameter_count];
        Adam { learning_rate, first_moments: zeros.clone(), second_moments: zeros, steps: 0 }
    }

    /// Restores an optimizer from m, v and the number of steps.
    ///
    /// # Errors
    /// If the vectors differ in length, contain NaN or infinity, or v contains a negative number.
    pub fn resume(
        learning_rate: f64,
        first_moments: Vec<T>,
        second_moments: Vec<T>,
        steps: u64,
    ) -> Result<Adam<T>, NetworkError> {
        if first_moments.len() != second_moments.len() {
            return Err(NetworkError::Length {
                what: "second moments".to_string(),
                expected: first_moments.len(),
                found: second_moments.len(),
            });
        }
        check_numbers("first moments", &first_moments, "finite", f64::is_finite)?;
        check_numbers("second moments", &second_moments, "finite and at least 0", |v| {
            v.is_finite() && v >= 0.0
        })?;
        Ok(Adam { learning_rate, first_moments, second_moments, steps })
    }

    /// Returns m, the running mean of gradients.
    pub fn first_moments(&self) -> &[T] {
        &self.first_moments
    }

    /// Returns v, the running mean of squared gradients.
    pub fn second_moments(&self) -> &[T] {
        &self.second_moments
    }

    /// Returns the number of steps taken.
    pub fn steps(&self) -> u64 {
        self.steps
    }

    /// Updates the parameters by one step of gradient descent.
    ///
    /// # Panics
    /// If the length of `parameters` or `gradient` is not the number of parameters.
    pub fn step(&mut self, parameters: &mut [T], gradient: &[T]) {
        let count = self.first_moments.len();
        assert!(parameters.len() == count, "expected {count} parameters, found {}", parameters.len());
        assert!(gradient.len() == count, "expected a gradient of {count} numbers, found {}", gradient.len());
        self.steps += 1;
        // For larger numbers of steps both powers are 0 in f64.
        let steps = i32::try_from(self.steps).unwrap_or(i32::MAX);
        let step_length = T::from_f64(self.learning_rate / (1.0 - BETA_1.powi(steps)));
        let root_of_correction = T::from_f64((1.0 - BETA_2.powi(steps)).sqrt());
        let first_weight = T::from_f64(1.0 - BETA_1);
        let second_decay = T::from_f64(BETA_2);
        let second_weight = T::from_f64(1.0 - BETA_2);
        let epsilon = T::from_f64(EPSILON);
        let moments = self.first_moments.iter_mut().zip(&mut self.second_moments);
        for ((parameter, g), (m, v)) in parameters.iter_mut().zip(gradient).zip(moments) {
            *m = first_weight.mul_add(*g - *m, *m);
            *v = (second_weight * *g).mul_add(*g, second_decay * *v);
            *parameter = *parameter - step_length * (*m / (v.sqrt() / root_of_correction + epsilon));
        }
    }
}

pub(crate) fn check_numbers<T: Scalar>(
    what: &str,
    numbers: &[T],
    expected: &'static str,
    is_valid: impl Fn(f64) -> bool,
) -> Result<(), NetworkError> {
    match numbers.iter().map(|number| number.to_f64()).enumerate().find(|(_, number)| !is_valid(*number)) {
        Some((index, found)) => Err(NetworkError::Number { what: what.to_string(), expected, index, found }),
        None => Ok(()),
    }
}

/// Clips the norm of `gradient` to `max_norm`, and returns the norm before clipping.
///
/// ```text
/// g ← g · min(1, max_norm / (‖g‖ + 1e-6))
/// ```
///
/// The norm is Euclidean and computed in f64. A gradient with NaN is unchanged, and its norm is
/// NaN. This is PyTorch's `clip_grad_norm_`.
///
/// # Example
/// ```
/// let mut gradient = [3.0_f64, 4.0];
/// assert_eq!(mishandle_network::clip_norm(&mut gradient, 1.0), 5.0);
/// assert!((gradient[0] - 0.6).abs() < 1e-6 && (gradient[1] - 0.8).abs() < 1e-6);
/// ```
///
/// # Reference
/// Pascanu, Mikolov and Bengio, "On the difficulty of training recurrent neural networks",
/// ICML 2013.
pub fn clip_norm<T: Scalar>(gradient: &mut [T], max_norm: f64) -> f64 {
    /// The number of parallel partial sums.
    const LANES: usize = 16;
    let mut sums = [0.0; LANES];
    for block in gradient.chunks(LANES) {
        for (sum, number) in sums.iter_mut().zip(block) {
            let number = number.to_f64();
            *sum += number * number;
        }
    }
    let norm = sums.iter().sum::<f64>().sqrt();
    let factor = max_norm / (norm + 1e-6);
    if factor < 1.0 {
        let factor = T::from_f64(factor);
        for number in gradient {
            *number = *number * factor;
        }
    }
    norm
}
