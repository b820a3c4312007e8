//! The part of a space that cannot fail if the robustness is as smooth there as at its samples.

use mishandle_random::Sequence;

/// Fewest samples from which a slope is estimated.
const FEWEST: usize = 50;

/// Most samples that are used: the spanning tree takes the square of their number.
const MOST: usize = 5000;

/// Number of random points that measure the covered volume.
const POINTS: usize = 4000;

/// Confidence of de Haan's interval. It is asymptotic: with 0.95 it covered 89 % of two-dimensional
/// waves in 300 samples, and with 0.98 at least 95 % of all functions that were tried.
const CONFIDENCE: f64 = 0.98;

/// Smallest exponent with which the largest difference of two values must grow with their distance.
/// It is 1 for a smooth function and 0 for a cliff.
const SMOOTH: f64 = 0.5;

/// Conclusion from the samples of a smooth robustness.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SmoothRegion {
    /// Estimated upper bound (95 %) of the slope: change of the robustness per width of the space.
    pub slope: f64,
    /// Largest slope between two adjacent samples.
    pub largest_slope: f64,
    /// Share of the space in which the robustness is positive if its slope is at most `slope`.
    pub covered: f64,
}

/// Why nothing follows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum NotSmooth {
    /// There are too few samples.
    #[error("there are fewer than 50 samples")]
    FewSamples,
    /// Many adjacent samples have the same robustness.
    #[error("the robustness is constant in parts of the space, so it does not say how close a failure is")]
    Plateaus,
    /// The robustness of adjacent samples differs as much as that of distant ones.
    #[error("the robustness has cliffs: adjacent samples differ about as much as distant ones")]
    Cliffs,
    /// The robustness of a scenario depends on the seed.
    #[error("the robustness of a scenario is random")]
    Random,
    /// An axis has whole numbers or categories.
    #[error("an axis has whole numbers or categories")]
    DiscreteAxes,
    /// The values are bounds, because simulations ended early.
    #[error("early stopping recorded bounds of the robustness")]
    Bounds,
}

/// Returns the region that follows from uniform samples of the unit cube, each with its robustness,
/// which must be finite and positive. `seed` draws the points at which the volume is measured.
///
/// The slopes are those between adjacent samples, the edges of the minimum spanning tree. It
/// connects all samples, so a cliff that separates some of them is crossed by a short edge. De
/// Haan's interval for the end of a distribution, applied to the two largest slopes, gives the
/// bound. Its index is that of the steepest point in a corner, (3 d - 1) / 2 in d dimensions, which
/// is the widest.
///
/// # Errors
/// If the samples do not look smooth. A cliff that no sample shows is not noticed: the result is an
/// estimate and no proof.
///
/// # Example
/// ```
/// use mishandle_evaluation::{NotSmooth, smooth_region};
/// use mishandle_random::Sequence;
/// let mut random = Sequence::new(1, 0);
/// let points: Vec<Vec<f64>> = (0..300).map(|_| vec![random.uniform(), random.uniform()]).collect();
/// let slope = |u: &Vec<f64>| 0.5 + u[0] + u[1]; // changes by at most √2 per width
/// let region = smooth_region(&points, &points.iter().map(slope).collect::<Vec<_>>(), 1)?;
/// assert!(region.slope >= 2.0_f64.sqrt() && region.slope < 2.0 && region.covered > 0.99);
/// let cliff = |u: &Vec<f64>| if u[0] < 0.5 { 1.0 } else { 2.0 + u[1] };
/// let refused = smooth_region(&points, &points.iter().map(cliff).collect::<Vec<_>>(), 1);
/// assert_eq!(refused, Err(NotSmooth::Cliffs));
/// # Ok::<(), NotSmooth>(())
/// ```
///
/// # Reference
/// De Haan, "Estimation of the minimum of a function using order statistics", Journal of the
/// American Statistical Association 76, 1981.
pub fn smooth_region(points: &[Vec<f64>], robustness: &[f64], seed: u64) -> Result<SmoothRegion, NotSmooth> {
    let n = points.len().min(robustness.len()).min(MOST);
    if n < FEWEST {
        return Err(NotSmooth::FewSamples);
    }
    let (points, robustness) = (&points[..n], &robustness[..n]);
    let pair = |a: usize, b: usize| Pair {
        distance: distance(&points[a], &points[b]),
        difference: (robustness[a] - robustness[b]).abs(),
    };
    let near: Vec<Pair> = spanning_tree(points).into_iter().map(|(a, b)| pair(a, b)).collect();
    let constant = near.iter().filter(|pair| pair.difference == 0.0).count();
    if 2 * constant > near.len() {
        return Err(NotSmooth::Plateaus);
    }
    let far: Vec<Pair> = (0..n).map(|a| pair(a, quarter_neighbor(points, a))).collect();
    let growth = (largest(&far) / largest(&near)).ln() / (median(&far) / median(&near)).ln();
    // It is not a number if all samples are at one point.
    if growth.is_nan() || growth < SMOOTH {
        return Err(NotSmooth::Cliffs);
    }
    let mut slopes: Vec<f64> = near.iter().map(|pair| pair.difference / pair.distance).collect();
    slopes.sort_by(|a, b| b.total_cmp(a));
    let index = (3.0 * points[0].len() as f64 - 1.0) / 2.0;
    let slope = slopes[0] + (slopes[0] - slopes[1]) / (CONFIDENCE.powf(-1.0 / index) - 1.0);
    Ok(SmoothRegion { slope, largest_slope: slopes[0], covered: covered(points, robustness, slope, seed) })
}

#[derive(Clone, Copy)]
struct Pair {
    distance: f64,
    difference: f64,
}

fn largest(pairs: &[Pair]) -> f64 {
    pairs.iter().map(|pair| pair.difference).fold(0.0, f64::max)
}

fn median(pairs: &[Pair]) -> f64 {
    let mut distances: Vec<f64> = pairs.iter().map(|pair| pair.distance).collect();
    distances.sort_by(f64::total_cmp);
    distances[distances.len() / 2]
}

fn distance(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum::<f64>().sqrt()
}

/// Returns the edges of the minimum spanning tree (Prim's algorithm).
fn spanning_tree(points: &[Vec<f64>]) -> Vec<(usize, usize)> {
    // Distance to the tree and the nearest point in it, for each point that is not in it.
    let mut outside: Vec<(usize, f64, usize)> =
        (1..points.len()).map(|i| (i, distance(&points[0], &points[i]), 0)).collect();
    let mut edges = Vec::with_capacity(outside.len());
    while let Some(next) = (0..outside.len()).min_by(|a, b| outside[*a].1.total_cmp(&outside[*b].1)) {
        let (added, _, parent) = outside.swap_remove(next);
        edges.push((parent, added));
        for (point, to_tree, nearest) in &mut outside {
            let to_added = distance(&points[*point], &points[added]);
            if to_added < *to_tree {
                (*to_tree, *nearest) = (to_added, added);
            }
        }
    }
    edges
}

/// Returns the neighbor of a point such that a quarter of the points is nearer.
fn quarter_neighbor(points: &[Vec<f64>], of: usize) -> usize {
    let mut others: Vec<(f64, usize)> = (0..points.len())
        .filter(|other| *other != of)
        .map(|other| (distance(&points[of], &points[other]), other))
        .collect();
    let quarter = others.len() / 4;
    others.select_nth_unstable_by(quarter, |a, b| a.0.total_cmp(&b.0)).1.1
}

/// Returns the share of random points within robustness / slope of a sample.
fn covered(points: &[Vec<f64>], robustness: &[f64], slope: f64, seed: u64) -> f64 {
    let mut random = Sequence::new(seed, 0);
    let is_covered = |at: &[f64]| {
        points.iter().zip(robustness).any(|(point, robustness)| slope * distance(point, at) < *robustness)
    };
    let count = (0..POINTS)
        .filter(|_| is_covered(&points[0].iter().map(|_| random.uniform()).collect::<Vec<_>>()))
        .count();
    count as f64 / POINTS as f64
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;

    fn uniform(n: usize, d: usize, seed: u64) -> Vec<Vec<f64>> {
        let mut random = Sequence::new(seed, 0);
        (0..n).map(|_| (0..d).map(|_| random.uniform()).collect()).collect()
    }

    fn region(points: &[Vec<f64>], function: impl Fn(&[f64]) -> f64) -> Result<SmoothRegion, NotSmooth> {
        smooth_region(points, &points.iter().map(|u| function(u)).collect::<Vec<_>>(), 7)
    }

    #[test]
    fn a_spanning_tree_is_that_of_a_hand_calculation() {
        let points = [[0.0, 0.0], [0.5, 0.0], [0.6, 0.0], [0.6, 0.3]].map(Vec::from);
        assert_eq!(spanning_tree(&points), [(0, 1), (1, 2), (2, 3)]);
    }

    /// Functions with known largest slopes: 2 · 0.7 · √d for the bowl, 0.9 e^(-1/2) / 0.1 for the
    /// pit, 2 for the tent.
    #[test]
    fn the_bound_contains_the_true_slope_of_smooth_functions() {
        let bowl = |u: &[f64]| 1.0 + u.iter().map(|x| (x - 0.3) * (x - 0.3)).sum::<f64>();
        let pit = |u: &[f64]| {
            let squares: f64 = u.iter().map(|x| (x - 0.4) * (x - 0.4)).sum();
            1.0 - 0.9 * (-squares / 0.02).exp()
        };
        let tent = |u: &[f64]| 1.0 + 2.0 * u.iter().map(|x| x.min(1.0 - x)).fold(0.0, f64::max);
        for d in 1..4 {
            let functions = [
                (&bowl as &dyn Fn(&[f64]) -> f64, 1.4 * (d as f64).sqrt()),
                (&pit, 9.0 * (-0.5_f64).exp()),
                (&tent, 2.0),
            ];
            for (number, (function, slope)) in functions.into_iter().enumerate() {
                let bounds: Vec<f64> = (0..40)
                    .filter_map(|seed| region(&uniform(300, d, seed), function).ok())
                    .map(|region| region.slope)
                    .collect();
                let covering = bounds.iter().filter(|bound| **bound >= slope).count();
                assert!(
                    covering as f64 >= 0.9 * bounds.len() as f64,
                    "function {number} in {d} dimensions: {covering} of {}",
                    bounds.len()
                );
            }
        }
    }

    #[test]
    fn cliffs_plateaus_and_few_samples_are_refused() {
        for d in 1..4 {
            for seed in 0..20 {
                let points = uniform(300, d, seed);
                let cliff = region(&points, |u| if u[0] > 0.6 { 0.5 } else { 1.5 + 0.1 * u[0] });
                assert_eq!(cliff, Err(NotSmooth::Cliffs), "{d} dimensions, seed {seed}");
            }
        }
        let points = uniform(300, 2, 1);
        assert_eq!(region(&points, |_| 1.0), Err(NotSmooth::Plateaus));
        assert_eq!(region(&points[..49], |u| 1.0 + u[0]), Err(NotSmooth::FewSamples));
    }

    #[test]
    fn the_covered_region_excludes_the_surroundings_of_a_possible_failure() {
        // Robustness 0.1 + x: with slope 1 every point is within reach of its own value.
        let points = uniform(400, 1, 3);
        let near_zero = region(&points, |u| 1e-4 + u[0]).unwrap();
        assert!((near_zero.slope - 1.0).abs() < 1e-6 && near_zero.covered > 0.99, "{near_zero:?}");
        // With a slope of 10, the values of 0.001 to 0.006 in the lower half cover at most 0.0012
        // each, so 200 samples cover at most 0.24.
        let shallow =
            region(&points, |u| 0.001 + if u[0] < 0.5 { 0.01 * u[0] } else { 0.005 + 10.0 * (u[0] - 0.5) });
        let SmoothRegion { slope, covered, .. } = shallow.unwrap();
        assert!(slope > 9.9 && slope < 12.0 && covered > 0.49 && covered < 0.74, "{shallow:?}");
    }
}
