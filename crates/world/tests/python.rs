//! MuJoCo's Python package computes the same states from the same model, initial state and
//! controls.
//!
//! The packages are installed into a virtual environment in the target folder and reused.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use mishandle_world::{Body, ElementKind, Model, PANDA};

const VERSION: &str = "3.17.0";
const STEPS: usize = 1000;

/// The replay script: reads model, initial state and controls, and writes the state after every
/// step.
const REPLAY: &str = include_str!("replay.py");

/// A ball on the ground and an obstacle.
const SCENE: &str = r#"
  <worldbody>
    <geom name="ground" type="plane" size="2 2 0.1" contype="8" conaffinity="7" friction="0.75 0.005 0.0001"/>
    <body name="post" mocap="true" pos="0.45 0.3 0.1">
      <geom type="box" size="0.03 0.03 0.1" contype="8" conaffinity="7"/>
    </body>
    <body name="ball" pos="0.5 0 0.06">
      <freejoint name="ball"/>
      <geom type="sphere" size="0.06" mass="0.2" contype="4" conaffinity="3" friction="0.75 0.005 0.0001"/>
    </body>
  </worldbody>
"#;

/// The parts of the scene, each with its bodies.
const PARTS: &str = "robot link0 link1 link2 link3 link4 link5 link6 link7 hand left_finger right_finger
ground world
post post
ball ball
";

fn run(program: &Path, arguments: &[&str], purpose: &str) -> Output {
    let output = Command::new(program)
        .args(arguments)
        .output()
        .unwrap_or_else(|error| panic!("{purpose}: cannot start {}: {error}", program.display()));
    assert!(
        output.status.success(),
        "{purpose}: `{} {}` ended with {}:\n{}",
        program.display(),
        arguments.join(" "),
        output.status,
        String::from_utf8_lossy(&output.stderr),
    );
    output
}

/// Returns a Python interpreter with the required version of MuJoCo. Installs MuJoCo if it is
/// missing.
fn python() -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).with_file_name("venv-mujoco");
    let python = folder.join("bin/python");
    let has_mujoco = Command::new(&python)
        .args(["-c", &format!("import mujoco; assert mujoco.__version__ == '{VERSION}'")])
        .output()
        .is_ok_and(|output| output.status.success());
    if !has_mujoco {
        let path = folder.to_str().unwrap();
        run(Path::new("python3"), &["-m", "venv", "--clear", path], "creating a virtual environment");
        run(
            &python,
            &["-m", "pip", "install", "--quiet", &format!("mujoco=={VERSION}")],
            "installing MuJoCo's Python package, which requires access to PyPI",
        );
    }
    python
}

fn bytes(values: &[f64]) -> Vec<u8> {
    values.iter().flat_map(|value| value.to_le_bytes()).collect()
}

/// Simulates `xml` with `controls`, here and in Python, and compares all numbers of all states.
/// Returns the positions after each step.
fn check(name: &str, xml: &str, qpos: &[f64], controls: &[[f64; 9]]) -> Vec<Vec<f64>> {
    let model = Model::from_xml(xml).unwrap();
    let mut world = model.world();
    world.qpos_mut()[..qpos.len()].copy_from_slice(qpos);
    let mut first = vec![0.0; model.state_size()];
    world.read_state(&mut first);

    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("python-{name}"));
    fs::create_dir_all(&folder).unwrap();
    fs::write(folder.join("model.xml"), xml).unwrap();
    fs::write(folder.join("first"), bytes(&first)).unwrap();
    fs::write(folder.join("controls"), bytes(controls.as_flattened())).unwrap();
    let arm = Model::from_xml(PANDA).unwrap().names(ElementKind::Body);
    let robot: Vec<Body> = arm[1..].iter().filter_map(|name| model.body(name).ok()).collect();
    let parts = model.contact_parts(&robot);
    let pairs: Vec<String> = parts.pairs().map(|[first, second]| format!("{first} {second}\n")).collect();
    fs::write(folder.join("pairs"), pairs.concat()).unwrap();
    fs::write(folder.join("parts"), PARTS).unwrap();
    fs::write(folder.join("replay.py"), REPLAY).unwrap();
    let script = folder.join("replay.py");
    run(&python(), &[script.to_str().unwrap(), folder.to_str().unwrap()], "replaying in Python");
    let replayed = fs::read(folder.join("states")).unwrap();
    assert_eq!(replayed.len(), 8 * controls.len() * model.state_size());

    let forces = fs::read(folder.join("forces")).unwrap();
    let width = pairs.len() + 1;
    assert_eq!(forces.len(), 8 * controls.len() * width);
    let mut forces = forces.chunks_exact(8).map(|bytes| f64::from_le_bytes(bytes.try_into().unwrap()));
    let mut other = model.world();
    let mut measured = Vec::new();
    let mut largest = vec![0.0_f64; width];

    let mut positions = Vec::new();
    let mut row = first;
    let mut replayed = replayed.chunks_exact(8).map(|bytes| f64::from_le_bytes(bytes.try_into().unwrap()));
    for (step, control) in controls.iter().enumerate() {
        world.ctrl_mut().copy_from_slice(control);
        world.step();
        world.read_state(&mut row);
        for (i, (ours, theirs)) in row.iter().zip(&mut replayed).enumerate() {
            assert!((ours - theirs).abs() <= 1e-12, "{name}, step {step}, element {i}: {ours} and {theirs}");
        }
        positions.push(world.qpos().to_vec());
        other.set_state(&row);
        other.contact_forces(&parts, &mut measured);
        for (i, (ours, theirs)) in measured.iter().zip(&mut forces).enumerate() {
            assert!((ours - theirs).abs() <= 1e-9, "{name}, step {step}, force {i}: {ours} and {theirs} N");
            largest[i] = largest[i].max(*ours);
        }
    }
    if name != "alone" {
        // Each pair but the robot and the ground touches at some time.
        let touching: Vec<&String> =
            pairs.iter().zip(&largest).filter(|(_, force)| **force > 0.1).map(|(pair, _)| pair).collect();
        assert!(touching.len() >= 3, "only {touching:?} of {pairs:?} touch");
    }
    positions
}

/// Numbers in [-1, 1): the top bits of a multiplicative congruential generator.
fn noise(state: &mut u64) -> f64 {
    *state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
    (*state >> 11) as f64 / (1u64 << 52) as f64 - 1.0
}

// One test only, so that two threads do not install into the same virtual environment.
#[test]
fn python_computes_the_same_states() {
    // The robot alone, with controls that jump ten times per second.
    let start = [0.0, -0.872, 0.0, -2.0, 0.0, 2.618, 0.785, 0.02, 0.02];
    let mut state = 1;
    let mut control = start;
    let mut controls = Vec::new();
    for step in 0..STEPS {
        if step % 12 == 0 {
            control = std::array::from_fn(|i| start[i] + if i < 7 { 1.5 } else { 0.02 } * noise(&mut state));
        }
        controls.push(control);
    }
    check("alone", PANDA, &start, &controls);

    // The hand, pointing down close to the ground, pushes the ball against the post, with noise.
    let scene = PANDA.replace("</mujoco>", &format!("{SCENE}</mujoco>"));
    let start = [-0.6, 0.57, 0.0, -2.29, 0.0, 2.86, 0.785, 0.0, 0.0];
    let mut controls = Vec::new();
    for step in 0..STEPS {
        let sweep = 1.2 * (step as f64 / 300.0).min(1.0);
        let mut control: [f64; 9] =
            std::array::from_fn(|i| start[i] + if i < 7 { 0.02 * noise(&mut state) } else { 0.0 });
        control[0] += sweep;
        controls.push(control);
    }
    let positions = check("pushing", &scene, &start, &controls);
    // The ball's position follows the nine joints. The ball must have moved, or contacts were not
    // tested.
    let path: f64 =
        positions.windows(2).map(|pair| (pair[1][9] - pair[0][9]).hypot(pair[1][10] - pair[0][10])).sum();
    assert!(path > 0.1, "the ball moved only {path} m");
    assert!(positions.iter().all(|q| (0.05..0.1).contains(&q[11])), "the ball left the ground");
}
