//! Initialization of networks.

use mishandle_network::{Activation, Mlp};
use mishandle_rollout::{Seed, Stream};
use serde::{Deserialize, Serialize};
use toml::Spanned;
use toml::de::DeValue;

use crate::TrainingError;
use crate::settings::setting::{INITIALIZATION, SettingKind, reads_as};

/// Initialization of a network.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Initialization {
    /// Orthogonal weights and zero biases. The gain is √2 in hidden layers. A policy has a small
    /// gain in the last layer, so that the initial actions are near 0 for all observations.
    Orthogonal,
    /// Weights and biases uniform in ±1/√inputs, the PyTorch default.
    Uniform,
    /// Weights and biases from N(0, σ²); `{ normal = σ }` in TOML.
    Normal(f64),
}

impl Initialization {
    /// Initializes `network`; `last_gain` is the gain of the last layer for orthogonal weights.
    ///
    /// # Errors
    /// Never; the number of gains is that of the layers.
    pub(crate) fn initialize(
        self,
        network: &mut Mlp<f32>,
        last_gain: f64,
        seed: Seed,
    ) -> Result<(), TrainingError> {
        let mut step = 0;
        let mut next = || {
            step += 1;
            step - 1
        };
        match self {
            Initialization::Orthogonal => {
                let mut gains = vec![std::f64::consts::SQRT_2; network.sizes().len() - 2];
                gains.push(last_gain);
                network.initialize_orthogonal(&gains, || {
                    let mut draw = [0.0];
                    seed.normals(Stream::Weights, next(), &mut draw);
                    draw[0]
                })?;
            }
            Initialization::Uniform => {
                network.initialize_uniform(|| seed.uniform(Stream::Weights, next(), 0));
            }
            Initialization::Normal(_) => {
                network.update(|parameters| self.initialize_vector(parameters, seed));
            }
        }
        Ok(())
    }

    /// Initializes parameters outside of networks: 0, or N(0, σ²) for [`Initialization::Normal`].
    pub(crate) fn initialize_vector(self, parameters: &mut [f32], seed: Seed) {
        let std = if let Initialization::Normal(std) = self { std } else { 0.0 };
        let mut draws = vec![0.0; parameters.len()];
        seed.normals(Stream::Weights, 0, &mut draws);
        parameters.iter_mut().zip(draws).for_each(|(parameter, z)| *parameter = (std * z) as f32);
    }
}

impl SettingKind for Initialization {
    fn allowed() -> String {
        INITIALIZATION.allowed.to_string()
    }

    fn reads(value: Spanned<DeValue<'_>>) -> bool {
        reads_as::<Initialization>(value)
    }

    fn numbers(&self) -> Option<Vec<f64>> {
        match self {
            Initialization::Normal(std) => Some(vec![*std]),
            Initialization::Orthogonal | Initialization::Uniform => None,
        }
    }
}

/// Creates an initialized network with hidden layers of the sizes `hidden`.
///
/// # Errors
/// If a layer has size 0.
pub(crate) fn initial_network(
    inputs: usize,
    hidden: &[usize],
    outputs: usize,
    activation: Activation,
    initialization: Initialization,
    last_gain: f64,
    seed: Seed,
) -> Result<Mlp<f32>, TrainingError> {
    let sizes = [&[inputs], hidden, &[outputs]].concat();
    let mut network = Mlp::new(&sizes, activation, Activation::Identity)?;
    initialization.initialize(&mut network, last_gain, seed)?;
    Ok(network)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn uniform_parameters_fill_their_range() {
        let network =
            initial_network(4, &[100], 1, Activation::Elu, Initialization::Uniform, 0.01, Seed(2)).unwrap();
        let (first, last) = network.parameters().split_at(4 * 100 + 100);
        // ±1/√4 and ±1/√100; a uniform distribution on ±b has variance b²/3.
        for (numbers, bound) in [(first, 0.5_f64), (last, 0.1)] {
            let squares: f64 = numbers.iter().map(|x| f64::from(*x).powi(2)).sum();
            let variance = squares / numbers.len() as f64;
            assert!(numbers.iter().all(|x| f64::from(x.abs()) <= bound));
            assert!((variance / (bound * bound / 3.0) - 1.0).abs() < 0.25, "{variance}");
        }
    }

    #[test]
    fn normal_parameters_have_the_given_standard_deviation() {
        let network =
            initial_network(25, &[400], 3, Activation::Elu, Initialization::Normal(0.5), 0.01, Seed(4))
                .unwrap();
        let n = network.parameter_count() as f64;
        let parameters = network.parameters().iter().map(|x| f64::from(*x));
        let mean = parameters.clone().sum::<f64>() / n;
        let variance = parameters.map(|x| x * x).sum::<f64>() / n;
        // Five standard errors.
        assert!(mean.abs() < 5.0 * 0.5 / n.sqrt(), "{mean}");
        assert!((variance / 0.25 - 1.0).abs() < 5.0 * (2.0 / n).sqrt(), "{variance}");
    }

    #[test]
    fn vectors_are_zero_except_with_normal_initialization() {
        for (initialization, zero) in [
            (Initialization::Orthogonal, true),
            (Initialization::Uniform, true),
            (Initialization::Normal(0.1), false),
        ] {
            let mut vector = [1.0; 4];
            initialization.initialize_vector(&mut vector, Seed(1));
            assert_eq!(vector.iter().all(|x| *x == 0.0), zero, "{initialization:?}");
        }
    }
}
