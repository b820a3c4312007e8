//! The verdict of a requirement for a controller, with its evidence.

use mishandle_falsification::FalsificationError;
use mishandle_results as results;
use mishandle_results::{CheckCell, CheckCounterexample, CheckedValue, Number};
use mishandle_rollout::{Request, Scenario, Seed};
use mishandle_store::{AxisRecord, RunFile, Simulation};
use mishandle_text::path_text;

use super::checker::{Asked, Checker};
use super::folder::{counterexample_file, create_folder, write};
use super::row::Row;
use super::violation::{moved_files, replay};
use crate::counterexample::Counterexample;
use crate::error::MishandleError;
use crate::portable::copy_target;
use crate::resolve::{ResolvedPlan, is_python};

/// End of the evidence of a violation that was not found again.
pub(super) const NOT_REPRODUCED: &str =
    "; simulated again, the counterexample satisfies it: the system is not deterministic";

impl Checker<'_> {
    /// Returns the cell of a requirement, and writes its counterexample.
    pub(super) fn cell(&self, asked: &Asked<'_>, row: &Row) -> Result<CheckCell, MishandleError> {
        let limit = asked.written.check.max_failure_rate;
        let mut cell = row.cell(&self.plan.controller, &asked.missing, limit);
        let Some(alone) = &asked.alone else { return Ok(cell) };
        if let (Some((path, trial, number)), true) = (&row.worst, row.violated() > 0) {
            let run = RunFile::open_unchecked(path)?;
            let recorded = run.simulation(*trial, *number)?;
            let (counterexample, is_reproduced) =
                self.counterexample(asked, alone, &run, &recorded, cell.minimum_robustness)?;
            if !is_reproduced {
                cell.evidence += NOT_REPRODUCED;
            }
            cell.counterexample = Some(counterexample);
        }
        Ok(cell)
    }

    /// Describes a violation and writes it to a file. Also returns whether it happened again.
    fn counterexample(
        &self,
        asked: &Asked<'_>,
        alone: &ResolvedPlan,
        run: &RunFile,
        recorded: &Simulation,
        robustness: Option<Number>,
    ) -> Result<(CheckCounterexample, bool), MishandleError> {
        let trial = recorded.trial;
        let number = recorded.number;
        let value = |(axis, value): (&AxisRecord, &Option<f64>)| CheckedValue {
            axis: axis.name.clone(),
            unit: axis.unit.clone(),
            value: *value,
            nominal: axis.nominal,
        };
        let header = run.header();
        let mut found = CheckCounterexample {
            run: path_text(run.path()),
            trial,
            simulation: number,
            seed: results::Seed(recorded.seed),
            scenario: header.axes.iter().zip(&recorded.scenario).map(value).collect(),
            robustness: robustness.unwrap_or_default(),
            file: None,
            physics: None,
            replay: String::new(),
        };
        found.replay = (self.words)(&replay(&header.target.kind, &found, Vec::new()));
        let scenario = Scenario::new(recorded.scenario.clone());
        let request = Request { trial, number, ..Request::new(scenario, Seed(recorded.seed)) };
        let mut counterexample = match Counterexample::simulate(alone, request) {
            Err(MishandleError::Falsification(FalsificationError::NotACounterexample { .. })) => {
                return Ok((found, false));
            }
            counterexample => counterexample?,
        };
        counterexample.physics = counterexample.check_physics(alone)?;
        found.physics.clone_from(&counterexample.physics);
        let path = counterexample_file(self.folder, &self.label, &asked.written.name);
        create_folder(path.parent().unwrap_or(self.folder))?;
        write(&path, counterexample.to_json().as_bytes())?;
        found.file = Some(path_text(&path));
        if !is_python(&header.target.kind) {
            // A target file is looked up beside the counterexample, with its files. If they cannot
            // be there, the command names their places.
            let _ = copy_target(&alone.plan, path.parent().unwrap_or(self.folder));
            let moved = moved_files(&path, &counterexample.plan, header)?;
            found.replay = (self.words)(&replay(&header.target.kind, &found, moved));
        }
        Ok((found, true))
    }
}
