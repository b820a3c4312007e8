//! A recorded simulation with all that another viewer needs: model, states, signals.

use std::path::Path;

use mishandle_rollout::{Episode, Request};
use mishandle_store::RunFile;
use mishandle_world::PictureModel;

use crate::counterexample::Counterexample;
use crate::error::{MishandleError, RunError};
use crate::picture::trajectory::{Recorded, simulate_states};
use crate::replay::{build_differences, replay_in, select_simulation};
use crate::resolve::{Moved, ResolvedPlan, picture_model, recorded_plan};

/// A simulation of a run file or a counterexample, simulated again.
pub struct RecordedScene {
    /// The model with its visual elements.
    pub model: PictureModel,
    /// Trial and number of the simulation.
    pub place: (u32, u32),
    /// The simulation, and with `with_nominal` the nominal scenario with the same seed.
    pub episodes: Vec<SceneEpisode>,
    /// The plan with target, formula and signals.
    pub resolved: ResolvedPlan,
    /// Differences between the file and the replay.
    pub differences: Vec<String>,
    /// Differences between the recorded build and the present one.
    pub build_differences: Vec<String>,
}

/// An episode with its states.
pub struct SceneEpisode {
    /// The episode.
    pub episode: Episode,
    /// A state row per sample, which begins with MuJoCo's state of the kind `mjSTATE_INTEGRATION`.
    pub states: Vec<Vec<f64>>,
}

/// Simulates a recorded simulation again and returns its scene. `path` is a run file, or a
/// counterexample (`.json`). `trial` and `number` choose a simulation of a run, as
/// [`select_simulation`] does.
///
/// # Errors
/// If the target has no scene or is not available, or the file has no such simulation.
pub fn recorded_scene(
    path: &Path,
    trial: Option<u32>,
    number: Option<u32>,
    moved: Moved<'_>,
    with_nominal: bool,
) -> Result<RecordedScene, MishandleError> {
    let is_counterexample = path.extension().is_some_and(|end| end.eq_ignore_ascii_case("json"));
    let mut scene =
        if is_counterexample { of_counterexample(path, moved)? } else { of_run(path, trial, number, moved)? };
    if let (true, Some(first)) = (with_nominal, scene.episodes.first()) {
        let nominal = Request::new(scene.resolved.space.nominal(), first.episode.request.seed);
        let (episode, trajectory) = simulate_states(&scene.resolved, &nominal)?;
        scene.episodes.push(SceneEpisode { episode, states: trajectory.states });
    }
    Ok(scene)
}

fn of_run(
    path: &Path,
    trial: Option<u32>,
    number: Option<u32>,
    moved: Moved<'_>,
) -> Result<RecordedScene, MishandleError> {
    let run = RunFile::open(path)?;
    let resolved = recorded_plan(run.header(), moved)?;
    let (trial, number) =
        select_simulation(&run, trial, number)?.ok_or(MishandleError::Run(RunError::NoEpisode))?;
    let mut recorded = Recorded::new(&resolved)?;
    let space = recorded.system.space().clone();
    let replayed = replay_in(&run, trial, number, &resolved, &mut *recorded.system, &space)?;
    let states = recorded.states();
    Ok(RecordedScene {
        model: picture_model(&resolved.plan.target)?,
        place: (trial, number),
        episodes: vec![SceneEpisode { episode: replayed.episode, states }],
        differences: replayed.differences,
        build_differences: build_differences(run.header(), &resolved),
        resolved,
    })
}

fn of_counterexample(path: &Path, moved: Moved<'_>) -> Result<RecordedScene, MishandleError> {
    let counterexample = Counterexample::read(path)?;
    let resolved = counterexample.resolve(path.parent().unwrap_or(Path::new("")), moved)?;
    let replayed = counterexample.replay(&resolved)?;
    let (episode, trajectory) = simulate_states(&resolved, &counterexample.request(&resolved.space)?)?;
    Ok(RecordedScene {
        model: picture_model(&resolved.plan.target)?,
        place: (counterexample.trial, counterexample.simulation),
        episodes: vec![SceneEpisode { episode, states: trajectory.states }],
        differences: replayed.differences,
        build_differences: replayed.build_differences,
        resolved,
    })
}
