//! Rendered states are the simulated ones.

#![allow(clippy::unwrap_used)]

use std::ops::ControlFlow;

use mishandle::rollout::Environment;
use mishandle::store::RunFile;
use mishandle::tasks::{Preset, Reward, TaskEnvironment, tasks};
use mishandle::world::Model;
use mishandle::{EvaluatePlan, Plan, ResolvedPlan};

/// The environment removes visual geoms, but its states must fit the scene with them.
#[test]
fn the_states_of_every_task_fit_its_scene_with_visuals() {
    for task in tasks() {
        let name = task.definition().name;
        let environment = TaskEnvironment::new(task, Preset::Paper, Reward::Original).unwrap();
        let film = mishandle::start(task, None).unwrap();
        let rendered = Model::from_xml(&mishandle::scene(task).unwrap()).unwrap();
        let stepped = environment.model();
        assert_eq!(rendered.state_size(), stepped.state_size(), "{name}");
        assert_eq!(rendered.qpos_size(), stepped.qpos_size(), "{name}");
        assert_eq!(film.states[0].len(), environment.state_size(), "{name}");
    }
}

#[test]
fn a_film_contains_every_sample_of_the_recorded_episode() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.sqlite");
    let evaluate = EvaluatePlan { episodes: 2, ..EvaluatePlan::default() };
    let plan = Plan { evaluate: Some(evaluate), ..Plan::new("point-reaching", "expert") };
    let resolved = ResolvedPlan::new(&plan).unwrap();
    let run = mishandle::create_run(&resolved, Some(&path)).unwrap();
    mishandle::evaluate(&resolved, run, |_| ControlFlow::Continue(())).unwrap();

    let (replayed, film) = mishandle::film(&RunFile::open(&path).unwrap(), 1, 2, None).unwrap();
    assert_eq!(replayed.differences, Vec::<String>::new());
    assert_eq!(film.states.len(), replayed.episode.trace.len());
    // The arm has moved, but the target has not.
    let model =
        Model::from_xml(&mishandle::scene(mishandle::task("point-reaching").unwrap()).unwrap()).unwrap();
    let target = model.body("target").unwrap();
    let mut world = model.world();
    let mut positions = |state: &[f64]| {
        world.set_state(state);
        world.refresh();
        (world.qpos().to_vec(), world.rows().position(target).to_vec())
    };
    let (first, last) = (positions(&film.states[0]), positions(&film.states[film.states.len() - 1]));
    assert_ne!(first.0, last.0);
    let scenario: Vec<f64> = replayed.recorded.scenario.iter().flatten().copied().collect();
    assert_eq!(first.1, scenario);
    assert_eq!(last.1, first.1);
}
