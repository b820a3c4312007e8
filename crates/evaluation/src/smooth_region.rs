//! The part of a space that cannot fail if each part of the requirement is as smooth there as at
//! its samples.

use mishandle_random::Sequence;

use crate::clopper_pearson;

/// Fewest samples from which a slope is estimated.
const FEWEST: usize = 50;

/// Number of random points that measure the covered volume.
const POINTS: u64 = 4000;

/// Confidence of de Haan's interval. It is asymptotic: with 0.95 it covered 89 % of two-dimensional
/// waves in 300 samples, and with 0.98 at least 95 % of all functions that were tried. Several
/// predicates share the rest.
const CONFIDENCE: f64 = 0.98;

/// Two-sided confidence of the covered volume, whose lower end is taken: 95 % for one side.
const VOLUME_CONFIDENCE: f64 = 0.9;

/// Smallest exponent with which the largest difference of two values must grow with their distance.
/// It is 1 for a smooth function and 0 for a cliff.
const SMOOTH: f64 = 0.5;

/// Conclusion from the samples of smooth predicates.
#[derive(Clone, Debug, PartialEq)]
pub struct SmoothRegion {
    /// Estimated upper bounds (95 % for all of them together) of the slopes of the predicates:
    /// change of the value per width of the space.
    pub slopes: Vec<f64>,
    /// Largest slope of each predicate between two adjacent samples.
    pub largest_slopes: Vec<f64>,
    /// Radius of the ball around each sample in which nothing fails if the slopes are at most
    /// `slopes`.
    pub radii: Vec<f64>,
    /// Share of the space in these balls: the lower end of a 95 % interval from random points.
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
    /// Simulations have different numbers of samples.
    #[error("simulations ended at different times")]
    Ends,
    /// The simulations that the slopes need were interrupted.
    #[error("it was interrupted")]
    Interrupted,
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

/// Returns the region that follows from uniform samples of the unit cube.
///
/// `predicates` has for each predicate of the requirement, and for each sample, the values of the
/// predicate over time. A predicate that decides no sample is bounded like the others, and so is a
/// time that decides none. `robustness` gets a positive factor for each predicate and returns for
/// each sample the robustness of the requirement with the predicates multiplied by them; it must be
/// positive. `seed` draws the points at which the volume is measured.
///
/// The slopes are those between adjacent samples, the edges of the minimum spanning tree. It
/// connects all samples, so a cliff that separates some of them is crossed by a short edge. The
/// difference of two samples is the largest one over time. De Haan's interval for the end of a
/// distribution, applied to the two largest slopes, gives the bound. Its index is that of the
/// steepest point in a corner, (3 d - 1) / 2 in d dimensions, which is the widest.
///
/// Divided by its slope, each predicate changes by at most the distance. So does the robustness
/// then, which is made of minima, maxima and changes of sign: it is the radius in which nothing
/// fails.
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
/// let region = |predicate: fn(&Vec<f64>) -> f64| {
///     let values: Vec<f64> = points.iter().map(predicate).collect();
///     let over_time = vec![values.iter().map(|value| vec![*value]).collect()];
///     let scaled = |factors: &[f64]| Some(values.iter().map(|value| value * factors[0]).collect());
///     smooth_region(&points, &over_time, scaled, 1)
/// };
/// let found = region(|u| 0.5 + u[0] + u[1])?; // changes by at most √2 per width
/// assert!(found.slopes[0] >= 2.0_f64.sqrt() && found.slopes[0] < 2.0 && found.covered > 0.99);
/// let refused = region(|u| if u[0] < 0.5 { 1.0 } else { 2.0 + u[1] });
/// assert_eq!(refused, Err(NotSmooth::Cliffs));
/// # Ok::<(), NotSmooth>(())
/// ```
///
/// # Reference
/// De Haan, "Estimation of the minimum of a function using order statistics", Journal of the
/// American Statistical Association 76, 1981.
pub fn smooth_region(
    points: &[Vec<f64>],
    predicates: &[Vec<Vec<f64>>],
    robustness: impl FnOnce(&[f64]) -> Option<Vec<f64>>,
    seed: u64,
) -> Result<SmoothRegion, NotSmooth> {
    if points.len() < FEWEST {
        return Err(NotSmooth::FewSamples);
    }
    let near = spanning_tree(points);
    let far: Vec<(usize, usize)> = (0..points.len()).map(|a| (a, quarter_neighbor(points, a))).collect();
    let confidence = 1.0 - (1.0 - CONFIDENCE) / predicates.len().max(1) as f64;
    let of = |values: &Vec<Vec<f64>>| slope(points, values, [&near, &far], confidence);
    let found = predicates.iter().map(of).collect::<Result<Vec<[f64; 2]>, _>>()?;
    let (slopes, largest_slopes): (Vec<f64>, Vec<f64>) = found.iter().map(|[a, b]| (*a, *b)).unzip();
    let factors: Vec<f64> = slopes.iter().map(|slope| slope.recip()).collect();
    let radii = robustness(&factors).ok_or(NotSmooth::Ends)?;
    let covered = covered(points, &radii, seed);
    Ok(SmoothRegion { slopes, largest_slopes, radii, covered })
}

/// Returns the bound of the slope of a predicate, and its largest slope between adjacent samples.
fn slope(
    points: &[Vec<f64>],
    values: &[Vec<f64>],
    [near, far]: [&[(usize, usize)]; 2],
    confidence: f64,
) -> Result<[f64; 2], NotSmooth> {
    if values.iter().any(|over_time| over_time.len() != values[0].len()) {
        return Err(NotSmooth::Ends);
    }
    let pairs = |edges: &[(usize, usize)]| -> Vec<Pair> {
        let pair = |(a, b): &(usize, usize)| Pair {
            distance: distance(&points[*a], &points[*b]),
            difference: largest_difference(&values[*a], &values[*b]),
        };
        edges.iter().map(pair).collect()
    };
    let near = pairs(near);
    let far = pairs(far);
    let constant = near.iter().filter(|pair| pair.difference == 0.0).count();
    if 2 * constant > near.len() {
        return Err(NotSmooth::Plateaus);
    }
    let growth = (largest(&far) / largest(&near)).ln() / (median(&far) / median(&near)).ln();
    // It is not a number if all samples are at one point.
    if growth.is_nan() || growth < SMOOTH {
        return Err(NotSmooth::Cliffs);
    }
    let mut slopes: Vec<f64> = near.iter().map(|pair| pair.difference / pair.distance).collect();
    slopes.sort_by(|a, b| b.total_cmp(a));
    let index = (3.0 * points[0].len() as f64 - 1.0) / 2.0;
    Ok([slopes[0] + (slopes[0] - slopes[1]) / (confidence.powf(-1.0 / index) - 1.0), slopes[0]])
}

/// Returns the largest difference of two values at one time; infinite if one has no difference.
fn largest_difference(a: &[f64], b: &[f64]) -> f64 {
    let difference = |(a, b): (&f64, &f64)| if a == b { 0.0 } else { (a - b).abs() };
    a.iter()
        .zip(b)
        .map(difference)
        .fold(0.0, |largest, x| if x.is_nan() { f64::INFINITY } else { largest.max(x) })
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

/// Returns the lower end of the interval of the share of points that are within the radius of a
/// sample.
fn covered(points: &[Vec<f64>], radii: &[f64], seed: u64) -> f64 {
    let mut random = Sequence::new(seed, 0);
    let is_covered =
        |at: &[f64]| points.iter().zip(radii).any(|(point, radius)| distance(point, at) < *radius);
    let count = (0..POINTS)
        .filter(|_| is_covered(&points[0].iter().map(|_| random.uniform()).collect::<Vec<_>>()))
        .count();
    clopper_pearson(count as u64, POINTS, VOLUME_CONFIDENCE).low.unwrap_or(0.0)
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;

    type Predicate<'a> = &'a dyn Fn(&[f64]) -> f64;

    fn uniform(n: usize, d: usize, seed: u64) -> Vec<Vec<f64>> {
        let mut random = Sequence::new(seed, 0);
        (0..n).map(|_| (0..d).map(|_| random.uniform()).collect()).collect()
    }

    fn region(points: &[Vec<f64>], function: impl Fn(&[f64]) -> f64) -> Result<SmoothRegion, NotSmooth> {
        conjunction(points, &[&function])
    }

    /// The region of `always (p1 and p2 ...)` of constant predicates.
    fn conjunction(points: &[Vec<f64>], predicates: &[Predicate<'_>]) -> Result<SmoothRegion, NotSmooth> {
        let values = |predicate: &&dyn Fn(&[f64]) -> f64| -> Vec<Vec<f64>> {
            points.iter().map(|u| vec![predicate(u); 2]).collect()
        };
        let values: Vec<Vec<Vec<f64>>> = predicates.iter().map(values).collect();
        let scaled = |factors: &[f64]| {
            let least = |sample: usize| {
                let parts = values.iter().zip(factors).map(|(values, factor)| values[sample][0] * factor);
                parts.fold(f64::INFINITY, f64::min)
            };
            Some((0..points.len()).map(least).collect())
        };
        smooth_region(points, &values, scaled, 7)
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
                    .map(|region| region.slopes[0])
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
        assert!((near_zero.slopes[0] - 1.0).abs() < 1e-6 && near_zero.covered > 0.99, "{near_zero:?}");
        // With a slope of 10, the values of 0.001 to 0.006 in the lower half cover at most 0.0012
        // each, so 200 samples cover at most 0.24.
        let shallow =
            region(&points, |u| 0.001 + if u[0] < 0.5 { 0.01 * u[0] } else { 0.005 + 10.0 * (u[0] - 0.5) });
        let SmoothRegion { slopes, covered, .. } = shallow.unwrap();
        let slope = slopes[0];
        assert!(slope > 9.9 && slope < 12.0 && covered > 0.47 && covered < 0.74, "{slope} {covered}");
    }

    /// Two predicates of the distance to a center: the steeper one decides only where it is below
    /// 0.05, where 300 samples rarely are, and fails below 0.025. The share of failing points that
    /// are in the region is 0 in at least 95 % of the seeds.
    #[test]
    fn a_predicate_that_decides_no_sample_limits_the_region() {
        let from = |u: &[f64], center: [f64; 2]| 2.0 * (u[0] - center[0]).hypot(u[1] - center[1]);
        let mut printed = 0;
        let mut wrong = 0;
        for seed in 0..60 {
            let center = [0.3 + 0.005 * seed as f64, 0.65];
            let shallow = |u: &[f64]| 0.3 * from(u, center) + 0.5;
            let steep = |u: &[f64]| 20.0 * from(u, center) - 0.5;
            let points: Vec<Vec<f64>> =
                uniform(300, 2, seed).into_iter().filter(|u| steep(u) > 0.0).collect();
            let Ok(found) = conjunction(&points, &[&shallow, &steep]) else { continue };
            printed += 1;
            assert!(found.covered > 0.9, "{}", found.covered);
            let mut random = Sequence::new(1000 + seed, 0);
            let is_covered = |at: &[f64]| {
                points.iter().zip(&found.radii).any(|(point, radius)| distance(point, at) < *radius)
            };
            let fails_inside = (0..2000).any(|_| {
                let angle = random.uniform() * std::f64::consts::TAU;
                let radius = 0.0125 * random.uniform();
                let at = [center[0] + radius * angle.cos(), center[1] + radius * angle.sin()];
                steep(&at) < 0.0 && is_covered(&at)
            });
            wrong += usize::from(fails_inside);
        }
        assert!(printed >= 50 && wrong <= 3, "{wrong} of {printed}");
    }

    /// A predicate that is steep at a time that decides no sample.
    #[test]
    fn a_time_that_decides_no_sample_limits_the_region() {
        let points = uniform(300, 1, 5);
        let over_time = |u: &Vec<f64>| vec![0.5 + 0.1 * u[0], 30.0 * (1.2 - u[0])];
        let values: Vec<Vec<f64>> = points.iter().map(over_time).collect();
        let least =
            |factor: f64| values.iter().map(|values| factor * values[0].min(values[1])).collect::<Vec<f64>>();
        let found =
            smooth_region(&points, std::slice::from_ref(&values), |factors| Some(least(factors[0])), 1)
                .unwrap();
        assert!(found.slopes[0] >= 30.0 - 1e-9, "{:?}", found.slopes);
        let shorter = [vec![vec![1.0]; 299], vec![vec![1.0, 2.0]]].concat();
        let refused = smooth_region(&points, &[shorter], |_| Some(vec![1.0; 300]), 1);
        assert_eq!(refused, Err(NotSmooth::Ends));
    }
}
