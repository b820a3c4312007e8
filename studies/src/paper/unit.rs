//! Units: the parts of a run that can be run again by themselves, each with a summary and a digest.

use mishandle::evaluation::FormulaRoles;
use mishandle::run::{metric_counter, recorded_episode};
use mishandle::store::{Simulation, SimulationEnd, TrialRecord, TrialStatus};
use mishandle::{Plan, ResolvedPlan};
use sha2::{Digest, Sha256};

use crate::paper::PaperError;

/// Number of simulations of a unit of an evaluation.
pub const UNIT_OF_EVALUATION: u32 = 100;

/// Number of verdicts that a digest covers: success, strict success, dangerous steps and completion
/// step.
const VERDICTS: usize = 4;

/// A trial of a falsification, or a hundred simulations of an evaluation.
#[derive(Clone, Debug, PartialEq)]
pub struct Unit {
    /// Number of the trial. Trial 1 of an evaluation has its random simulations, trial 2 those of
    /// the corners.
    pub trial: u32,
    /// Number of its first simulation.
    pub first: u32,
    /// Number of simulations; 0 for a trial that has just started.
    pub simulations: u32,
    /// Seed of the trial.
    pub seed: u64,
    /// Status of the trial.
    pub status: TrialStatus,
    /// Number of simulations with a negative robustness.
    pub violations: u32,
    /// Number of simulations that ended as soon as they met the formula. Their robustness is a
    /// bound.
    pub stopped: u32,
    /// Smallest robustness of the simulations that were not stopped.
    pub lowest: Option<f64>,
    /// Largest robustness of the simulations that were not stopped.
    pub highest: Option<f64>,
    /// The counts of an evaluation.
    pub evaluated: Option<Evaluated>,
    /// SHA-256 of the rows.
    pub sha256: String,
}

/// Counts and sums of simulations of an evaluation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Evaluated {
    /// Number of simulations that the success rate counts.
    pub started: u64,
    /// Number of successes.
    pub successes: u64,
    /// Number of simulations that the dangerous behavior rate counts.
    pub dangerous_n: u64,
    /// Sum of their fractions of dangerous steps.
    pub dangerous_sum: f64,
    /// Number of simulations that the completion time counts.
    pub completed: u64,
    /// Sum of their completion steps.
    pub completion_sum: f64,
}

impl Unit {
    /// Returns the units of a trial from all its simulations.
    pub fn of_trial(plan: &Plan, trial: &TrialRecord, simulations: &[Simulation]) -> Vec<Unit> {
        if simulations.is_empty() || plan.evaluate.is_none() {
            return vec![Unit::new(plan, trial, 1, simulations)];
        }
        let hundreds = simulations.chunks(UNIT_OF_EVALUATION as usize);
        let firsts = (1..).step_by(UNIT_OF_EVALUATION as usize);
        firsts.zip(hundreds).map(|(first, rows)| Unit::new(plan, trial, first, rows)).collect()
    }

    fn new(plan: &Plan, trial: &TrialRecord, first: u32, simulations: &[Simulation]) -> Unit {
        let count = |is_counted: fn(&Simulation) -> bool| {
            simulations.iter().filter(|row| is_counted(row)).count() as u32
        };
        let values = || simulations.iter().filter(|row| !is_stopped(row)).filter_map(|row| row.robustness);
        let is_evaluation = plan.evaluate.is_some();
        Unit {
            trial: trial.number,
            first,
            simulations: simulations.len() as u32,
            seed: trial.seed,
            status: trial.status,
            violations: count(Simulation::is_violated),
            stopped: count(is_stopped),
            lowest: values().reduce(f64::min),
            highest: values().reduce(f64::max),
            evaluated: is_evaluation.then(|| Evaluated::of(plan, simulations)),
            sha256: digest(simulations, is_evaluation),
        }
    }

    /// Runs the unit again. Returns `None` if the plan has no such unit.
    ///
    /// # Errors
    /// If a simulation cannot be run.
    pub fn run_again(&self, resolved: &ResolvedPlan) -> Result<Option<Unit>, PaperError> {
        let plan = &resolved.plan;
        if plan.evaluate.is_some() {
            let last = self.first.saturating_add(UNIT_OF_EVALUATION - 1);
            let rows = mishandle::run::run_simulations(resolved, self.trial, self.first..=last)?;
            let status = TrialStatus::BudgetSpent;
            let trial = TrialRecord { number: self.trial, seed: plan.seed, status };
            return Ok((!rows.is_empty()).then(|| Unit::new(plan, &trial, self.first, &rows)));
        }
        let found = mishandle::run::run_trial(resolved, self.trial)?;
        Ok(found.map(|(trial, rows)| Unit::new(plan, &trial, 1, &rows)))
    }

    /// Lists the columns in which another result of the same unit differs.
    pub fn differences(&self, again: &Unit) -> Vec<String> {
        // The text of a float has all digits and the sign of a zero.
        let float = |value: &Option<f64>| value.map_or("none".to_string(), |value| value.to_string());
        let parts = |unit: &Unit| {
            let Unit { simulations, seed, status, violations, stopped, lowest, highest, .. } = unit;
            [
                ("simulations", simulations.to_string()),
                ("seed", seed.to_string()),
                ("status", format!("{status:?}")),
                ("violations", violations.to_string()),
                ("stopped", stopped.to_string()),
                ("lowest robustness", float(lowest)),
                ("highest robustness", float(highest)),
                ("counts", format!("{:?}", unit.evaluated)),
                ("SHA-256", unit.sha256.clone()),
            ]
        };
        let pairs = parts(self).into_iter().zip(parts(again));
        pairs
            .filter(|(recorded, again)| recorded != again)
            .map(|((what, recorded), (_, again))| format!("{what}: recorded {recorded}, now {again}"))
            .collect()
    }
}

impl Evaluated {
    fn of(plan: &Plan, simulations: &[Simulation]) -> Evaluated {
        let mut counter = metric_counter(plan, FormulaRoles::default());
        simulations.iter().for_each(|row| counter.add(&recorded_episode(row)));
        let fractions = counter.dangerous_fractions();
        let steps = counter.completion_steps();
        Evaluated {
            started: counter.started(),
            successes: counter.successes(),
            dangerous_n: fractions.len() as u64,
            dangerous_sum: fractions.iter().sum(),
            completed: steps.len() as u64,
            completion_sum: steps.iter().sum(),
        }
    }
}

fn is_stopped(row: &Simulation) -> bool {
    matches!(row.end, SimulationEnd::Stopped { .. })
}

/// Returns the SHA-256 of the rows as text: see [`row_text`].
fn digest(simulations: &[Simulation], is_evaluation: bool) -> String {
    let mut digest = Sha256::new();
    simulations.iter().for_each(|row| digest.update(row_text(row, is_evaluation)));
    digest.finalize().iter().map(|byte| format!("{byte:02x}")).collect()
}

/// Returns a simulation as a line of text: trial, number, seed, robustness, name, step and index of
/// the end, control steps, the values of the scenario, and for an evaluation four verdicts. A float
/// has the shortest text with the same bits; a missing value is empty.
fn row_text(row: &Simulation, is_evaluation: bool) -> String {
    let float =
        |value: Option<f64>| value.filter(|value| !value.is_nan()).map_or(String::new(), |v| v.to_string());
    let integer = |value: Option<u32>| value.map_or(String::new(), |value| value.to_string());
    let mut cells = vec![
        row.trial.to_string(),
        row.number.to_string(),
        row.seed.to_string(),
        float(row.robustness),
        row.end.name().to_string(),
        integer(row.end.step()),
        integer(index(row.end)),
        row.steps.to_string(),
    ];
    cells.extend(row.scenario.iter().copied().map(float));
    // The only verdict that a falsification uses is its robustness.
    let verdicts = if is_evaluation { VERDICTS } else { 0 };
    cells.extend(row.verdicts.iter().take(verdicts).copied().map(float));
    cells.join(",") + "\n"
}

/// Returns the index of the invalid value that ended a simulation.
fn index(end: SimulationEnd) -> Option<u32> {
    use SimulationEnd as End;
    match end {
        End::InvalidAction { index, .. }
        | End::InvalidObservation { index, .. }
        | End::InvalidReward { index, .. }
        | End::InvalidSignal { index, .. } => Some(index),
        _ => None,
    }
}
