//! State trajectories contain the simulated states.

#![allow(clippy::unwrap_used)]

use std::ops::ControlFlow;

use mishandle::rollout::Environment;
use mishandle::store::RunFile;
use mishandle::tasks::{Preset, Reward, TaskEnvironment, tasks};
use mishandle::world::Model;
use mishandle::{EvaluatePlan, Plan, ResolvedPlan};

/// The environment removes visual elements from the scene. Its states must still fit the scene with visual elements.
#[test]
fn the_states_of_every_task_fit_its_scene_with_visual_elements() {
    for task in tasks() {
        let name = task.definition().name;
        let environment = TaskEnvironment::new(task, Preset::Paper, Reward::Original).unwrap();
        let trajectory = mishandle::initial_state(task, None).unwrap();
        let rendered = Model::from_xml(&mishandle::scene_mjcf(task).unwrap()).unwrap();
        let simulated = environment.model();
        assert_eq!(rendered.state_size(), simulated.state_size(), "{name}");
        assert_eq!(rendered.qpos_size(), simulated.qpos_size(), "{name}");
        assert_eq!(trajectory.states[0].len(), environment.state_size(), "{name}");
    }
}

#[test]
fn a_replayed_trajectory_has_one_state_per_sample_of_the_trace() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.sqlite");
    let evaluate = EvaluatePlan { episodes: 2, ..EvaluatePlan::default() };
    let plan = Plan { evaluate: Some(evaluate), ..Plan::new("point-reaching", "expert") };
    let resolved = ResolvedPlan::new(&plan).unwrap();
    let run = mishandle::create_run(&resolved, Some(&path)).unwrap();
    mishandle::evaluate(&resolved, run, |_| ControlFlow::Continue(())).unwrap();

    let (replayed, trajectory) =
        mishandle::replay_states(&RunFile::open(&path).unwrap(), 1, 2, None).unwrap();
    assert_eq!(replayed.differences, Vec::<String>::new());
    assert_eq!(trajectory.states.len(), replayed.episode.trace.len());
    // The arm has moved, and its target has not.
    let model =
        Model::from_xml(&mishandle::scene_mjcf(mishandle::task("point-reaching").unwrap()).unwrap()).unwrap();
    let target = model.body("target").unwrap();
    let mut world = model.world();
    let mut positions = |state: &[f64]| {
        world.set_state(state);
        world.refresh();
        (world.qpos().to_vec(), world.rows().position(target).to_vec())
    };
    let states = &trajectory.states;
    let (first, last) = (positions(&states[0]), positions(&states[states.len() - 1]));
    assert_ne!(first.0, last.0);
    let scenario: Vec<f64> = replayed.recorded.scenario.iter().flatten().copied().collect();
    assert_eq!(first.1, scenario);
    assert_eq!(last.1, first.1);
}
