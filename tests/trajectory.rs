//! State trajectories contain the simulated states.

use std::ops::ControlFlow;

use mishandle::inspect::EventKind;
use mishandle::plan::EvaluatePlan;
use mishandle::rollout::{Environment, Request, Scenario, Seed};
use mishandle::run::{Engine, ask};
use mishandle::store::{RunFile, TraceColumn};
use mishandle::tasks::{Preset, Reward, TaskEnvironment, tasks};
use mishandle::world::Model;
use mishandle::{Plan, ResolvedPlan};

/// The environment removes visual elements from the scene. Its states must still fit the scene with
/// visual elements.
#[test]
fn the_states_of_every_task_fit_its_scene_with_visual_elements() {
    for task in tasks() {
        let name = task.definition().name;
        let environment = TaskEnvironment::new(task, Preset::Paper, Reward::Original).unwrap();
        let trajectory = mishandle::picture::initial_state(name, None).unwrap();
        let rendered = Model::from_xml(&mishandle::resolve::picture_model(name).unwrap().document).unwrap();
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
    let run = mishandle::run::create_run(&resolved, Some(&path)).unwrap();
    ask(&resolved, run, Engine::Direct, &mut |_| ControlFlow::Continue(())).unwrap();

    let (replayed, trajectory) =
        mishandle::picture::replay_states(&RunFile::open(&path).unwrap(), 1, 2, None).unwrap();
    assert_eq!(replayed.differences, Vec::<String>::new());
    assert_eq!(trajectory.states.len(), replayed.episode.trace.len());
    // The arm has moved, and its target has not.
    let model =
        Model::from_xml(&mishandle::resolve::picture_model("point-reaching").unwrap().document).unwrap();
    let target = model.body("target").unwrap();
    let mut world = model.world();
    let mut positions = |state: &[f64]| {
        world.set_state(state);
        world.refresh();
        (world.qpos().to_vec(), world.rows().position(target).to_vec())
    };
    let states = &trajectory.states;
    let first = positions(&states[0]);
    let last = positions(&states[states.len() - 1]);
    assert_ne!(first.0, last.0);
    let scenario: Vec<f64> = replayed.recorded.scenario.iter().flatten().copied().collect();
    assert_eq!(first.1, scenario);
    assert_eq!(last.1, first.1);
}

/// The expert of cube stacking lowers the held cube until it touches the target, or drops it from
/// just above.
#[test]
fn the_first_contact_and_the_release_are_those_of_the_trace() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.sqlite");
    let plan = Plan {
        evaluate: Some(EvaluatePlan { episodes: 1, ..EvaluatePlan::default() }),
        ..Plan::new("cube-stacking", "expert")
    };
    let resolved = ResolvedPlan::new(&plan).unwrap();
    let run = mishandle::run::create_run(&resolved, Some(&path)).unwrap();
    ask(&resolved, run, Engine::Direct, &mut |_| ControlFlow::Continue(())).unwrap();
    let (replayed, trajectory) =
        mishandle::picture::replay_states(&RunFile::open(&path).unwrap(), 1, 1, None).unwrap();
    let trace = &replayed.episode.trace;
    let held = trace.names().iter().position(|name| name == "cube_held").unwrap();
    let release = mishandle::inspect::release(trace).unwrap();
    assert_eq!((release.kind, trace.column(held)[release.sample - 1]), (EventKind::Release, 1.0));
    assert_eq!(trace.column(held)[release.sample], 0.0);

    let columns = mishandle::picture::full_trace(&resolved, &replayed.episode).unwrap();
    let (contact, pair) = trajectory.first_contact().unwrap().unwrap();
    assert_eq!(contact.kind, EventKind::Contact);
    let force = &columns.iter().find(|column| column.name == pair).unwrap().values;
    assert!(force[contact.sample].unwrap() > 0.0, "{pair}");
    // No pair that is apart in the first 0.1 s touches before.
    for column in columns.iter().filter(|column| column.name.matches('_').count() == 2) {
        let is_apart = column.name.starts_with("contact_")
            && column.values[..=6].iter().all(|force| *force == Some(0.0));
        let touches = column.values[..contact.sample].iter().any(|force| *force != Some(0.0));
        assert!(!is_apart || !touches, "{}", column.name);
    }
    let arm = mishandle::picture::initial_state("point-reaching", None).unwrap();
    assert_eq!(arm.first_contact().unwrap(), None);
}

/// The expert puts the cube on the target. Both have 0.02 kg.
#[test]
fn a_full_trace_has_the_weights_of_the_stack_and_the_actions_that_moved_the_arm() {
    let resolved =
        ResolvedPlan::new(&Plan { space: "dynamics".to_string(), ..Plan::new("cube-stacking", "expert") })
            .unwrap();
    let axes = resolved.space.axes();
    let columns = |mass: f64| -> (usize, Vec<TraceColumn>) {
        let mut values = resolved.space.nominal().values().to_vec();
        values[axes.iter().position(|axis| axis.name == "target_mass_scale").unwrap()] = Some(mass);
        let request = Request::new(Scenario::new(values), Seed(0));
        let episode = resolved.system().unwrap().rollout(&[request]).unwrap().remove(0);
        (episode.trace.len(), mishandle::picture::full_trace(&resolved, &episode).unwrap())
    };
    let (samples, nominal) = columns(1.0);
    assert!(nominal.iter().all(|column| column.values.len() == samples));
    let find = |columns: &[TraceColumn], name: &str| -> Vec<Option<f64>> {
        columns
            .iter()
            .find(|column| column.name == name)
            .unwrap_or_else(|| panic!("no {name}"))
            .values
            .clone()
    };
    let at_end = |columns: &[TraceColumn], name: &str| find(columns, name)[samples - 1].unwrap();
    let near = |force: f64, mass: f64| (force - 9.81 * mass).abs() < 1e-3;
    assert!(
        near(at_end(&nominal, "contact_ground_target"), 0.04),
        "{:?}",
        find(&nominal, "contact_ground_target")
    );
    assert!(near(at_end(&nominal, "contact_cube_target"), 0.02));
    assert_eq!(at_end(&nominal, "contact_robot_cube"), 0.0, "the hand has released the cube");
    assert!(find(&nominal, "contact_largest")[1].unwrap() > 1.0, "the fingers press on the cube");
    // Masses that the scenario changes count.
    let (_, heavy) = columns(2.0);
    assert!(near(at_end(&heavy, "contact_ground_target"), 0.06));
    // The state starts in the posture of the definition, at rest.
    let start = mishandle::resolve::task("cube-stacking").unwrap().definition().start;
    assert_eq!(find(&nominal, "q_joint4")[0], Some(start[3]));
    assert_eq!(find(&nominal, "dq_joint4")[0], Some(0.0));
    assert_eq!(nominal.iter().find(|column| column.name == "dq_joint4").unwrap().unit, "rad/s");
    // Each action has a control step after it.
    let actions = find(&nominal, "action_joint1");
    assert_eq!((actions[samples - 1], actions[samples - 2].is_some()), (None, true));
    assert!(actions.iter().flatten().any(|action| *action != 0.0));
}

#[test]
fn a_target_without_a_scene_has_no_full_trace() {
    let resolved = ResolvedPlan::new(&Plan::new("toy/sphere-2d", "")).unwrap();
    let request = Request::new([0.5, 0.5], Seed(0));
    let episode = resolved.system().unwrap().rollout(&[request]).unwrap().remove(0);
    let error = mishandle::picture::full_trace(&resolved, &episode).unwrap_err().to_string();
    assert!(error.contains("toy/sphere-2d") && error.contains("a task or a target file"), "{error}");
}
