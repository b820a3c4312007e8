//! Failure modes: failures grouped by decisive predicate, time and region of the space.

use mishandle_evaluation::{holm, kolmogorov_smirnov};
use mishandle_rollout::{Axis, AxisValues};

/// Two failures with the same decisive predicate are neighbors if the instants at which the
/// violation is final differ by at most this fraction of an episode.
const TIME: f64 = 0.15;

/// And if their scenarios differ by at most this: the root mean square over the axes that matter,
/// as a fraction of their widths.
const REGION: f64 = 0.15;

/// With few failures, the distance may be as large as that to the nearest of n random scenarios in
/// k axes, which is about this times n^(-1/k).
const SPARSE: f64 = 0.35;

/// Rounding errors of a distance.
const ROUNDING: f64 = 1e-9;

/// In a space with more axes than this, only axes matter that tell the failures from the other
/// simulations.
const FEW_AXES: usize = 2;

/// Largest p-value of an axis that matters, after Holm's correction for all axes.
const SIGNIFICANT: f64 = 0.05;

/// Largest number of other simulations that failures are compared with.
pub const MAX_OTHERS: usize = 5000;

/// Largest number of failures that are grouped, since every pair is compared.
pub const MAX_FAILURES: usize = 5000;

/// A scenario as fractions of the widths of the axes; `None` for a value that is drawn at random.
pub type UnitScenario = Vec<Option<f64>>;

/// Returns the coordinates of a scenario, given its values.
pub fn unit_scenario(axes: &[Axis], values: &[Option<f64>]) -> UnitScenario {
    axes.iter().zip(values).map(|(axis, value)| value.map(|value| axis.unit_coordinate(value))).collect()
}

/// Criteria that group violations, besides their scenarios.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Signature {
    /// Text of the decisive predicate; empty if the formula has none.
    pub predicate: String,
    /// First sample after which nothing can satisfy the formula; the decisive one if the trace does
    /// not decide the formula.
    pub sample: usize,
}

/// A failure, as far as its mode depends on it.
#[derive(Clone, Debug, PartialEq)]
pub struct FailurePoint {
    /// The scenario.
    pub point: UnitScenario,
    /// Predicate and time.
    pub signature: Signature,
}

/// The failures of one mode.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ModeMembers {
    /// Indices of the failures, in order.
    pub failures: Vec<usize>,
    /// Indices of the axes by which failures with this predicate were grouped. In a space of more
    /// than two axes, these are the axes along which they are distributed differently from the
    /// other simulations; there may be none.
    pub axes: Vec<usize>,
}

/// Groups failures: single-linkage clusters of the same predicate, in the order of the first
/// failure of each predicate.
///
/// Two failures with the same predicate are neighbors if the instants at which they become final
/// differ by at most 15 % of an episode, and their scenarios by at most r: the root mean square
/// over the axes that matter, as a fraction of their widths; two successive integers count as
/// equal. r is the larger of 0.15 and 0.35 n^(-1/k) for n failures with this predicate and k axes.
/// In a space of more than two axes, an axis matters if the failures are distributed differently
/// along it than `others`, the simulations that do not fail: two-sample Kolmogorov-Smirnov test, p
/// < 0.05 after Holm's correction. If no axis matters, predicate and time alone decide. `others`
/// must be random scenarios, or empty: points that a search chose differ along every axis. Failures
/// with different categories are never in one mode, and modes whose boxes overlap are one.
pub fn group_failures(
    failures: &[FailurePoint],
    others: &[UnitScenario],
    axes: &[Axis],
    episode_steps: usize,
) -> Vec<ModeMembers> {
    let mut predicates: Vec<Vec<usize>> = Vec::new();
    for (index, failure) in failures.iter().enumerate() {
        let same =
            |group: &&mut Vec<usize>| failures[group[0]].signature.predicate == failure.signature.predicate;
        match predicates.iter_mut().find(same) {
            Some(group) => group.push(index),
            None => predicates.push(vec![index]),
        }
    }
    let modes = |group: Vec<usize>| {
        let points: Vec<&UnitScenario> = group.iter().map(|index| &failures[*index].point).collect();
        let chosen = axes_that_matter(&points, others, axes.len());
        let reach = reach(group.len(), chosen.len());
        let are_neighbors = |a: usize, b: usize| {
            let [a, b] = [a, b].map(|index| &failures[group[index]]);
            let distance = mode_distance(axes, &chosen, episode_steps, a, b);
            distance.is_some_and(|distance| distance <= reach + ROUNDING)
        };
        let point = |index: usize| &failures[group[index]];
        let clusters = joined(connected(group.len(), are_neighbors), |cluster| {
            Extent::of(axes, &chosen, cluster.iter().map(|index| point(*index)))
        });
        let members = |cluster: Vec<usize>| cluster.into_iter().map(|index| group[index]).collect();
        clusters
            .into_iter()
            .map(|cluster| ModeMembers { failures: members(cluster), axes: chosen.clone() })
            .collect::<Vec<_>>()
    };
    predicates.into_iter().flat_map(modes).collect()
}

/// Returns the distance of two failures: the root mean square over these axes, as a fraction of
/// their widths. `None` if no distance makes them neighbors: their predicates or categories differ,
/// or their times by more than 15 % of an episode.
pub fn mode_distance(
    axes: &[Axis],
    chosen: &[usize],
    episode_steps: usize,
    a: &FailurePoint,
    b: &FailurePoint,
) -> Option<f64> {
    let can_be_near = a.signature.predicate == b.signature.predicate
        && is_same_time(a.signature.sample, b.signature.sample, episode_steps)
        && has_same_categories(axes, &a.point, &b.point);
    can_be_near.then(|| distance(axes, chosen, &a.point, &b.point))
}

/// Returns whether two scenarios have the same values of all categorical axes: a category is a case
/// of its own, so no mode mixes two.
fn has_same_categories(axes: &[Axis], a: &UnitScenario, b: &UnitScenario) -> bool {
    let is_category = |axis: &Axis| matches!(axis.values, AxisValues::Categorical(_));
    axes.iter().zip(a.iter().zip(b)).all(|(axis, (a, b))| !is_category(axis) || a == b)
}

/// The categories, the range of times and the ranges along the axes that matter of a cluster.
struct Extent {
    categories: UnitScenario,
    ranges: Vec<[f64; 2]>,
}

impl Extent {
    fn of<'a>(axes: &[Axis], chosen: &[usize], failures: impl Iterator<Item = &'a FailurePoint>) -> Extent {
        let is_category = |axis: usize| matches!(axes[axis].values, AxisValues::Categorical(_));
        let mut found: Option<Extent> = None;
        for failure in failures {
            let numeric = chosen.iter().filter(|axis| !is_category(**axis));
            let values = numeric.map(|axis| failure.point[*axis].unwrap_or(f64::NAN));
            let values: Vec<f64> = std::iter::once(failure.signature.sample as f64).chain(values).collect();
            match &mut found {
                Some(found) => {
                    for (range, value) in found.ranges.iter_mut().zip(values) {
                        *range = [range[0].min(value), range[1].max(value)];
                    }
                }
                None => {
                    let categories = (0..axes.len()).filter(|axis| is_category(*axis));
                    found = Some(Extent {
                        categories: categories.map(|axis| failure.point[axis]).collect(),
                        ranges: values.into_iter().map(|value| [value; 2]).collect(),
                    });
                }
            }
        }
        found.unwrap_or(Extent { categories: Vec::new(), ranges: Vec::new() })
    }

    /// Returns whether the boxes have a point in common. A value that is drawn at random does not
    /// separate them.
    fn overlaps(&self, other: &Extent) -> bool {
        let is_apart = |(a, b): (&[f64; 2], &[f64; 2])| a[1] < b[0] || b[1] < a[0];
        self.categories == other.categories && !self.ranges.iter().zip(&other.ranges).any(is_apart)
    }
}

/// Joins clusters with overlapping boxes: they have the same explanation.
fn joined(mut clusters: Vec<Vec<usize>>, of: impl Fn(&[usize]) -> Extent) -> Vec<Vec<usize>> {
    let mut index = 0;
    while index < clusters.len() {
        let own = of(&clusters[index]);
        match (index + 1..clusters.len()).find(|other| own.overlaps(&of(&clusters[*other]))) {
            Some(other) => {
                let members = clusters.remove(other);
                clusters[index].extend(members);
                clusters[index].sort_unstable();
                // The box has grown: clusters before it may overlap now.
                index = 0;
            }
            None => index += 1,
        }
    }
    clusters
}

/// Returns whether two samples of an episode are neighbors.
pub(crate) fn is_same_time(a: usize, b: usize, episode_steps: usize) -> bool {
    a.abs_diff(b) as f64 <= TIME * (episode_steps as f64).max(1.0)
}

/// Returns the root mean square of the differences along these axes. Two successive integers have
/// the distance 0.
pub(crate) fn distance(axes: &[Axis], chosen: &[usize], a: &UnitScenario, b: &UnitScenario) -> f64 {
    let difference = |axis: &usize| {
        let apart = ((a[*axis])? - (b[*axis])?).abs();
        Some(match (&axes[*axis].values, axes[*axis].levels()) {
            (AxisValues::Integer, Some(levels)) => (apart - 1.0 / levels as f64).max(0.0),
            _ => apart,
        })
    };
    let (n, sum) = chosen.iter().filter_map(difference).fold((0, 0.0), |(n, sum), x| (n + 1, sum + x * x));
    if n == 0 { 0.0 } else { (sum / f64::from(n)).sqrt() }
}

/// Returns the largest distance between neighbors among `n` failures over `k` axes.
pub(crate) fn reach(n: usize, k: usize) -> f64 {
    match k {
        0 => REGION,
        k => REGION.max(SPARSE * (n as f64).powf(-1.0 / k as f64)),
    }
}

/// Returns the axes along which the failures are distributed differently from the other
/// simulations; all axes if they are few.
pub(crate) fn axes_that_matter(
    failing: &[&UnitScenario],
    others: &[UnitScenario],
    axes: usize,
) -> Vec<usize> {
    if axes <= FEW_AXES {
        return (0..axes).collect();
    }
    let of_failing = |axis: usize| failing.iter().filter_map(|point| point[axis]).collect::<Vec<f64>>();
    let of_others = |axis: usize| others.iter().filter_map(|point| point[axis]).collect::<Vec<f64>>();
    let p_values: Vec<f64> =
        (0..axes).map(|axis| kolmogorov_smirnov(&of_failing(axis), &of_others(axis))).collect();
    let adjusted = holm(&p_values);
    (0..axes).filter(|axis| adjusted[*axis] < SIGNIFICANT).collect()
}

/// Returns the connected components of `n` vertices, each sorted, in the order of their first
/// vertex.
fn connected(n: usize, are_neighbors: impl Fn(usize, usize) -> bool) -> Vec<Vec<usize>> {
    let mut component = vec![None; n];
    let mut components: Vec<Vec<usize>> = Vec::new();
    for start in 0..n {
        if component[start].is_some() {
            continue;
        }
        let index = components.len();
        component[start] = Some(index);
        let mut members = vec![start];
        let mut open = vec![start];
        while let Some(vertex) = open.pop() {
            let is_new = |other: &usize| component[*other].is_none() && are_neighbors(vertex, *other);
            let new: Vec<usize> = (start + 1..n).filter(is_new).collect();
            new.iter().for_each(|other| component[*other] = Some(index));
            members.extend(&new);
            open.extend(new);
        }
        members.sort_unstable();
        components.push(members);
    }
    components
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn components_are_connected_by_chains_of_neighbors() {
        let at: [i32; 6] = [0, 10, 1, 11, 2, 20];
        let components = connected(6, |a, b| (at[a] - at[b]).abs() <= 1);
        assert_eq!(components, [vec![0, 2, 4], vec![1, 3], vec![5]]);
    }

    /// Uniform points over `axes` axes, from a fixed generator.
    fn uniform(n: u32, axes: u32, seed: u64) -> Vec<Vec<Option<f64>>> {
        let seed = mishandle_rollout::Seed(seed);
        let value = |point, axis| {
            seed.uniform(mishandle_rollout::Stream::InitialConfiguration, u64::from(point), axis)
        };
        (0..n).map(|point| (0..axes).map(|axis| Some(value(point, axis))).collect()).collect()
    }

    fn refs(points: &[UnitScenario]) -> Vec<&UnitScenario> {
        points.iter().collect()
    }

    #[test]
    fn an_axis_matters_if_it_tells_failures_from_the_others() {
        let others = uniform(500, 40, 1);
        let mut failing = uniform(20, 40, 2);
        assert_eq!(axes_that_matter(&refs(&failing), &others, 40), Vec::<usize>::new());
        for (index, point) in failing.iter_mut().enumerate() {
            // All failures are above 0.8 of axis 7, and at both ends of axis 30.
            point[7] = point[7].map(|u| 0.8 + 0.2 * u);
            point[30] = point[30].map(|u| if index % 2 == 0 { 0.05 * u } else { 1.0 - 0.05 * u });
        }
        assert_eq!(axes_that_matter(&refs(&failing), &others, 40), [7, 30]);
        // Few axes all matter, and no test is made without other simulations.
        assert_eq!(axes_that_matter(&refs(&failing), &others, 2), [0, 1]);
        assert_eq!(axes_that_matter(&refs(&failing), &[], 40), Vec::<usize>::new());
    }

    #[test]
    fn failures_at_both_ends_of_an_axis_are_two_modes_in_many_axes() {
        let axes: Vec<Axis> = (0..40).map(|index| Axis::start(&format!("x{index}"), "", 0.0, 1.0)).collect();
        let mut failures = Vec::new();
        for (number, mut point) in (1..).zip(uniform(20, 40, 3)) {
            point[30] = point[30].map(|u| if number % 2 == 0 { 0.05 * u } else { 1.0 - 0.05 * u });
            let signature = Signature { predicate: "x >= 0".to_string(), sample: 50 };
            failures.push(FailurePoint { point, signature });
        }
        let modes = group_failures(&failures, &uniform(500, 40, 4), &axes, 100);
        assert_eq!(
            modes.iter().map(|mode| (mode.failures.len(), mode.axes.clone())).collect::<Vec<_>>(),
            [(10, vec![30]), (10, vec![30]),]
        );
    }

    #[test]
    fn few_failures_are_neighbors_at_larger_distances() {
        // Half the mean distance of two neighbors among n points on a line is 1 / (2 n).
        assert_eq!((reach(100, 1), reach(1000, 2)), (0.15, 0.15));
        assert!((reach(2, 1) - 0.175).abs() < 1e-12 && (reach(16, 4) - 0.175).abs() < 1e-12);
    }
}
