//! The initial posture of the robot: offsets of its joints, which what it holds follows.

use mishandle_rollout::{Axis, Environment, Sample, Scenario, Seed, Space};
use mishandle_tasks::{Preset, Reward, TASKS, Task, TaskEnvironment};
use mishandle_world::World;
use mishandle_world::frame::{inverse, multiply, norm, rotate_back, sub};

/// Returns the world at the start of a scenario of a space.
fn start(environment: &TaskEnvironment, scenario: &Scenario) -> World {
    let mut worker = environment.worker();
    let mut state = vec![0.0; environment.state_size()];
    let mut observation = vec![0.0; environment.observation_size()];
    let mut signals = vec![0.0; environment.signals().len()];
    let mut rewards = vec![0.0; environment.reward_terms().len()];
    let sample = Sample { observation: &mut observation, signals: &mut signals, rewards: &mut rewards };
    worker.reset(scenario, Seed(1), &mut state, sample);
    let mut world = environment.model().world();
    world.set_state(&state);
    world.refresh();
    world
}

/// A task with the space of the posture at a severity.
fn with_posture(task: &dyn Task, severity: usize) -> TaskEnvironment {
    let environment = TaskEnvironment::new(task, Preset::Paper, Reward::Original).unwrap();
    let (_, spaces) = environment.axes_and_spaces(&[], &[]).unwrap();
    let name = format!("posture-{severity}");
    let space = spaces.iter().find(|space| space.name() == name).unwrap();
    let starts = environment.space().axes().iter().chain(space.axes()).cloned().collect();
    environment.with_space(Space::new(&name, starts).unwrap()).unwrap()
}

/// Joints start at their usual position plus the offset, the hand holds what it holds as usual, and
/// nothing else moves.
#[test]
fn joints_start_at_their_offsets_and_what_the_hand_holds_follows() {
    for task in TASKS {
        let name = task.definition().name;
        let environment = with_posture(*task, 5);
        let space = environment.space();
        let model = environment.model();
        let hand = model.body("hand").unwrap();
        let held = task.definition().held.map(|held| model.body(held.name).unwrap());
        let carried: Vec<_> = match name {
            "ball-balancing" => vec![model.body("ball").unwrap()],
            "cloth-placing" => model.flex("cloth").unwrap().bodies().collect(),
            _ => Vec::new(),
        };
        let usual = start(&environment, &space.nominal());
        for number in 0..4 {
            // The starts of two scenarios differ in their posture alone.
            let drawn = space.sample(Seed(3), number);
            let is_own = |axis: &Axis| axis.name.starts_with("start_offset");
            let value = |(index, axis): (usize, &Axis)| {
                if is_own(axis) { drawn.get(index) } else { axis.nominal }
            };
            let scenario = Scenario::new(space.axes().iter().enumerate().map(value).collect());
            let moved = start(&environment, &scenario);
            for (index, axis) in space.axes().iter().enumerate() {
                let Some(joint) = axis.name.strip_prefix("start_offset_") else { continue };
                let joint = model.joint(joint).unwrap();
                let expected =
                    (usual.qpos()[joint.qpos] + scenario.get(index).unwrap()).clamp(joint.low, joint.high);
                assert!((moved.qpos()[joint.qpos] - expected).abs() < 1e-12, "{name}: {}", axis.name);
            }
            for body in held.iter().chain(&carried) {
                let in_hand = |world: &World| {
                    let (p, q) = world.pose(hand);
                    let (position, quaternion) = world.pose(*body);
                    (rotate_back(q, sub(position, p)), multiply(inverse(q), quaternion))
                };
                let (p, q) = in_hand(&moved);
                let (p0, q0) = in_hand(&usual);
                assert!(norm(sub(p, p0)) < 1e-9, "{name}: {p:?}, usually {p0:?}");
                // The vertices of a cloth do not turn.
                let turned = q.iter().zip(&q0).map(|(a, b)| a * b).sum::<f64>().abs();
                assert!(
                    name == "cloth-placing" || (turned - 1.0).abs() < 1e-9,
                    "{name}: {q:?}, usually {q0:?}"
                );
            }
        }
    }
}
