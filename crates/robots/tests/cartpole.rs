//! A cart-pole in a file, against a loop written by hand.

use std::path::Path;

use mishandle_robots::{RobotFile, RobotPolicy};
use mishandle_rollout::{
    Component, Environment, Episode, Noise, Request, Sample, Scenario, Seed, Specification, StepStatus,
    Target,
};
use mishandle_stl::Formula;
use mishandle_world::{Change, FieldOperation, Model, ModelField};

use crate::function_controller::controller;

const MODEL: &str = r#"<mujoco>
  <option timestep="0.005"/>
  <worldbody>
    <geom name="floor" type="plane" size="3 3 0.1" pos="0 0 -0.5"/>
    <body name="cart">
      <joint name="slide" type="slide" axis="1 0 0" damping="0.1"/>
      <geom type="box" size="0.15 0.1 0.06" mass="1"/>
      <body name="pole">
        <joint name="hinge" axis="0 1 0" damping="0.002"/>
        <geom name="rod" type="capsule" fromto="0 0 0 0 0 0.6" size="0.02" mass="0.1"/>
        <site name="tip" pos="0 0 0.6"/>
      </body>
    </body>
  </worldbody>
  <actuator><motor name="force" joint="slide" ctrlrange="-20 20" ctrllimited="true"/></actuator>
</mujoco>"#;

const FILE: &str = r#"
format = 1
name = "cartpole"
model.file = "cartpole.xml"
control = { period = 0.02, steps = 120 }
start = { hinge = "tilt" }
observation.state = "[*qpos('slide'), *qvel('slide'), *qpos('hinge'), *qvel('hinge')]"

[policy]
expression = "dot([1, 2, 25, 4], state)"
action = "action"

[signals]
angle = { value = "abs(qpos('hinge'))[0]", unit = "rad" }
height = { value = "site_pos('tip')[2]", unit = "m" }
fastest = { value = "abs(qvel('hinge')[0])", over = "max" }

[axes]
tilt = { range = [-0.3, 0.3], unit = "rad" }
pole = { kind = "model", range = [0.5, 4], scale = "body_mass('pole')" }
gust = { kind = "event", body = "pole", time = [0.5, 3], duration = [0.05, 0.2], x = [-4, 4] }

[formulas]
upright = "always(angle <= 0.5)"
"#;

fn read(folder: &Path, file: &str) -> Result<RobotFile, String> {
    std::fs::write(folder.join("cartpole.xml"), MODEL).unwrap();
    std::fs::write(folder.join("cartpole.toml"), file).unwrap();
    RobotFile::read(&folder.join("cartpole.toml")).map_err(|error| {
        let text = error.to_string();
        text.replace(&folder.display().to_string(), "FOLDER")
    })
}

fn target(robot: &RobotFile) -> Target {
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

/// The same simulation by hand: the three signals at each control step.
fn by_hand(tilt: f64, pole: f64, [start, duration, force]: [f64; 3]) -> Vec<[f64; 3]> {
    let model = Model::from_xml(MODEL).unwrap();
    let body = model.body("pole").unwrap();
    let entries = vec![body.index()];
    let change =
        Change::Field { field: ModelField::BodyMass, entries, operation: FieldOperation::Scale, value: pole };
    let model = if pole == 1.0 { model } else { model.changed(&[change]) };
    let tip = model.site("tip").unwrap();
    let mut world = model.world();
    world.reset();
    world.qpos_mut()[1] = tilt;
    let mut samples = Vec::new();
    let mut fastest = world.qvel()[1].abs();
    for step in 0..=120 {
        world.refresh();
        samples.push([world.qpos()[1].abs(), world.rows().site_position(tip)[2], fastest]);
        // Observations and actions are 32-bit numbers.
        let state =
            [world.qpos()[0], world.qvel()[0], world.qpos()[1], world.qvel()[1]].map(|x| f64::from(x as f32));
        let action = [1.0, 2.0, 25.0, 4.0].iter().zip(state).map(|(gain, x)| gain * x).sum::<f64>() as f32;
        world.ctrl_mut()[0] = f64::from(action).clamp(-20.0, 20.0);
        fastest = 0.0;
        for substep in 0..4 {
            let time = f64::from(step) * 0.02 + f64::from(substep) * 0.005;
            let covered = ((time + 0.005).min(start + duration) - time.max(start)).max(0.0) / 0.005;
            world.push(body, [force * covered, 0.0, 0.0]);
            world.step();
            fastest = fastest.max(world.qvel()[1].abs());
        }
    }
    samples
}

#[test]
fn traces_are_those_of_a_loop_by_hand_bit_for_bit() {
    let folder = tempfile::tempdir().unwrap();
    let target = target(&read(folder.path(), FILE).unwrap());
    let scenarios = [
        vec![0.1, 1.0, 0.5, 0.2, 0.0],
        vec![-0.3, 1.0, 0.5, 0.1, 3.0],
        vec![0.05, 3.7, 0.513, 0.07, -2.0],
        vec![0.2, 0.5, 1.0, 0.2, 0.0],
    ];
    // More rows than one thread steps together, in another order.
    let many: Vec<Vec<f64>> = (0..40).map(|row| scenarios[row * 7 % 4].clone()).collect();
    let alone = simulate(&target, "scenarios", &scenarios);
    let together = simulate(&target, "scenarios", &many);
    for (row, episode) in together.iter().enumerate() {
        assert_eq!(episode.trace, alone[row * 7 % 4].trace, "row {row}");
    }
    for (values, episode) in scenarios.iter().zip(&alone) {
        let expected = by_hand(values[0], values[1], [values[2], values[3], values[4]]);
        assert_eq!(episode.trace.len(), 121);
        for (column, name) in ["angle", "height", "fastest"].iter().enumerate() {
            let found: Vec<u64> = episode.trace.column(column).iter().map(|x| x.to_bits()).collect();
            let expected: Vec<u64> = expected.iter().map(|sample| sample[column].to_bits()).collect();
            assert_eq!(found, expected, "{name} of {values:?}");
        }
    }
}

#[test]
fn nominal_values_of_all_axes_change_no_bit() {
    let folder = tempfile::tempdir().unwrap();
    let target = target(&read(folder.path(), FILE).unwrap());
    let nominal = |space: &str| -> Vec<f64> {
        target.space(space).unwrap().nominal().values().iter().map(|value| value.unwrap()).collect()
    };
    let small = simulate(&target, "starts", &[nominal("starts")]);
    let large = simulate(&target, "all", &[nominal("all")]);
    assert_eq!(small[0].trace, large[0].trace);
    let names: Vec<&str> = target.spaces.iter().map(mishandle_rollout::Space::name).collect();
    let expected = [
        "scenarios",
        "starts",
        "dynamics",
        "events",
        "delay",
        "timing",
        "sensing",
        "disturbance",
        "faults-sensing",
        "faults-actuation",
    ];
    assert_eq!(names, expected);
}

#[test]
fn every_robot_has_a_disturbance_of_delays_biases_model_and_events() {
    let folder = tempfile::tempdir().unwrap();
    let names = |file: &str| -> Vec<String> {
        let target = target(&read(folder.path(), file).unwrap());
        let space = target.space("disturbance").unwrap();
        assert!(space.axes().iter().all(|axis| axis.nominal.is_some()), "a margin needs nominal values");
        assert!(space.axes().iter().all(|axis| !target.random_axes.contains(&axis.name)));
        space.axes().iter().map(|axis| axis.name.clone()).collect()
    };
    let of_loop =
        ["action_delay", "observation_delay", "bias_state_1", "bias_state_2", "bias_state_3", "bias_state_4"];
    let of_file = ["pole", "gust_time", "gust_duration", "gust_x"];
    assert_eq!(names(FILE), [&of_loop[..], &of_file].concat());
    let (before, _) = FILE.split_once("[axes]").unwrap();
    let plain =
        format!("{}[formulas]\nupright = \"always(angle <= 0.5)\"", before.replace("\"tilt\"", "\"0.1\""));
    assert_eq!(names(&plain), of_loop);
    // An axis of the file with the same effect replaces that of every robot.
    let late = "[axes]\nlate = { kind = \"model\", range = [0, 9], delay = \"action\" }";
    let own = names(&FILE.replace("[axes]", late));
    assert!(own.contains(&"late".to_string()) && !own.contains(&"action_delay".to_string()), "{own:?}");
}

#[test]
fn mistakes_name_their_line_and_the_nearest_element() {
    let folder = tempfile::tempdir().unwrap();
    for (from, to, line, part) in [
        (
            "qvel('hinge')]",
            "qvel('hing')]",
            7,
            "no joint `hing`; did you mean `hinge`? (joints: slide, hinge)",
        ),
        ("site_pos('tip')", "site_pos('top')", 15, "did you mean `tip`?"),
        ("site_pos('tip')[2]", "site_pos('tip')", 15, "the signal `height` has 3 numbers"),
        ("hinge = \"tilt\"", "hinge = \"tild\"", 6, "did you mean `tilt`?"),
        ("hinge = \"tilt\"", "henge = \"tilt\"", 6, "did you mean `hinge`?"),
        ("25, 4], state", "25], state", 10, "the arguments of `dot` have 3 and 4 numbers"),
        (
            "action = \"action\"",
            "action = \"[action[0], 1]\"",
            11,
            "needs 1 numbers, and the expression has 2",
        ),
        ("body_mass('pole')", "body_mas('pole')", 20, "body_mass"),
        ("body_mass('pole')", "body_mass('polo')", 20, "did you mean `pole`?"),
        ("range = [0.5, 4]", "range = [-1, 4]", 20, "is negative"),
        ("range = [-0.3, 0.3]", "range = [0.3, -0.3]", 19, "low at most high"),
        ("body = \"pole\"", "body = \"poles\"", 21, "did you mean `pole`?"),
        ("x = [-4, 4]", "x = [1, 4]", 21, "contains 0"),
        ("steps = 120", "step = 120", 5, "needs the key `steps`"),
        ("steps = 120", "steps = 120, stops = 1", 5, "no key `stops`; did you mean `steps`?"),
        ("period = 0.02", "period = 0.012", 5, "not a whole number of physics steps"),
        ("always(angle <= 0.5)", "always(angel <= 0.5)", 24, "angel"),
        ("format = 1", "format = 2", 2, "format = 1"),
        ("over = \"max\"", "over = \"most\"", 16, "must be \"max\""),
        ("kind = \"model\"", "kind = \"modal\"", 20, "`kind` must be"),
        ("expression =", "expresion =", 10, "no key `expresion`; did you mean `expression`?"),
        ("[formulas]", "[formulae]", 23, "no key `formulae`; did you mean `formulas`?"),
    ] {
        assert!(FILE.contains(from), "{from}");
        let error = match read(folder.path(), &FILE.replace(from, to)) {
            Ok(robot) => {
                let RobotPolicy::Expression(policy) = robot.policy() else { panic!("{to} is accepted") };
                let component = Component {
                    role: String::new(),
                    name: String::new(),
                    hash: String::new(),
                    file_hash: String::new(),
                };
                let made = robot.target(policy.clone(), vec![component], Noise::default());
                made.err().map_or_else(|| panic!("{to} is accepted"), |error| error.to_string())
            }
            Err(error) => error,
        };
        assert!(error.contains(part), "{to}: {error}");
        assert!(error.contains(&format!("cartpole.toml, line {line}:")), "{to}: {error}");
    }
}

#[test]
fn an_axis_may_bias_all_numbers_of_a_part_or_each() {
    let folder = tempfile::tempdir().unwrap();
    let bias = |each: &str| {
        let axis =
            format!("[axes]\nerror = {{ kind = \"model\", range = [-0.1, 0.1], bias = \"state\"{each} }}");
        target(&read(folder.path(), &FILE.replace("[axes]", &axis)).unwrap())
    };
    let names = |target: &Target| -> Vec<String> {
        target.space("sensing").unwrap().axes().iter().map(|axis| axis.name.clone()).collect()
    };
    let all = bias("");
    let each = bias(", each = true");
    assert_eq!(names(&all), ["error", "noise_state"]);
    assert_eq!(names(&each), ["error_1", "error_2", "error_3", "error_4", "noise_state"]);
    let [one, four] = [(&all, vec![0.02, 0.0]), (&each, vec![0.02, 0.02, 0.02, 0.02, 0.0])]
        .map(|(target, values)| simulate(target, "sensing", &[values]));
    assert_eq!(one[0].trace, four[0].trace);
    assert_ne!(one[0].trace, simulate(&all, "sensing", &[vec![0.0, 0.0]])[0].trace);
}

/// A pendulum with a torque motor. Without a policy it hangs; `hold` must keep it up.
const ARM: &str = r#"
format = 1
name = "arm"
model.file = "arm.xml"
control = { period = 0.01, steps = 30 }
start = { shoulder = "0.7" }
observation = { angle = "qpos('shoulder')", rate = "qvel('shoulder')" }
policy = { expression = "40 * (0.7 - angle) - 8 * rate", action = "bias_forces + action", hold = "bias_forces" }
signals.error = "abs(qpos('shoulder')[0] - 0.7)"
formulas.stays = "always(error <= 0.001)"
"#;

#[test]
fn the_controls_before_a_late_action_are_those_of_hold() {
    let folder = tempfile::tempdir().unwrap();
    let model = r#"<mujoco><option timestep="0.002" integrator="implicitfast"/><worldbody><body name="link">
        <joint name="shoulder" axis="0 1 0"/><geom type="capsule" fromto="0 0 0 0.5 0 0" size="0.03" mass="1"/></body></worldbody>
        <actuator><motor name="motor" joint="shoulder"/></actuator></mujoco>"#;
    std::fs::write(folder.path().join("arm.xml"), model).unwrap();
    let worst = |file: &str, delay: f64| {
        std::fs::write(folder.path().join("arm.toml"), file).unwrap();
        let target = target(&RobotFile::read(&folder.path().join("arm.toml")).unwrap());
        let trace = &simulate(&target, "delay", &[vec![delay, 0.0]])[0].trace;
        trace.column(0).iter().copied().fold(0.0, f64::max)
    };
    let without = ARM.replace(", hold = \"bias_forces\"", "").replace("bias_forces + action", "action");
    assert!(
        worst(ARM, 0.0) < 1e-3 && worst(ARM, 3.0) < 1e-3,
        "gravity is compensated, also while actions are late"
    );
    let with_bias = without.replace("action = \"action\"", "action = \"bias_forces + action\"");
    assert!(worst(&with_bias, 3.0) < 1e-3, "an action of 0 with compensation");
    let dropped = with_bias.replace("bias_forces + action\"", "bias_forces + action\", hold = \"[0]\"");
    assert!(worst(&dropped, 3.0) > 0.003, "three steps of free fall");
}

/// A cart-pole that falls, with an action of its own; its training ends at 0.35 rad.
const TRAINED: &str = r#"
format = 1
name = "cartpole"
model.file = "cartpole.xml"
control = { period = 0.02, steps = 120 }
start = { hinge = "tilt" }
observation.state = "[*qpos('hinge'), *qvel('hinge')]"
policy = { action = "action", limit = 0.25 }
signals.angle = { value = "abs(qpos('hinge')[0])", clip = [0, 1] }
signals.height = "site_pos('tip')[2]"
rewards = { push = "action[0]", upright = "2 * angle" }
ends = { fallen = "angle > 0.35", far = "abs(qpos('slide')[0]) > 5" }
axes.tilt = { range = [0.1, 0.3], unit = "rad" }
axes.rod = { kind = "model", range = [0.5, 4], scale = "body_mass('pole')" }
formulas = { upright = "always(angle <= 0.3)", tall = "always(height > 0)" }
"#;

#[test]
fn a_condition_of_the_file_ends_training_episodes_and_no_evaluated_ones() {
    let folder = tempfile::tempdir().unwrap();
    let robot = read(folder.path(), TRAINED).unwrap();
    let environment = robot.training().unwrap().environment;
    assert_eq!(environment.space().axes().len(), 1, "only axes of the start");
    let mut state = vec![0.0; environment.state_size()];
    let mut observation = vec![0.0; 2];
    let mut signals = [0.0; 2];
    let mut rewards = [0.0; 2];
    let mut worker = environment.worker();
    let mut angles = Vec::new();
    let sample = Sample { observation: &mut observation, signals: &mut signals, rewards: &mut rewards };
    worker.reset(&Scenario::from([0.3]), Seed(1), &mut state, sample);
    let ended = (1..=120).find(|_| {
        let sample = Sample { observation: &mut observation, signals: &mut signals, rewards: &mut rewards };
        let status = worker.step(&[0.0], &mut state, sample);
        angles.push(signals[0]);
        assert_eq!(rewards[1], 2.0 * signals[0], "a reward reads a signal within its bounds");
        assert_ne!(status, StepStatus::Diverged);
        status == StepStatus::Terminated
    });
    let ended = ended.unwrap();
    assert!(angles[..ended - 1].iter().all(|angle| *angle <= 0.35) && angles[ended - 1] > 0.35, "{angles:?}");
    let component =
        Component { role: "controller".into(), name: "e".into(), hash: "h".into(), file_hash: String::new() };
    let still = controller([2, 1, 0], |_, _, action| action.fill(0.0));
    let target = robot.target(still, vec![component], Noise::default()).unwrap();
    let episode = &simulate(&target, "starts", &[vec![0.3]])[0];
    assert_eq!(episode.trace.len(), 121);
    let angle = episode.trace.column(0).to_vec();
    assert_eq!(angle[1..=ended], angles, "the same simulation");
}

#[test]
fn success_of_a_validation_is_the_formula_of_that_name_or_the_first() {
    let folder = tempfile::tempdir().unwrap();
    let specification = |formulas: &str| {
        let line = TRAINED.lines().find(|line| line.starts_with("formulas")).unwrap();
        let file = TRAINED.replace(line, &format!("formulas = {{ {formulas} }}"));
        let found = read(folder.path(), &file).unwrap().training().unwrap().specification;
        let [success, strict] = [found.success, found.strict].map(|formula| formula.unwrap().to_string());
        (success, strict)
    };
    let text = |formula: &str| Formula::parse(formula).unwrap().to_string();
    let [angle, height] = ["always(angle <= 0.3)", "always(height > 0)"];
    let first = specification(&format!("upright = \"{angle}\", tall = \"{height}\""));
    assert_eq!(first, (text(angle), text(angle)));
    let named = specification(&format!("upright = \"{angle}\", success = \"{height}\""));
    assert_eq!(named, (text(height), text(height)));
    let strict = specification(&format!("strict = \"{angle}\", success = \"{height}\""));
    assert_eq!(strict, (text(height), text(angle)));
}

#[test]
fn pushes_on_one_body_add_up() {
    let folder = tempfile::tempdir().unwrap();
    let push = |name: &str| {
        format!("{name} = {{ kind = \"event\", body = \"pole\", time = 0.5, duration = 0.1, x = [-4, 4] }}")
    };
    let axes = format!(
        "[axes]\n{}\n{}",
        push("first").replace("0.5,", "[0.5, 0.5],"),
        push("second").replace("0.5,", "[0.5, 0.5],")
    );
    let target = target(&read(folder.path(), &FILE.replace("[axes]", &axes)).unwrap());
    let space = target.space("events").unwrap();
    let names: Vec<&str> = space.axes().iter().map(|axis| axis.name.as_str()).collect();
    let scenario = |first: f64, second: f64| -> Vec<f64> {
        let value = |axis: &mishandle_rollout::Axis| match axis.name.as_str() {
            "first_x" => first,
            "second_x" => second,
            _ => axis.nominal.unwrap(),
        };
        space.axes().iter().map(value).collect()
    };
    assert!(names.contains(&"first_x") && names.contains(&"second_x"), "{names:?}");
    let scenarios = [scenario(3.0, 0.0), scenario(0.0, 3.0), scenario(1.5, 1.5), scenario(0.0, 0.0)];
    let found = simulate(&target, "events", &scenarios);
    assert_eq!(found[0].trace, found[1].trace);
    assert_eq!(found[0].trace, found[2].trace);
    assert_ne!(found[0].trace, found[3].trace);
}
