use csv::StringRecord;
use mishandle_training::{Progress, Shares, Validation};

use super::CurveProblem;

/// Names of the columns that every curve has; behind them stands one for each term of the reward.
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

/// What comes before the name of a reward term in the name of its column.
pub(super) const REWARD: &str = "reward_";

/// Where a training stood after an iteration: a row of its [`Curve`](super::Curve).
///
/// Quantities are those of [`Progress`]; `None` where nothing was measured.
#[derive(Clone, Debug, PartialEq)]
pub struct CurveRow {
    /// Iterations done.
    pub iteration: u64,
    /// Environment steps done: control steps times environments.
    pub environment_steps: u64,
    /// Duration of the training so far, of resumed runs together, s.
    pub wall_clock_secs: f64,
    /// Mean sum of rewards over the episodes that ended in this iteration, if any did.
    pub mean_return: Option<f64>,
    /// Mean control steps of these episodes.
    pub mean_episode_steps: Option<f64>,
    /// Share of these episodes that the task ended.
    pub terminated_rate: Option<f64>,
    /// What this iteration's validation found, if it had one.
    pub validation: Option<Validation>,
    /// Mean Kullback-Leibler divergence of the new policy from the old one.
    pub kl: Option<f64>,
    /// Entropy of the policy.
    pub entropy: Option<f64>,
    /// Step length of the policy's optimiser.
    pub learning_rate: f64,
    /// Where the time of this iteration went.
    pub shares: Shares,
    /// Mean of each reward term per control step in this iteration.
    pub reward_terms: Vec<f64>,
}

impl From<&Progress> for CurveRow {
    fn from(progress: &Progress) -> CurveRow {
        CurveRow {
            iteration: progress.iteration,
            environment_steps: progress.environment_steps,
            wall_clock_secs: progress.wall_clock_secs,
            mean_return: progress.mean_return,
            mean_episode_steps: progress.mean_episode_steps,
            terminated_rate: progress.terminated_rate,
            validation: progress.validation.filter(|_| progress.validation_is_fresh),
            kl: progress.kl,
            entropy: progress.entropy,
            learning_rate: progress.learning_rate,
            shares: progress.shares,
            reward_terms: progress.reward_terms.clone(),
        }
    }
}

impl CurveRow {
    /// Control steps that each of as many environments had made.
    pub fn control_steps(&self, environments: usize) -> u64 {
        self.environment_steps / environments as u64
    }

    /// The cells, in the order of [`COLUMNS`]. Numbers come back to the bit, but for times: those are rounded, since
    /// no other run has the same.
    pub(super) fn cells(&self) -> Vec<String> {
        let optional = |number: Option<f64>| number.map_or(String::new(), |number| number.to_string());
        let found = |rate: fn(&Validation) -> f64| optional(self.validation.as_ref().map(rate));
        let share = |share: f64| format!("{share:.4}");
        let mut cells = vec![
            self.iteration.to_string(),
            self.environment_steps.to_string(),
            secs_cell(self.wall_clock_secs),
            optional(self.mean_return),
            optional(self.mean_episode_steps),
            optional(self.terminated_rate),
            found(|found| found.success_rate),
            found(|found| found.strict_success_rate),
            found(|found| found.mean_return),
            optional(self.kl),
            optional(self.entropy),
            self.learning_rate.to_string(),
            share(self.shares.physics),
            share(self.shares.inference),
            share(self.shares.learning),
        ];
        cells.extend(self.reward_terms.iter().map(f64::to_string));
        cells
    }

    /// The row that a line of cells holds, in a file with these columns.
    pub(super) fn read(columns: &StringRecord, record: &StringRecord) -> Result<CurveRow, CurveProblem> {
        let mut cells = Cells { columns, record, next: 0 };
        Ok(CurveRow {
            iteration: cells.count()?,
            environment_steps: cells.count()?,
            wall_clock_secs: cells.number()?,
            mean_return: cells.optional()?,
            mean_episode_steps: cells.optional()?,
            terminated_rate: cells.optional()?,
            validation: cells.validation()?,
            kl: cells.optional()?,
            entropy: cells.optional()?,
            learning_rate: cells.number()?,
            shares: Shares {
                physics: cells.number()?,
                inference: cells.number()?,
                learning: cells.number()?,
            },
            reward_terms: (COLUMNS.len()..columns.len()).map(|_| cells.number()).collect::<Result<_, _>>()?,
        })
    }
}

/// Seconds as they are written: to the nanosecond of the clock, so that no two trainings agree, however short they are.
pub(super) fn secs_cell(secs: f64) -> String {
    format!("{secs:.9}")
}

/// The cells of a line, taken one after the other.
struct Cells<'a> {
    columns: &'a StringRecord,
    record: &'a StringRecord,
    next: usize,
}

impl Cells<'_> {
    fn take(&mut self) -> &str {
        self.next += 1;
        &self.record[self.next - 1]
    }

    /// What is wrong with the cell taken last.
    fn wrong(&self, wanted: &'static str) -> CurveProblem {
        CurveProblem::Cell {
            line: line_of(self.record),
            column: self.columns[self.next - 1].to_string(),
            found: self.record[self.next - 1].to_string(),
            wanted,
        }
    }

    fn count(&mut self) -> Result<u64, CurveProblem> {
        self.take().parse().map_err(|_| self.wrong("a whole number"))
    }

    fn number(&mut self) -> Result<f64, CurveProblem> {
        let number = self.take().parse().ok().filter(|number: &f64| number.is_finite());
        number.ok_or_else(|| self.wrong("a finite number"))
    }

    /// What was measured: NaN or infinite in a training that breaks down.
    fn optional(&mut self) -> Result<Option<f64>, CurveProblem> {
        match self.take() {
            "" => Ok(None),
            cell => cell.parse().map(Some).map_err(|_| self.wrong("a number, or nothing")),
        }
    }

    fn validation(&mut self) -> Result<Option<Validation>, CurveProblem> {
        match (self.optional()?, self.optional()?, self.optional()?) {
            (Some(success_rate), Some(strict_success_rate), Some(mean_return)) => {
                Ok(Some(Validation { success_rate, strict_success_rate, mean_return }))
            }
            (None, None, None) => Ok(None),
            _ => Err(self.wrong("there with both success rates, or missing with them")),
        }
    }
}

/// The line that a record begins in, from 1.
pub(super) fn line_of(record: &StringRecord) -> u64 {
    record.position().map_or(0, csv::Position::line)
}
