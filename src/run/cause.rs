//! The axes that cause the failure of a counterexample, from the simulations that moved it toward
//! nominal.

use mishandle_evaluation::{Estimate, failure_rate};
use mishandle_falsification::{Survivor, distance, inside_bounds, is_inside_of, off_nominal, on_bounds};
use mishandle_results::{Cause, CheckedFailure, PhysicsCheck, Violation};
use mishandle_rollout::{Axis, AxisValues, Request, Scenario, Seed, Space};
use mishandle_store::{RunFile, RunHeader, Simulation};

use crate::error::MishandleError;
use crate::resolve::named_scenario;
use crate::run::findings::recorded_survivor;
use crate::run::recorded_axis;
use crate::run::violation::recorded_violation;

/// The cause of a failure: the scenario that it becomes when it moves toward nominal.
#[derive(Clone, Debug, PartialEq)]
pub struct FailureCause {
    /// Indices of the axes off nominal.
    pub axes: Vec<usize>,
    /// Their values: below (-1) or above (1) nominal, or the category.
    pub sides: Vec<i64>,
    /// Share of simulations with other seeds that fail; `None` if the target is not random.
    pub failing_seeds: Option<f64>,
    /// Trial and number of the failure with these axes off nominal: the minimal one.
    pub minimal: (u32, u32),
}

/// The simulations that move a counterexample toward nominal.
#[derive(Clone, Debug)]
pub(crate) struct Isolation {
    /// The failing simulation with the fewest axes off nominal, and of these the closest to
    /// nominal: the counterexample itself if no other fails.
    pub(crate) closest: Simulation,
    /// Indices of its axes that are off nominal.
    pub(crate) axes: Vec<usize>,
    /// The failing simulations from `closest` to the counterexample, the ones nearer to nominal
    /// first.
    failing: Vec<Simulation>,
    /// Which of these survives the checks of the physics; `None` without checks.
    survivor: Option<Survivor>,
    original: Simulation,
    rows: Vec<Simulation>,
    space: Space,
}

/// Returns the simulations that move the counterexample of a trial toward nominal; `None` if there
/// are none. The closest failure is the one that survives the recorded checks of the physics.
///
/// # Errors
/// If the run cannot be read.
pub(crate) fn isolation(run: &RunFile, trial: u32) -> Result<Option<Isolation>, MishandleError> {
    let rows = run.derived_simulations(trial).collect::<Result<Vec<Simulation>, _>>()?;
    if rows.is_empty() {
        return Ok(None);
    }
    let mut original = None;
    for simulation in run.trial_simulations(trial) {
        let simulation = simulation?;
        if simulation.is_violated() {
            original = Some(simulation);
            break;
        }
    }
    let Some(original) = original else { return Ok(None) };
    let isolation = isolation_of(run.header(), original, rows)?;
    Ok(Some(match recorded_survivor(run, &isolation.failing)? {
        Some(survivor) => isolation.checked(survivor),
        None => isolation,
    }))
}

/// Returns what the simulations `rows` say that moved the failure `original` of a run with this
/// header toward nominal.
///
/// # Errors
/// If the axes of the header are invalid.
pub(crate) fn isolation_of(
    header: &RunHeader,
    original: Simulation,
    rows: Vec<Simulation>,
) -> Result<Isolation, MishandleError> {
    let axes: Vec<Axis> = header.axes.iter().map(recorded_axis).collect();
    let space = Space::new(&header.space, axes)?;
    let off = |simulation: &Simulation| off_nominal(&space, &Scenario::new(simulation.scenario.clone()));
    let order = |simulation: &Simulation| {
        (off(simulation).len(), distance(&space, &Scenario::new(simulation.scenario.clone())))
    };
    let scenario = |simulation: &Simulation| Scenario::new(simulation.scenario.clone());
    // What other seeds say is true of the scenario that has them.
    let repeated = rows.iter().find(|row| row.seed != original.seed).map(scenario);
    let is_repeated = |row: &&Simulation| repeated.as_ref().is_none_or(|at| at.is_same(&scenario(row)));
    let mut failing: Vec<&Simulation> = rows.iter().filter(|row| row.seed == original.seed).collect();
    failing.push(&original);
    failing.retain(|row| row.is_violated());
    // A simulation inside of a bound only says how exact the bound must be.
    let is_inside =
        |row: &Simulation| failing.iter().any(|other| is_inside_of(&space, &scenario(row), &scenario(other)));
    let compare = |a: &&Simulation, b: &&Simulation| {
        let a = order(a);
        let b = order(b);
        a.0.cmp(&b.0).then(a.1.total_cmp(&b.1))
    };
    let mut moved: Vec<&Simulation> = failing.iter().copied().filter(|row| !is_inside(row)).collect();
    moved.sort_by(compare);
    let closest = moved.iter().copied().find(is_repeated).unwrap_or(&original).clone();
    moved.retain(|row| compare(&&closest, row).is_lt());
    let is_original = |row: &&Simulation| (row.trial, row.number) == (original.trial, original.number);
    moved.retain(|row| !is_original(row));
    let mut failing: Vec<Simulation> = std::iter::once(&closest).chain(moved).cloned().collect();
    if !is_original(&&closest) {
        failing.push(original.clone());
    }
    let axes = off(&closest);
    Ok(Isolation { closest, axes, failing, survivor: None, original, rows, space })
}

/// Returns the simulation of a row as a request.
fn request(row: &Simulation) -> Request {
    Request {
        trial: row.trial,
        number: row.number,
        ..Request::new(Scenario::new(row.scenario.clone()), Seed(row.seed))
    }
}

fn passes(row: &Simulation) -> bool {
    row.robustness.is_some() && !row.is_violated()
}

impl Isolation {
    /// Returns the axes with which `is_wanted` holds for a simulation with the seed of the
    /// counterexample and the scenario that `of` returns; `None` if one was not simulated.
    fn axes_where(
        &self,
        of: impl Fn(usize) -> Scenario,
        is_wanted: impl Fn(&Simulation) -> bool,
    ) -> Option<Vec<usize>> {
        let original = Scenario::new(self.original.scenario.clone());
        let mut found = Vec::new();
        for axis in off_nominal(&self.space, &original) {
            let scenario = of(axis);
            let is_asked = |row: &&Simulation| {
                row.seed == self.original.seed && Scenario::new(row.scenario.clone()).is_same(&scenario)
            };
            let known = [&self.original];
            let row = self.rows.iter().chain(known).find(is_asked)?;
            found.extend(is_wanted(row).then_some(axis));
        }
        Some(found)
    }

    /// Returns the axes that stay off nominal, which differ from those of other causes.
    pub(crate) fn cause(&self) -> FailureCause {
        let axes = self.space.axes();
        let side = |index: &usize| {
            let axis = &axes[*index];
            let value = self.closest.scenario[*index].unwrap_or_default();
            match axis.values {
                AxisValues::Categorical(_) => value as i64,
                _ => {
                    if value < axis.nominal.unwrap_or_default() {
                        -1
                    } else {
                        1
                    }
                }
            }
        };
        FailureCause {
            axes: self.axes.clone(),
            sides: self.axes.iter().map(side).collect(),
            failing_seeds: self.other_seeds().and_then(|estimate| estimate.value),
            minimal: (self.closest.trial, self.closest.number),
        }
    }

    /// Returns the axes that must be exactly on a bound for the closest failure.
    fn only_on_bounds(&self) -> Vec<usize> {
        let closest = Scenario::new(self.closest.scenario.clone());
        let axes = on_bounds(&self.space, &closest);
        let passes_inside = |moved: &[usize]| {
            let inside = inside_bounds(&self.space, &closest, moved);
            let is_asked = |row: &&Simulation| {
                row.seed == self.original.seed && Scenario::new(row.scenario.clone()).is_same(&inside)
            };
            self.rows.iter().find(is_asked).is_some_and(passes)
        };
        if axes.is_empty() || !passes_inside(&axes) {
            return Vec::new();
        }
        let alone: Vec<usize> = axes.iter().copied().filter(|axis| passes_inside(&[*axis])).collect();
        if alone.is_empty() { axes } else { alone }
    }

    /// Returns trial and number of the counterexample.
    pub(crate) fn original(&self) -> (u32, u32) {
        (self.original.trial, self.original.number)
    }

    /// Returns the failing simulations, from the closest one to the counterexample.
    pub(crate) fn failures(&self) -> Vec<Request> {
        self.failing.iter().map(request).collect()
    }

    /// Returns whether the physics of the closest failure was checked.
    pub(crate) fn is_checked(&self) -> bool {
        self.survivor.is_some()
    }

    /// Returns whether the closest failure is not the nearest one, which depends on the solver.
    pub(crate) fn went_back(&self) -> bool {
        self.survivor.as_ref().is_some_and(|survivor| survivor.index > 0)
    }

    /// Goes back to the survivor of [`failures`](Self::failures).
    pub(crate) fn checked(mut self, survivor: Survivor) -> Isolation {
        self.closest = self.failing[survivor.index].clone();
        self.axes = off_nominal(&self.space, &Scenario::new(self.closest.scenario.clone()));
        self.survivor = Some(survivor);
        self
    }

    /// Returns how often the closest failure fails with other seeds; `None` if they have no effect,
    /// or were tried on a failure nearer to nominal.
    fn other_seeds(&self) -> Option<Estimate> {
        if self.went_back() {
            return None;
        }
        let others = || self.rows.iter().filter(|row| row.seed != self.original.seed);
        let failures = others().filter(|row| row.is_violated()).count() as u64;
        let undecided = others().filter(|row| row.robustness.is_none()).count() as u64;
        let rate = failure_rate(failures, undecided, others().count() as u64);
        rate.value.is_some().then_some(rate)
    }

    /// Returns the findings as a result.
    ///
    /// # Errors
    /// If the run cannot be read.
    pub(crate) fn result(&self, run: &RunFile) -> Result<Cause, MishandleError> {
        Ok(self.result_with(recorded_violation(run, self.closest.trial, self.closest.number)?))
    }

    /// As [`result`](Self::result), with what is known about the violation of the closest failure.
    pub(crate) fn result_with(&self, violation: Option<Violation>) -> Cause {
        let axes = self.space.axes();
        let off = off_nominal(&self.space, &Scenario::new(self.original.scenario.clone()));
        let names = |found: Vec<usize>| found.into_iter().map(|axis| axes[axis].name.clone()).collect();
        let without_all = |left_out: &mut dyn Iterator<Item = usize>| {
            let mut scenario = self.original.scenario.clone();
            left_out.for_each(|axis| scenario[axis] = axes[axis].nominal);
            self.space.canonical(Scenario::new(scenario))
        };
        let alone = |kept: usize| {
            let kept = self.space.with_needed(kept);
            without_all(&mut off.iter().copied().filter(|axis| !kept.contains(axis)))
        };
        let without = |axis: usize| without_all(&mut std::iter::once(axis));
        let found = self.failing.len() - 1;
        let checked = |(index, physics): &(usize, PhysicsCheck)| {
            let Simulation { scenario, robustness, .. } = &self.failing[*index];
            CheckedFailure {
                scenario: named_scenario(axes, scenario),
                robustness: robustness.unwrap_or_default().into(),
                physics: physics.clone(),
            }
        };
        let checks = self.survivor.iter().flat_map(|survivor| &survivor.checked);
        Cause {
            simulations: self.rows.len() as u64,
            scenario: named_scenario(axes, &self.closest.scenario),
            robustness: self.closest.robustness.unwrap_or_default().into(),
            violation,
            axes: names(self.axes.clone()),
            sufficient: self
                .axes_where(alone, Simulation::is_violated)
                .map(|axes| names(self.space.without_dependent(&axes))),
            necessary: self.axes_where(without, passes).map(names),
            only_on_bounds: names(self.only_on_bounds()),
            other_seeds: self.other_seeds(),
            went_back: self.went_back(),
            physics: self.survivor.as_ref().map(|survivor| survivor.physics.clone()),
            checked: checks.filter(|(index, _)| *index != found).map(checked).collect(),
        }
    }
}
