//! Activations and their derivatives.

use std::fmt;
use std::str::FromStr;

use crate::NetworkError;
use crate::matmul::Lanes;
use crate::scalar::Scalar;

/// The activation function of a layer. Every activation maps 0 to 0, and its derivative is a function of its value.
///
/// | | y(x) | dy/dx |
/// |---|---|---|
/// | `Elu` | x for x > 0, else e^x − 1 | 1 for y > 0, else y + 1 |
/// | `Tanh` | tanh x | 1 − y² |
/// | `Relu` | x for x > 0, else 0 | 1 for y > 0, else 0 |
/// | `Identity` | x | 1 |
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
/// `Elu`: Clevert, Unterthiner and Hochreiter, "Fast and Accurate Deep Network Learning by Exponential Linear Units
/// (ELUs)", ICLR 2016.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Activation {
    /// Exponential linear unit, with α = 1.
    Elu,
    /// Hyperbolic tangent.
    Tanh,
    /// Rectified linear unit.
    Relu,
    /// No activation.
    Identity,
}

const NAMES: [(Activation, &str); 4] = [
    (Activation::Elu, "elu"),
    (Activation::Tanh, "tanh"),
    (Activation::Relu, "relu"),
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
    /// Every number is written, even if it does not change: conditional writes compile to masked stores, which are
    /// very slow on some processors. NaN stays NaN.
    #[inline(always)]
    pub(crate) fn apply<T: Scalar>(self, values: &mut [Lanes<T>]) {
        match self {
            Activation::Elu => map(values, |x| {
                let (above, below) = if x > T::ZERO { (x, T::ZERO) } else { (T::ZERO, x) };
                above + below.exp_m1_of_nonpositive()
            }),
            Activation::Tanh => map(values, T::tanh),
            Activation::Relu => map(values, |x| if x < T::ZERO { T::ZERO } else { x + T::ZERO }),
            Activation::Identity => {}
        }
    }

    /// Multiplies each of `factors` by dy/dx, given the activation's value in `outputs`.
    ///
    /// The piecewise activations add f · (dy/dx − 1) to f, so that every number is written here too.
    #[inline(always)]
    pub(crate) fn times_derivative<T: Scalar>(self, outputs: &[Lanes<T>], factors: &mut [Lanes<T>]) {
        let at_most_zero = |y: T| if y > T::ZERO { T::ZERO } else { y };
        let zero_or_minus_one = |y: T| if y > T::ZERO { T::ZERO } else { -T::ONE };
        match self {
            Activation::Elu => zip(outputs, factors, |y, f| f.mul_add(at_most_zero(y), f)),
            Activation::Tanh => zip(outputs, factors, |y, f| f * (-y).mul_add(y, T::ONE)),
            Activation::Relu => zip(outputs, factors, |y, f| f.mul_add(zero_or_minus_one(y), f)),
            Activation::Identity => {}
        }
    }
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
