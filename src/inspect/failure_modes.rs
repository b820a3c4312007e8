//! Failure modes: the failures of a run, grouped by decisive predicate, region of the space and
//! time.

use std::collections::BTreeMap;
use std::collections::btree_map::Entry;

use mishandle_falsification::{
    FailurePoint, MAX_FAILURES, MAX_OTHERS, Signature, group_failures, mode_distance, unit_scenario,
};
use mishandle_rollout::{Axis, Scenario};
use mishandle_store::{RunFile, RunHeader, Simulation};

use crate::error::{MishandleError, problem};
use crate::inspect::explanation::trace;
use crate::run::violation::{Violation, violation};
use crate::run::{FailureCause, Isolation, has_random_rows, isolation, recorded_axis};

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
    /// The axes that stayed off nominal when the failure was moved toward it; `None` if it was not.
    pub cause: Option<FailureCause>,
}

/// Failures with the same decisive predicate at similar times that the same axes cause, in the same
/// direction. Failures without a known cause are connected by neighbors in the space: see
/// [`group_failures`].
#[derive(Clone, Debug, PartialEq)]
pub struct FailureMode {
    /// The failures, the representative first, in order of their distance from nominal.
    pub failures: Vec<Failure>,
    /// Smallest and largest value of each axis; `None` for an axis that is drawn at random.
    pub region: Vec<Option<(f64, f64)>>,
    /// Smallest and largest [`Failure::sample`].
    pub samples: (usize, usize),
    /// Indices of the axes by which failures with this predicate were grouped: those that cause
    /// them, if that `is_isolated`. Otherwise all of at most two axes, and of more axes those along
    /// which failures are distributed differently from other random scenarios; there may be none.
    pub axes: Vec<usize>,
    /// Whether each failure was moved toward nominal, and the same axes stayed.
    pub is_isolated: bool,
}

impl FailureMode {
    /// Returns the failure that is closest to the nominal scenario, of those that fail with most
    /// seeds if that is known.
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

impl FailureModes {
    /// Returns whether a failure of a space with these axes is in another mode than a simulation,
    /// given by its trial and number: the nearest failure with its predicate, time and categories
    /// is. Modes that their causes tell apart have no place in the space.
    pub(crate) fn tells_apart(
        &self,
        simulation: (u32, u32),
        axes: &[Axis],
        episode_steps: usize,
        failure: &FailurePoint,
    ) -> bool {
        let is_own =
            |mode: &&FailureMode| mode.failures.iter().any(|own| (own.trial, own.number) == simulation);
        let nearest = |mode: &FailureMode| {
            let near = |known: &Failure| {
                mode_distance(axes, &mode.axes, episode_steps, &point(axes, known), failure)
            };
            mode.failures.iter().filter_map(near).fold(f64::INFINITY, f64::min)
        };
        let Some(own) = self.modes.iter().find(is_own) else { return false };
        let others = self.modes.iter().filter(|mode| !mode.is_isolated && !is_own(mode));
        !own.is_isolated && others.map(nearest).fold(f64::INFINITY, f64::min) < nearest(own)
    }
}

/// Groups the failures of a run by decisive predicate, time and cause. Failures that were not moved
/// toward nominal are grouped by region: see [`group_failures`].
///
/// # Errors
/// If the run cannot be read, or the formula has no finite value on a recorded trace.
pub fn failure_modes(run: &RunFile) -> Result<FailureModes, MishandleError> {
    let header = run.header();
    let axes: Vec<Axis> = header.axes.iter().map(recorded_axis).collect();
    let mut failures = Vec::new();
    let mut all = 0;
    let mut not_grouped = 0;
    let mut failing = Vec::new();
    let mut others = Vec::new();
    let mut causes: BTreeMap<u32, Option<Isolation>> = BTreeMap::new();
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
        let isolation = match causes.entry(trial) {
            Entry::Vacant(entry) => entry.insert(isolation(run, trial)?).as_ref(),
            // Only the first failure of a trial is moved toward nominal.
            Entry::Occupied(_) => None,
        };
        let mut found = failure(header, &axes, simulation)?;
        if let Some(isolation) = isolation {
            let cause = isolation.cause();
            let closest = run.simulation(isolation.closest.trial, isolation.closest.number)?;
            if let Some(trace) = closest.trace.map(|stored| trace(header, &stored)) {
                Signature { predicate: found.predicate, sample: found.sample } =
                    violation(header, &trace)?.signature;
            }
            found.cause = Some(cause);
        }
        failures.push(found);
    }
    // Points that a search chose do not tell which axes matter.
    if !has_random_rows(header) {
        others.clear();
    }
    let (isolated, near): (Vec<Failure>, Vec<Failure>) =
        failures.into_iter().partition(|failure| failure.cause.is_some());
    let steps = header.episode_steps as usize;
    let mut modes = Vec::new();
    // Without axes, predicate and time alone decide. The cause is a part of the predicate.
    let points: Vec<FailurePoint> = isolated.iter().map(caused_point).collect();
    for group in group_failures(&points, &[], &[], steps) {
        let members: Vec<Failure> = group.failures.iter().map(|index| isolated[*index].clone()).collect();
        let caused = members[0].cause.as_ref().map_or(Vec::new(), |cause| cause.axes.clone());
        modes.push(mode(members, &caused, axes.len()));
    }
    let points: Vec<FailurePoint> = near.iter().map(|failure| point(&axes, failure)).collect();
    for group in group_failures(&points, &others, &axes, steps) {
        let members = group.failures.iter().map(|index| near[*index].clone()).collect();
        modes.push(mode(members, &group.axes, axes.len()));
    }
    // Stable, so modes of equal size stay in the order of their first failure.
    modes.sort_by_key(|mode| std::cmp::Reverse(mode.failures.len()));
    Ok(FailureModes { modes, failures: all, not_grouped })
}

/// Returns what decides the mode of a failure with a known cause.
fn caused_point(failure: &Failure) -> FailurePoint {
    let cause = failure.cause.as_ref().map(|cause| (&cause.axes, &cause.sides));
    let predicate = format!("{} {cause:?}", failure.predicate);
    FailurePoint { point: Vec::new(), signature: Signature { predicate, sample: failure.sample } }
}

/// Returns the error of a simulation without a robustness.
pub(crate) fn nothing_to_explain(simulation: &Simulation) -> MishandleError {
    let Simulation { trial, number, reason, .. } = simulation;
    let reason = if reason.is_empty() { String::new() } else { format!("\nit ended because: {reason}") };
    let text = "has no robustness, so there is nothing to explain; choose another one";
    problem(format!("simulation {number} of trial {trial} {text}{reason}"))
}

fn failure(header: &RunHeader, axes: &[Axis], simulation: Simulation) -> Result<Failure, MishandleError> {
    let trace = simulation.trace.as_ref().map(|stored| trace(header, stored));
    let Some(trace) = trace else {
        return Err(nothing_to_explain(&simulation));
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
        cause: None,
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
        let low = values().reduce(f64::min)?;
        let high = values().reduce(f64::max)?;
        Some((low, high))
    };
    let region = (0..axes).map(region).collect();
    let first = failures.iter().map(|failure| failure.sample).min().unwrap_or(0);
    let last = failures.iter().map(|failure| failure.sample).max().unwrap_or(0);
    // A failure that its seed caused explains nothing, however near it is.
    let is_chance = |failure: &Failure| {
        failure.cause.as_ref().and_then(|cause| cause.failing_seeds).is_some_and(|share| share < 0.5)
    };
    failures.sort_by(|a, b| {
        is_chance(a).cmp(&is_chance(b)).then(a.distance_from_nominal.total_cmp(&b.distance_from_nominal))
    });
    let is_isolated = failures.iter().all(|failure| failure.cause.is_some());
    FailureMode { failures, region, samples: (first, last), axes: chosen.to_vec(), is_isolated }
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
