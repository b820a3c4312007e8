//! The contract between a policy and the robot of a file: order of joints, frames, warnings.

use std::path::Path;
use std::sync::Arc;

use mishandle_robots::{RobotFile, RobotPolicy};
use mishandle_rollout::{Component, Controller, Noise, Request, Scenario, Seed, Specification};
use mishandle_stl::Formula;

use crate::function_controller::controller;

/// Two sliders whose actuators are in the other order than the joints, and a box that floats.
const MODEL: &str = r#"<mujoco>
  <option timestep="0.01" gravity="0 0 0"/>
  <worldbody>
    <body name="first"><joint name="a" type="slide" axis="1 0 0"/><geom size="0.1" mass="2" contype="0" conaffinity="0"/></body>
    <body name="second"><joint name="b" type="slide" axis="0 1 0"/><geom size="0.1" mass="2" contype="0" conaffinity="0"/></body>
    <body name="box"><freejoint name="root"/><geom type="box" size="0.1 0.1 0.1" contype="0" conaffinity="0"/></body>
  </worldbody>
  <actuator>
    <motor name="push_b" joint="b" ctrlrange="-5 5" ctrllimited="true"/>
    <motor name="push_a" joint="a" ctrlrange="-5 5" ctrllimited="true"/>
  </actuator>
</mujoco>"#;

const FILE: &str = r#"
format = 1
name = "sliders"
model.file = "model.xml"
control = { period = 0.01, steps = 12 }

[constants]
joints = { group = "joint", names = ["b", "a"] }
motors = { group = "actuator", names = ["push_a", "push_b"] }

[start]
joints = "[0.25, shift]"
root = "[0, 0, 0, *quat_euler(0, 0, pi / 2)]"
velocity.root = "[1, 0, 0, 0, 0, 3]"

[observation]
position = "qpos(joints)"
command = "[2 * shift, 1]"

[policy]
expression = "[3, 4] + 0 * position"
actions = 2
action = "action"
actuators = "motors"

[signals]
control_a = "ctrl('push_a')[0]"
control_b = "ctrl('push_b')[0]"
position_b = "qpos(joints)[0]"
forward = "body_frame('box', body_vel('box'))[0]"
left = "body_frame('box', body_vel('box'))[1]"
turn = "body_frame('box', body_angvel('box'))[2]"
down = "body_frame('box', [0, 0, -1])[2]"

[axes]
shift = { range = [-0.5, 0.5] }

[formulas]
slow = "always(control_a <= 10)"
"#;

fn read(folder: &Path, file: &str) -> Result<RobotFile, String> {
    read_with(folder, MODEL, file)
}

fn read_with(folder: &Path, model: &str, file: &str) -> Result<RobotFile, String> {
    std::fs::write(folder.join("model.xml"), model).unwrap();
    std::fs::write(folder.join("sliders.toml"), file).unwrap();
    RobotFile::read(&folder.join("sliders.toml")).map_err(|error| error.to_string())
}

fn expression(robot: &RobotFile) -> Arc<dyn Controller> {
    let RobotPolicy::Expression(policy) = robot.policy() else { panic!("the policy is an expression") };
    policy.clone()
}

/// Returns the signals of the nominal scenario at the first and the second sample.
fn samples(file: &str) -> [Vec<f64>; 2] {
    let all = samples_with(MODEL, file);
    [all[0].clone(), all[1].clone()]
}

/// Returns the signals of the nominal scenario at each sample.
fn samples_with(model: &str, file: &str) -> Vec<Vec<f64>> {
    let folder = tempfile::tempdir().unwrap();
    let robot = read_with(folder.path(), model, file).unwrap();
    let component =
        Component { role: "controller".into(), name: "e".into(), hash: "h".into(), file_hash: String::new() };
    let target = robot.target(expression(&robot), vec![component], Noise::default()).unwrap();
    let space = target.space("starts").unwrap();
    let requirement = Formula::parse(&target.formulas[0].text).unwrap();
    let specification = Specification::from_formulas(&target.formulas, requirement).unwrap();
    let request = Request::new(Scenario::from([0.0].as_slice()), Seed(0));
    let episodes = target.system(&space, &specification).unwrap().rollout(&[request]).unwrap();
    let trace = &episodes[0].trace;
    let row = |sample: usize| (0..trace.names().len()).map(|index| trace.column(index)[sample]).collect();
    (0..trace.len()).map(row).collect()
}

#[test]
fn groups_keep_the_order_of_their_names() {
    let [start, next] = samples(FILE);
    // Slider `b` is first in the group of joints; motor `push_a` is first in the group of motors.
    assert_eq!(start[2], 0.25);
    assert_eq!(next[..2], [3.0, 4.0]);
    let swapped = FILE.replace(r#"["push_a", "push_b"]"#, r#"["push_b", "push_a"]"#);
    assert_eq!(samples(&swapped)[1][..2], [4.0, 3.0]);
    // Without a group, the controls are in the order of the model.
    let plain = FILE.replace("actuators = \"motors\"\n", "");
    assert_eq!(samples(&plain)[1][..2], [4.0, 3.0]);
    // An actuator outside the group keeps its control.
    let one = FILE.replace(r#"["push_a", "push_b"]"#, r#"["push_b"]"#);
    let one = one.replace("action = \"action\"", "action = \"action[:1]\"");
    assert_eq!(samples(&one)[1][..2], [0.0, 3.0]);
}

#[test]
fn vectors_are_rotated_into_the_axes_of_a_body() {
    // The box is turned to the left by 90 degrees, moves along x and turns about z.
    let [start, _] = samples(FILE);
    let expected = [0.0, -1.0, 3.0, -1.0];
    assert!(start[3..].iter().zip(expected).all(|(x, y)| (x - y).abs() < 1e-12), "{start:?}");
}

#[test]
fn wrong_groups_name_the_line() {
    let folder = tempfile::tempdir().unwrap();
    let error = |from: &str, to: &str| read(folder.path(), &FILE.replace(from, to)).err().unwrap();
    let message = error(r#"["push_a", "push_b"]"#, r#"["push_a", "push_.*"]"#);
    assert!(message.contains("line 9") && message.contains("`push_a` is in the group twice"), "{message}");
    let message = error(r#"["b", "a"]"#, r#"["b", "c"]"#);
    assert!(message.contains("line 8") && message.contains("no joint `c`"), "{message}");
    let message = error("actuators = \"motors\"", "actuators = \"joints\"");
    assert!(message.contains("`joints` is a group of the kind \"joint\""), "{message}");
    let message = error("body_frame('box', [0, 0, -1])[2]", "body_frame('box')[2]");
    assert!(message.contains("`body_frame` takes a body and a vector, not 1 arguments"), "{message}");
    let message = error("body_frame('box', [0, 0, -1])[2]", "body_frame('box', [0, 1])[1]");
    assert!(message.contains("has 2 numbers, but 3 numbers are needed"), "{message}");
}

/// Returns a policy that answers by a function of the observation.
fn answering(answer: fn(&[f32]) -> [f32; 2]) -> Arc<dyn Controller> {
    controller([4, 2, 0], move |observation, _, action| action.copy_from_slice(&answer(observation)))
}

#[test]
fn a_policy_that_does_not_fit_is_found_before_the_first_episode() {
    let folder = tempfile::tempdir().unwrap();
    let robot = read(folder.path(), FILE).unwrap();
    let check = |answer: fn(&[f32]) -> [f32; 2]| {
        robot.check_contract(&*answering(answer)).map_err(|error| error.to_string())
    };
    // It pushes both sliders, and reads where they are. The command may be constant.
    assert_eq!(check(|x| [1.0 - x[0], 2.0 - x[1]]).unwrap(), Vec::<String>::new());
    let warnings = check(|x| [9.0 + x[0], -9.0]).unwrap();
    assert!(
        matches!(&warnings[..], [one] if one.starts_with("the first action puts all 2 controls")),
        "{warnings:?}"
    );
    let warnings = check(|_| [1.0, 2.0]).unwrap();
    assert!(matches!(&warnings[..], [one] if one.starts_with("the action never changes")), "{warnings:?}");
    let warnings = check(|x| [x[0].sqrt() + 1.0, 1.0]).unwrap();
    assert!(matches!(&warnings[..], [one] if one.contains("not finite for 1 of 4")), "{warnings:?}");
    let error = check(|x| [x[1], f32::NAN]).unwrap_err();
    assert!(error.contains("number 2 of the action is NaN"), "{error}");
    assert!(error.contains("position 2, command 2; together 4"), "{error}");
}

#[test]
fn a_part_of_the_observation_that_never_changes_is_reported() {
    let folder = tempfile::tempdir().unwrap();
    let file =
        FILE.replace("position = \"qpos(joints)\"", "position = \"[*qpos(joints)[1:], ctrl('push_a')[0]]\"");
    let file = file.replace("command = ", "fixed = \"body_pos('world')[:1]\"\ncommand = ");
    let file = file.replace("[2 * shift, 1]", "[2 * shift]");
    let robot = read(folder.path(), &file).unwrap();
    let warnings = robot.check_contract(&*answering(|x| [1.0 - x[0], 1.0])).unwrap();
    assert!(
        matches!(&warnings[..], [one] if one.starts_with("the part `fixed` of the observation never changes")),
        "{warnings:?}"
    );
}

#[test]
fn a_nominal_scenario_that_diverges_is_an_error_that_names_the_joint() {
    let folder = tempfile::tempdir().unwrap();
    let stiff = MODEL.replace(
        "<motor name=\"push_b\" joint=\"b\"",
        "<position name=\"push_b\" joint=\"b\" kp=\"10\" kv=\"1e6\"",
    );
    let check = |file: &str| {
        let robot = read_with(folder.path(), &stiff, file).unwrap();
        robot.check_contract(&*answering(|x| [1.0 - x[0], 2.0 - x[1]])).map_err(|error| error.to_string())
    };
    let error = check(FILE).unwrap_err();
    assert!(
        error.contains("the nominal scenario diverges in control step") && error.contains("(joint `b`)"),
        "{error}"
    );
    // Implicit in velocities, the same damping is stable.
    let implicit = FILE.replace("model.file", "model.integrator = \"implicitfast\"\nmodel.file");
    assert_eq!(check(&implicit).unwrap(), Vec::<String>::new());
}

#[test]
fn a_start_whose_quaternion_is_no_rotation_is_an_error() {
    let folder = tempfile::tempdir().unwrap();
    for quaternion in ["0, 0, 0, 0", "0, 0, 0.2, 1.9"] {
        let file = FILE.replace("*quat_euler(0, 0, pi / 2)", quaternion);
        let robot = read(folder.path(), &file).unwrap();
        let error = robot.check_contract(&*answering(|x| [1.0 - x[0], 1.0])).unwrap_err().to_string();
        assert!(error.contains("joint `root` at the nominal start") && error.contains("not 1"), "{error}");
    }
}

#[test]
fn a_keyframe_and_repeated_numbers_are_constants() {
    let folder = tempfile::tempdir().unwrap();
    let model = MODEL.replace(
        "</mujoco>",
        "<keyframe><key name=\"home\" qpos=\"0.5 0.7  0 0 0 1 0 0 0\"/></keyframe></mujoco>",
    );
    for keyframe in ["'home'", "0"] {
        let file = FILE
            .replace("[2 * shift, 1]", &format!("[*repeat(2 * shift, 3), *key_qpos({keyframe}, joints)]"));
        let file = file.replace(
            "position_b = \"qpos(joints)[0]\"",
            &format!("position_b = \"key_qpos({keyframe}, joints)[0]\""),
        );
        let robot = read_with(folder.path(), &model, &file).unwrap();
        assert_eq!(robot.observation_size(), 7);
    }
    let error =
        |text: &str| read_with(folder.path(), &model, &FILE.replace("[2 * shift, 1]", text)).err().unwrap();
    assert!(error("repeat(shift, 0.5)").contains("a whole number from 1 to"));
    assert!(error("key_qpos('away', joints)").contains("no keyframe `away`"));
}

#[test]
fn the_external_force_on_a_box_at_rest_is_its_weight() {
    let model = MODEL.replace("gravity=\"0 0 0\"", "gravity=\"0 0 -10\"").replace(
        "<geom type=\"box\" size=\"0.1 0.1 0.1\" contype=\"0\" conaffinity=\"0\"/>",
        "<geom type=\"box\" size=\"0.1 0.1 0.1\" mass=\"3\"/>",
    );
    let model = model.replace("<worldbody>", "<worldbody><geom type=\"plane\" size=\"0 0 1\"/>");
    let file = FILE.replace("steps = 12", "steps = 200").replace("[0, 0, 0, *quat", "[0, 0, 0.1, *quat");
    let file = file.replace("velocity.root = \"[1, 0, 0, 0, 0, 3]\"\n", "");
    let file = file.replace("[axes]", "all = \"cfrc_ext[17]\"\nup = \"cfrc_ext('box')[5]\"\n\n[axes]");
    let samples = samples_with(&model, &file);
    let [.., all, up] = samples.last().unwrap()[..] else { panic!("two signals") };
    assert!((up - 30.0).abs() < 0.01, "{up}");
    // The box is the third body.
    assert_eq!(all, up);
}
