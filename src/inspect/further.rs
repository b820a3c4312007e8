use std::ops::ControlFlow;
use std::path::Path;

use mishandle_results::{Answer, Falsification};
use mishandle_store::{Finding, RunFile, RunWriter, StoreError};

use crate::error::MishandleError;
use crate::inspect::mode_survey;
use crate::inspect::physics::check_physics;
use crate::inspect::smooth_region::smooth_region_of;
use crate::plan::ReportSettings;
use crate::resolve::ResolvedPlan;
use crate::run::{counterexample_repeats, repeats_finding};

/// A part of the simulations of [`further`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FurtherPart {
    /// The checks of the physics of the counterexamples.
    Physics,
    /// The repeats of the counterexamples with other seeds.
    Repeats,
    /// The samples of the smooth region again.
    Region,
}

/// Adds to the answer of a falsification what takes its rows or further simulations: the failure
/// modes of one that keeps going, and of a complete one the checks of the physics of its
/// counterexamples, their repeats and, if the settings ask for it, the smooth region. It does not
/// change other answers. The run file gets what the checks and repeats say, so that whoever reads
/// it names the same cause; what it has is not simulated again.
///
/// The run file must be closed. `watch` gets the number of finished simulations of a part and of
/// all, and can end them. It gets the largest number of simulations that check the physics before
/// the first of them.
///
/// # Errors
/// If a simulation cannot be run, or the run file cannot be read or written.
pub fn further(
    resolved: &ResolvedPlan,
    answer: &mut Answer,
    settings: &ReportSettings,
    watch: impl FnMut(FurtherPart, u64, u64) -> ControlFlow<()>,
) -> Result<(), MishandleError> {
    complete(resolved, answer, settings, watch, |path, findings| {
        let mut run = RunWriter::resume_unchecked(path)?;
        run.record_findings(findings)?;
        run.close()
    })
}

/// Does what [`further`] does, and leaves the run file as it is.
///
/// # Errors
/// If a simulation cannot be run, or the run file cannot be read.
pub fn further_unrecorded(
    resolved: &ResolvedPlan,
    answer: &mut Answer,
    settings: &ReportSettings,
    watch: impl FnMut(FurtherPart, u64, u64) -> ControlFlow<()>,
) -> Result<(), MishandleError> {
    complete(resolved, answer, settings, watch, |_, _| Ok(()))
}

fn complete(
    resolved: &ResolvedPlan,
    answer: &mut Answer,
    settings: &ReportSettings,
    mut watch: impl FnMut(FurtherPart, u64, u64) -> ControlFlow<()>,
    record: impl Fn(&Path, &[Finding]) -> Result<(), StoreError>,
) -> Result<(), MishandleError> {
    let Answer::Falsification(found) = answer else { return Ok(()) };
    let Some(path) = found.run.clone() else { return Ok(()) };
    let path = Path::new(&path);
    let mut check = |found: &mut Falsification| -> Result<(), MishandleError> {
        if !found.is_complete {
            return Ok(());
        }
        let run = RunFile::open_unchecked(path)?;
        let watch = &mut |done, all| watch(FurtherPart::Physics, done, all);
        let findings = check_physics(resolved, found, &run, watch)?;
        drop(run);
        if !findings.is_empty() {
            record(path, &findings)?;
        }
        Ok(())
    };
    check(found)?;
    if resolved.plan.falsify.as_ref().is_some_and(|falsify| falsify.keep_going) {
        // After the checks, which decide the causes by which the failures are grouped.
        let run = RunFile::open_unchecked(path)?;
        found.modes = Some(mode_survey(&run)?.result(&run)?);
        drop(run);
        check(found)?;
    }
    if found.is_complete {
        let watch_repeats = |done, all| watch(FurtherPart::Repeats, done, all);
        let repeats = Some(settings.repeats.into());
        let repeated = counterexample_repeats(resolved, found, repeats, watch_repeats)?;
        let mut findings = Vec::new();
        for trial in &mut found.trials {
            let Some(repeats) = repeated.get(&trial.trial) else { continue };
            let place = trial.simulation.map(|simulation| (trial.trial, simulation));
            findings.extend(place.and_then(|place| repeats_finding(place, repeats)));
            trial.repeats = Some(repeats.clone());
        }
        if !findings.is_empty() {
            record(path, &findings)?;
        }
        if settings.smooth_region && found.screening.is_none() {
            let watch = |done, all| watch(FurtherPart::Region, done, all);
            found.smooth_region = smooth_region_of(resolved, found, path, watch)?;
        }
    }
    Ok(())
}
