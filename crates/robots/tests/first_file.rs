//! First target files from an IO descriptor of Isaac Lab.

use std::path::Path;

use mishandle_robots::{
    FirstFile, FirstPolicy, Paths, PolicyFacts, PolicySizes, RobotFile, first_file, isaac_facts,
};

/// A body with two legs, whose joints have motors.
const MODEL: &str = r#"<mujoco>
  <option timestep="0.002"/>
  <worldbody>
    <body name="torso" pos="0 0 0.7">
      <freejoint name="root"/><geom type="box" size="0.2 0.1 0.1" mass="8"/>
      <body name="left"><joint name="left_hip" axis="0 1 0" range="-1 1"/><geom type="capsule" fromto="0 0 0 0 0 -0.4" size="0.03" mass="1"/></body>
      <body name="right"><joint name="right_hip" axis="0 1 0" range="-1 1"/><geom type="capsule" fromto="0 0 0 0 0 -0.4" size="0.03" mass="1"/></body>
    </body>
  </worldbody>
  <actuator><motor name="left_motor" joint="left_hip"/><motor name="right_motor" joint="right_hip"/></actuator>
</mujoco>"#;

const DESCRIPTOR: &str = "actions:
- action_type: JointAction
  clip: null
  extras:
    description: Sets the joints to positions, which the
      simulator reaches with its gains.
  full_path: isaaclab.envs.mdp.actions.joint_actions.JointPositionAction
  joint_names:
  - right_hip
  - left_hip
  name: joint_position_action
  offset:
  - 0.10000000149011612
  - -0.20000000298023224
  scale: 0.25
  shape:
  - 2
articulations:
  robot:
    default_joint_armature:
    - 0.0
    - 0.05
    default_joint_damping: &id001
    - 2.0
    - 2.0
    default_joint_pos:
    - -0.20000000298023224
    - 0.10000000149011612
    default_joint_pos_limits:
    - - -1.0
      - 1.0
    - - -1.0
      - 1.0
    default_joint_stiffness:
    - 30.0
    - 40.0
    joint_names:
    - left_hip
    - right_hip
observations:
  policy:
  - name: base_ang_vel
    overloads:
      clip: null
      history_length: 0
      scale: 0.2
    shape:
    - 3
  - name: projected_gravity
    shape:
    - 3
  - name: generated_commands
    shape:
    - 3
  - joint_names:
    - left_hip
    - right_hip
    joint_pos_offsets:
    - -0.2
    - 0.1
    name: joint_pos_rel
    shape:
    - 2
  - name: last_action
    shape:
    - 2
scene:
  decimation: 4
  dt: 0.02
  physics_dt: 0.005
";

fn init(folder: &Path, model: &str, facts: &PolicyFacts) -> FirstFile {
    std::fs::write(folder.join("robot.xml"), model).unwrap();
    let paths = Paths {
        model: "robot.xml".into(),
        policy: FirstPolicy::Onnx("policy.onnx".into()),
        name: "legs".into(),
        allow_outside: false,
    };
    let sizes = PolicySizes { observation: Some(13), action: Some(2) };
    first_file(&folder.join("robot.xml"), &paths, facts, sizes, None).unwrap()
}

fn read(folder: &Path, text: &str) -> Result<RobotFile, String> {
    std::fs::write(folder.join("legs.toml"), text).unwrap();
    RobotFile::read(&folder.join("legs.toml")).map_err(|error| error.to_string())
}

#[test]
fn an_io_descriptor_gives_a_file_that_loads() {
    let folder = tempfile::tempdir().unwrap();
    let facts = isaac_facts(DESCRIPTOR, "io.yaml").unwrap();
    let file = init(folder.path(), MODEL, &facts);
    let text = &file.text;
    for part in [
        "timestep = 0.005",
        "joints = { group = \"joint\", names = [\"right_hip\", \"left_hip\"] }",
        "actuators = { group = \"actuator\", names = [\"right_hip\", \"left_hip\"] }",
        "scale = 0.25",
        "joints = \"right_hip\"\ntype = \"position\"\nkp = 40\nkv = 2\n",
        "joints = \"left_hip\"\ntype = \"position\"\nkp = 30\nkv = 2\n",
        "action = \"default + scale * action\"",
        "\"right_hip\" = 0.1\n\"left_hip\" = -0.2\n",
        "base_ang_vel = { value = \"0.2 * (body_frame('torso', body_angvel('torso')))\" }",
        "joint_pos_rel = { value = \"qpos(observed) - default_observed\"",
        "observed = { group = \"joint\", names = [\"left_hip\", \"right_hip\"] }",
        "generated_commands = { value = \"[command_x, command_y, command_yaw]\"",
        "[[model.add]]",
        "period = 0.02",
    ] {
        assert!(text.contains(part), "`{part}` is missing:\n{text}");
    }
    assert!(file.remarks.iter().any(|remark| remark.contains("take forces")), "{:?}", file.remarks);
    let armature = "[[model.set]] changes it: right_hip 0.05 (policy), 0 (model)";
    assert!(file.remarks.iter().any(|remark| remark.ends_with(armature)), "{:?}", file.remarks);
    let robot = read(folder.path(), text).unwrap();
    assert_eq!((robot.observation_size(), robot.actions()), (13, 2));
    // A part may have joints of its own.
    let one = DESCRIPTOR.replace("    - right_hip\n    joint_pos_offsets:", "    joint_pos_offsets:");
    let one =
        one.replace("name: joint_pos_rel\n    shape:\n    - 2", "name: joint_pos_rel\n    shape:\n    - 1");
    let file = init(folder.path(), MODEL, &isaac_facts(&one, "io.yaml").unwrap());
    let part = "qpos(joint_pos_rel_joints) - default_joint_pos_rel_joints";
    assert!(file.text.contains(part), "{}", file.text);
    assert_eq!(read(folder.path(), &file.text).unwrap().observation_size(), 12);
}

#[test]
fn parts_that_are_not_known_are_questions_of_the_file() {
    let folder = tempfile::tempdir().unwrap();
    let scan = DESCRIPTOR.replace(
        "  - name: last_action\n    shape:\n    - 2\n",
        "  - name: height_scan\n    shape:\n    - 11\n    - 2\n",
    );
    let file = init(folder.path(), MODEL, &isaac_facts(&scan, "io.yaml").unwrap());
    let question = "the part `height_scan` of the observation: 22 numbers";
    assert!(file.unknown.iter().any(|unknown| unknown == question), "{:?}", file.unknown);
    assert!(file.remarks.iter().any(|remark| remark.contains("33 numbers, but the policy reads 13")));
    let error = read(folder.path(), &file.text).err().unwrap();
    assert!(error.contains("no observation `height_scan`"), "{error}");
    // Neither is one with modifiers, or with a scale that is not a number.
    for (from, to) in [
        ("scale: 0.2\n", "scale: large\n"),
        (
            "  - name: projected_gravity\n",
            "  - name: projected_gravity\n    extras:\n      modifiers:\n      - name: delay\n",
        ),
    ] {
        assert!(DESCRIPTOR.contains(from));
        let file =
            init(folder.path(), MODEL, &isaac_facts(&DESCRIPTOR.replace(from, to), "io.yaml").unwrap());
        assert!(
            file.unknown.iter().any(|unknown| unknown.ends_with("of the observation: 3 numbers")),
            "{to}"
        );
    }
    // A part that remembers several steps is not one that is known.
    let history = DESCRIPTOR.replace("history_length: 0", "history_length: 4");
    let file = init(folder.path(), MODEL, &isaac_facts(&history, "io.yaml").unwrap());
    assert!(file.unknown.iter().any(|unknown| unknown.ends_with("remembered for 4 control steps")));
}

#[test]
fn joints_that_the_model_lacks_are_named() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("robot.xml"), MODEL.replace("right_hip", "hip_right")).unwrap();
    let paths =
        Paths { model: String::new(), policy: FirstPolicy::Law, name: "legs".into(), allow_outside: false };
    let facts = isaac_facts(DESCRIPTOR, "io.yaml").unwrap();
    let error = first_file(&folder.path().join("robot.xml"), &paths, &facts, PolicySizes::default(), None);
    let error = error.unwrap_err().to_string();
    assert!(
        error.contains("io.yaml: no joint `right_hip`") && error.contains("left_hip, hip_right"),
        "{error}"
    );
}

#[test]
fn wrong_descriptors_say_what_is_wrong() {
    for (text, message) in [
        ("actions: []\n", "no key `observations`"),
        ("observations: |\n  text\n", "line 1"),
        (&DESCRIPTOR.replace("  offset:\n  - 0.10000000149011612\n", "  offset:\n"), ""),
        (
            &DESCRIPTOR.replace("    - 40.0\n", ""),
            "`default_joint_stiffness` has 1 numbers, but there are 2 joints",
        ),
    ] {
        let result = isaac_facts(text, "io.yaml").map_err(|error| error.to_string());
        match message {
            "" => assert!(result.is_ok(), "one offset stands for all joints"),
            message => {
                assert!(result.as_ref().is_err_and(|error| error.contains(message)), "{result:?}");
            }
        }
    }
}
