//! The weights that networks begin with.

use mishandle_network::Mlp;
use mishandle_rollout::{Seed, Stream};
use serde::{Deserialize, Serialize};

use crate::TrainingError;
use crate::settings::positive;

/// How the parameters of a network are drawn.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Initialization {
    /// `"orthogonal"`: orthogonal weights, of a small last layer; no biases.
    #[default]
    Orthogonal,
    /// `"uniform"`: weights and biases within ± 1/√inputs of their layer, as PyTorch's `Linear` has them.
    Uniform,
    /// `{ normal = σ }`: all parameters from N(0, σ²), biases too.
    Normal(f64),
}

impl Initialization {
    pub(crate) fn check(self, name: &'static str) -> Result<(), TrainingError> {
        match self {
            Initialization::Normal(std) => positive(name, std),
            Initialization::Orthogonal | Initialization::Uniform => Ok(()),
        }
    }

    /// Gives a network its parameters; orthogonal ones have gain `last_gain` in the last layer.
    ///
    /// # Errors
    /// Never: there is a gain for each layer.
    pub(crate) fn initialize(
        self,
        network: &mut Mlp<f32>,
        last_gain: f64,
        seed: Seed,
    ) -> Result<(), TrainingError> {
        match self {
            Initialization::Orthogonal => crate::critic::initialize(network, last_gain, seed)?,
            Initialization::Uniform => {
                let mut steps = 0..;
                network.initialize_uniform(|| seed.uniform(Stream::Weights, steps.next().unwrap_or(0), 0));
            }
            Initialization::Normal(_) => network.update(|parameters| self.initialize_alone(parameters, seed)),
        }
        Ok(())
    }

    /// Gives values to parameters that are no weights: normal numbers if all are to be, 0 else.
    pub(crate) fn initialize_alone(self, parameters: &mut [f32], seed: Seed) {
        let std = if let Initialization::Normal(std) = self { std } else { 0.0 };
        let mut draws = vec![0.0; parameters.len()];
        seed.normals(Stream::Weights, 0, &mut draws);
        parameters.iter_mut().zip(draws).for_each(|(parameter, z)| *parameter = (std * z) as f32);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mishandle_network::Activation;

    fn parameters(weights: Initialization) -> Vec<f32> {
        let mut network = Mlp::new(&[25, 400, 3], Activation::Elu, Activation::Identity).unwrap();
        weights.initialize(&mut network, 0.01, Seed(4)).unwrap();
        network.parameters().to_vec()
    }

    #[test]
    fn normal_parameters_have_the_deviation_that_was_asked_for() {
        let parameters = parameters(Initialization::Normal(0.5));
        let n = parameters.len() as f64;
        let mean = parameters.iter().map(|x| f64::from(*x)).sum::<f64>() / n;
        let variance = parameters.iter().map(|x| f64::from(*x).powi(2)).sum::<f64>() / n;
        // Five standard errors.
        assert!(mean.abs() < 5.0 * 0.5 / n.sqrt(), "{mean}");
        assert!((variance / 0.25 - 1.0).abs() < 5.0 * (2.0 / n).sqrt(), "{variance}");
    }

    #[test]
    fn uniform_parameters_fill_their_bounds_layer_by_layer() {
        let parameters = parameters(Initialization::Uniform);
        let (first, last) = parameters.split_at(25 * 400 + 400);
        for (layer, bound) in [(first, 1.0 / 5.0), (last, 1.0 / 20.0)] {
            let most = layer.iter().fold(0.0_f32, |most, x| most.max(x.abs()));
            assert!(most <= bound && most > 0.99 * bound, "{most} of {bound}");
        }
    }

    #[test]
    fn what_is_no_weight_is_zero_unless_all_is_normal() {
        for (weights, zero) in [
            (Initialization::Orthogonal, true),
            (Initialization::Uniform, true),
            (Initialization::Normal(0.1), false),
        ] {
            let mut alone = [1.0; 4];
            weights.initialize_alone(&mut alone, Seed(1));
            assert_eq!(alone.iter().all(|x| *x == 0.0), zero, "{weights:?}");
        }
    }
}
