//! A robot of a file has variants of its physics.

use mishandle_robots::{RobotFile, RobotPolicy};
use mishandle_rollout::{Component, Episode, Noise, Request, Seed, SolverChange, Specification, Target};
use mishandle_stl::Formula;

/// MuJoCo has no function of its own for an ellipsoid on a box.
const MODEL: &str = r#"<mujoco><option timestep="0.005"/><worldbody>
  <geom name="floor" type="box" size="1 1 0.1" pos="0 0 -0.1"/>
  <body name="stone" pos="0 0 0.12" euler="10 20 0"><freejoint name="stone"/>
    <geom type="ellipsoid" size="0.1 0.05 0.08" mass="0.5"/></body>
  <body name="arm" pos="0.5 0 0.5"><joint name="hinge" axis="0 1 0" damping="0.1"/>
    <geom type="capsule" fromto="0 0 0 0.2 0 0" size="0.02" mass="1"/></body></worldbody>
  <actuator><motor name="motor" joint="hinge"/></actuator></mujoco>"#;

const FILE: &str = r#"
format = 1
name = "stone"
model.file = "stone.xml"
control = { period = 0.02, steps = 50 }
start = { hinge = "0.1 + tilt" }
observation.angle = "qpos('hinge')"
policy = { expression = "-angle", action = "action" }
formulas.stays = "always(height >= 0)"

[signals]
height = "qpos('stone')[2]"
hinge = "qpos('hinge')"
lowest = { value = "qpos('stone')[2]", over = "min" }
heights = { value = "qpos('stone')[2]", over = "sum" }

[axes]
tilt = { range = [-0.1, 0.1], unit = "rad" }
"#;

fn target() -> Target {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("stone.xml"), MODEL).unwrap();
    std::fs::write(folder.path().join("stone.toml"), FILE).unwrap();
    let robot = RobotFile::read(&folder.path().join("stone.toml")).unwrap();
    let RobotPolicy::Expression(policy) = robot.policy() else { panic!("the policy is an expression") };
    let component =
        Component { role: "controller".into(), name: "e".into(), hash: "h".into(), file_hash: String::new() };
    robot.target(policy.clone(), vec![component], Noise::default()).unwrap()
}

fn column(episode: &Episode, name: &str) -> Vec<f64> {
    let index = episode.trace.names().iter().position(|known| known == name).unwrap();
    episode.trace.column(index).to_vec()
}

#[test]
fn a_robot_with_contact_has_variants_with_other_bits_and_close_signals() {
    let target = target();
    let space = target.space("starts").unwrap();
    let requirement = Formula::parse(&target.formulas[0].text).unwrap();
    let specification = Specification::from_formulas(&target.formulas, requirement).unwrap();
    let request = Request::new(space.nominal(), Seed(1));
    let plain = target.system(&space, &specification).unwrap().rollout(std::slice::from_ref(&request));
    let plain = plain.unwrap().remove(0);
    let heights = column(&plain, "height");
    assert!(heights[0] > 0.11 && heights[50] < 0.09, "it falls and rests on the floor: {heights:?}");
    let variants = target.solver_systems(&space, &specification).unwrap();
    assert_eq!(variants.iter().map(|(change, _)| *change).collect::<Vec<_>>(), SolverChange::ALL);
    for (change, mut system) in variants {
        let changed = system.rollout(std::slice::from_ref(&request)).unwrap().remove(0);
        for name in ["height", "lowest", "heights"] {
            let [changed, plain] = [&changed, &plain].map(|episode| column(episode, name));
            assert!(changed != plain, "{change:?}: {name} has the same bits");
            // A sum over physics steps has as many terms with half the step.
            let largest = changed.iter().zip(&plain).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            assert!(largest < 0.03, "{change:?}: {name} differs by {largest}");
        }
        let [hinge, plain_hinge] = [&changed, &plain].map(|episode| column(episode, "hinge"));
        let moved = hinge[0] - plain_hinge[0];
        let expected = if change == SolverChange::MovedStart { -1e-6 } else { 0.0 };
        // The stone has the first three coordinates.
        assert!((moved - expected).abs() < 1e-12, "{change:?}: {moved}");
    }
}
