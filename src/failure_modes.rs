//! Failure modes: the failures of a run, grouped by decisive predicate, region of the space and time.

use mishandle_rollout::{Axis, AxisKind, AxisValues, Scenario};
use mishandle_store::{AxisRecord, RunFile, RunHeader, Simulation};

use crate::MishandleError;
use crate::explanation::{explain_recorded, trace};

/// Two failures with the same decisive predicate are neighbors if their scenarios differ by at most this: the root mean square
/// over the axes, as a fraction of their widths.
const REGION: f64 = 0.15;

/// And if their decisive instants differ by at most this fraction of an episode.
const TIME: f64 = 0.15;

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
    /// Decisive sample.
    pub sample: usize,
    /// Distance of the scenario from the nominal one: the root mean square over the axes with a nominal value, as a fraction of
    /// their widths.
    pub distance_from_nominal: f64,
}

/// Failures with the same decisive predicate that are connected by neighbors in the space and in time.
#[derive(Clone, Debug, PartialEq)]
pub struct FailureMode {
    /// The failures, the representative first, in order of their distance from nominal.
    pub failures: Vec<Failure>,
    /// Smallest and largest value of each axis; `None` for an axis that is drawn at random.
    pub region: Vec<Option<(f64, f64)>>,
    /// First and last decisive sample.
    pub samples: (usize, usize),
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
/// # Errors
/// If the run cannot be read, or the formula has no finite value on a recorded trace.
pub fn failure_modes(run: &RunFile) -> Result<FailureModes, MishandleError> {
    let header = run.header();
    let axes: Vec<Axis> = header.axes.iter().map(axis).collect();
    let mut failures = Vec::new();
    let (mut all, mut not_grouped) = (0, 0);
    let mut failing = Vec::new();
    for simulation in run.simulations() {
        let simulation = simulation?;
        if simulation.robustness.is_some_and(|rho| rho < 0.0) {
            failing.push((simulation.trial, simulation.number));
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
    let points: Vec<Vec<Option<f64>>> =
        failures.iter().map(|failure| unit_point(&axes, &failure.scenario)).collect();
    let length = f64::from(header.episode_steps).max(1.0);
    let are_neighbors = |a: usize, b: usize| {
        let (first, second): (&Failure, &Failure) = (&failures[a], &failures[b]);
        first.predicate == second.predicate
            && first.sample.abs_diff(second.sample) as f64 <= TIME * length
            && distance(&points[a], &points[b]) <= REGION
    };
    let clusters = connected(failures.len(), are_neighbors);
    let mut modes: Vec<FailureMode> = clusters
        .iter()
        .map(|members| mode(members.iter().map(|index| failures[*index].clone()).collect(), axes.len()))
        .collect();
    // Stable, so modes of equal size stay in the order of their first failure.
    modes.sort_by_key(|mode| std::cmp::Reverse(mode.failures.len()));
    Ok(FailureModes { modes, failures: all, not_grouped })
}

fn failure(header: &RunHeader, axes: &[Axis], simulation: Simulation) -> Result<Failure, MishandleError> {
    let trace = simulation.trace.as_ref().map(|stored| trace(header, stored));
    let Some(trace) = trace else {
        let Simulation { trial, number, .. } = simulation;
        return Err(MishandleError::NothingToExplain { trial, number });
    };
    let explained = explain_recorded(header, simulation, trace)?;
    let diagnosis = &explained.explanation.diagnosis;
    let last = diagnosis.path.last();
    let Simulation { trial, number, seed, scenario, robustness, .. } = explained.recorded;
    let nominal: Vec<Option<f64>> = axes.iter().map(|axis| axis.nominal).collect();
    Ok(Failure {
        distance_from_nominal: distance(&unit_point(axes, &scenario), &unit_point(axes, &nominal)),
        trial,
        number,
        seed,
        robustness: robustness.unwrap_or(diagnosis.robustness()),
        predicate: diagnosis.predicate.as_ref().map_or(String::new(), |predicate| predicate.text.clone()),
        sample: last.map_or(0, |last| last.sample),
        scenario,
    })
}

fn mode(mut failures: Vec<Failure>, axes: usize) -> FailureMode {
    let region = |axis: usize| {
        let values = || failures.iter().filter_map(|failure| failure.scenario.get(axis).copied().flatten());
        let (low, high) = (values().reduce(f64::min)?, values().reduce(f64::max)?);
        Some((low, high))
    };
    let region = (0..axes).map(region).collect();
    let first = failures.iter().map(|failure| failure.sample).min().unwrap_or(0);
    let last = failures.iter().map(|failure| failure.sample).max().unwrap_or(0);
    failures.sort_by(|a, b| a.distance_from_nominal.total_cmp(&b.distance_from_nominal));
    FailureMode { failures, region, samples: (first, last) }
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
    let differences: Vec<f64> = a.iter().zip(b).filter_map(|(a, b)| Some((*a)? - (*b)?)).collect();
    match differences.len() {
        0 => 0.0,
        n => (differences.iter().map(|d| d * d).sum::<f64>() / n as f64).sqrt(),
    }
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

    #[test]
    fn the_distance_is_relative_to_the_widths_of_the_axes() {
        let axes = [Axis::start("x", "m", 0.0, 2.0), Axis::start("y", "m", -1.0, 1.0)];
        let at = |x, y| unit_point(&axes, &[Some(x), y]);
        assert_eq!(distance(&at(0.0, Some(0.0)), &at(2.0, Some(0.0))), 0.5_f64.sqrt());
        assert_eq!(distance(&at(0.0, Some(0.0)), &at(1.0, None)), 0.5);
    }
}
