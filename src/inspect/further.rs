use std::ops::ControlFlow;
use std::path::Path;

use mishandle_results::Answer;
use mishandle_store::RunFile;

use crate::error::MishandleError;
use crate::inspect::mode_survey;
use crate::inspect::physics::check_physics;
use crate::inspect::smooth_region::smooth_region_of;
use crate::plan::ReportSettings;
use crate::resolve::ResolvedPlan;
use crate::run::counterexample_repeats;

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
/// change other answers.
///
/// The run file must be closed. `watch` gets the number of finished simulations of a part and of
/// all, and can end them. It gets the largest number of simulations that check the physics before
/// the first of them.
///
/// # Errors
/// If a simulation cannot be run, or the run file cannot be read.
pub fn further(
    resolved: &ResolvedPlan,
    answer: &mut Answer,
    settings: &ReportSettings,
    mut watch: impl FnMut(FurtherPart, u64, u64) -> ControlFlow<()>,
) -> Result<(), MishandleError> {
    let Answer::Falsification(found) = answer else { return Ok(()) };
    let Some(path) = found.run.clone() else { return Ok(()) };
    let run = RunFile::open_unchecked(&path)?;
    if resolved.plan.falsify.as_ref().is_some_and(|falsify| falsify.keep_going) {
        found.modes = Some(mode_survey(&run)?.result(run.header()));
    }
    if found.is_complete {
        check_physics(resolved, found, &run, &mut |done, all| watch(FurtherPart::Physics, done, all))?;
        let watch_repeats = |done, all| watch(FurtherPart::Repeats, done, all);
        let repeats = Some(settings.repeats.into());
        let mut repeated = counterexample_repeats(resolved, found, repeats, watch_repeats)?;
        for trial in &mut found.trials {
            trial.repeats = repeated.remove(&trial.trial);
        }
        if settings.smooth_region && found.screening.is_none() {
            let watch = |done, all| watch(FurtherPart::Region, done, all);
            found.smooth_region = smooth_region_of(resolved, found, Path::new(&path), watch)?;
        }
    }
    Ok(())
}
