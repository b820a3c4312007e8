//! Failure modes: the failures of a run, grouped by decisive predicate, region of the space and
//! time.

use mishandle_falsification::{
    FailurePoint, MAX_FAILURES, MAX_OTHERS, Signature, group_failures, unit_scenario,
};
use mishandle_rollout::{Axis, Scenario};
use mishandle_store::{RunFile, RunHeader, Simulation};

use crate::error::MishandleError;
use crate::inspect::explanation::trace;
use crate::run::recorded_axis;
use crate::run::violation::{Violation, violation};

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
    /// First sample after which nothing can satisfy the formula; the decisive one if the trace does
    /// not decide the formula.
    pub sample: usize,
    /// Distance of the scenario from the nominal one: the root mean square over the axes with a
    /// nominal value, as a fraction of their widths.
    pub distance_from_nominal: f64,
}

/// Failures with the same decisive predicate that are connected by neighbors in the space and in
/// time: see [`group_failures`].
#[derive(Clone, Debug, PartialEq)]
pub struct FailureMode {
    /// The failures, the representative first, in order of their distance from nominal.
    pub failures: Vec<Failure>,
    /// Smallest and largest value of each axis; `None` for an axis that is drawn at random.
    pub region: Vec<Option<(f64, f64)>>,
    /// Smallest and largest [`Failure::sample`].
    pub samples: (usize, usize),
    /// Indices of the axes by which failures with this predicate were grouped. In a space of more
    /// than two axes, these are the axes along which they are distributed differently from the
    /// other simulations; there may be none.
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
    /// Number of failures that are in no mode: without a recorded trace, or above the limit of
    /// 5,000.
    pub not_grouped: usize,
}

/// Groups the failures of a run by decisive predicate, region and time: see [`group_failures`].
///
/// # Errors
/// If the run cannot be read, or the formula has no finite value on a recorded trace.
pub fn failure_modes(run: &RunFile) -> Result<FailureModes, MishandleError> {
    let header = run.header();
    let axes: Vec<Axis> = header.axes.iter().map(recorded_axis).collect();
    let mut failures = Vec::new();
    let (mut all, mut not_grouped) = (0, 0);
    let (mut failing, mut others) = (Vec::new(), Vec::new());
    let passing = run.counts()?.simulations as usize;
    let every = passing.div_ceil(MAX_OTHERS).max(1);
    for (index, simulation) in run.simulations().enumerate() {
        let simulation = simulation?;
        if simulation.is_violated() {
            failing.push((simulation.trial, simulation.number));
        } else if index % every == 0 {
            others.push(unit_scenario(&axes, &simulation.scenario));
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
    let points: Vec<FailurePoint> = failures.iter().map(|failure| point(&axes, failure)).collect();
    let grouped = group_failures(&points, &others, &axes, header.episode_steps as usize);
    let members = |indices: &[usize]| indices.iter().map(|index| failures[*index].clone()).collect();
    let mut modes: Vec<FailureMode> =
        grouped.iter().map(|found| mode(members(&found.failures), &found.axes, axes.len())).collect();
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
    let Simulation { trial, number, seed, scenario, robustness, .. } = simulation;
    let Violation { robustness: evaluated, signature } = violation(header, &trace)?;
    let Signature { predicate, sample } = signature;
    let nominal: Vec<Option<f64>> = axes.iter().map(|axis| axis.nominal).collect();
    Ok(Failure {
        distance_from_nominal: distance(&unit_scenario(axes, &scenario), &unit_scenario(axes, &nominal)),
        trial,
        number,
        seed,
        robustness: robustness.unwrap_or(evaluated),
        predicate,
        sample,
        scenario,
    })
}

/// Returns what decides the mode of a failure.
fn point(axes: &[Axis], failure: &Failure) -> FailurePoint {
    let signature = Signature { predicate: failure.predicate.clone(), sample: failure.sample };
    FailurePoint { point: unit_scenario(axes, &failure.scenario), signature }
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

/// Returns the root mean square of the differences of the coordinates that both points have.
fn distance(a: &[Option<f64>], b: &[Option<f64>]) -> f64 {
    root_mean_square(a.iter().zip(b).filter_map(|(a, b)| Some((*a)? - (*b)?)))
}

/// Returns the root mean square; 0 without values.
fn root_mean_square(values: impl Iterator<Item = f64>) -> f64 {
    let (n, sum) = values.fold((0, 0.0), |(n, sum), value| (n + 1, sum + value * value));
    if n == 0 { 0.0 } else { (sum / f64::from(n)).sqrt() }
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
    fn the_distance_is_relative_to_the_widths_of_the_axes() {
        let axes = [Axis::start("x", "m", 0.0, 2.0), Axis::start("y", "m", -1.0, 1.0)];
        let at = |x, y| unit_scenario(&axes, &[Some(x), y]);
        assert_eq!(distance(&at(0.0, Some(0.0)), &at(2.0, Some(0.0))), 0.5_f64.sqrt());
        assert_eq!(distance(&at(0.0, Some(0.0)), &at(1.0, None)), 0.5);
    }
}
