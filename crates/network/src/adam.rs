//! The optimiser Adam, and the norm of a gradient.

use crate::NetworkError;
use crate::scalar::Scalar;

/// Adam, with PyTorch's defaults and order of operations.
///
/// ```text
/// m ← m + (1 − β₁)(g − m)          v ← β₂ v + (1 − β₂) g²
/// θ ← θ − α / (1 − β₁ᵗ) · m / (√v / √(1 − β₂ᵗ) + ε)
/// ```
///
/// β₁ = 0.9, β₂ = 0.999, ε = 1e-8; t counts steps from 1. There is no weight decay.
///
/// # Example
/// ```
/// use mishandle_network::Adam;
/// let mut adam = Adam::<f64>::new(1, 0.1);
/// let mut parameters = [1.0];
/// adam.step(&mut parameters, &[5.0]); // the first step has the length α, whatever the gradient's
/// assert!((parameters[0] - 0.9).abs() < 1e-9);
/// ```
///
/// # Reference
/// Kingma and Ba, "Adam: A Method for Stochastic Optimization", ICLR 2015.
#[derive(Debug, Clone, PartialEq)]
pub struct Adam<T> {
    /// α, which may be changed between steps.
    pub learning_rate: f64,
    first_moments: Vec<T>,
    second_moments: Vec<T>,
    steps: u64,
}

const BETA_1: f64 = 0.9;
const BETA_2: f64 = 0.999;
const EPSILON: f64 = 1e-8;

impl<T: Scalar> Adam<T> {
    /// An optimiser of `parameter_count` numbers that has taken no step.
    pub fn new(parameter_count: usize, learning_rate: f64) -> Adam<T> {
        let zeros = vec![T::ZERO; parameter_count];
        Adam { learning_rate, first_moments: zeros.clone(), second_moments: zeros, steps: 0 }
    }

    /// An optimiser that goes on where another was: m, v and the number of steps taken.
    ///
    /// # Errors
    /// If the two vectors differ in length, or hold NaN or infinity, or v holds a negative number.
    pub fn resume(
        learning_rate: f64,
        first_moments: Vec<T>,
        second_moments: Vec<T>,
        steps: u64,
    ) -> Result<Adam<T>, NetworkError> {
        if first_moments.len() != second_moments.len() {
            return Err(NetworkError::Length {
                what: "second moments".to_string(),
                wanted: first_moments.len(),
                found: second_moments.len(),
            });
        }
        check_numbers("first moments", &first_moments, "finite", f64::is_finite)?;
        check_numbers("second moments", &second_moments, "finite and at least 0", |v| {
            v.is_finite() && v >= 0.0
        })?;
        Ok(Adam { learning_rate, first_moments, second_moments, steps })
    }

    /// m, a running mean of gradients.
    pub fn first_moments(&self) -> &[T] {
        &self.first_moments
    }

    /// v, a running mean of squared gradients.
    pub fn second_moments(&self) -> &[T] {
        &self.second_moments
    }

    /// How many steps were taken.
    pub fn steps(&self) -> u64 {
        self.steps
    }

    /// One step against `gradient`.
    ///
    /// # Panics
    /// If a length is not the number of parameters.
    pub fn step(&mut self, parameters: &mut [T], gradient: &[T]) {
        let count = self.first_moments.len();
        assert!(parameters.len() == count, "parameters: {} numbers, {count} wanted", parameters.len());
        assert!(gradient.len() == count, "gradient: {} numbers, {count} wanted", gradient.len());
        self.steps += 1;
        // Beyond this count both powers are 0 in f64.
        let steps = i32::try_from(self.steps).unwrap_or(i32::MAX);
        let step_length = T::from_f64(self.learning_rate / (1.0 - BETA_1.powi(steps)));
        let root_of_correction = T::from_f64((1.0 - BETA_2.powi(steps)).sqrt());
        let (first_share, second_kept) = (T::from_f64(1.0 - BETA_1), T::from_f64(BETA_2));
        let (second_share, epsilon) = (T::from_f64(1.0 - BETA_2), T::from_f64(EPSILON));
        let moments = self.first_moments.iter_mut().zip(&mut self.second_moments);
        for ((parameter, g), (m, v)) in parameters.iter_mut().zip(gradient).zip(moments) {
            *m = first_share.mul_add(*g - *m, *m);
            *v = (second_share * *g).mul_add(*g, second_kept * *v);
            *parameter = *parameter - step_length * (*m / (v.sqrt() / root_of_correction + epsilon));
        }
    }
}

pub(crate) fn check_numbers<T: Scalar>(
    what: &str,
    numbers: &[T],
    wanted: &'static str,
    right: impl Fn(f64) -> bool,
) -> Result<(), NetworkError> {
    match numbers.iter().map(|number| number.to_f64()).enumerate().find(|(_, number)| !right(*number)) {
        Some((index, found)) => Err(NetworkError::Number { what: what.to_string(), wanted, index, found }),
        None => Ok(()),
    }
}

/// Shortens `gradient` to `max_norm` where it is longer, and gives the norm that it had.
///
/// ```text
/// g ← g · min(1, max_norm / (‖g‖ + 1e-6))
/// ```
///
/// The norm is Euclidean and is summed in f64. A gradient that holds NaN stays as it is, and so does its norm show it.
///
/// # Example
/// ```
/// let mut gradient = [3.0_f64, 4.0];
/// assert_eq!(mishandle_network::clip_norm(&mut gradient, 1.0), 5.0);
/// assert!((gradient[0] - 0.6).abs() < 1e-6 && (gradient[1] - 0.8).abs() < 1e-6);
/// ```
pub fn clip_norm<T: Scalar>(gradient: &mut [T], max_norm: f64) -> f64 {
    /// Sums under way at once.
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
