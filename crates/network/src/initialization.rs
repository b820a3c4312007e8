//! Initial parameters, from random numbers that the caller draws.

use crate::NetworkError;
use crate::mlp::Mlp;
use crate::scalar::Scalar;

impl<T: Scalar> Mlp<T> {
    /// Gives each layer an orthogonal weight times its gain, and zero bias.
    ///
    /// The columns of a weight (its rows, where there are fewer of them) are orthogonal and `gain` long: a uniformly random one of
    /// such matrices if `normal` draws standard normal numbers. Each layer takes outputs · inputs of them, in order. It is
    /// PyTorch's `orthogonal_`: the same numbers give the same matrix up to rounding.
    ///
    /// # Errors
    /// [`NetworkError::Length`] if there is not one gain for each layer.
    ///
    /// # Panics
    /// If `normal` keeps giving numbers of which no basis can be made, such as zeros alone.
    ///
    /// # Reference
    /// Saxe, McClelland and Ganguli, "Exact solutions to the nonlinear dynamics of learning in deep linear neural networks",
    /// ICLR 2014.
    pub fn initialize_orthogonal(
        &mut self,
        gains: &[f64],
        mut normal: impl FnMut() -> f64,
    ) -> Result<(), NetworkError> {
        if gains.len() != self.layer_count() {
            return Err(NetworkError::Length {
                what: "gains".to_string(),
                wanted: self.layer_count(),
                found: gains.len(),
            });
        }
        let shapes = self.shapes.clone();
        self.update(|parameters| {
            for (shape, gain) in shapes.iter().zip(gains) {
                let (weight, bias) = shape.split_mut(parameters);
                let matrix: Vec<f64> = weight.iter().map(|_| normal()).collect();
                for (to, from) in weight.iter_mut().zip(orthogonal(matrix, shape.outputs, shape.inputs)) {
                    *to = T::from_f64(gain * from);
                }
                bias.fill(T::ZERO);
            }
        });
        Ok(())
    }

    /// Gives each layer the weights and biases that PyTorch's `Linear` has by default.
    ///
    /// ```text
    /// W, b ~ U(−1/√inputs, 1/√inputs)
    /// ```
    ///
    /// `uniform` draws from [0, 1); each layer takes its weight's numbers and then its bias's.
    pub fn initialize_uniform(&mut self, mut uniform: impl FnMut() -> f64) {
        let shapes = self.shapes.clone();
        self.update(|parameters| {
            for shape in &shapes {
                let bound = 1.0 / (shape.inputs as f64).sqrt();
                let (weight, bias) = shape.split_mut(parameters);
                for parameter in weight.iter_mut().chain(bias) {
                    *parameter = T::from_f64((2.0 * uniform() - 1.0) * bound);
                }
            }
        });
    }
}

/// The orthogonal factor of `matrix`, which is plain and of `rows` x `columns`: its columns made orthogonal, or its rows where
/// there are fewer of them.
fn orthogonal(mut matrix: Vec<f64>, rows: usize, columns: usize) -> Vec<f64> {
    if rows < columns {
        orthonormalize(&mut matrix, columns);
        return matrix;
    }
    let mut transposed = transpose(&matrix, rows, columns);
    orthonormalize(&mut transposed, rows);
    transpose(&transposed, columns, rows)
}

/// Modified Gram-Schmidt on the rows of `vectors`, which are `length` long.
fn orthonormalize(vectors: &mut [f64], length: usize) {
    for i in 0..vectors.len() / length {
        let (done, rest) = vectors.split_at_mut(i * length);
        let vector = &mut rest[..length];
        for earlier in done.chunks_exact(length) {
            let along = dot(earlier, vector);
            for (x, e) in vector.iter_mut().zip(earlier) {
                *x -= along * e;
            }
        }
        let norm = dot(vector, vector).sqrt();
        assert!(norm > 0.0, "the random numbers given make no basis");
        for x in vector {
            *x /= norm;
        }
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

fn transpose(matrix: &[f64], rows: usize, columns: usize) -> Vec<f64> {
    (0..columns).flat_map(|c| (0..rows).map(move |r| matrix[r * columns + c])).collect()
}
