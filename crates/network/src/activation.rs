//! Activations and their derivatives.

use std::fmt;
use std::str::FromStr;

use crate::NetworkError;
use crate::matmul::Lanes;
use crate::scalar::Scalar;

/// The activation function of a layer. Every activation maps 0 to 0.
///
/// The derivative of most activations is a function of their value, which a forward pass keeps.
/// `Silu` and `Gelu` are not monotonic, so theirs is not: networks with them run, but are not
/// trained.
///
/// | | y(x) | dy/dx |
/// |---|---|---|
/// | `Elu` | x for x > 0, else e^x − 1 | 1 for y > 0, else y + 1 |
/// | `Tanh` | tanh x | 1 − y² |
/// | `Relu` | x for x > 0, else 0 | 1 for y > 0, else 0 |
/// | `LeakyRelu` | x for x > 0, else 0.01 x | 1 for y > 0, else 0.01 |
/// | `Silu` | x / (1 + e^−x) | |
/// | `Gelu` | x Φ(x) = x (1 + erf(x / √2)) / 2 | |
/// | `Identity` | x | 1 |
///
/// The slope of `LeakyRelu` and the exact form of `Gelu` are the defaults of PyTorch. The error of
/// `Gelu` is below 3e-7 · max(1, |x|).
///
/// # Example
/// ```
/// use mishandle_network::Activation;
/// assert_eq!("elu".parse(), Ok(Activation::Elu));
/// assert_eq!(Activation::Tanh.to_string(), "tanh");
/// assert!("swish".parse::<Activation>().is_err());
/// ```
///
/// # Reference
/// `Elu`: Clevert, Unterthiner and Hochreiter, "Fast and Accurate Deep Network Learning by
/// Exponential Linear Units (ELUs)", ICLR 2016. `Silu` and `Gelu`: Hendrycks and Gimpel, "Gaussian
/// Error Linear Units (GELUs)", 2016. erf: Abramowitz and Stegun, "Handbook of Mathematical
/// Functions", 1964, formula 7.1.26.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Activation {
    /// Exponential linear unit, with α = 1.
    Elu,
    /// Hyperbolic tangent.
    Tanh,
    /// Rectified linear unit.
    Relu,
    /// Leaky rectified linear unit, with the slope 0.01 for negative numbers.
    LeakyRelu,
    /// Sigmoid linear unit, also called swish.
    Silu,
    /// Gaussian error linear unit, with the error function rather than its approximation by tanh.
    Gelu,
    /// No activation.
    Identity,
}

/// The slope of [`Activation::LeakyRelu`] for negative numbers.
pub const LEAKY_SLOPE: f32 = 0.01;

const NAMES: [(Activation, &str); 7] = [
    (Activation::Elu, "elu"),
    (Activation::Tanh, "tanh"),
    (Activation::Relu, "relu"),
    (Activation::LeakyRelu, "leaky_relu"),
    (Activation::Silu, "silu"),
    (Activation::Gelu, "gelu"),
    (Activation::Identity, "identity"),
];

impl fmt::Display for Activation {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let name = NAMES.iter().find(|(activation, _)| activation == self).map_or("", |(_, name)| name);
        formatter.write_str(name)
    }
}

impl FromStr for Activation {
    type Err = NetworkError;

    fn from_str(name: &str) -> Result<Activation, NetworkError> {
        NAMES
            .iter()
            .find(|(_, known)| *known == name)
            .map(|(activation, _)| *activation)
            .ok_or_else(|| NetworkError::UnknownActivation { found: name.to_string() })
    }
}

impl Activation {
    /// Replaces each x by y(x).
    ///
    /// Every number is written, even if it does not change: conditional writes compile to masked
    /// stores, which are very slow on some processors. NaN stays NaN.
    #[inline(always)]
    pub(crate) fn apply<T: Scalar>(self, values: &mut [Lanes<T>]) {
        match self {
            Activation::Elu => map(values, |x| {
                let (above, below) = if x > T::ZERO { (x, T::ZERO) } else { (T::ZERO, x) };
                above + below.exp_m1_of_nonpositive()
            }),
            Activation::Tanh => map(values, T::tanh),
            Activation::Relu => map(values, |x| if x < T::ZERO { T::ZERO } else { x + T::ZERO }),
            Activation::LeakyRelu => {
                let slope = T::from_f64(f64::from(LEAKY_SLOPE));
                map(values, |x| if x < T::ZERO { slope * x } else { x + T::ZERO });
            }
            Activation::Silu => map(values, silu),
            Activation::Gelu => map(values, gelu),
            Activation::Identity => {}
        }
    }

    /// Returns whether networks with this activation can be trained.
    pub fn is_trainable(self) -> bool {
        !matches!(self, Activation::Silu | Activation::Gelu)
    }

    /// Multiplies each of `factors` by dy/dx, given the activation's value in `outputs`.
    ///
    /// The piecewise activations add f · (dy/dx − 1) to f, so that every number is written here
    /// too.
    #[inline(always)]
    pub(crate) fn times_derivative<T: Scalar>(self, outputs: &[Lanes<T>], factors: &mut [Lanes<T>]) {
        let at_most_zero = |y: T| if y > T::ZERO { T::ZERO } else { y };
        let zero_or_minus_one = |y: T| if y > T::ZERO { T::ZERO } else { -T::ONE };
        match self {
            Activation::Elu => zip(outputs, factors, |y, f| f.mul_add(at_most_zero(y), f)),
            Activation::Tanh => zip(outputs, factors, |y, f| f * (-y).mul_add(y, T::ONE)),
            Activation::Relu => zip(outputs, factors, |y, f| f.mul_add(zero_or_minus_one(y), f)),
            Activation::LeakyRelu => {
                let below = T::from_f64(f64::from(LEAKY_SLOPE) - 1.0);
                zip(outputs, factors, |y, f| f.mul_add(if y > T::ZERO { T::ZERO } else { below }, f));
            }
            // Not trainable, which the passes check.
            Activation::Silu | Activation::Gelu | Activation::Identity => {}
        }
    }
}

/// Returns x / (1 + e^−x), without overflow for negative x.
#[inline(always)]
fn silu<T: Scalar>(x: T) -> T {
    let e = (if x < T::ZERO { x } else { -x }).exp_of_nonpositive();
    (if x < T::ZERO { x * e } else { x }) / (T::ONE + e)
}

/// Returns x Φ(x). With z = |x| / √2, erfc z = (a₁ t + … + a₅ t⁵) e^(−z²), t = 1 / (1 + p z), and
/// Φ(−|x|) = erfc(z) / 2.
#[inline(always)]
fn gelu<T: Scalar>(x: T) -> T {
    const P: f64 = 0.327_591_1;
    const A: [f64; 5] = [0.254_829_592, -0.284_496_736, 1.421_413_741, -1.453_152_027, 1.061_405_429];
    let number = T::from_f64;
    let z = (if x < T::ZERO { -x } else { x }) * number(std::f64::consts::FRAC_1_SQRT_2);
    let t = T::ONE / number(P).mul_add(z, T::ONE);
    let polynomial = A.iter().rev().fold(T::ZERO, |sum, a| sum.mul_add(t, number(*a))) * t;
    let below = number(0.5) * polynomial * (-(z * z)).exp_of_nonpositive();
    x * if x < T::ZERO { below } else { T::ONE - below }
}

#[inline(always)]
fn map<T: Scalar>(values: &mut [Lanes<T>], f: impl Fn(T) -> T) {
    for lanes in values {
        for x in &mut lanes.0 {
            *x = f(*x);
        }
    }
}

#[inline(always)]
fn zip<T: Scalar>(outputs: &[Lanes<T>], factors: &mut [Lanes<T>], f: impl Fn(T, T) -> T) {
    for (y, factor) in outputs.iter().zip(factors) {
        for (y, factor) in y.0.iter().zip(&mut factor.0) {
            *factor = f(*y, *factor);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Mlp, Workspace};

    fn value(activation: Activation, x: f32) -> f32 {
        let mut network = Mlp::<f32>::new(&[1, 1], Activation::Elu, activation).unwrap();
        network.update(|parameters| parameters.copy_from_slice(&[1.0, 0.0]));
        network.forward(&[x], &mut Workspace::default())[0]
    }

    #[test]
    fn activations_have_the_values_of_their_definitions() {
        // Python 3.11: x / (1 + math.exp(-x)) and 0.5 * x * (1 + math.erf(x / math.sqrt(2))).
        for (x, silu, gelu) in [
            (-20.0_f32, -4.122_307e-8_f32, 0.0_f32),
            (-5.0, -0.033464255, -1.4332579e-6),
            (-1.0, -0.26894143, -0.15865526),
            (-0.3, -0.1276673, -0.11462657),
            (0.0, 0.0, 0.0),
            (0.5, 0.31122968, 0.34573123),
            (2.0, 1.7615942, 1.9544997),
            (30.0, 30.0, 30.0),
        ] {
            let bound = 3e-7 * f32::max(1.0, x.abs());
            assert!((value(Activation::Silu, x) - silu).abs() < bound, "silu({x})");
            assert!((value(Activation::Gelu, x) - gelu).abs() < bound, "gelu({x})");
        }
        assert_eq!(value(Activation::LeakyRelu, -3.0), -0.03);
        assert_eq!(value(Activation::LeakyRelu, 3.0), 3.0);
        for activation in [Activation::Silu, Activation::Gelu, Activation::LeakyRelu] {
            assert!(value(activation, f32::NAN).is_nan());
            assert_eq!(activation.to_string().parse(), Ok(activation));
        }
    }

    #[test]
    #[should_panic = "networks with silu or gelu are not trained"]
    fn the_gradient_of_an_activation_that_is_not_trainable_is_refused() {
        let network = Mlp::<f32>::new(&[1, 2, 1], Activation::Silu, Activation::Identity).unwrap();
        let mut workspace = Workspace::default();
        network.forward(&[1.0], &mut workspace);
        network.backward(&[1.0], &mut workspace, None, Some(&mut [0.0]));
    }
}
