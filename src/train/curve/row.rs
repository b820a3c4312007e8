use csv::StringRecord;
use mishandle_training::{PartValidation, Rates, TimeShares, TrainingProgress, Validation};

use crate::error::CurveProblem;

/// Names of the columns of every curve; one column per reward term follows.
pub(super) const COLUMNS: [&str; 15] = [
    "iteration",
    "environment_steps",
    "wall_clock_secs",
    "mean_return",
    "mean_episode_steps",
    "terminated_rate",
    "success_rate",
    "strict_success_rate",
    "validation_return",
    "kl",
    "entropy",
    "learning_rate",
    "physics_share",
    "inference_share",
    "learning_share",
];

/// Columns between these and those of the reward terms, in the curve of a training run on
/// scenarios.
pub(super) const SCENARIO_COLUMNS: [&str; 6] = [
    "space_success_rate",
    "space_strict_success_rate",
    "space_return",
    "corners_success_rate",
    "corners_strict_success_rate",
    "corners_return",
];

/// Columns after these, in the curve of a training run with a curriculum.
pub(super) const CURRICULUM_COLUMNS: [&str; 4] =
    ["scenario_share", "share_success_rate", "share_strict_success_rate", "share_return"];

/// Prefix of the column of a reward term.
pub(super) const REWARD: &str = "reward_";

/// Progress of a training run after an iteration: a row of its [`Curve`](super::Curve).
///
/// The quantities are those of [`TrainingProgress`]; `None` if not measured.
#[derive(Clone, Debug, PartialEq)]
pub struct CurveRow {
    /// Number of completed iterations.
    pub iteration: u64,
    /// Number of environment steps so far: control steps times environments.
    pub environment_steps: u64,
    /// Wall-clock time so far, including the runs that this one resumes, s.
    pub wall_clock_secs: f64,
    /// Mean undiscounted return of the episodes that ended in this iteration; `None` if no episode
    /// ended.
    pub mean_return: Option<f64>,
    /// Mean length of these episodes in control steps.
    pub mean_episode_steps: Option<f64>,
    /// Fraction of these episodes that the task terminated.
    pub terminated_rate: Option<f64>,
    /// Share of the range of each axis from which new episodes drew; `None` without a curriculum.
    pub scenario_share: Option<f64>,
    /// Validation of this iteration, if there was one.
    pub validation: Option<Validation>,
    /// Mean Kullback-Leibler divergence of the new policy from the old one.
    pub kl: Option<f64>,
    /// Entropy of the policy.
    pub entropy: Option<f64>,
    /// Learning rate of the policy.
    pub learning_rate: f64,
    /// Time shares of this iteration.
    pub time_shares: TimeShares,
    /// Mean of each reward term per control step in this iteration.
    pub reward_terms: Vec<f64>,
}

impl From<&TrainingProgress> for CurveRow {
    fn from(progress: &TrainingProgress) -> CurveRow {
        CurveRow {
            iteration: progress.iteration,
            environment_steps: progress.environment_steps,
            wall_clock_secs: progress.wall_clock_secs,
            mean_return: progress.mean_return,
            mean_episode_steps: progress.mean_episode_steps,
            terminated_rate: progress.terminated_rate,
            scenario_share: progress.scenario_share,
            validation: progress.validation.filter(|_| progress.validation_is_fresh),
            kl: progress.kl,
            entropy: progress.entropy,
            learning_rate: progress.learning_rate,
            time_shares: progress.time_shares,
            reward_terms: progress.reward_terms.clone(),
        }
    }
}

impl CurveRow {
    /// Returns the number of control steps per environment.
    pub fn control_steps(&self, environments: usize) -> u64 {
        self.environment_steps / environments as u64
    }

    /// Returns the cells, in the order of the columns. Numbers round-trip exactly, except for
    /// times, which are rounded.
    pub(super) fn cells(&self, has_scenarios: bool, has_curriculum: bool) -> Vec<String> {
        let optional = |number: Option<f64>| number.map_or(String::new(), |number| number.to_string());
        let validation = |rate: fn(&Validation) -> f64| optional(self.validation.as_ref().map(rate));
        let share = |share: f64| format!("{share:.4}");
        let mut cells = vec![
            self.iteration.to_string(),
            self.environment_steps.to_string(),
            secs_cell(self.wall_clock_secs),
            optional(self.mean_return),
            optional(self.mean_episode_steps),
            optional(self.terminated_rate),
            validation(|validation| validation.success_rate),
            validation(|validation| validation.strict_success_rate),
            validation(|validation| validation.mean_return),
            optional(self.kl),
            optional(self.entropy),
            self.learning_rate.to_string(),
            share(self.time_shares.physics),
            share(self.time_shares.inference),
            share(self.time_shares.learning),
        ];
        let part_cells = |part: fn(&Validation) -> Option<Rates>| {
            let rates = self.validation.as_ref().and_then(part);
            let rate = |rate: fn(&Rates) -> f64| optional(rates.as_ref().map(rate));
            [
                rate(|rates| rates.success_rate),
                rate(|rates| rates.strict_success_rate),
                rate(|rates| rates.mean_return),
            ]
        };
        if has_scenarios {
            cells.extend(part_cells(|validation| validation.space));
            cells.extend(part_cells(|validation| validation.corners));
        }
        if has_curriculum {
            cells.push(optional(self.scenario_share));
            cells.extend(part_cells(|validation| validation.part.map(|part| part.rates)));
        }
        cells.extend(self.reward_terms.iter().map(f64::to_string));
        cells
    }

    /// Reads a row from a line of a file with these columns. The record has one cell per column.
    pub(super) fn read(
        columns: &StringRecord,
        record: &StringRecord,
        line: &dyn Fn() -> u64,
    ) -> Result<CurveRow, CurveProblem> {
        let mut cells = Cells { columns, record, line, next: 0 };
        let mut row = CurveRow {
            iteration: cells.count()?,
            environment_steps: cells.count()?,
            wall_clock_secs: cells.number()?,
            mean_return: cells.optional()?,
            mean_episode_steps: cells.optional()?,
            terminated_rate: cells.optional()?,
            scenario_share: None,
            validation: cells.rates()?.map(Validation::of_starts),
            kl: cells.optional()?,
            entropy: cells.optional()?,
            learning_rate: cells.number()?,
            time_shares: TimeShares {
                physics: cells.number()?,
                inference: cells.number()?,
                learning: cells.number()?,
            },
            reward_terms: Vec::new(),
        };
        if has_scenario_columns(columns) {
            let space = cells.rates()?;
            let corners = cells.rates()?;
            row.validation = row.validation.map(|starts| Validation { space, corners, ..starts });
        }
        if has_curriculum_columns(columns) {
            row.scenario_share = cells.optional()?;
            let part = cells.rates()?.zip(row.scenario_share);
            let part = part.map(|(rates, share)| PartValidation { share, rates });
            row.validation = row.validation.map(|validation| Validation { part, ..validation });
        }
        row.reward_terms = (cells.next..columns.len()).map(|_| cells.number()).collect::<Result<_, _>>()?;
        Ok(row)
    }
}

/// Returns whether a curve has the columns of a training run on scenarios.
pub(super) fn has_scenario_columns(columns: &StringRecord) -> bool {
    columns.get(COLUMNS.len()) == Some(SCENARIO_COLUMNS[0])
}

/// Returns whether a curve has the columns of a curriculum.
pub(super) fn has_curriculum_columns(columns: &StringRecord) -> bool {
    let before = if has_scenario_columns(columns) { SCENARIO_COLUMNS.len() } else { 0 };
    columns.get(COLUMNS.len() + before) == Some(CURRICULUM_COLUMNS[0])
}

/// Formats seconds with the nanosecond resolution of the clock, so that the times identify a
/// training run.
pub(super) fn secs_cell(secs: f64) -> String {
    format!("{secs:.9}")
}

/// Cells of a line, read one after the other.
struct Cells<'a> {
    columns: &'a StringRecord,
    record: &'a StringRecord,
    line: &'a dyn Fn() -> u64,
    next: usize,
}

impl Cells<'_> {
    fn take(&mut self) -> &str {
        self.next += 1;
        &self.record[self.next - 1]
    }

    /// Returns the error for the cell read last.
    fn wrong(&self, expected: &'static str) -> CurveProblem {
        CurveProblem::Cell {
            line: (self.line)(),
            column: self.columns[self.next - 1].to_string(),
            found: self.record[self.next - 1].to_string(),
            expected,
        }
    }

    fn count(&mut self) -> Result<u64, CurveProblem> {
        self.take().parse().map_err(|_| self.wrong("a whole number"))
    }

    fn number(&mut self) -> Result<f64, CurveProblem> {
        let number = self.take().parse().ok().filter(|number: &f64| number.is_finite());
        number.ok_or_else(|| self.wrong("a finite number"))
    }

    /// Reads a measured quantity; it is NaN or infinite in a run that diverges.
    fn optional(&mut self) -> Result<Option<f64>, CurveProblem> {
        match self.take() {
            "" => Ok(None),
            cell => cell.parse().map(Some).map_err(|_| self.wrong("a number or an empty cell")),
        }
    }

    fn rates(&mut self) -> Result<Option<Rates>, CurveProblem> {
        match (self.optional()?, self.optional()?, self.optional()?) {
            (Some(success_rate), Some(strict_success_rate), Some(mean_return)) => {
                Ok(Some(Rates { success_rate, strict_success_rate, mean_return }))
            }
            (None, None, None) => Ok(None),
            _ => Err(self.wrong("a number beside both success rates, or three empty cells")),
        }
    }
}
