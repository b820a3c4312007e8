//! Initialization of parameters from the caller's random numbers.

use crate::NetworkError;
use crate::mlp::Mlp;
use crate::scalar::Scalar;

impl<T: Scalar> Mlp<T> {
    /// Sets the weight of each layer to a random orthogonal matrix times the layer's gain, and the
    /// bias to zero.
    ///
    /// The columns of a weight (or its rows, if there are fewer rows) are orthogonal and have the
    /// length `gain`. The matrix is uniformly distributed if `normal` returns standard normal
    /// numbers. Each layer uses outputs · inputs numbers, in order. This is PyTorch's
    /// `orthogonal_`: the same numbers give the same matrix up to rounding.
    ///
    /// # Errors
    /// [`NetworkError::Length`] if the number of gains is not the number of layers.
    ///
    /// # Panics
    /// If the numbers from `normal` are linearly dependent, for example all zero.
    ///
    /// # Reference
    /// Saxe, McClelland and Ganguli, "Exact solutions to the nonlinear dynamics of learning in deep
    /// linear neural networks", ICLR 2014.
    pub fn initialize_orthogonal(
        &mut self,
        gains: &[f64],
        mut normal: impl FnMut() -> f64,
    ) -> Result<(), NetworkError> {
        if gains.len() != self.layer_count() {
            return Err(NetworkError::Length {
                what: "gains".to_string(),
                expected: self.layer_count(),
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

    /// Initializes weights and biases like PyTorch's `Linear`.
    ///
    /// ```text
    /// W, b ~ U(−1/√inputs, 1/√inputs)
    /// ```
    ///
    /// `uniform` must return uniform random numbers in [0, 1). Each layer uses them for its weight
    /// first, then for its bias.
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

/// Returns the row-major `rows` x `columns` matrix with its columns orthonormalized, or its rows if
/// there are fewer.
fn orthogonal(mut matrix: Vec<f64>, rows: usize, columns: usize) -> Vec<f64> {
    if rows < columns {
        orthonormalize(&mut matrix, columns);
        return matrix;
    }
    let mut transposed = transpose(&matrix, rows, columns);
    orthonormalize(&mut transposed, rows);
    transpose(&transposed, columns, rows)
}

/// Orthonormalizes the rows of `vectors`, of length `length`, by the modified Gram-Schmidt process.
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
        assert!(norm > 0.0, "the random numbers are linearly dependent");
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
