//! Jumps and slips, against loops written by hand.

use std::path::Path;

use mishandle_robots::{RobotFile, RobotPolicy};
use mishandle_rollout::{
    AxisKind, Component, Episode, Noise, Request, Scenario, Seed, Space, Specification, Target,
};
use mishandle_stl::Formula;
use mishandle_world::{Change, ElementKind, FieldOperation, Model, ModelField};

/// A box that slides on a floor towards a mocap goal, and a driven cart beside it.
const MODEL: &str = r#"<mujoco>
  <option timestep="0.004"/>
  <worldbody>
    <geom name="floor" type="plane" size="9 9 0.1" friction="0.5 0.005 0.0001"/>
    <body name="box" pos="0 0 0.1">
      <freejoint name="free"/>
      <geom name="shell" type="box" size="0.1 0.1 0.1" mass="2" friction="0.3 0.005 0.0001"/>
    </body>
    <body name="goal" mocap="true" pos="1 0 0.1"><geom size="0.02" contype="0" conaffinity="0"/></body>
    <body name="cart" pos="0 3 0.5">
      <joint name="slide" type="slide" axis="1 0 0" damping="1"/>
      <geom size="0.1" mass="1"/>
    </body>
  </worldbody>
  <actuator><motor name="drive" joint="slide"/></actuator>
</mujoco>"#;

const FILE: &str = r#"
format = 1
name = "boxes"
model.file = "boxes.xml"
control = { period = 0.02, steps = 50 }
start.velocity = { free = "[1.5, 0, 0, 0, 0, 0]" }
observation = { goal = "body_pos('goal')", slide = "qpos('slide')" }
policy = { expression = "4 * (goal[0] - slide)", action = "action" }

[signals]
x = "qpos('free')[0]"
z = "qpos('free')[2]"
goal = "body_pos('goal')[1]"
cart = "qpos('slide')[0]"

[axes]
friction = { kind = "model", range = [0.2, 1], nominal = 0.5, set = "geom_friction('floor')[0]" }
hop = { kind = "event", jump = "box", time = [0, 0.8], y = [-0.2, 0.2], z = [-0.1, 0.5] }
move = { kind = "event", jump = "goal", time = 0.3, x = [-0.5, 0.5], y = [-0.5, 0.5] }
ice = { kind = "event", slip = ["geom_friction('floor')[0]", "geom_friction('shell')[0]"], scale = [0, 1], time = [0, 0.8], duration = [0, 0.5] }
stuck = { kind = "event", slip = "dof_damping('slide')", set = [1, 50], time = [0, 0.8], duration = 0.2 }

[formulas]
near = "always(x <= 9)"
"#;

fn read(folder: &Path, file: &str) -> Result<RobotFile, String> {
    std::fs::write(folder.join("boxes.xml"), MODEL).unwrap();
    std::fs::write(folder.join("boxes.toml"), file).unwrap();
    RobotFile::read(&folder.join("boxes.toml")).map_err(|error| error.to_string())
}

fn target() -> Target {
    let folder = tempfile::tempdir().unwrap();
    let robot = read(folder.path(), FILE).unwrap();
    let RobotPolicy::Expression(policy) = robot.policy() else { panic!("the policy is an expression") };
    let component =
        Component { role: "controller".into(), name: "e".into(), hash: "h".into(), file_hash: String::new() };
    robot.target(policy.clone(), vec![component], Noise::default()).unwrap()
}

/// Returns the nominal scenario with other values of some axes.
fn scenario(space: &Space, values: &[(&str, f64)]) -> Scenario {
    assert!(values.iter().all(|(name, _)| space.axes().iter().any(|axis| axis.name == *name)));
    let value = |axis: &mishandle_rollout::Axis| {
        values.iter().find(|(name, _)| axis.name == *name).map(|(_, value)| *value).or(axis.nominal)
    };
    Scenario::new(space.axes().iter().map(value).collect())
}

fn simulate(target: &Target, values: &[(&str, f64)]) -> Episode {
    let space = target.space("scenarios").unwrap();
    let requirement = Formula::parse(&target.formulas[0].text).unwrap();
    let specification = Specification::from_formulas(&target.formulas, requirement).unwrap();
    let request = Request::new(scenario(&space, values), Seed(3));
    target.system(&space, &specification).unwrap().rollout(&[request]).unwrap().remove(0)
}

/// Events of a simulation by hand.
#[derive(Default)]
struct Events {
    friction: Option<f64>,
    /// Control step and offset of a jump of the box.
    hop: Option<(usize, [f64; 3])>,
    /// The same of the goal.
    moved: Option<(usize, [f64; 3])>,
    /// Factor of both frictions, first physics step and the one after the last.
    ice: Option<(f64, usize, usize)>,
    /// Damping of the cart, first physics step and the one after the last.
    stuck: Option<(f64, usize, usize)>,
}

/// The signals of each sample, in a loop written by hand.
fn by_hand(events: &Events) -> Vec<[f64; 4]> {
    let model = Model::from_xml(MODEL).unwrap();
    let geom = |name, operation, value| {
        let entries = vec![3 * model.find(ElementKind::Geom, name).unwrap()];
        Change::Field { field: ModelField::GeomFriction, entries, operation, value }
    };
    let slide = model.joint("slide").unwrap();
    let free = model.joint("free").unwrap();
    let goal = model.mocap("goal").unwrap();
    let mut world = model.world();
    world.qvel_mut()[free.dof] = 1.5;
    let mut samples = Vec::new();
    for step in 0..=50 {
        let position = world.mocap_poses().0[goal.index()];
        samples.push([
            world.qpos()[free.qpos],
            world.qpos()[free.qpos + 2],
            position[1],
            world.qpos()[slide.qpos],
        ]);
        if step == 50 {
            break;
        }
        let observed = [position[0], world.qpos()[slide.qpos]].map(|x| f64::from(x as f32));
        let action = f64::from((4.0 * (observed[0] - observed[1])) as f32);
        if let Some((_, offset)) = events.hop.filter(|(at, _)| *at == step) {
            (0..3).for_each(|axis| world.qpos_mut()[free.qpos + axis] += offset[axis]);
        }
        if let Some((_, offset)) = events.moved.filter(|(at, _)| *at == step) {
            world.shift(goal, offset);
        }
        world.ctrl_mut()[0] = action;
        for substep in 0..5 {
            let now = 5 * step + substep;
            let mut changes = Vec::new();
            changes.extend(events.friction.map(|value| geom("floor", FieldOperation::Set, value)));
            if let Some((factor, ..)) = events.ice.filter(|(_, first, end)| (*first..*end).contains(&now)) {
                changes.push(geom("floor", FieldOperation::Scale, factor));
                changes.push(geom("shell", FieldOperation::Scale, factor));
            }
            if let Some((value, ..)) = events.stuck.filter(|(_, first, end)| (*first..*end).contains(&now)) {
                let field = ModelField::DofDamping;
                let entries = vec![slide.dof];
                changes.push(Change::Field { field, entries, operation: FieldOperation::Set, value });
            }
            world.set_model(&model.changed(&changes));
            world.step();
        }
    }
    samples
}

#[track_caller]
fn check(target: &Target, values: &[(&str, f64)], events: &Events) {
    let episode = simulate(target, values);
    let expected = by_hand(events);
    assert_eq!(episode.trace.len(), expected.len());
    for (sample, numbers) in expected.iter().enumerate() {
        for (column, number) in numbers.iter().enumerate() {
            let found = episode.trace.column(column)[sample];
            assert_eq!(found.to_bits(), number.to_bits(), "{values:?}: column {column} of sample {sample}");
        }
    }
}

#[test]
fn jumps_are_those_of_a_loop_by_hand_bit_for_bit() {
    let target = target();
    check(&target, &[], &Events::default());
    let hop = [("hop_time", 0.41), ("hop_y", 0.1), ("hop_z", 0.3)];
    check(&target, &hop, &Events { hop: Some((20, [0.0, 0.1, 0.3])), ..Events::default() });
    let moved = [("move_x", -0.4), ("move_y", 0.5)];
    check(&target, &moved, &Events { moved: Some((15, [-0.4, 0.5, 0.0])), ..Events::default() });
    let both = [hop.as_slice(), &moved].concat();
    let events =
        Events { hop: Some((20, [0.0, 0.1, 0.3])), moved: Some((15, [-0.4, 0.5, 0.0])), ..Events::default() };
    check(&target, &both, &events);
}

#[test]
fn slips_are_those_of_a_loop_by_hand_bit_for_bit() {
    let target = target();
    // 0.103 s is within physics step 25, so that the slip starts with step 26.
    let ice = [("ice_time", 0.103), ("ice_duration", 0.2), ("ice_scale", 0.1)];
    check(&target, &ice, &Events { ice: Some((0.1, 26, 76)), ..Events::default() });
    let stuck = [("stuck_time", 0.5), ("stuck_set", 20.0)];
    check(&target, &stuck, &Events { stuck: Some((20.0, 125, 175)), ..Events::default() });
    // A slip scales the friction that an axis has set.
    let values = [ice.as_slice(), &stuck, &[("friction", 0.9)]].concat();
    let events = Events {
        friction: Some(0.9),
        ice: Some((0.1, 26, 76)),
        stuck: Some((20.0, 125, 175)),
        hop: None,
        moved: None,
    };
    check(&target, &values, &events);
    let [free, icy] = [&[][..], &ice].map(|values| simulate(&target, values).trace.column(0)[50]);
    assert!(icy > free + 0.05, "{icy} {free}: a box slides farther on ice");
}

#[test]
fn an_event_without_magnitude_changes_no_bit_whenever_it_happens() {
    let target = target();
    let undisturbed = simulate(&target, &[]);
    for time in [0.0, 0.2, 0.8] {
        let values = [("hop_time", time), ("ice_time", time), ("ice_duration", 0.4), ("stuck_time", time)];
        assert_eq!(simulate(&target, &values).trace, undisturbed.trace, "{time}");
    }
    // Neither does a slip without a duration.
    assert_eq!(simulate(&target, &[("ice_duration", 0.0), ("ice_scale", 0.0)]).trace, undisturbed.trace);
}

#[test]
fn the_axes_of_an_event_are_its_name_with_its_components() {
    let target = target();
    let events = target.space("events").unwrap();
    let found: Vec<(&str, &str, f64, f64, f64)> = events
        .axes()
        .iter()
        .map(|axis| (axis.name.as_str(), axis.unit.as_str(), axis.low, axis.high, axis.nominal.unwrap()))
        .collect();
    let expected = [
        ("hop_time", "s", 0.0, 0.8, 0.0),
        ("hop_y", "m", -0.2, 0.2, 0.0),
        ("hop_z", "m", -0.1, 0.5, 0.0),
        ("move_x", "m", -0.5, 0.5, 0.0),
        ("move_y", "m", -0.5, 0.5, 0.0),
        ("ice_time", "s", 0.0, 0.8, 0.0),
        ("ice_duration", "s", 0.0, 0.5, 0.5),
        ("ice_scale", "", 0.0, 1.0, 1.0),
        ("stuck_time", "s", 0.0, 0.8, 0.0),
        ("stuck_set", "", 1.0, 50.0, 1.0),
    ];
    assert_eq!(found, expected);
    assert!(events.axes().iter().all(|axis| axis.kind == AxisKind::Event && !axis.meaning.is_empty()));
}

#[test]
fn mistakes_in_events_name_their_line_and_a_way_out() {
    let folder = tempfile::tempdir().unwrap();
    for (from, to, line, part) in [
        ("jump = \"box\"", "jump = \"bux\"", 18, "did you mean `box`?"),
        ("jump = \"box\"", "jump = \"cart\"", 18, "neither a mocap body nor has a free joint"),
        ("jump = \"box\"", "body = \"box\", jump = \"box\"", 18, "exactly one of `body` (a push), `jump`"),
        ("jump = \"box\", time", "time", 18, "exactly one of `body` (a push), `jump`"),
        ("y = [-0.2, 0.2], z", "y = [0.1, 0.2], z", 18, "the range of `y` of an event contains 0"),
        ("jump = \"goal\", time = 0.3", "jump = \"goal\", time = -0.3", 19, "not negative"),
        ("jump = \"goal\", time = 0.3", "jump = \"goal\"", 19, "needs the key `time`"),
        ("jump = \"goal\"", "jump = \"goal\", duration = 1", 19, "no key `duration`"),
        ("scale = [0, 1]", "scale = [0, 0.9]", 20, "the range of `scale` of an event contains 1"),
        ("scale = [0, 1]", "scale = [-1, 1]", 20, "is negative"),
        ("scale = [0, 1]", "scale = [0, 1], add = [0, 1]", 20, "exactly one of `set`, `add` and `scale`"),
        ("set = [1, 50]", "", 21, "exactly one of `set`, `add` and `scale`"),
        ("set = [1, 50]", "set = [2, 50]", 21, "the range of `set` of an event contains 1"),
        ("set = [1, 50]", "set = [1, 50], range = [1, 2]", 21, "no key `range`"),
        ("dof_damping('slide')", "dof_damping('glide')", 21, "did you mean `slide`?"),
        ("\"dof_damping('slide')\"", "[\"dof_damping('slide')\", \"dof_damping('free')\"]", 21, "is 0"),
        (
            "dof_damping('slide')\", set = [1, 50]",
            "geom_friction('floor')[0]\", scale = [0.5, 2]",
            21,
            "an axis before it",
        ),
        ("scale = [0, 1]", "add = [0, 1]", 20, "an axis before it"),
    ] {
        assert!(FILE.contains(from), "{from}");
        let file = FILE.replace(from, to).replace("set = [1, 50], set", "set").replace(", ,", ",");
        let error = read(folder.path(), &file).err().unwrap_or_else(|| panic!("{to} is accepted"));
        assert!(error.contains(part), "{to}: {error}");
        assert!(error.contains(&format!("boxes.toml, line {line}:")), "{to}: {error}");
    }
}
