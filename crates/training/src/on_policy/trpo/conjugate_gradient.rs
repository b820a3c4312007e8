//! Conjugate gradient method.

/// Solves A x = b for a symmetric positive definite matrix A, starting at x = 0.
///
/// `product` writes A v for a given v. Stops after `iterations` or when the squared residual norm
/// is below `tolerance`.
///
/// # Example
/// ```
/// use mishandle_training::conjugate_gradient;
/// // A = [[4, 1], [1, 3]], b = [1, 2]: x = [1/11, 7/11] after two iterations, the number of unknowns.
/// let product = |v: &[f64], out: &mut [f64]| {
///     out.copy_from_slice(&[4.0 * v[0] + v[1], v[0] + 3.0 * v[1]]);
/// };
/// let x = conjugate_gradient(product, &[1.0, 2.0], 2, 1e-20);
/// assert!((x[0] - 1.0 / 11.0).abs() < 1e-15 && (x[1] - 7.0 / 11.0).abs() < 1e-15);
/// ```
///
/// # Reference
/// Hestenes and Stiefel, "Methods of Conjugate Gradients for Solving Linear Systems", 1952.
pub fn conjugate_gradient(
    mut product: impl FnMut(&[f64], &mut [f64]),
    b: &[f64],
    iterations: usize,
    tolerance: f64,
) -> Vec<f64> {
    let mut x = vec![0.0; b.len()];
    let mut residual = b.to_vec();
    let mut direction = b.to_vec();
    let mut along = vec![0.0; b.len()];
    let mut squared = dot(&residual, &residual);
    for _ in 0..iterations {
        if squared < tolerance {
            break;
        }
        product(&direction, &mut along);
        let step = squared / dot(&direction, &along);
        for i in 0..b.len() {
            x[i] += step * direction[i];
            residual[i] -= step * along[i];
        }
        let new_squared = dot(&residual, &residual);
        let ratio = new_squared / squared;
        for (direction, residual) in direction.iter_mut().zip(&residual) {
            *direction = residual + ratio * *direction;
        }
        squared = new_squared;
    }
    x
}

/// Returns the dot product.
pub(crate) fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn converges_after_as_many_iterations_as_unknowns() {
        // The Hilbert-like matrix A_ij = 1 / (1 + i + j) + [i = j]: symmetric, positive definite.
        let entry = |i: usize, j: usize| 1.0 / (1 + i + j) as f64 + f64::from(u8::from(i == j));
        let product = |v: &[f64], out: &mut [f64]| {
            for (i, out) in out.iter_mut().enumerate() {
                *out = (0..v.len()).map(|j| entry(i, j) * v[j]).sum();
            }
        };
        let b: Vec<f64> = (0..8).map(|i| f64::from(i).sin()).collect();
        let x = conjugate_gradient(product, &b, 8, 0.0);
        let mut found = vec![0.0; 8];
        product(&x, &mut found);
        assert!(b.iter().zip(&found).all(|(b, found)| (b - found).abs() < 1e-12), "{found:?}");
    }

    #[test]
    fn a_zero_right_hand_side_needs_no_product() {
        let x = conjugate_gradient(|_, _| panic!("no product is needed"), &[0.0; 3], 10, 1e-10);
        assert_eq!(x, [0.0; 3]);
    }
}
