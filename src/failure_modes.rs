//! Failure modes: the failures of a run, grouped by decisive predicate, region of the space and time.

use mishandle_evaluation::{holm, kolmogorov_smirnov};
use mishandle_rollout::{Axis, AxisKind, AxisValues, Scenario};
use mishandle_store::{AxisRecord, RunFile, RunHeader, Simulation};

use crate::MishandleError;
use crate::explanation::{Violation, trace, violation};

/// Two failures with the same decisive predicate are neighbors if the instants at which the violation is final differ by at most
/// this fraction of an episode.
const TIME: f64 = 0.15;

/// And if their scenarios differ by at most this: the root mean square over the axes that matter, as a fraction of their widths.
const REGION: f64 = 0.15;

/// With few failures, the distance may be as large as that to the nearest of n random scenarios in k axes, which is about this
/// times n^(-1/k).
const SPARSE: f64 = 0.35;

/// Rounding errors of a distance.
const ROUNDING: f64 = 1e-9;

/// In a space with more axes than this, only axes matter that tell the failures from the other simulations.
const FEW_AXES: usize = 2;

/// Largest p-value of an axis that matters, after Holm's correction for all axes.
const SIGNIFICANT: f64 = 0.05;

/// Largest number of other simulations that failures are compared with.
const MAX_OTHERS: usize = 5000;

/// Largest number of failures that are grouped, since every pair is compared.
const MAX_FAILURES: usize = 5000;

/// A recorded failure.
#[derive(Clone, Debug, PartialEq)]
pub struct Failure {
    /// Number of the trial.
    pub trial: u32,
    /// Number of the simulation within the trial.
    pub number: u32,
    /// Random seed of the simulation.
    pub seed: u64,
    /// One value per axis.
    pub scenario: Vec<Option<f64>>,
    /// Robustness; negative.
    pub robustness: f64,
    /// Text of the decisive predicate; empty if the formula has none.
    pub predicate: String,
    /// First sample after which nothing can satisfy the formula; the decisive one if the trace does not decide the formula.
    pub sample: usize,
    /// Distance of the scenario from the nominal one: the root mean square over the axes with a nominal value, as a fraction of
    /// their widths.
    pub distance_from_nominal: f64,
}

/// Failures with the same decisive predicate that are connected by neighbors in the space and in time: see [`failure_modes`].
#[derive(Clone, Debug, PartialEq)]
pub struct FailureMode {
    /// The failures, the representative first, in order of their distance from nominal.
    pub failures: Vec<Failure>,
    /// Smallest and largest value of each axis; `None` for an axis that is drawn at random.
    pub region: Vec<Option<(f64, f64)>>,
    /// Smallest and largest [`Failure::sample`].
    pub samples: (usize, usize),
    /// Indices of the axes by which failures with this predicate were grouped. In a space of more than two axes, these are the
    /// axes along which they are distributed differently from the other simulations; there may be none.
    pub axes: Vec<usize>,
}

impl FailureMode {
    /// Returns the failure that is closest to the nominal scenario.
    pub fn representative(&self) -> &Failure {
        &self.failures[0]
    }
}

/// Failure modes of a run, and the numbers of failures.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FailureModes {
    /// The modes, the one with the most failures first.
    pub modes: Vec<FailureMode>,
    /// Number of failures in the run.
    pub failures: usize,
    /// Number of failures that are in no mode: without a recorded trace, or above the limit of 5,000.
    pub not_grouped: usize,
}

/// Groups the failures of a run by decisive predicate, region and time: single-linkage clusters.
///
/// Two failures with the same predicate are neighbors if the instants at which they become final differ by at most 15 % of an episode, and their
/// scenarios by at most r: the root mean square over the axes that matter, as a fraction of their widths; two successive integers
/// count as equal. r is the larger of
/// 0.15 and 0.35 n^(-1/k) for n failures with this predicate and k axes. In a space of more than two axes, an axis matters if
/// the failures are distributed differently along it than the simulations that do not fail: two-sample Kolmogorov-Smirnov test,
/// p < 0.05 after Holm's correction. If no axis matters, predicate and time alone decide.
///
/// # Errors
/// If the run cannot be read, or the formula has no finite value on a recorded trace.
pub fn failure_modes(run: &RunFile) -> Result<FailureModes, MishandleError> {
    let header = run.header();
    let axes: Vec<Axis> = header.axes.iter().map(axis).collect();
    let mut failures = Vec::new();
    let (mut all, mut not_grouped) = (0, 0);
    let (mut failing, mut others) = (Vec::new(), Vec::new());
    let passing = run.counts()?.simulations as usize;
    let every = passing.div_ceil(MAX_OTHERS).max(1);
    for (index, simulation) in run.simulations().enumerate() {
        let simulation = simulation?;
        if simulation.robustness.is_some_and(|rho| rho < 0.0) {
            failing.push((simulation.trial, simulation.number));
        } else if index % every == 0 {
            others.push(unit_point(&axes, &simulation.scenario));
        }
    }
    for (trial, number) in failing {
        all += 1;
        let simulation = run.simulation(trial, number)?;
        if failures.len() == MAX_FAILURES || simulation.trace.is_none() {
            not_grouped += 1;
            continue;
        }
        failures.push(failure(header, &axes, simulation)?);
    }
    let mut predicates: Vec<Vec<Failure>> = Vec::new();
    for failure in failures {
        match predicates.iter_mut().find(|group| group[0].predicate == failure.predicate) {
            Some(group) => group.push(failure),
            None => predicates.push(vec![failure]),
        }
    }
    let length = f64::from(header.episode_steps).max(1.0);
    let mut modes: Vec<FailureMode> =
        predicates.into_iter().flat_map(|group| grouped(&group, &others, &axes, length)).collect();
    // Stable, so modes of equal size stay in the order of their first failure.
    modes.sort_by_key(|mode| std::cmp::Reverse(mode.failures.len()));
    Ok(FailureModes { modes, failures: all, not_grouped })
}

/// Groups failures with the same predicate by region and time.
fn grouped(
    failures: &[Failure],
    others: &[Vec<Option<f64>>],
    axes: &[Axis],
    length: f64,
) -> Vec<FailureMode> {
    let points: Vec<Vec<Option<f64>>> =
        failures.iter().map(|failure| unit_point(axes, &failure.scenario)).collect();
    let chosen = axes_that_matter(&points, others, axes.len());
    let reach = reach(failures.len(), chosen.len());
    let difference = |a: usize, b: usize, axis: usize| {
        let apart = ((points[a][axis])? - (points[b][axis])?).abs();
        // Two successive integers are neighbors like two equal values.
        Some(match (&axes[axis].values, axes[axis].levels()) {
            (AxisValues::Integer, Some(levels)) => (apart - 1.0 / levels as f64).max(0.0),
            _ => apart,
        })
    };
    let are_neighbors = |a: usize, b: usize| {
        failures[a].sample.abs_diff(failures[b].sample) as f64 <= TIME * length
            && root_mean_square(chosen.iter().filter_map(|axis| difference(a, b, *axis))) <= reach + ROUNDING
    };
    let clusters = connected(failures.len(), are_neighbors);
    let members = |cluster: &Vec<usize>| cluster.iter().map(|index| failures[*index].clone()).collect();
    clusters.iter().map(|cluster| mode(members(cluster), &chosen, axes.len())).collect()
}

/// Returns the largest distance between neighbors among `n` failures over `k` axes.
fn reach(n: usize, k: usize) -> f64 {
    match k {
        0 => REGION,
        k => REGION.max(SPARSE * (n as f64).powf(-1.0 / k as f64)),
    }
}

/// Returns the axes along which the failures are distributed differently from the other simulations; all axes if they are few.
fn axes_that_matter(failing: &[Vec<Option<f64>>], others: &[Vec<Option<f64>>], axes: usize) -> Vec<usize> {
    if axes <= FEW_AXES {
        return (0..axes).collect();
    }
    let values = |points: &[Vec<Option<f64>>], axis: usize| -> Vec<f64> {
        points.iter().filter_map(|point| point[axis]).collect()
    };
    let p_values: Vec<f64> =
        (0..axes).map(|axis| kolmogorov_smirnov(&values(failing, axis), &values(others, axis))).collect();
    let adjusted = holm(&p_values);
    (0..axes).filter(|axis| adjusted[*axis] < SIGNIFICANT).collect()
}

fn failure(header: &RunHeader, axes: &[Axis], simulation: Simulation) -> Result<Failure, MishandleError> {
    let trace = simulation.trace.as_ref().map(|stored| trace(header, stored));
    let Some(trace) = trace else {
        let Simulation { trial, number, .. } = simulation;
        return Err(MishandleError::NothingToExplain { trial, number });
    };
    let Simulation { trial, number, seed, scenario, robustness, .. } = simulation;
    let Violation { robustness: evaluated, predicate, sample } = violation(header, &trace)?;
    let nominal: Vec<Option<f64>> = axes.iter().map(|axis| axis.nominal).collect();
    Ok(Failure {
        distance_from_nominal: distance(&unit_point(axes, &scenario), &unit_point(axes, &nominal)),
        trial,
        number,
        seed,
        robustness: robustness.unwrap_or(evaluated),
        predicate,
        sample,
        scenario,
    })
}

fn mode(mut failures: Vec<Failure>, chosen: &[usize], axes: usize) -> FailureMode {
    let region = |axis: usize| {
        let values = || failures.iter().filter_map(|failure| failure.scenario.get(axis).copied().flatten());
        let (low, high) = (values().reduce(f64::min)?, values().reduce(f64::max)?);
        Some((low, high))
    };
    let region = (0..axes).map(region).collect();
    let first = failures.iter().map(|failure| failure.sample).min().unwrap_or(0);
    let last = failures.iter().map(|failure| failure.sample).max().unwrap_or(0);
    failures.sort_by(|a, b| a.distance_from_nominal.total_cmp(&b.distance_from_nominal));
    FailureMode { failures, region, samples: (first, last), axes: chosen.to_vec() }
}

/// Returns the connected components of `n` vertices, each sorted, in the order of their first vertex.
fn connected(n: usize, are_neighbors: impl Fn(usize, usize) -> bool) -> Vec<Vec<usize>> {
    let mut component = vec![None; n];
    let mut components: Vec<Vec<usize>> = Vec::new();
    for start in 0..n {
        if component[start].is_some() {
            continue;
        }
        let index = components.len();
        component[start] = Some(index);
        let (mut members, mut open) = (vec![start], vec![start]);
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

/// Returns the coordinates of a scenario as fractions of the widths of the axes.
fn unit_point(axes: &[Axis], scenario: &[Option<f64>]) -> Vec<Option<f64>> {
    axes.iter().zip(scenario).map(|(axis, value)| value.map(|value| axis.unit_coordinate(value))).collect()
}

/// Returns the root mean square of the differences of the coordinates that both points have.
fn distance(a: &[Option<f64>], b: &[Option<f64>]) -> f64 {
    root_mean_square(a.iter().zip(b).filter_map(|(a, b)| Some((*a)? - (*b)?)))
}

/// Returns the root mean square; 0 without values.
fn root_mean_square(values: impl Iterator<Item = f64>) -> f64 {
    let (n, sum) = values.fold((0, 0.0), |(n, sum), value| (n + 1, sum + value * value));
    if n == 0 { 0.0 } else { (sum / f64::from(n)).sqrt() }
}

/// Returns the axis that a run file describes. Its kind matters for sampling and checks only, which a description does not need.
pub fn axis(record: &AxisRecord) -> Axis {
    let values = match record.values.split_once(": ") {
        Some(("categorical", names)) => {
            AxisValues::Categorical(names.split(", ").map(str::to_string).collect())
        }
        _ if record.values == "logarithmic" => AxisValues::Logarithmic,
        _ if record.values == "integer" => AxisValues::Integer,
        _ => AxisValues::Continuous,
    };
    let bounds = [record.low, record.high];
    Axis::new(AxisKind::Start, &record.name, &record.unit, bounds, record.nominal).with_values(values)
}

impl From<&Failure> for Scenario {
    fn from(failure: &Failure) -> Scenario {
        Scenario::new(failure.scenario.clone())
    }
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

    #[test]
    fn an_axis_matters_if_it_tells_failures_from_the_others() {
        let others = uniform(500, 40, 1);
        let mut failing = uniform(20, 40, 2);
        assert_eq!(axes_that_matter(&failing, &others, 40), Vec::<usize>::new());
        for (index, point) in failing.iter_mut().enumerate() {
            // All failures are above 0.8 of axis 7, and at both ends of axis 30.
            point[7] = point[7].map(|u| 0.8 + 0.2 * u);
            point[30] = point[30].map(|u| if index % 2 == 0 { 0.05 * u } else { 1.0 - 0.05 * u });
        }
        assert_eq!(axes_that_matter(&failing, &others, 40), [7, 30]);
        // Few axes all matter, and no test is made without other simulations.
        assert_eq!(axes_that_matter(&failing, &others, 2), [0, 1]);
        assert_eq!(axes_that_matter(&failing, &[], 40), Vec::<usize>::new());
    }

    #[test]
    fn failures_at_both_ends_of_an_axis_are_two_modes_in_many_axes() {
        let axes: Vec<Axis> = (0..40).map(|index| Axis::start(&format!("x{index}"), "", 0.0, 1.0)).collect();
        let mut failures = Vec::new();
        for (number, mut point) in (1..).zip(uniform(20, 40, 3)) {
            point[30] = point[30].map(|u| if number % 2 == 0 { 0.05 * u } else { 1.0 - 0.05 * u });
            failures.push(Failure {
                trial: number,
                number: 1,
                seed: 0,
                scenario: point,
                robustness: -1.0,
                predicate: "x >= 0".to_string(),
                sample: 50,
                distance_from_nominal: 0.0,
            });
        }
        let modes = grouped(&failures, &uniform(500, 40, 4), &axes, 100.0);
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

    #[test]
    fn the_distance_is_relative_to_the_widths_of_the_axes() {
        let axes = [Axis::start("x", "m", 0.0, 2.0), Axis::start("y", "m", -1.0, 1.0)];
        let at = |x, y| unit_point(&axes, &[Some(x), y]);
        assert_eq!(distance(&at(0.0, Some(0.0)), &at(2.0, Some(0.0))), 0.5_f64.sqrt());
        assert_eq!(distance(&at(0.0, Some(0.0)), &at(1.0, None)), 0.5);
    }
}
