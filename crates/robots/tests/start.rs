//! Settling after a start, and starts from which no episode begins.

use std::path::Path;

use mishandle_robots::{RobotFile, RobotPolicy};
use mishandle_rollout::{
    Component, Environment, Episode, EpisodeEnd, Noise, Request, Sample, Scenario, Seed, Specification,
    StepStatus, Target,
};
use mishandle_stl::Formula;
use mishandle_world::Model;

/// A box on two vertical slides above a floor: the upper joint is driven, the lower one has a name
/// that `[start]` uses itself.
const MODEL: &str = r#"<mujoco>
  <option timestep="0.002"/>
  <worldbody>
    <geom name="floor" type="plane" size="3 3 0.1"/>
    <body name="box" pos="0 0 0.3">
      <joint name="lift" type="slide" axis="0 0 1" damping="2"/>
      <geom name="shell" type="box" size="0.1 0.1 0.1" mass="1"/>
      <body name="flap" pos="0.5 0 0.5">
        <joint name="settle" axis="0 1 0" damping="0.1"/>
        <geom type="box" size="0.1 0.05 0.01" mass="0.1" contype="0" conaffinity="0"/>
      </body>
    </body>
  </worldbody>
  <actuator><motor name="push" joint="lift"/></actuator>
</mujoco>"#;

const FILE: &str = r#"
format = 1
name = "box"
model.file = "box.xml"
control = { period = 0.01, steps = 20 }
memory = { count = { start = "7", next = "count + 1" } }
observation.state = "[*qpos('lift'), *qvel('lift')]"

[start]
lift = "drop"
"(settle)" = "0.2"

[policy]
expression = "[-20 * state[1]]"
action = "action[0] - 0.5 * qvel('lift')[0]"

[signals]
height = "qpos('lift')[0]"
speed = "qvel('lift')[0]"
flap = "qpos('settle')[0]"
force = "sum(contact_forces('shell'))"
clock = "time"
count = "count"

[axes]
drop = { range = [-0.25, 0.4], unit = "m" }
mass = { kind = "model", range = [0.5, 3], scale = "body_mass('box')" }

[formulas]
calm = "always(height <= 1)"
"#;

fn read(folder: &Path, start: &str) -> Result<RobotFile, String> {
    std::fs::write(folder.join("box.xml"), MODEL).unwrap();
    let file = FILE.replace("[start]\n", &format!("[start]\n{start}\n"));
    std::fs::write(folder.join("box.toml"), file).unwrap();
    RobotFile::read(&folder.join("box.toml")).map_err(|error| error.to_string())
}

fn target(start: &str) -> Target {
    let folder = tempfile::tempdir().unwrap();
    let robot = read(folder.path(), start).unwrap();
    let RobotPolicy::Expression(policy) = robot.policy() else { panic!("the policy is an expression") };
    let component =
        Component { role: "controller".into(), name: "e".into(), hash: "h".into(), file_hash: String::new() };
    robot.target(policy.clone(), vec![component], Noise::default()).unwrap()
}

fn simulate(target: &Target, space: &str, scenarios: &[Vec<f64>]) -> Vec<Episode> {
    let space = target.space(space).unwrap();
    let requirement = Formula::parse(&target.formulas[0].text).unwrap();
    let specification = Specification::from_formulas(&target.formulas, requirement).unwrap();
    let requests: Vec<Request> =
        scenarios.iter().map(|values| Request::new(Scenario::from(values.as_slice()), Seed(3))).collect();
    target.system(&space, &specification).unwrap().rollout(&requests).unwrap()
}

/// Height, speed and flap angle after `steps` physics steps in which the controls are computed
/// every 5 steps from an action of 0.
fn settled(height: f64, steps: usize) -> [f64; 3] {
    let mut world = Model::from_xml(MODEL).unwrap().world();
    world.qpos_mut().copy_from_slice(&[height, 0.2]);
    for step in 0..steps {
        if step % 5 == 0 {
            let speed = world.qvel()[0];
            world.ctrl_mut()[0] = -0.5 * speed;
        }
        world.step();
    }
    [world.qpos()[0], world.qvel()[0], world.qpos()[1]]
}

#[test]
fn sample_0_follows_the_physics_steps_of_settling_bit_for_bit() {
    for (duration, steps) in [("0.002", 1), ("0.01", 5), ("0.124", 62), ("1.5", 750)] {
        let target = target(&format!("settle = {duration}"));
        for height in [0.0, 0.4] {
            let trace = &simulate(&target, "starts", &[vec![height]])[0].trace;
            let first: Vec<u64> = (0..3).map(|column| trace.column(column)[0].to_bits()).collect();
            let expected: Vec<u64> = settled(height, steps).iter().map(|number| number.to_bits()).collect();
            assert_eq!(first, expected, "{duration} s from {height} m");
            assert_eq!((trace.column(4)[0], trace.column(5)[0]), (0.0, 7.0), "time and memory start later");
            assert_eq!((trace.column(4)[20], trace.column(5)[20]), (0.2, 27.0));
        }
    }
}

#[test]
fn a_box_that_has_settled_carries_its_weight_and_stays() {
    let trace = &simulate(&target("settle = 3"), "starts", &[vec![0.3]])[0].trace;
    // The box with its flap weighs 1.1 kg.
    let forces = trace.column(3);
    assert!(forces.iter().all(|force| (force - 1.1 * 9.81).abs() < 0.05), "{forces:?}");
    assert!(trace.column(1).iter().all(|speed| speed.abs() < 1e-4));
    let falling = &simulate(&target(""), "starts", &[vec![0.3]])[0].trace;
    assert_eq!((falling.column(0)[0], falling.column(3)[0]), (0.3, 0.0));
}

#[test]
fn settling_has_the_controls_of_hold_and_the_model_of_the_scenario() {
    let held = |hold: &str| {
        let folder = tempfile::tempdir().unwrap();
        read(folder.path(), "settle = 2").unwrap();
        let path = folder.path().join("box.toml");
        let text = std::fs::read_to_string(&path).unwrap();
        std::fs::write(&path, text.replace("[policy]\n", &format!("[policy]\nhold = \"{hold}\"\n"))).unwrap();
        let robot = RobotFile::read(&path).unwrap();
        let RobotPolicy::Expression(policy) = robot.policy() else { panic!("the policy is an expression") };
        let role = "controller".to_string();
        let name = "e".to_string();
        let hash = "h".to_string();
        let component = Component { role, name, hash, file_hash: String::new() };
        robot.target(policy.clone(), vec![component], Noise::default()).unwrap()
    };
    // An upward force of 5 N carries a part of the weight.
    let force =
        |target: &Target, mass: f64| simulate(target, "scenarios", &[vec![0.0, mass]])[0].trace.column(3)[0];
    let pushed = held("5 - 2 * qvel('lift')");
    assert!((force(&pushed, 1.0) - (1.1 * 9.81 - 5.0)).abs() < 0.05);
    assert!((force(&pushed, 2.0) - (2.1 * 9.81 - 5.0)).abs() < 0.05);
}

#[test]
fn an_invalid_start_is_an_episode_without_verdict_and_no_other_one_changes() {
    let conditions = "invalid = [\"geom_pos('shell')[2] < 0.099\", \"sum(contact_forces('shell')) > 0.5\"]";
    let free = target("");
    let limited = target(conditions);
    assert!(!free.can_fail && limited.can_fail);
    let scenarios: Vec<Vec<f64>> = [-0.25, 0.1, -0.2005, 0.0, 0.3].map(|height| vec![height]).to_vec();
    let all = simulate(&free, "starts", &scenarios);
    let found = simulate(&limited, "starts", &scenarios);
    for (index, is_invalid) in [true, false, true, false, false].into_iter().enumerate() {
        if !is_invalid {
            assert_eq!(found[index], all[index]);
            continue;
        }
        let Episode { end, steps, ref trace, .. } = found[index];
        assert_eq!((end, steps, trace.len()), (EpisodeEnd::InvalidScenario, 0, 0));
        assert_eq!(found[index].robustness(), None);
    }
    // After settling, every box rests on the floor.
    let settled = target(&format!("settle = 3\n{conditions}"));
    let ends: Vec<EpisodeEnd> =
        simulate(&settled, "starts", &scenarios).iter().map(|found| found.end).collect();
    assert_eq!(ends, [EpisodeEnd::InvalidScenario; 5]);
}

#[test]
fn a_signal_in_a_condition_is_that_of_sample_0() {
    let scenarios: Vec<Vec<f64>> = (0..20).map(|index| vec![0.02 * f64::from(index)]).collect();
    // The boxes that start higher are still falling.
    let free = simulate(&target("settle = 0.25"), "starts", &scenarios);
    let limited = simulate(&target("settle = 0.25\ninvalid = \"speed < -1\""), "starts", &scenarios);
    let rejected = limited.iter().filter(|found| found.end == EpisodeEnd::InvalidScenario).count();
    assert!(rejected > 0 && rejected < 20, "{rejected}");
    for (free, limited) in free.iter().zip(&limited) {
        let is_invalid = free.trace.column(1)[0] < -1.0;
        assert_eq!(limited.end == EpisodeEnd::InvalidScenario, is_invalid);
    }
}

#[test]
fn physics_that_diverge_while_they_settle_end_the_episode_at_its_reset() {
    let folder = tempfile::tempdir().unwrap();
    read(folder.path(), "settle = 1").unwrap();
    let path = folder.path().join("box.toml");
    let text = std::fs::read_to_string(&path).unwrap();
    std::fs::write(&path, text.replace("[policy]\n", "[policy]\nhold = \"1e9 * qvel('lift') + 1\"\n"))
        .unwrap();
    let robot = RobotFile::read(&path).unwrap();
    let environment = robot.starts().unwrap();
    let mut state = vec![0.0; environment.state_size()];
    let mut observation = vec![0.0; 2];
    let mut signals = [0.0; 6];
    let sample = Sample { observation: &mut observation, signals: &mut signals, rewards: &mut [] };
    let status = environment.worker().reset(&Scenario::from([0.0]), Seed(0), &mut state, sample);
    assert_eq!(status, StepStatus::Diverged);
}

#[test]
fn the_check_of_the_contract_names_a_nominal_start_that_is_invalid() {
    let folder = tempfile::tempdir().unwrap();
    let robot = read(folder.path(), "invalid = \"qpos('lift')[0] < 0.1\"").unwrap();
    let RobotPolicy::Expression(policy) = robot.policy() else { panic!("the policy is an expression") };
    let warnings = robot.check_contract(&**policy).unwrap();
    assert!(warnings.len() == 1 && warnings[0].contains("`start.invalid`"), "{warnings:?}");
}

#[test]
fn a_start_away_from_nominal_that_is_invalid_says_nothing_about_the_observation() {
    let folder = tempfile::tempdir().unwrap();
    let warnings = |condition: &str| {
        // A box without gravity moves only if its start moves it.
        let start = format!("velocity = {{ lift = \"drop\" }}\n{condition}");
        read(folder.path(), &start).unwrap();
        let path = folder.path().join("box.toml");
        let file = std::fs::read_to_string(&path).unwrap();
        let file = file.replace("lift = \"drop\"\n", "lift = \"0\"\n");
        let file = file.replace("\"box.xml\"", "\"box.xml\"\nmodel.gravity = [0, 0, 0]");
        std::fs::write(&path, file).unwrap();
        let robot = RobotFile::read(&path).unwrap();
        let RobotPolicy::Expression(policy) = robot.policy() else { panic!("the policy is an expression") };
        robot.check_contract(&**policy).unwrap()
    };
    assert_eq!(warnings("invalid = \"drop > 9\""), Vec::<String>::new());
    assert_eq!(warnings("invalid = \"drop > 0.2\""), Vec::<String>::new());
}

#[test]
fn mistakes_of_settling_and_conditions_name_their_line() {
    let folder = tempfile::tempdir().unwrap();
    for (start, part) in [
        ("settle = 0.003", "0.003 s of `settle` are not a whole number of physics steps of 0.002 s"),
        ("settle = 3000", "at most 1000000"),
        ("settle = 0", "greater than 0 s"),
        ("settle = \"flap\"", "`settle` must be a number"),
        ("invalid = 1", "`invalid` must be a text"),
        ("invalid = [\"1\", \"qpos('lift') > 0\", \"[1, 2]\"]", "is one number"),
        ("invalid = \"qpos('lft')[0]\"", "did you mean `lift`?"),
    ] {
        let error = read(folder.path(), start).err().unwrap();
        assert!(error.contains(part) && error.contains("box.toml, line 10:"), "{start}: {error}");
    }
}

#[test]
fn the_rows_of_a_batch_have_conditions_of_their_own() {
    let target = target("invalid = \"height > 0.2\"");
    let many: Vec<Vec<f64>> = (0..60).map(|index| vec![f64::from(index % 5) * 0.1]).collect();
    let found = simulate(&target, "starts", &many);
    for (index, episode) in found.iter().enumerate() {
        let end = if index % 5 > 2 { EpisodeEnd::InvalidScenario } else { EpisodeEnd::Completed };
        assert_eq!(episode.end, end, "row {index}");
    }
}
