//! Invariants of every task and every axis of its scenarios.

use std::sync::Arc;

use mishandle_camera::sight::{CAMERA_FAULTS, Factor, SEVERITIES, severity_space};
use mishandle_controllers::ControllerFile;
use mishandle_rollout::{
    Axis, AxisKind, Component, Controller, Environment, Episode, Noise, Request, Sample, Scenario, Seed,
    Space, Specification, System, Target,
};
use mishandle_tasks::{Preset, Reward, TASKS, Task, TaskEnvironment, TaskTarget, task};
use mishandle_world::Model;
use mishandle_world::frame::{rotate_back, sub};

const NOISE: Noise = Noise { action_std: 0.2, observation_std: 0.0 };

/// Loads the shipped PPO controller, which uses every number of the observation.
fn policy(task: &dyn Task) -> Arc<dyn Controller> {
    let definition = task.definition();
    let name = definition.variant_of.unwrap_or(definition.name);
    let path = format!("{}/../../controllers/{name}/ppo.safetensors", env!("CARGO_MANIFEST_DIR"));
    Arc::new(ControllerFile::load(path.as_ref()).unwrap().policy)
}

fn target(task: &'static dyn Task) -> Target {
    let component = Component {
        role: "controller".into(),
        name: "ppo".into(),
        hash: "-".into(),
        file_hash: String::new(),
    };
    let controller = policy(task);
    TaskTarget::new(task, Preset::Paper, controller, vec![component], NOISE).unwrap().target().unwrap()
}

fn specification(task: &dyn Task) -> Specification {
    task.definition().paper.specification().unwrap()
}

fn system(target: &Target, task: &dyn Task, space: &Space) -> Box<dyn System> {
    target.system(space, &specification(task)).unwrap()
}

/// Returns the contents of an episode without its scenario, numbers as bits.
fn bits(episode: &Episode) -> (Vec<u64>, String) {
    let trace = &episode.trace;
    let columns = (0..trace.names().len()).flat_map(|i| trace.column(i).iter().map(|x| x.to_bits()));
    let numbers = columns.chain([episode.total_reward.to_bits()]).collect();
    (numbers, format!("{:?} {:?} {}", episode.end, episode.verdict, episode.steps))
}

fn run(system: &mut dyn System, scenario: Scenario) -> Episode {
    system.rollout(&[Request::new(scenario, Seed(9))]).unwrap().remove(0)
}

/// Returns the nominal scenario of `space` with some values replaced.
fn with(space: &Space, values: &[(&str, f64)]) -> Scenario {
    let nominal = space.nominal();
    let value = |(index, axis): (usize, &Axis)| {
        let set = values.iter().find(|(name, _)| axis.name == *name);
        set.map(|(_, value)| *value).or(nominal.get(index))
    };
    Scenario::new(space.axes().iter().enumerate().map(value).collect())
}

#[test]
fn a_nominal_scenario_has_the_bits_of_an_undisturbed_episode() {
    for task in TASKS {
        let target = target(*task);
        let name = task.definition().name;
        let starts = target.space("starts").unwrap();
        let undisturbed = run(&mut *system(&target, *task, &starts), starts.nominal());
        let all = target.space("all").unwrap();
        let mut system = system(&target, *task, &all);
        assert!(bits(&run(&mut *system, all.nominal())) == bits(&undisturbed), "{name}");
        // An event without magnitude has no effect at any time.
        let times = [("push_time", 1.3), ("push_duration", 0.17), ("jump_time", 2.1), ("slip_time", 0.7)];
        assert!(bits(&run(&mut *system, with(&all, &times))) == bits(&undisturbed), "{name}: times");
    }
}

#[test]
fn every_task_has_axes_of_every_kind() {
    for task in TASKS {
        let target = target(*task);
        for (kind, name) in AxisKind::ALL {
            assert!(
                target.axes.iter().any(|axis| axis.kind == kind),
                "{} has no {name}",
                task.definition().name
            );
        }
        let spaces: Vec<&str> = target.spaces.iter().map(Space::name).collect();
        let expected = [
            "starts",
            "dynamics",
            "delay",
            "timing",
            "sensing",
            "drift",
            "events",
            "faults-sensing",
            "faults-actuation",
            "disturbance",
            "noise",
        ];
        let factors = ["posture"].into_iter().chain(Factor::ALL.map(|(_, name)| name));
        let factors = factors.flat_map(|factor| (1..=SEVERITIES).map(|level| severity_space(factor, level)));
        let expected: Vec<String> = (expected.map(str::to_string).into_iter())
            .chain(factors)
            .chain([CAMERA_FAULTS.to_string()])
            .collect();
        assert_eq!(spaces, expected, "{}", task.definition().name);
        // No controller sees, so the axes of sight are not in the space of all axes.
        let strongest = severity_space("posture", SEVERITIES);
        let physical = |space: &&Space| !space.name().contains(char::is_numeric) || space.name() == strongest;
        let physical = target.spaces.iter().filter(physical).filter(|space| space.name() != CAMERA_FAULTS);
        let in_spaces: usize = physical.map(Space::dimension).sum();
        assert_eq!(in_spaces, target.axes.len(), "each axis is in exactly one space");
    }
}

/// Selects the axes of the test. From axes that differ only by joint or observed number it takes
/// the first and the last, and only the first segment, because later disturbances may have no
/// effect, for instance on a cloth at rest. Axes of faults have no effect alone: see `faults.rs`.
fn representatives(axes: &[Axis]) -> Vec<&Axis> {
    let family = |axis: &Axis| axis.name.split('_').next().unwrap_or_default().to_string();
    let is_repeated = |axis: &Axis| ["bias", "drift", "disturbance", "draw"].contains(&family(axis).as_str());
    let segment = |axis: &Axis| axis.name.rsplit('_').next().and_then(|part| part.parse::<u32>().ok());
    let axes: Vec<&Axis> = axes
        .iter()
        .filter(|axis| axis.kind != AxisKind::Fault && segment(axis).is_none_or(|segment| segment == 1))
        .collect();
    let is_same =
        |axis: &Axis, other: Option<&&Axis>| other.is_some_and(|other| family(other) == family(axis));
    let is_kept = |i: usize| {
        let before = i.checked_sub(1).and_then(|i| axes.get(i));
        !is_repeated(axes[i]) || !is_same(axes[i], before) || !is_same(axes[i], axes.get(i + 1))
    };
    (0..axes.len()).filter(|i| is_kept(*i)).map(|i| axes[i]).collect()
}

#[test]
fn every_axis_changes_the_trace() {
    // The small cloth has the axes of the large one and is faster.
    for task in TASKS.iter().filter(|task| task.definition().name != "cloth-placing") {
        let target = target(*task);
        let name = task.definition().name;
        let all = target.space("all").unwrap();
        let mut system = system(&target, *task, &all);
        // Times and durations have an effect only if an event has a magnitude.
        let force = target.axes.iter().find(|axis| axis.name == "push_force_x").map_or(0.0, |axis| axis.high);
        let events = [("push_force_x", force), ("jump_x", 0.05), ("slip_z", 0.01)];
        let nominal = bits(&run(&mut *system, all.nominal()));
        let disturbed = bits(&run(&mut *system, with(&all, &events)));
        assert!(nominal != disturbed, "{name}: the events have no effect");
        let axes = representatives(&target.axes);
        let scenarios = axes.iter().map(|axis| {
            let value = if axis.nominal == Some(axis.high) { axis.low } else { axis.high };
            let is_time = axis.kind == AxisKind::Event && axis.unit == "s";
            let others: &[(&str, f64)] = if is_time { &events } else { &[] };
            with(&all, &[&[(axis.name.as_str(), value)], others].concat())
        });
        let requests: Vec<Request> = scenarios.map(|scenario| Request::new(scenario, Seed(9))).collect();
        for (axis, episode) in axes.iter().zip(system.rollout(&requests).unwrap()) {
            let is_time = axis.kind == AxisKind::Event && axis.unit == "s";
            let before = if is_time { &disturbed } else { &nominal };
            // The hinge axis of the door is vertical, so a vertical force does not move it.
            if (name, axis.name.as_str()) == ("door-opening", "push_force_z") {
                assert!(bits(&episode) == *before, "a vertical force moves the door");
                continue;
            }
            assert!(bits(&episode) != *before, "{name}: {} has no effect", axis.name);
        }
    }
}

#[test]
fn a_disturbed_episode_depends_on_neither_batch_nor_threads() {
    for task in TASKS.iter().filter(|task| !task.definition().name.starts_with("cloth")) {
        let target = target(*task);
        let all = target.space("all").unwrap();
        // More than the 16 rows that a thread takes at a time. In one task, there are more rows
        // with different constants than a worker keeps models.
        let count = if task.definition().name == "ball-balancing" { 40 } else { 18 };
        let requests: Vec<Request> =
            (0..count).map(|i| Request::new(all.sample(Seed(2), i), Seed(2).child(i))).collect();
        let on = |threads: usize, requests: &[Request]| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| system(&target, *task, &all).rollout(requests).unwrap())
        };
        let together = on(1, &requests);
        let threaded = on(3, &requests);
        for (i, (a, b)) in together.iter().zip(&threaded).enumerate() {
            assert!(bits(a) == bits(b), "{} row {i}", task.definition().name);
        }
        for i in [0, 17] {
            let alone = on(1, &requests[i..=i]);
            assert!(bits(&alone[0]) == bits(&together[i]), "{} row {i}", task.definition().name);
        }
    }
}

/// One simulation that a test steps with actions of 0.
struct Stepper {
    environment: TaskEnvironment,
    worker: Box<dyn mishandle_rollout::EnvironmentWorker>,
    state: Vec<f64>,
    observation: Vec<f32>,
    signals: Vec<f64>,
    rewards: Vec<f64>,
}

impl Stepper {
    fn new(name: &str, values: &[(&str, f64)]) -> Stepper {
        let task = task(name).unwrap();
        let target = target(task);
        let of_loop = |axis: &Axis| {
            let loops = [
                "bias",
                "noise",
                "drift",
                "disturbance",
                "draw",
                "action",
                "observation",
                "sensor",
                "actuator",
            ];
            loops.contains(&axis.name.split('_').next().unwrap())
        };
        let axes = target.axes.iter().filter(|axis| !of_loop(axis)).cloned().collect();
        let space = Space::new("environment", axes).unwrap();
        let environment = TaskEnvironment::new(task, Preset::Paper, Reward::Original).unwrap();
        let environment = environment.with_space(space.clone()).unwrap();
        let mut stepper = Stepper {
            worker: environment.worker(),
            state: vec![0.0; environment.state_size()],
            observation: vec![0.0; environment.observation_size()],
            signals: vec![0.0; environment.signals().len()],
            rewards: vec![0.0; environment.reward_terms().len()],
            environment,
        };
        let sample = Sample {
            observation: &mut stepper.observation,
            signals: &mut stepper.signals,
            rewards: &mut stepper.rewards,
        };
        stepper.worker.reset(&with(&space, values), Seed(1), &mut stepper.state, sample);
        stepper
    }

    fn step(&mut self) {
        let sample = Sample {
            observation: &mut self.observation,
            signals: &mut self.signals,
            rewards: &mut self.rewards,
        };
        self.worker.step(&[0.0; 9], &mut self.state, sample);
    }

    /// Runs `count` control steps.
    fn steps(mut self, count: usize) -> Stepper {
        (0..count).for_each(|_| self.step());
        self
    }

    fn model(&self) -> &Model {
        self.environment.model()
    }

    /// Returns the velocity of a free body, m/s.
    fn velocity(&self, name: &str) -> [f64; 3] {
        let mut world = self.model().world();
        world.set_state(&self.state);
        world.rows().free_velocity(self.model().joint(name).unwrap())
    }

    fn position(&self, name: &str) -> [f64; 3] {
        let mut world = self.model().world();
        world.set_state(&self.state);
        world.rows().free_position(self.model().joint(name).unwrap())
    }
}

#[test]
fn a_push_on_a_free_body_changes_its_momentum_by_force_times_duration() {
    // Start time and duration (s, not multiples of the physics step), and a control step after the
    // push but before the ball has contacts.
    for (name, start, duration, steps) in [
        ("ball-balancing", 0.0213, 0.0517, 6),
        ("ball-catching", 0.1003, 0.1511, 18),
        ("ball-pushing", 0.0041, 0.0183, 2),
    ] {
        for scale in [1.0, 2.0] {
            let force = [0.004, -0.003, 0.002];
            let pushed = Stepper::new(
                name,
                &[
                    ("ball_mass_scale", scale),
                    ("push_time", start),
                    ("push_duration", duration),
                    ("push_force_x", force[0]),
                    ("push_force_y", force[1]),
                    ("push_force_z", force[2]),
                ],
            )
            .steps(steps);
            let free = Stepper::new(name, &[("ball_mass_scale", scale)]).steps(steps);
            let mass = scale * free.model().mass(free.model().body("ball").unwrap());
            let with = pushed.velocity("ball");
            let without = free.velocity("ball");
            for i in 0..3 {
                let momentum = mass * (with[i] - without[i]);
                let impulse = force[i] * duration;
                assert!(
                    (momentum - impulse).abs() <= 1e-9 * impulse.abs(),
                    "{name}: {momentum} instead of {impulse} N s"
                );
            }
        }
    }
}

#[test]
fn a_pushed_cube_slides_the_distance_of_coulomb_friction() {
    // A push of 0.5 N for 0.05 s accelerates a cube of 20 g on the ground against the friction μ m
    // g, which then stops it.
    let slide = |scale: f64| {
        let push =
            [("friction_scale", scale), ("push_time", 0.5), ("push_duration", 0.05), ("push_force_x", 0.5)];
        let cube = Stepper::new("cube-stacking", &push).steps(29);
        let before = cube.position("target")[0];
        let cube = cube.steps(90);
        assert!(cube.velocity("target")[0].abs() < 0.01, "the cube is at rest");
        cube.position("target")[0] - before
    };
    for (scale, mu) in [(1.0, 0.75), (0.5, 0.375)] {
        let mass = 0.02;
        let g = 9.81;
        let duration = 0.05;
        let acceleration = 0.5 / mass - mu * g;
        let velocity = acceleration * duration;
        let expected = 0.5 * acceleration * duration * duration + velocity * velocity / (2.0 * mu * g);
        let found = slide(scale);
        // The tolerance allows for soft contacts and for the discretization of a short push.
        assert!((found / expected - 1.0).abs() < 0.1, "{found} m, expected {expected} m at friction {mu}");
    }
}

#[test]
fn a_target_jumps_by_its_offset_in_the_control_step_of_its_time() {
    let jump = [("jump_time", 0.1), ("jump_x", 0.04), ("jump_y", -0.03), ("jump_z", 0.02)];
    let mut with = Stepper::new("point-reaching", &jump);
    let mut without = Stepper::new("point-reaching", &[]);
    for step in 1..=10 {
        with.step();
        without.step();
        let moved: Vec<f32> = (18..21).map(|i| with.observation[i] - without.observation[i]).collect();
        // 0.1 s is six control steps, so the seventh step starts with the jump.
        let expected = if step > 6 { [0.04, -0.03, 0.02] } else { [0.0; 3] };
        for (moved, expected) in moved.iter().zip(expected) {
            assert!((moved - expected).abs() < 1e-6, "after step {step}: {moved:?}");
        }
    }
}

#[test]
fn a_tilt_of_gravity_accelerates_a_free_ball_sideways() {
    let tilt = 0.03;
    let steps = 12;
    let ball = |axis: &str| Stepper::new("ball-catching", &[(axis, tilt)]).steps(steps).velocity("ball");
    let level = Stepper::new("ball-catching", &[]).steps(steps).velocity("ball");
    let gained = 9.81 * tilt.sin() * steps as f64 / 60.0;
    // A rotation about x turns -z towards y, and one about y turns -z towards -x.
    let about_x = ball("gravity_tilt_x");
    let about_y = ball("gravity_tilt_y");
    assert!((about_x[1] - level[1] - gained).abs() < 1e-9, "{about_x:?}");
    assert!((about_y[0] - level[0] + gained).abs() < 1e-9, "{about_y:?}");
}

#[test]
fn a_thrown_ball_starts_with_the_scaled_velocity() {
    let [nominal, fast] = [1.0, 1.25]
        .map(|scale| Stepper::new("ball-catching", &[("throw_speed_scale", scale)]).velocity("ball"));
    assert!(nominal[0] != 0.0 && fast == nominal.map(|v| 1.25 * v), "{nominal:?} {fast:?}");
}

#[test]
fn a_held_object_slips_by_the_offset_in_the_hand_and_stays_there() {
    for (name, object) in [("cube-stacking", "cube"), ("peg-in-hole", "peg")] {
        for (axis, along) in [("slip_x", 0), ("slip_z", 2)] {
            let in_hand = |stepper: Stepper| {
                let mut world = stepper.model().world();
                world.set_state(&stepper.state);
                world.refresh();
                let rows = world.rows();
                let hand = stepper.model().body("hand").unwrap();
                let from_hand = sub(stepper.position(object), rows.position(hand));
                rotate_back(rows.quaternion(hand), from_hand)
            };
            let slipped = |steps| {
                let start = Stepper::new(name, &[("slip_time", 0.2), (axis, 0.01)]);
                let still = Stepper::new(name, &[]);
                sub(in_hand(start.steps(steps)), in_hand(still.steps(steps)))
            };
            assert_eq!(slipped(12), [0.0; 3], "{name}: before the slip");
            let after = slipped(40);
            for i in 0..3 {
                let expected = if i == along { 0.01 } else { 0.0 };
                assert!((after[i] - expected).abs() < 5e-4, "{name} {axis}: {after:?}");
            }
        }
    }
}

#[test]
fn a_state_restored_during_a_push_continues_with_the_same_bits() {
    for task in TASKS {
        let force = task.definition().variations.push.unwrap().1;
        let push =
            [("servo_gain_scale", 0.9), ("push_time", 0.05), ("push_duration", 0.2), ("push_force_y", force)];
        let mut stepper = Stepper::new(task.definition().name, &push).steps(8);
        let mut restored = Stepper::new(task.definition().name, &[]);
        restored.state.copy_from_slice(&stepper.state);
        for step in 8..20 {
            stepper.step();
            restored.step();
            let bits =
                |row: &Stepper| row.state.iter().chain(&row.signals).map(|x| x.to_bits()).collect::<Vec<_>>();
            assert!(bits(&stepper) == bits(&restored), "{} at step {step}", task.definition().name);
        }
    }
}

#[test]
fn damping_and_weaker_servos_slow_the_arm() {
    // Position of joint 1 after one control step with a raised target and nine with actions of 0.
    let reach = |values: &[(&str, f64)]| {
        let mut stepper = Stepper::new("point-reaching", values);
        let sample = Sample {
            observation: &mut stepper.observation,
            signals: &mut stepper.signals,
            rewards: &mut stepper.rewards,
        };
        stepper.worker.step(&[1.0; 9], &mut stepper.state, sample);
        let stepper = stepper.steps(9);
        let mut world = stepper.model().world();
        world.set_state(&stepper.state);
        world.qpos()[stepper.model().joint("joint1").unwrap().qpos]
    };
    let nominal = reach(&[]);
    assert!(reach(&[("joint_damping", 10.0)]) < nominal);
    assert!(reach(&[("servo_gain_scale", 0.8)]) < nominal);
    assert!(reach(&[("servo_gain_scale", 1.25)]) > nominal);
}

#[test]
fn an_unknown_axis_and_a_value_out_of_range_are_errors() {
    let task = task("ball-balancing").unwrap();
    let target = target(task);
    let wind = Space::new("wind", vec![Axis::start("wind", "m/s", 0.0, 1.0)]).unwrap();
    let error = target.system(&wind, &specification(task)).err().unwrap().to_string();
    assert!(error.contains("wind"), "{error}");
    let dynamics = target.space("dynamics").unwrap();
    let mut system = system(&target, task, &dynamics);
    let request = Request::new(with(&dynamics, &[("friction_scale", -1.0)]), Seed(0));
    let error = system.rollout(&[request]).unwrap_err().to_string();
    assert!(error.contains("friction_scale") && error.contains("-1"), "{error}");
    let error = target.space("dynamics+nowhere").unwrap_err().to_string();
    assert!(error.contains("nowhere") && error.contains("dynamics, delay"), "{error}");
}
