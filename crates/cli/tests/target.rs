//! `mishandle init`: a first target file for a policy of another tool.

use crate::bench::{Bench, text};

/// Two sliders without actuators. The policy names them in the other order.
const MODEL: &str = r#"<mujoco>
  <option timestep="0.005" gravity="0 0 0"/>
  <worldbody>
    <body name="arm"><joint name="first" type="slide" axis="1 0 0"/><geom size="0.1" mass="1"/>
      <body name="hand" pos="0 0 1"><joint name="second" type="slide" axis="0 1 0"/><geom size="0.1" mass="1"/></body>
    </body>
  </worldbody>
</mujoco>"#;

/// The metadata of mjlab's exporter: lists with commas, three decimals.
const METADATA: &[(&str, &str)] = &[
    ("run_path", "somewhere/run"),
    ("joint_names", "second,first"),
    ("joint_stiffness", "40.000,20.000"),
    ("joint_damping", "4.000,2.000"),
    ("default_joint_pos", "0.300,-0.200"),
    ("command_names", ""),
    ("observation_names", "joint_pos,joint_vel,actions"),
    ("observation_terms_scale", "1.000,0.500,1.000"),
    ("observation_terms_flatten_history_dim", "1.000,1.000,1.000"),
    ("observation_terms_history_length", "0.000,0.000,0.000"),
    ("observation_terms_clip", "-inf;inf,-2.000;2.000,-inf;inf"),
    ("action_scale", "0.250,0.500"),
];

/// A message of protocol buffers in the making.
#[derive(Clone, Default)]
struct Message(Vec<u8>);

impl Message {
    fn varint(mut self, mut value: u64) -> Message {
        while value >= 0x80 {
            self.0.push(value as u8 | 0x80);
            value >>= 7;
        }
        self.0.push(value as u8);
        self
    }

    fn integer(self, number: u64, value: u64) -> Message {
        self.varint(number << 3).varint(value)
    }

    fn bytes(self, number: u64, bytes: &[u8]) -> Message {
        let mut message = self.varint(number << 3 | 2).varint(bytes.len() as u64);
        message.0.extend_from_slice(bytes);
        message
    }

    fn inside(self, number: u64, message: &Message) -> Message {
        self.bytes(number, &message.0)
    }
}

/// An ONNX model with the inputs `obs` and maybe another one. Its action is 0.01 times the first
/// two numbers, plus a bias.
fn model(size: usize, bias: [f32; 2], metadata: &[(&str, &str)], other_input: bool) -> Vec<u8> {
    let floats = |values: &[f32]| values.iter().flat_map(|x| x.to_le_bytes()).collect::<Vec<u8>>();
    let tensor = |name: &str, shape: &[usize], values: &[f32]| {
        let tensor = shape.iter().fold(Message::default(), |tensor, size| tensor.integer(1, *size as u64));
        tensor.integer(2, 1).bytes(8, name.as_bytes()).bytes(9, &floats(values))
    };
    let value = |name: &str, size: usize| {
        let dim = |size: usize| Message::default().integer(1, size as u64);
        let shape = Message::default().inside(1, &dim(1)).inside(1, &dim(size));
        let kind = Message::default().inside(1, &Message::default().integer(1, 1).inside(2, &shape));
        Message::default().bytes(1, name.as_bytes()).inside(2, &kind)
    };
    let mut weights = vec![0.0; 2 * size];
    (weights[0], weights[3]) = (0.01, 0.01);
    let node = ["obs", "weights", "bias"]
        .iter()
        .fold(Message::default(), |node, input| node.bytes(1, input.as_bytes()))
        .bytes(2, b"actions")
        .bytes(4, b"Gemm");
    let graph = Message::default()
        .inside(1, &node)
        .bytes(2, b"policy")
        .inside(5, &tensor("weights", &[size, 2], &weights))
        .inside(5, &tensor("bias", &[2], &bias))
        .inside(11, &value("obs", size));
    let graph = if other_input { graph.inside(11, &value("image", 4)) } else { graph };
    let graph = graph.inside(12, &value("actions", 2));
    let model = Message::default()
        .integer(1, 8)
        .inside(7, &graph)
        .inside(8, &Message::default().bytes(1, b"").integer(2, 17));
    let entry =
        |(key, value): &(&str, &str)| Message::default().bytes(1, key.as_bytes()).bytes(2, value.as_bytes());
    metadata.iter().map(entry).fold(model, |model, entry| model.inside(14, &entry)).0
}

const INIT: &str = "init --model robot.xml --policy policy.onnx --out robot.toml";

/// A folder with the model of the robot and a policy.
fn bench(metadata: &[(&str, &str)]) -> Bench {
    let bench = Bench::new();
    bench.write("robot.xml", MODEL);
    std::fs::write(bench.path("policy.onnx"), model(6, [1.0, -0.5], metadata, false)).unwrap();
    bench
}

/// Returns the last row of the trace of the nominal scenario, by the names of its columns.
fn last_row(bench: &Bench, name: &str) -> f64 {
    bench.run("simulate robot.toml --trace trace.csv");
    let text = std::fs::read_to_string(bench.path("trace.csv")).unwrap();
    std::fs::remove_file(bench.path("trace.csv")).unwrap();
    let rows: Vec<Vec<&str>> = text.lines().map(|line| line.split(',').collect()).collect();
    let column = rows[0].iter().position(|column| *column == name).unwrap();
    rows.last().unwrap()[column].parse().unwrap()
}

#[test]
fn the_action_of_each_joint_reaches_its_joint() {
    let bench = bench(METADATA);
    bench.check(INIT, 0);
    bench.check("list robot.toml", 0);
    let file = std::fs::read_to_string(bench.path("robot.toml")).unwrap();
    assert!(file.contains(r#"joints = { group = "joint", names = ["second", "first"] }"#), "{file}");
    assert!(file.contains("joint_vel = { value = \"0.5 * (clip(qvel(joints), -2, 2))\" }"), "{file}");
    let controls =
        "[signals]\ncontrol_first = \"ctrl('first')[0]\"\ncontrol_second = \"ctrl('second')[0]\"\n";
    bench.write("robot.toml", &file.replace("[signals]\n", controls));
    // The bias of the action, its scale and the default position of each joint. The rest of the
    // action is 0.01 times the distance to the default position.
    assert!((last_row(&bench, "control_second") - (0.3 + 0.25)).abs() < 0.003);
    assert!((last_row(&bench, "control_first") - (-0.2 + 0.5 * -0.5)).abs() < 0.003);
}

#[test]
fn gains_and_unknown_facts_are_in_the_file_and_in_the_messages() {
    let bench = bench(METADATA);
    let message = text(&bench.run(INIT).stderr);
    for part in [
        "not known: the period of the policy",
        "limits of the joints' torques",
        "next: mishandle run robot.toml",
    ] {
        assert!(message.contains(part), "{message}");
    }
    let file = std::fs::read_to_string(bench.path("robot.toml")).unwrap();
    for part in [
        "# TODO not known: the period of the policy: here 0.02 s",
        "joints = \"second\"\ntype = \"position\"\nkp = 40\nkv = 4\n",
        "joints = \"first\"\ntype = \"position\"\nkp = 20\nkv = 2\n",
    ] {
        assert!(file.contains(part), "{file}");
    }
    bench.refuses(INIT, &["robot.toml exists already", "--force"]);
    bench.check(&format!("{INIT} --force"), 0);
    bench.refuses(&INIT.replace("robot.toml", "robot.txt"), &["must end in .toml"]);
}

#[test]
fn a_model_with_actuators_keeps_them_and_differences_are_reported() {
    let bench = bench(METADATA);
    let actuators = "<actuator><position name=\"pull\" joint=\"second\" kp=\"40.0002\" kv=\"4\"/>\
                     <position name=\"slide\" joint=\"first\" kp=\"25\" kv=\"2\"/></actuator>\
                     <keyframe><key name=\"home\" qpos=\"-0.2003 0.4\"/></keyframe></mujoco>";
    bench.write("robot.xml", &MODEL.replace("</mujoco>", actuators));
    let message = text(&bench.run(INIT).stderr);
    assert!(message.contains("first kp 20 and kv 2 (policy), 25 and 2 (model)"), "{message}");
    assert!(!message.contains("second kp"), "{message}");
    assert!(message.contains("keyframe `home`: second 0.3 (policy), 0.4 (model)"), "{message}");
    let file = std::fs::read_to_string(bench.path("robot.toml")).unwrap();
    assert!(file.contains("actuators = { group = \"actuator\", names = [\"pull\", \"slide\"] }"), "{file}");
    // Three decimals of the policy stand for the value of the model.
    assert!(file.contains("\"second\" = 0.3\n\"first\" = -0.2003\n"), "{file}");
    bench.check("list robot.toml", 0);
}

#[test]
fn joints_are_matched_by_name() {
    let mut metadata = METADATA.to_vec();
    metadata[1].1 = "second,frist";
    let bench = bench(&metadata);
    bench.refuses(INIT, &["no joint `frist`; did you mean `first`?", "the metadata of policy.onnx"]);
    metadata[1].1 = "second,first,third";
    std::fs::write(bench.path("policy.onnx"), model(6, [0.0; 2], &metadata, false)).unwrap();
    bench.refuses(INIT, &["`default_joint_pos` has 2 numbers, but there are 3 joints"]);
}

#[test]
fn a_policy_without_a_description_gives_a_file_with_questions() {
    let bench = bench(&[]);
    let message = text(&bench.run(INIT).stderr);
    for part in
        ["the actuators, which the model lacks", "the meaning of the actions", "the parts of the observation"]
    {
        assert!(message.contains(part), "{message}");
    }
    // Its 6 numbers are those of two positions, two velocities and two actions.
    assert!(!message.contains("does not load"), "{message}");
    bench.check("evaluate robot.toml --episodes 2 --out run.sqlite", 0);
    std::fs::write(bench.path("policy.onnx"), model(7, [0.0; 2], &[], false)).unwrap();
    let message = text(&bench.run(&format!("{INIT} --force")).stderr);
    assert!(message.contains("does not load yet") && message.contains("[1, 7]"), "{message}");
}

#[test]
fn the_contract_is_checked_before_the_first_simulation() {
    let bench = bench(METADATA);
    bench.check(INIT, 0);
    let file = std::fs::read_to_string(bench.path("robot.toml")).unwrap();
    let policy = |bytes: Vec<u8>| std::fs::write(bench.path("policy.onnx"), bytes).unwrap();
    let evaluate = "evaluate robot.toml --episodes 2 --out run.sqlite";
    for command in [evaluate, "list robot.toml", "simulate robot.toml"] {
        policy(model(9, [0.0; 2], &[], false));
        bench.refuses(command, &["[1, 9]", "joint_pos 2, joint_vel 2, actions 2; together 6"]);
        policy(model(6, [f32::NAN, 0.0], &[], false));
        bench.refuses(command, &["number 1 of the action is NaN for the first observation"]);
        std::fs::remove_file(bench.path("policy.onnx")).unwrap();
        bench.refuses(command, &["policy.onnx"]);
    }
    policy(model(6, [0.0; 2], &[], true));
    bench.refuses(evaluate, &["nothing says what the input `image` is"]);
    policy(model(6, [0.0; 2], &[], false));
    let named = |input: &str, output: &str| {
        let names = format!("input = \"{input}\"\noutput = \"{output}\"\nonnx = ");
        bench.write("robot.toml", &file.replace("onnx = ", &names));
    };
    named("observations", "actions");
    bench.refuses(evaluate, &["the model has no input `observations`; its inputs: obs"]);
    named("obs", "act");
    bench.refuses(evaluate, &["the model has no output `act`; its outputs: actions"]);
    named("obs", "actions");
    bench.check("list robot.toml", 0);
    // Motors that are always at the ends of their ranges.
    let strong = file.replace("kv = 4\n", "kv = 4\nctrlrange = [-0.1, 0.1]\n");
    bench.write("robot.toml", &strong.replace("kv = 2\n", "kv = 2\nctrlrange = [-0.1, 0.1]\n"));
    let message = text(&bench.run(evaluate).stderr);
    assert!(
        message.contains("the first action puts all 2 controls to the ends of their ranges"),
        "{message}"
    );
}

#[test]
fn a_target_file_may_stand_elsewhere_and_a_model_outside_its_folder_if_that_is_allowed() {
    let bench = bench(METADATA);
    for folder in ["models", "targets"] {
        std::fs::create_dir(bench.path(folder)).unwrap();
    }
    bench.write("models/scene.xml", "<mujoco><include file=\"../robot.xml\"/></mujoco>");
    let init = "init --model models/scene.xml --policy policy.onnx --out targets/robot.toml";
    bench.refuses(init, &["`../robot.xml` is outside the folder of the model", "allow_outside = true"]);
    bench.check(&format!("{init} --allow-outside"), 0);
    let file = std::fs::read_to_string(bench.path("targets/robot.toml")).unwrap();
    assert!(
        file.contains("file = \"../models/scene.xml\"") && file.contains("onnx = \"../policy.onnx\""),
        "{file}"
    );
    bench.check("list targets/robot.toml", 0);
}

#[test]
fn an_edit_that_mujoco_rejects_has_a_line() {
    let bench = bench(METADATA);
    bench.check(INIT, 0);
    let file = std::fs::read_to_string(bench.path("robot.toml")).unwrap();
    let edit = "\n[[model.set]]\njoint = \"first\"\naxis = [0, 0, 0]\n\n[constants]";
    let file = file.replacen("\n[constants]", edit, 1);
    let line = 1 + file[..file.find("joint = \"first\"\naxis").unwrap()].matches('\n').count();
    bench.write("robot.toml", &file);
    bench.refuses("list robot.toml", &[&format!("robot.toml, line {line}: ")]);
}

#[test]
fn a_model_alone_gives_a_file_and_a_first_look_at_its_spaces() {
    let bench = bench(&[]);
    let message = text(&bench.run("init --model robot.xml --out robot.toml").stderr);
    assert!(
        !message.contains("does not load") && message.contains("a law that holds the start"),
        "{message}"
    );
    let seen = bench.run("run robot.toml --out look -k space=delay");
    let table = text(&seen.stdout);
    assert_eq!(seen.status.code(), Some(0), "{table}");
    for part in [
        "space  fails     cause, toward nominal",
        "delay  0 of 100  none in 100 simulations",
        "margin: robot.toml",
    ] {
        assert!(table.contains(part), "`{part}` is missing:\n{table}");
    }
    let index = std::fs::read_to_string(bench.path("look/pages/index.html")).unwrap();
    assert!(index.contains("runs/falsify.html"), "{index}");
}

#[test]
fn a_person_who_guesses_is_led_to_a_target_file() {
    let bench = bench(&[]);
    for (command, hint) in [
        ("falsify robot.xml", "run `mishandle init --model robot.xml --out robot.toml`"),
        ("evaluate missing.urdf", "run `mishandle init --model missing.urdf --out missing.toml`"),
        ("falsify CartPole-v1", "mishandle.falsify(gymnasium.make(\"CartPole-v1\"), policy=my_policy)"),
        ("falsify policy.zip", "policy=stable_baselines3.PPO.load(\"policy.zip\")"),
        ("falsify cell.csv", "mishandle monitor --formula FORMULA cell.csv"),
    ] {
        bench.refuses(command, &[hint]);
    }
}
