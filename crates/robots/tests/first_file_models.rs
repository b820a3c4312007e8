//! First target files for models and policies as the tools write them.

use std::path::Path;
use std::sync::Arc;

use mishandle_robots::{
    FirstFile, FirstPolicy, Paths, PolicyFacts, PolicySizes, RobotFile, RobotPolicy, first_file, isaac_facts,
    mjlab_facts,
};
use mishandle_rollout::{Component, Noise, Request, Scenario, Seed, Specification};
use mishandle_stl::Formula;

/// A body with a leg and a box that nothing moves, in a keyframe without a name. Neither the free
/// joint of the body nor the actuator has a name.
const MODEL: &str = r#"<mujoco>
  <worldbody>
    <geom name="floor" type="plane" size="0 0 0.05"/>
    <body name="cube" pos="1 0 0.05"><freejoint name="cube"/><geom type="box" size="0.05 0.05 0.05"/></body>
    <body name="trunk" pos="0 0 0.5">
      <freejoint/>
      <geom type="box" size="0.2 0.1 0.1" pos="0.05 0 0.02" mass="8"/>
      <site name="imu" pos="-0.05 0.02 0.1"/>
      <body name="leg"><joint name="hip" axis="0 1 0"/><geom type="capsule" fromto="0 0 0 0 0 -0.3" size="0.03" mass="1"/></body>
    </body>
  </worldbody>
  <actuator><motor joint="hip" gear="2" ctrlrange="-5 5"/></actuator>
  <sensor><velocimeter name="imu_lin_vel" site="imu"/></sensor>
  <keyframe><key qpos="1 0 0.05 1 0 0 0  0 0 0.6 1 0 0 0  0.3"/></keyframe>
</mujoco>"#;

fn init(folder: &Path, model: &str, facts: &PolicyFacts) -> Result<FirstFile, String> {
    init_with(FirstPolicy::Onnx("policy.onnx".into()), folder, model, facts)
}

fn init_with(
    policy: FirstPolicy,
    folder: &Path,
    model: &str,
    facts: &PolicyFacts,
) -> Result<FirstFile, String> {
    std::fs::write(folder.join("robot.xml"), model).unwrap();
    let paths = Paths { model: "robot.xml".into(), policy, name: "robot".into(), allow_outside: false };
    first_file(&folder.join("robot.xml"), &paths, facts, PolicySizes::default(), None)
        .map_err(|error| error.to_string())
}

fn read(folder: &Path, text: &str) -> Result<RobotFile, String> {
    std::fs::write(folder.join("robot.toml"), text).unwrap();
    RobotFile::read(&folder.join("robot.toml")).map_err(|error| error.to_string())
}

fn of_mjlab(more: &[(&str, &str)]) -> PolicyFacts {
    let given = [("joint_names", "hip"), ("default_joint_pos", "0.3"), ("action_scale", "0.5")];
    let metadata: Vec<(String, String)> =
        given.iter().chain(more).map(|(key, value)| (key.to_string(), value.to_string())).collect();
    mjlab_facts(&metadata, "the metadata").unwrap().unwrap()
}

/// Returns the signals at the start of the nominal scenario.
fn signals_at_start(robot: &RobotFile) -> Vec<f64> {
    nominal_traces(robot).iter().map(|signal| signal[0]).collect()
}

/// Returns the signals of the nominal scenario.
fn nominal_traces(robot: &RobotFile) -> Vec<Vec<f64>> {
    let RobotPolicy::Expression(policy) = robot.policy() else { panic!("the policy is an expression") };
    let component =
        Component { role: "controller".into(), name: "e".into(), hash: "h".into(), file_hash: String::new() };
    let target = robot.target(Arc::clone(policy), vec![component], Noise::default()).unwrap();
    let space = target.space("scenarios").unwrap();
    let requirement = Formula::parse(&target.formulas[0].text).unwrap();
    let specification = Specification::from_formulas(&target.formulas, requirement).unwrap();
    let request = Request::new(space.nominal(), Seed(0));
    let _: &Scenario = &request.scenario;
    let episodes = target.system(&space, &specification).unwrap().rollout(&[request]).unwrap();
    (0..target.signals.len()).map(|index| episodes[0].trace.column(index).to_vec()).collect()
}

#[test]
fn elements_without_names_are_called_as_what_they_move() {
    let folder = tempfile::tempdir().unwrap();
    let file = init(folder.path(), MODEL, &PolicyFacts::default()).unwrap();
    for part in [
        "#   hip, [-5, 5]\n",
        "\"trunk\" = \"[0, 0, 0.6, *quat_euler(roll, pitch, 0)]\"",
        "keyframe = \"0\"",
        "high = \"always(height >= 0.3)\"",
        "payload = { kind = \"model\", range = [0, 0.2], nominal = 0, unit = \"kg\", add = \"body_mass('trunk')\" }",
    ] {
        let part = part.split(", range").next().unwrap();
        assert!(file.text.contains(part), "`{part}` is missing:\n{}", file.text);
    }
    let robot = read(folder.path(), &file.text).unwrap();
    assert_eq!(robot.actions(), 1);
    // A number is a keyframe, too; others are an error that says which there are.
    let number = file.text.replace("keyframe = \"0\"", "keyframe = 0");
    assert!(read(folder.path(), &number).is_ok());
    let error = read(folder.path(), &number.replace("keyframe = 0", "keyframe = 1")).err().unwrap();
    assert!(error.contains("from 0 to 0"), "{error}");
}

#[test]
fn a_free_object_is_no_base() {
    let folder = tempfile::tempdir().unwrap();
    let fixed = MODEL.replace("<freejoint/>", "").replace("0 0 0.6 1 0 0 0  0.3", "0.3");
    let file = init(folder.path(), &fixed, &PolicyFacts::default()).unwrap();
    assert!(!file.text.contains("'cube'") && !file.text.contains("projected_gravity"), "{}", file.text);
    read(folder.path(), &file.text).unwrap();
}

#[test]
fn an_action_for_motors_without_a_description_is_their_control() {
    let folder = tempfile::tempdir().unwrap();
    let file = init(folder.path(), MODEL, &PolicyFacts::default()).unwrap();
    assert!(
        file.text.contains("actions = 1\n") && file.text.contains("action = \"action\""),
        "{}",
        file.text
    );
    assert!(file.unknown.iter().any(|unknown| unknown.contains("controls of the actuators")));
}

#[test]
fn gains_of_a_policy_become_position_actuators_that_are_stepped_implicitly() {
    let folder = tempfile::tempdir().unwrap();
    let facts = of_mjlab(&[("joint_stiffness", "40"), ("joint_damping", "2")]);
    let file = init(folder.path(), MODEL, &facts).unwrap();
    // The motor with the gear 2 and the control 5 gives at most 10 N m.
    for part in
        ["integrator = \"implicitfast\"", "kp = 40\nkv = 2\nforcerange = [-10, 10]", "# armature = 0.006250"]
    {
        assert!(file.text.contains(part), "`{part}` is missing:\n{}", file.text);
    }
    assert!(file.text.contains("action = \"default + scale * action\""), "{}", file.text);
    assert!(file.unknown.iter().any(|unknown| unknown.contains("armature of the joints")));
    read(folder.path(), &file.text).unwrap();
    // An actuator with the name of its joint leaves no room for another one.
    let named = MODEL.replace("<motor joint", "<motor name=\"hip\" joint");
    let file = init(folder.path(), &named, &facts).unwrap();
    assert!(file.text.contains("kp * (default + scale * action - qpos(joints))"), "{}", file.text);
    read(folder.path(), &file.text).unwrap();
}

#[test]
fn the_velocity_of_mjlab_is_that_of_its_sensor() {
    let folder = tempfile::tempdir().unwrap();
    let file = init(folder.path(), MODEL, &of_mjlab(&[("observation_names", "base_lin_vel")])).unwrap();
    let line = file.text.lines().find(|line| line.starts_with("base_lin_vel")).unwrap();
    let value = line.split('"').nth(1).unwrap();
    let signal = |name: &str, text: &str| {
        (0..3).map(|axis| format!("{name}_{axis} = \"({text})[{axis}]\"\n")).collect::<String>()
    };
    let text = format!(
        "format = 1\nname = \"robot\"\nmodel.file = \"robot.xml\"\ncontrol = {{ period = 0.02, steps = 1 }}\n[start]\n\
         trunk = \"[0, 0, 2, *quat_euler(0.3, -0.4, 1)]\"\nvelocity.trunk = \"[1, 2, -0.5, 3, -2, 1]\"\n[observation]\nx = \"hip\"\n\
         [constants]\nhip = \"qpos('hip')\"\n[policy]\nexpression = \"0 * x\"\naction = \"action\"\n[signals]\n{}{}[axes]\n\
         a = {{ range = [0, 1] }}\n[formulas]\nf = \"always(a_0 <= 10)\"\n",
        signal("a", value),
        signal("b", "sensor('imu_lin_vel')")
    );
    let signals = signals_at_start(&read(folder.path(), &text).unwrap());
    for axis in 0..3 {
        let [ours, sensor] = [signals[axis], signals[3 + axis]];
        assert!((ours - sensor).abs() < 1e-12 && sensor.abs() > 0.1, "axis {axis}: {ours}, {sensor}");
    }
}

#[test]
fn terms_with_one_name_get_numbers_and_joints_with_two_actions_are_an_error() {
    let folder = tempfile::tempdir().unwrap();
    let action = "- full_path: JointPositionAction\n  joint_names:\n  - hip\n";
    let terms = "  - name: joint_pos_rel\n    joint_names:\n    - hip\n";
    let file = format!("actions:\n{action}observations:\n  policy:\n{terms}{terms}");
    let file = init(folder.path(), MODEL, &isaac_facts(&file, "io.yaml").unwrap()).unwrap();
    assert!(file.text.contains("observation = [\"joint_pos_rel\", \"joint_pos_rel_2\"]"), "{}", file.text);
    assert_eq!(read(folder.path(), &file.text).unwrap().observation_size(), 2);
    let file = format!("actions:\n{action}{action}observations:\n  policy:\n{terms}");
    let error = isaac_facts(&file, "io.yaml").unwrap_err().to_string();
    assert!(error.contains("the joint `hip` has two actions"), "{error}");
}

#[test]
fn a_common_text_before_the_names_of_the_model_is_found() {
    let folder = tempfile::tempdir().unwrap();
    let composed = MODEL.replace("\"hip\"", "\"robot/hip\"").replace("\"trunk\"", "\"robot/trunk\"");
    let file = init(folder.path(), &composed, &of_mjlab(&[])).unwrap();
    assert!(
        file.text.contains("names = [\"robot/hip\"]") && file.text.contains("'robot/trunk'"),
        "{}",
        file.text
    );
    assert_eq!(read(folder.path(), &file.text).unwrap().actions(), 1);
}

/// A body with a joint and a site, on which actuators of each transmission act.
fn with_actuators(actuators: &str) -> String {
    format!(
        r#"<mujoco><worldbody>
          <body name="a" pos="0 0 1"><joint name="left" type="slide" axis="0 1 0"/><geom size="0.1"/><site name="tip"/>
            <body name="b" pos="0 0 0.3"><joint name="right" axis="0 1 0" range="-1 1"/><geom size="0.1"/><site name="rod" pos="0 0 0.2"/></body>
          </body>
          <body name="c" pos="1 0 1"><joint name="round" type="ball"/><geom size="0.1"/></body>
          <site name="crank" pos="0.2 0 1"/>
        </worldbody>
        <tendon><fixed name="both"><joint joint="left" coef="1"/><joint joint="right" coef="1"/></fixed></tendon>
        <actuator>{actuators}</actuator></mujoco>"#
    )
}

#[test]
fn each_actuator_has_an_action_of_its_own_whatever_it_moves() {
    let folder = tempfile::tempdir().unwrap();
    for (actuators, count) in [
        (r#"<motor name="arm" joint="left"/>"#, 1),
        (r#"<position name="fingers" tendon="both" kp="10"/>"#, 1),
        (r#"<motor name="arm" joint="left"/><position name="fingers" tendon="both" kp="10"/>"#, 2),
        (r#"<motor name="push" joint="left"/><velocity name="brake" joint="left" kv="1"/>"#, 2),
        (r#"<motor name="thrust" site="tip" gear="0 0 1 0 0 0"/>"#, 1),
        (r#"<adhesion name="grip" body="b" ctrlrange="0 1" gain="2"/>"#, 1),
        (r#"<motor name="twist" joint="round" gear="1 0 0"/>"#, 1),
        (r#"<motor name="crank" cranksite="rod" slidersite="crank" cranklength="0.5"/>"#, 1),
        (r#"<motor joint="left"/><motor joint="left"/>"#, 2),
        ("", 2),
    ] {
        let facts = PolicyFacts::default();
        let file = init_with(FirstPolicy::Law, folder.path(), &with_actuators(actuators), &facts);
        let text = file.unwrap_or_else(|error| panic!("{actuators}: {error}")).text;
        let robot = read(folder.path(), &text).unwrap_or_else(|error| panic!("{error}\n{text}"));
        assert_eq!(robot.actions(), count, "{text}");
        assert!(signals_at_start(&robot).iter().all(|signal| signal.is_finite()), "{text}");
    }
}

#[test]
fn a_model_without_a_hinge_or_slide_gets_a_file_or_an_error_that_says_why() {
    let folder = tempfile::tempdir().unwrap();
    let body = |joint: &str, actuator: &str| {
        format!(
            r#"<mujoco><worldbody><body name="b" pos="0 0 1">{joint}<geom size="0.1"/><site name="s"/></body></worldbody>
            <actuator>{actuator}</actuator></mujoco>"#
        )
    };
    let motor = r#"<motor site="s" gear="0 0 1 0 0 0" ctrlrange="-1 1"/>"#;
    for joint in [r#"<joint name="j" type="ball"/>"#, "<freejoint/>", ""] {
        let init = |model: &str| init_with(FirstPolicy::Law, folder.path(), model, &PolicyFacts::default());
        let text = init(&body(joint, motor)).unwrap().text;
        let robot = read(folder.path(), &text).unwrap_or_else(|error| panic!("{error}\n{text}"));
        assert!(signals_at_start(&robot).iter().all(|signal| signal.is_finite()), "{text}");
        let error = init(&body(joint, "")).unwrap_err();
        assert!(error.contains("nothing can be moved"), "{error}");
    }
}

#[test]
fn the_law_of_a_first_file_holds_its_start() {
    let folder = tempfile::tempdir().unwrap();
    let arm = r#"<mujoco><option timestep="0.003"/><worldbody><body name="arm"><joint name="hinge" axis="0 1 0"/>
      <geom type="capsule" fromto="0 0 0 0 0 -0.6" size="0.02" mass="1"/></body></worldbody>
      <actuator><motor name="m" joint="hinge" gear="3"/></actuator>
      <keyframe><key qpos="0.2"/></keyframe></mujoco>"#;
    let text = init_with(FirstPolicy::Law, folder.path(), arm, &PolicyFacts::default()).unwrap().text;
    assert!(text.contains("period = 0.021\n"), "a whole number of physics steps:\n{text}");
    let robot = read(folder.path(), &text).unwrap();
    let traces = nominal_traces(&robot);
    // Gravity alone turns a pendulum of this length from 0.2 rad to -0.2 rad.
    let farthest = traces[1].iter().copied().fold(0.0, f64::max);
    assert!(farthest < 0.1, "{farthest}");
}
