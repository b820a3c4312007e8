use mishandle_controllers::WRITTEN_VERSIONS;
use mishandle_rollout::Seed;
use mishandle_training::{AlgorithmSettings, Checkpoint};

use crate::error::MishandleError;
use crate::plan::TrainPlan;
use crate::run::Device;
use crate::train::curve::CurveColumns;
use crate::train::{Prepared, batches, check_outputs, prepare};

/// Facts that determine the result of a training run and the format of its controller files.
#[derive(Clone, Debug, PartialEq)]
pub struct TrainingFacts {
    /// All settings, with the defaults of missing keys.
    pub settings: AlgorithmSettings,
    /// Hash of the parts of the target that training depends on; see
    /// [`TrainingTarget::hash`](crate::resolve::TrainingTarget::hash).
    pub task_hash: String,
    /// Hash of the layout of observations and actions.
    pub layout_hash: String,
    /// Kinds of policies, each with the format version of its controller files.
    pub formats: &'static [(&'static str, u64)],
}

/// Runs all checks that [`train`](crate::train::train()) runs before its first step, except for
/// locks of other processes. Creates no files.
///
/// # Errors
/// The errors of [`train`](crate::train::train()) before its first step.
pub fn training_facts(plan: &TrainPlan, gpu: Option<&Device>) -> Result<TrainingFacts, MishandleError> {
    let target = plan.target()?;
    let Prepared { settings, environment, scenarios, supervisor, .. } = prepare(plan, &*target)?;
    let checkpoint = plan.checkpoint();
    let resumed = plan.resume && checkpoint.exists();
    let resumed = resumed.then(|| Checkpoint::load(&checkpoint)).transpose()?;
    check_outputs(plan, CurveColumns::new(&settings, &*environment.environment), resumed.as_ref())?;
    let batches = batches(plan, gpu, environment, scenarios, supervisor)?;
    if let Some(checkpoint) = &resumed {
        settings.check_resumption(&batches, Seed(plan.seed), checkpoint)?;
    }
    Ok(TrainingFacts {
        task_hash: target.hash(&plan.reward)?,
        layout_hash: target.layout(&settings).hash(),
        formats: &WRITTEN_VERSIONS,
        settings,
    })
}
