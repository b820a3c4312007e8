use std::collections::BTreeMap;

use mishandle_results as results;
use mishandle_results::{Counterexamples, FirstInMode, FoundMode, Modes, Seed};
use mishandle_store::RunFile;

use crate::error::MishandleError;
use crate::inspect::{FailureMode, FailureModes, ModeSurvey};
use crate::run::{recorded_axes, recorded_named, recorded_physics, recorded_scenario};

/// Returns the failure modes of a run as a result.
///
/// # Errors
/// If the run cannot be read.
pub fn counterexamples_result(
    run: &RunFile,
    found: &FailureModes,
) -> Result<Counterexamples, MishandleError> {
    let header = run.header();
    Ok(Counterexamples {
        run: run.path().to_string_lossy().into_owned(),
        target: header.target.name.clone(),
        formula: header.formula.clone(),
        failures: found.failures as u64,
        not_grouped: found.not_grouped as u64,
        modes: modes(run, found)?,
        space_axes: recorded_axes(&header.axes),
        control_dt: header.control_dt,
    })
}

impl ModeSurvey {
    /// Returns the survey of a run as a result.
    ///
    /// # Errors
    /// If the run cannot be read.
    pub fn result(&self, run: &RunFile) -> Result<Modes, MishandleError> {
        let found = |first: &BTreeMap<u32, u32>| {
            first.iter().map(|(trial, number)| FirstInMode { trial: *trial, simulation: *number }).collect()
        };
        let modes = modes(run, &self.modes)?.into_iter().zip(&self.first);
        Ok(Modes {
            failures: self.modes.failures as u64,
            not_grouped: self.modes.not_grouped as u64,
            modes: modes.map(|(mode, first)| FoundMode { mode, found: found(first) }).collect(),
            unseen_modes: self.unseen,
            coverage: self.coverage,
        })
    }
}

fn modes(run: &RunFile, found: &FailureModes) -> Result<Vec<results::FailureMode>, MishandleError> {
    let header = run.header();
    let time = |sample: usize| sample as f64 * header.control_dt;
    let mode = |(mode, number): (&FailureMode, u64)| {
        let failure = mode.representative();
        let (first, last) = mode.samples;
        let chosen = mode.axes.iter().filter_map(|index| header.axes.get(*index));
        let region = mode.region.iter().map(|range| range.map(<[f64; 2]>::from));
        Ok(results::FailureMode {
            mode: number,
            failures: mode.failures.len() as u64,
            predicate: failure.predicate.clone(),
            samples: [first as u64, last as u64],
            times: [time(first), time(last)],
            axes: chosen.map(|axis| axis.name.clone()).collect(),
            region: recorded_named(&header.axes, region),
            trial: failure.trial,
            simulation: failure.number,
            seed: Seed(failure.seed),
            scenario: recorded_scenario(&header.axes, &failure.scenario),
            robustness: failure.robustness.into(),
            distance_from_nominal: failure.distance_from_nominal,
            physics: recorded_physics(run, (failure.trial, failure.number))?,
        })
    };
    found.modes.iter().zip(1..).map(mode).collect()
}
