//! The signals of the manner agree with the state of the simulation, and computing them changes
//! nothing else.

use crate::stepped::Run;
use mishandle_rollout::{Environment, Seed, Stream};
use mishandle_tasks::{
    ACCELERATION_LIMIT, JOINT_NAMES, MANNER, Preset, Reward, TASKS, TORQUE_LIMIT, TaskEnvironment,
    VELOCITY_LIMIT, task,
};
use mishandle_world::{Arm, World};

const ARM: usize = 7;
const DT: f64 = 1.0 / 60.0;

impl Run {
    /// Returns a world in the present state.
    fn world(&self) -> World {
        let mut world = self.environment.model().world();
        world.set_state(&self.state);
        world.refresh();
        world
    }
}

/// Returns the task with `substeps` physics steps per control step, with the signals of the manner.
fn with_substeps(name: &str, substeps: usize) -> TaskEnvironment {
    let task = task(name).unwrap();
    TaskEnvironment::with_substeps(task, Preset::Paper, Reward::Shaped, substeps).unwrap().with_manner()
}

/// Returns random actions that change every tenth control step.
fn actions(step: u64) -> [f64; 9] {
    std::array::from_fn(|joint| {
        2.0 * Seed(7).uniform(Stream::ActionNoise, step / 10, u32::try_from(joint).unwrap()) - 1.0
    })
}

#[track_caller]
fn assert_near(found: f64, expected: f64, tolerance: f64) {
    assert!((found - expected).abs() <= tolerance, "{found} instead of {expected}");
}

#[test]
fn computing_the_signals_changes_no_bit_of_anything_else() {
    for task in TASKS {
        let plain = TaskEnvironment::new(*task, Preset::Paper, Reward::Shaped).unwrap();
        let count = plain.signals().len();
        let names: Vec<&str> = MANNER.iter().map(|signal| signal.name).collect();
        let scenario = plain.space().nominal();
        let mut with = Run::new(plain.with_manner(), &scenario);
        let mut without = Run::new(plain, &scenario);
        assert_eq!(with.environment.signals()[count..], names);
        for step in 0..60 {
            let [a, b] = [&with, &without].map(|run| {
                let numbers = run.signals[..count].iter().chain(&run.rewards);
                let observation = run.observation.iter().map(|value| u64::from(value.to_bits()));
                let state = run.state[..without.state.len()].iter().map(|value| value.to_bits());
                numbers.map(|value| value.to_bits()).chain(observation).chain(state).collect::<Vec<u64>>()
            });
            assert_eq!(a, b, "{} at step {step}", with.environment.name());
            with.step(&actions(step));
            without.step(&actions(step));
        }
    }
}

#[test]
fn a_state_row_continues_to_the_same_bits_on_another_worker() {
    for task in TASKS {
        // With all axes, the values of the axes stand between the targets and the memory.
        let environment = TaskEnvironment::new(*task, Preset::Paper, Reward::Shaped).unwrap();
        let target = mishandle_tasks::TaskTarget::new(
            *task,
            Preset::Paper,
            task.expert().unwrap(),
            vec![component()],
            mishandle_rollout::Noise::default(),
        );
        let all = target.unwrap().target().unwrap().space("starts+dynamics+events").unwrap();
        for space in [environment.space().clone(), all] {
            let environment = environment.with_space(space).unwrap().with_manner();
            let scenario = environment.space().sample(Seed(5), 2);
            let mut first = Run::new(environment.clone(), &scenario);
            (0..20).for_each(|step| first.step(&actions(step)));
            let mut second = Run::new(environment.clone(), &environment.space().sample(Seed(5), 3));
            (0..7).for_each(|step| second.step(&actions(100 + step)));
            second.state.copy_from_slice(&first.state);
            for step in 20..30 {
                first.step(&actions(step));
                second.step(&actions(step));
                assert_eq!(first.signals, second.signals, "{}", environment.name());
                assert_eq!(first.state, second.state, "{}", environment.name());
            }
        }
    }
}

fn component() -> mishandle_rollout::Component {
    mishandle_rollout::Component {
        role: "controller".into(),
        name: "expert".into(),
        hash: String::new(),
        file_hash: String::new(),
    }
}

#[test]
fn motion_agrees_with_states_and_the_jacobian() {
    // With one physics step per control step, every state is visible.
    let environment = with_substeps("point-reaching", 1);
    let model = environment.model().clone();
    let joints: Vec<_> = JOINT_NAMES[..ARM].iter().map(|name| model.joint(name).unwrap()).collect();
    let mut arm = Arm::new(&model, &JOINT_NAMES[..ARM], "grasp").unwrap();
    let mut run = Run::new(environment.clone(), &environment.space().nominal());
    let mut last = run.world();
    let mut largest_torque = 0.0_f64;
    for step in 0..60 {
        run.step(&actions(step));
        let world = run.world();
        let of = |world: &World, value: &dyn Fn(usize, &World) -> f64| -> f64 {
            (0..ARM).map(|joint| value(joint, world)).fold(0.0, f64::max)
        };
        let qvel = |world: &World, joint: usize| world.qvel()[joints[joint].dof];
        let qpos = |world: &World, joint: usize| world.qpos()[joints[joint].qpos];
        let speed = of(&world, &|joint, world| qvel(world, joint).abs() / VELOCITY_LIMIT[joint]);
        assert_eq!(run.signal("joint_speed_share"), speed);
        let acceleration = of(&world, &|joint, world| {
            (qvel(world, joint) - qvel(&last, joint)).abs() / DT / ACCELERATION_LIMIT[joint]
        });
        assert_near(run.signal("joint_acceleration_share"), acceleration, 1e-9);
        // A servo of 400 N m/rad and 80 N m s/rad, at the start of the step.
        let torque = of(&world, &|joint, world| {
            let force = 400.0 * (world.ctrl()[joint] - qpos(&last, joint)) - 80.0 * qvel(&last, joint);
            force.abs() / TORQUE_LIMIT[joint]
        });
        assert_near(run.signal("joint_torque_share"), torque, 1e-9);
        largest_torque = largest_torque.max(torque);
        let distance = (0..ARM).map(|joint| {
            let q = qpos(&world, joint);
            (q - joints[joint].low).min(joints[joint].high - q)
        });
        assert_eq!(run.signal("joint_limit_distance"), distance.fold(f64::INFINITY, f64::min));
        let q: Vec<f64> = (0..ARM).map(|joint| qpos(&world, joint)).collect();
        let mut jacobian = [0.0; 6 * ARM];
        arm.set(&q);
        arm.jacobian(&mut jacobian);
        let velocity = jacobian.chunks(ARM).take(3).map(|row| -> f64 {
            row.iter().enumerate().map(|(joint, entry)| entry * qvel(&world, joint)).sum()
        });
        let tool = velocity.map(|v| v * v).sum::<f64>().sqrt();
        assert_near(run.signal("tool_speed"), tool, 1e-12);
        last = world;
    }
    // Servos demand more than they may give.
    assert!(largest_torque > 1.0, "{largest_torque}");
}

#[test]
fn the_largest_values_are_those_over_all_physics_steps() {
    // The physics step is the same, so that the states are too.
    let environment = with_substeps("point-reaching", 4);
    let mut run = Run::new(environment.clone(), &environment.space().nominal());
    let mut arm = Arm::new(environment.model(), &JOINT_NAMES[..ARM], "grasp").unwrap();
    let panda = mishandle_tasks::Panda::new(environment.model()).unwrap();
    for step in 0..40 {
        let mut world = run.world();
        let start = world.qvel().to_vec();
        run.step(&actions(step));
        let mut largest = [0.0_f64; 2];
        let targets = &run.state[environment.model().state_size()..][..9];
        for _ in 0..4 {
            panda.step(targets, &mut world);
            let mut jacobian = [0.0; 6 * ARM];
            arm.set(&world.qpos()[..ARM]);
            arm.jacobian(&mut jacobian);
            let velocity = jacobian
                .chunks(ARM)
                .take(3)
                .map(|row| -> f64 { row.iter().zip(world.qvel()).map(|(entry, v)| entry * v).sum() });
            let tool = velocity.map(|v| v * v).sum::<f64>().sqrt();
            let shares = world.qvel().iter().zip(&VELOCITY_LIMIT[..ARM]).map(|(v, limit)| v.abs() / limit);
            largest = [largest[0].max(tool), shares.fold(largest[1], f64::max)];
        }
        assert_near(run.signal("tool_speed"), largest[0], 1e-12);
        assert_near(run.signal("joint_speed_share"), largest[1], 1e-12);
        let changes = world.qvel().iter().zip(&start).zip(&ACCELERATION_LIMIT);
        let acceleration = changes.map(|((end, start), limit)| (end - start).abs() / DT / limit);
        assert_near(run.signal("joint_acceleration_share"), acceleration.fold(0.0, f64::max), 1e-9);
    }
}

#[test]
fn a_robot_that_touches_something_has_no_acceleration_and_one_that_carries_a_ball_has() {
    let environment = with_substeps("cube-stacking", 8);
    let mut run = Run::new(environment.clone(), &environment.space().nominal());
    let mut steps = [0; 2];
    for step in 0..200 {
        // The arm reaches down, stretched.
        let mut action = actions(step).map(|a| 0.1 * a);
        (action[1], action[3]) = (1.0, 1.0);
        let holds = run.signal("cube_held") > 0.5;
        run.step(&action);
        if holds != (run.signal("cube_held") > 0.5) {
            continue;
        }
        let forces = ["fixture_force", "ground_force", "self_force", "object_force"];
        let forces = if holds { &forces[..3] } else { &forces[..] };
        let touches = forces.iter().any(|name| run.signal(name) > 0.0);
        assert_eq!(touches, run.signal("joint_acceleration_share") == 0.0, "step {step}");
        steps[usize::from(touches)] += 1;
    }
    assert!(steps.iter().all(|count| *count > 2), "{steps:?}");

    let environment = with_substeps("ball-balancing", 8);
    let mut run = Run::new(environment.clone(), &environment.space().nominal());
    (0..100).for_each(|_| run.step(&[0.0; 9]));
    run.step(&[0.1; 9]);
    assert!(run.signal("object_force") > 1.0);
    assert!(run.signal("joint_acceleration_share") > 0.01);
}

#[test]
fn a_ball_at_rest_presses_on_the_tray_with_its_weight() {
    let task = task("ball-balancing").unwrap();
    let environment = TaskEnvironment::new(task, Preset::Paper, Reward::Shaped).unwrap();
    let environment = environment.with_manner();
    let expert = task.expert().unwrap();
    let environment = environment.with_further_parts(expert.further_parts()).unwrap();
    let mut controller = expert.worker();
    let mut memory = vec![0.0; expert.state_size()];
    controller.reset(&mut memory, Seed(0));
    let mut run = Run::new(environment.clone(), &environment.space().nominal());
    let mut output = [0.0; 9];
    for _ in 0..300 {
        controller.act(1, &run.observation, &mut memory, &mut output);
        run.step(&output.map(f64::from));
    }
    // The tray is a part of the hand.
    for name in ["object_force", "object_force_mean", "arm_object_force"] {
        assert_near(run.signal(name), 0.15 * 9.81, 1e-3);
    }
    for name in ["fixture_force", "ground_force_mean", "self_force"] {
        assert_eq!(run.signal(name), 0.0, "{name}");
    }
}

#[test]
fn a_mean_is_that_of_three_control_steps() {
    // The ball falls on the tray and bounces; with one physics step per control step, the largest
    // force of a control step is its mean.
    let environment = with_substeps("ball-balancing", 1);
    let mut run = Run::new(environment.clone(), &environment.space().nominal());
    let mut forces = vec![0.0; 3];
    for step in 0..100 {
        run.step(&[0.0; 9]);
        forces.push(run.signal("object_force"));
        let mean = forces[forces.len() - 3..].iter().sum::<f64>() / 3.0;
        assert_near(run.signal("object_force_mean"), mean, 1e-9);
        assert!(step < 20 || forces.iter().any(|force| *force > 1.0), "the ball has not fallen");
    }
}

#[test]
fn an_action_rate_is_the_largest_change_of_an_action_and_rest_starts_when_the_arm_stops() {
    let environment = with_substeps("point-reaching", 2);
    let mut run = Run::new(environment.clone(), &environment.space().nominal());
    assert_eq!((run.signal("action_rate"), run.signal("rest_time")), (0.0, 0.0));
    let mut step = |action: &[f64; 9]| {
        run.step(action);
        (run.signal("action_rate") * DT, run.signal("rest_time") / DT)
    };
    let mut action = [0.0; 9];
    // The arm starts at rest.
    assert_eq!(step(&action), (0.0, 1.0));
    assert_eq!(step(&action), (0.0, 2.0));
    (action[3], action[8]) = (-0.5, 0.25);
    let (rate, rest) = step(&action);
    assert_near(rate, 0.5, 1e-12);
    assert_eq!(rest, 0.0);
    action[8] = 1.0;
    assert_near(step(&action).0, 0.75, 1e-12);
    action = [0.0; 9];
    assert_near(step(&action).0, 1.0, 1e-12);
    let rests: Vec<f64> = (0..120).map(|_| step(&action).1).collect();
    assert_eq!(rests[0], 0.0);
    let start = rests.iter().position(|rest| *rest > 0.0).unwrap();
    for (rest, expected) in rests[start..].iter().zip(1_u32..) {
        assert_near(*rest, f64::from(expected), 1e-9);
    }
}
