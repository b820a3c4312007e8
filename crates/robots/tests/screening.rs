//! A robot in worlds of another engine: with MuJoCo C behind the interface, outcomes are those of
//! its episodes, and what such an engine cannot do is an error.

use std::sync::Arc;

use mishandle_robots::{ControlledRobot, RobotFile, RobotPolicy};
use mishandle_rollout::{
    Component, EpisodeEnd, Noise, Request, RolloutError, ScenarioBatch, Screen, Screening, Seed, Space,
    Specification, System, Target,
};
use mishandle_stl::Formula;
use mishandle_world::{BatchSpec, CpuDevice, WorldBatch, WorldDevice, WorldError};

/// An arm with two servos and a motor beside a mocap goal and a free ball.
const MODEL: &str = r#"<mujoco>
  <option timestep="0.005" integrator="implicitfast"/>
  <worldbody>
    <geom name="floor" type="plane" size="3 3 0.1" pos="0 0 -1"/>
    <body name="upper" pos="0 0 0.2">
      <joint name="shoulder" axis="0 1 0" damping="0.1"/>
      <geom name="a" type="capsule" fromto="0 0 0 0.3 0 0" size="0.03" mass="1"/>
      <body name="lower" pos="0.3 0 0">
        <joint name="elbow" axis="0 1 0" damping="0.1"/>
        <geom name="b" type="capsule" fromto="0 0 0 0.3 0 0" size="0.03" mass="0.5"/>
        <site name="tip" pos="0.3 0 0"/>
      </body>
    </body>
    <body name="wheel" pos="0 1 0">
      <joint name="spin" axis="0 1 0" damping="0.02"/>
      <geom name="rim" type="cylinder" size="0.1 0.02" mass="0.2"/>
    </body>
    <body name="ball" pos="0.2 0 0.6"><freejoint name="free"/><geom name="shell" size="0.05" mass="0.2"/></body>
    <body name="goal" mocap="true" pos="0.4 0 0.3"><geom size="0.01" contype="0" conaffinity="0"/></body>
  </worldbody>
  <actuator>
    <position name="s" joint="shoulder" kp="80" kv="8" forcerange="-40 40"/>
    <position name="e" joint="elbow" kp="40" kv="4" forcerange="-20 20"/>
    <motor name="m" joint="spin" ctrlrange="-0.5 0.5"/>
  </actuator>
  <sensor><actuatorfrc name="effort" actuator="s"/></sensor>
</mujoco>"#;

const FILE: &str = r#"
format = 1
name = "arm"
model.file = "arm.xml"
control = { period = 0.02, steps = 60 }
start = { shoulder = "bend", settle = 0.03, invalid = ["bend > 0.35"] }
memory.filtered = { start = "[bend, 0]", next = "0.5 * filtered + 0.5 * action[0:2]" }

[servos]
max_velocity = [1.5, 2]
max_effort = [40, 20]

[observation]
joints = "[*qpos('shoulder'), *qpos('elbow'), *qvel('spin')]"
goal = "body_pos('goal') - site_pos('tip')"
motor = "ctrl('m')"

[policy]
expression = "[joints[0] + 2 * goal[2], joints[1] + goal[0], 0.3 * goal[2] - motor]"
action = "[*filtered, action[2]]"
hold = "[bend, 0, 0.2]"

[signals]
distance = "norm(body_pos('goal') - site_pos('tip'))"
ball = "qpos('free')[2]"
swing = "body_angvel('lower')[1] + 0.01 * time"
wheel = "qvel('spin')[0] + 0 * ctrl('m')[0]"

[axes]
bend = { range = [-0.4, 0.4], unit = "rad" }
load = { kind = "model", range = [0.5, 3], scale = "body_mass('lower')" }
shove = { kind = "event", body = "lower", time = [0, 1], duration = [0.05, 0.3], x = [-3, 3], z = [-6, 6] }
gust = { kind = "event", body = "lower", time = [0, 1], duration = 0.1, y = [-2, 2] }
move = { kind = "event", jump = "goal", time = [0, 1], x = [-0.2, 0.2], z = [-0.2, 0.2] }
late = { kind = "model", range = [0, 4], delay = "action" }
roll = { kind = "noise", range = [-1, 1] }

[formulas]
near = "always[20:60](distance <= 0.45) and always(ball >= -2) and always(swing <= 9) and always(wheel <= 90)"
"#;

const NOISE: Noise = Noise { action_std: 0.05, observation_std: 0.01 };

/// Returns the robot of a file, with the policy of the file.
fn robot(file: &str) -> (RobotFile, ControlledRobot, Target) {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("arm.xml"), MODEL).unwrap();
    std::fs::write(folder.path().join("arm.toml"), file).unwrap();
    let robot = RobotFile::read(&folder.path().join("arm.toml")).unwrap_or_else(|error| panic!("{error}"));
    let RobotPolicy::Expression(policy) = robot.policy() else { panic!("the policy is an expression") };
    let policy = policy.clone();
    let component =
        Component { role: "controller".into(), name: "e".into(), hash: "h".into(), file_hash: String::new() };
    let target = robot.target(policy.clone(), vec![component], NOISE).unwrap();
    let controlled = robot.controlled(policy, NOISE).unwrap();
    (robot, controlled, target)
}

fn all_axes(target: &Target) -> Space {
    Space::new("scenarios", target.axes.clone()).unwrap()
}

fn specification(target: &Target) -> Specification {
    let requirement = Formula::parse(&target.formulas[0].text).unwrap();
    Specification::from_formulas(&target.formulas, requirement).unwrap()
}

/// Compares screened simulations of random scenarios with episodes, and returns how these ended.
fn compare(file: &str, space: impl Fn(&Target) -> Space) -> Vec<(EpisodeEnd, bool)> {
    let (robot, controlled, target) = robot(file);
    let space = space(&target);
    let specification = specification(&target);
    let requests: Vec<Request> =
        (0..60).map(|i| Request::new(space.sample(Seed(3), i), Seed(100 + i))).collect();
    let environment = Arc::new(controlled.environment(&space).unwrap());
    let mut system = controlled.system_in(environment, &space, &specification).unwrap();
    let expected = system.rollout(&requests).unwrap();
    let worlds = robot.on_device(&controlled, &space).unwrap();
    // Fewer rows than simulations: rows are used again, and batches differ in size.
    let batch = |rows| Box::new(worlds.batch(&CpuDevice, rows).unwrap()) as Box<dyn ScenarioBatch>;
    let mut screening = Screening::new(system, vec![batch(17), batch(2)]);
    let found = screening.run(&requests, &|_| true).unwrap();
    for (row, (episode, screened)) in expected.iter().zip(found).enumerate() {
        let screened = screened.unwrap();
        assert_eq!((screened.end, &screened.verdict), (episode.end, &episode.verdict), "simulation {row}");
    }
    expected.iter().map(|episode| (episode.end, episode.is_violated())).collect()
}

#[test]
fn screened_simulations_on_the_cpu_have_the_bits_of_episodes() {
    let ends = compare(FILE, all_axes);
    for violated in [false, true] {
        let count = ends.iter().filter(|end| **end == (EpisodeEnd::Completed, violated)).count();
        assert!(count > 5, "{count} episodes with violated = {violated}: the test needs both outcomes");
    }
    assert!(ends.iter().any(|(end, _)| *end == EpisodeEnd::InvalidScenario));
}

#[test]
fn controls_without_servos_have_the_bits_of_episodes() {
    let (before, after) = FILE.split_once("[servos]").unwrap();
    let (_, after) = after.split_once("[observation]").unwrap();
    compare(&format!("{before}[observation]{after}"), all_axes);
}

#[test]
fn controls_that_are_not_finite_end_a_screened_simulation_as_an_episode() {
    let broken = FILE.replace("action = \"[*filtered, action[2]]\"", "action = \"[*filtered, log(bend)]\"");
    let ends = compare(&broken, all_axes);
    let diverged = |end: &&(EpisodeEnd, bool)| matches!(end.0, EpisodeEnd::Diverged { .. });
    assert!(ends.iter().filter(diverged).count() > 5, "{ends:?}");
}

#[test]
fn what_another_engine_cannot_do_is_an_error_with_its_line() {
    let slip = "[axes]\nice = { kind = \"event\", slip = \"geom_friction('floor')[0]\", scale = [0, 1], time = 0, duration = 1 }";
    let hop = "[axes]\nhop = { kind = \"event\", jump = \"ball\", time = 0, z = [0, 1] }";
    let second = "[axes]\nsecond = { kind = \"event\", body = \"ball\", time = 0, duration = 1, x = [0, 1] }";
    for (from, to, part) in [
        (
            "ball = \"qpos('free')[2]\"",
            "ball = { value = \"qpos('free')[2]\", over = \"max\" }",
            "`ball` has `over`",
        ),
        ("ball = \"qpos('free')[2]\"", "ball = \"sensor('effort')[0]\"", "`ball` reads forces or sensors"),
        ("motor = \"ctrl('m')\"", "motor = \"actuator_force('m')\"", "`motor` reads forces or sensors"),
        ("motor = \"ctrl('m')\"", "motor = \"ctrl('s')\"", "`motor` reads `ctrl` of [servos]"),
        ("next = \"0.5 *", "next = \"sum(contact_forces('shell')) + 0.5 *", "`filtered` reads forces"),
        ("action[2]]\"", "bias_forces('spin')[0]]\"", "`policy.action` reads forces"),
        ("[axes]", slip, "the event `ice` is a slip"),
        ("[axes]", hop, "the event `hop` displaces a free body"),
        ("[axes]", second, "the event `shove` pushes a second body"),
        (
            "action = \"[*filtered, action[2]]\"",
            "actuators = \"some\"\naction = \"[action[0], action[2]]\"",
            "an actuator of [servos]",
        ),
    ] {
        let mut text = FILE.replacen(from, to, 1);
        assert_ne!(text, FILE, "{from}");
        if to.contains("some") {
            text = text.replace(
                "[servos]",
                "[constants]\nsome = { group = \"actuator\", names = [\"s\", \"m\"] }\n\n[servos]",
            );
            text = text.replace("hold = \"[bend, 0, 0.2]\"", "hold = \"[bend, 0.2]\"");
        }
        let (robot, controlled, target) = robot(&text);
        let error = robot.on_device(&controlled, &all_axes(&target)).err().expect(part).to_string();
        assert!(error.contains(part) && error.contains(", line "), "{part}: {error}");
        assert!(error.contains("without screening"), "{error}");
        // An event outside the space does not happen.
        if part.contains("the event") {
            let starts = target.space("starts").unwrap();
            assert!(robot.on_device(&controlled, &starts).is_ok(), "{part}");
        }
    }
}

/// A device that simulates nothing.
struct Refusing;

impl WorldDevice for Refusing {
    fn engine(&self) -> &'static str {
        "none"
    }

    fn batch(&self, _spec: &BatchSpec) -> Result<Box<dyn WorldBatch>, WorldError> {
        Err(WorldError::Device("it needs the integrator implicitfast".to_string()))
    }
}

#[test]
fn a_model_that_the_device_does_not_support_is_its_error() {
    let (robot, controlled, target) = robot(FILE);
    let worlds = robot.on_device(&controlled, &all_axes(&target)).unwrap();
    let error = worlds.batch(&Refusing, 3).err();
    assert!(matches!(&error, Some(RolloutError::Engine(text)) if text.contains("implicitfast")), "{error:?}");
}
