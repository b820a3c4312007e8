//! Contact forces between parts agree with statics.

use mishandle_world::{Body, ElementKind, Model, Part, World, WorldError};

/// A robot whose base is a plate. On the plate stand a cube of 0.5 kg and a link of 0.4 kg. One
/// finger of 0.3 kg is pressed on a block by a motor of 20 N, the other one of 0.2 kg stands on the
/// ground. A weightless lever of 0.5 m is pressed on a post by a torque of 10 N m.
const SCENE: &str = r#"<mujoco>
  <option gravity="0 0 -10" timestep="0.002"/>
  <worldbody>
    <geom type="plane" size="3 3 0.1"/>
    <geom type="box" size="0.1 0.1 0.1" pos="1 0 0.1"/>
    <geom type="sphere" size="0.05" pos="-1 0.5 0.89"/>
    <body name="link0" pos="0 0 0.5">
      <geom type="box" size="0.3 0.3 0.1"/>
      <body name="standing" pos="0.2 0 0.15">
        <joint type="slide" axis="0 0 1"/>
        <geom type="sphere" size="0.05" mass="0.4"/>
      </body>
      <body name="left_finger" pos="1 0 -0.25">
        <joint name="left" type="slide" axis="0 0 1"/>
        <geom type="sphere" size="0.05" mass="0.3"/>
      </body>
      <body name="right_finger" pos="0 1 -0.45">
        <joint type="slide" axis="0 0 1"/>
        <geom type="sphere" size="0.05" mass="0.2"/>
      </body>
      <body name="lever" pos="-1 0 0.5" gravcomp="1">
        <joint name="lever" axis="1 0 0" damping="1"/>
        <geom type="capsule" fromto="0 0 0 0 0.6 0" size="0.06" mass="0.1"/>
      </body>
    </body>
    <body name="cube" pos="-0.1 0 0.65">
      <freejoint/>
      <geom type="box" size="0.05 0.05 0.05" mass="0.25"/>
      <body pos="0 0 0.06"><geom type="box" size="0.01 0.01 0.01" mass="0.25"/></body>
    </body>
    <body name="other" pos="2 0 0.05"><freejoint/><geom type="box" size="0.05 0.05 0.05" mass="1"/></body>
  </worldbody>
  <actuator>
    <motor name="left" joint="left"/>
    <motor name="lever" joint="lever"/>
  </actuator>
</mujoco>"#;

fn at_rest(model: &Model) -> World {
    let mut world = model.world();
    world.ctrl_mut().copy_from_slice(&[-20.0, -10.0]);
    (0..4000).for_each(|_| world.step());
    world
}

#[track_caller]
fn assert_near(found: f64, expected: f64) {
    assert!((found - expected).abs() <= 1e-3 * expected.max(1.0), "{found} instead of {expected}");
}

#[test]
fn parts_at_rest_press_on_each_other_with_their_weight_and_their_motors() {
    let model = Model::from_xml(SCENE).unwrap();
    let map = model.part_map(Some("cube")).unwrap();
    let mut world = at_rest(&model);
    let forces = world.part_forces(&map);
    assert_near(forces.between(Part::Arm, Part::Object), 5.0);
    assert_near(forces.between(Part::Object, Part::Arm), 5.0);
    assert_near(forces.between(Part::Arm, Part::Arm), 4.0);
    // The motor and the weight of the finger.
    assert_near(forces.between(Part::Fingers, Part::Fixture), 23.0);
    assert_near(forces.between(Part::Fingers, Part::Ground), 2.0);
    // The torque over the length of the lever.
    assert_near(forces.between(Part::Arm, Part::Fixture), 20.0);
    // The other box stands on the ground, which is none of the robot's business.
    for (a, b) in [(Part::Fixture, Part::Ground), (Part::Object, Part::Ground), (Part::Arm, Part::Ground)] {
        assert_eq!(forces.between(a, b), 0.0);
    }
    // At rest, a further evaluation of the dynamics gives the same net forces.
    let arm = Model::from_xml(mishandle_world::PANDA).unwrap().names(ElementKind::Body);
    let robot: Vec<Body> = arm[1..].iter().filter_map(|name| model.body(name).ok()).collect();
    let parts = model.contact_parts(&robot);
    let mut net = Vec::new();
    world.contact_forces(&parts, &mut net);
    let of = |pair: [&str; 2]| net[parts.pairs().position(|known| known == pair).unwrap()];
    assert_near(of(["robot", "cube"]), 5.0);
    assert_near(of(["robot", "ground"]), 2.0);
}

#[test]
fn reading_the_forces_changes_nothing() {
    let model = Model::from_xml(SCENE).unwrap();
    let map = model.part_map(Some("cube")).unwrap();
    let mut states = [(); 2].map(|()| vec![0.0; model.state_size()]);
    for (reads, state) in [false, true].into_iter().zip(&mut states) {
        let mut world = model.world();
        world.ctrl_mut()[0] = -20.0;
        for _ in 0..200 {
            world.step();
            if reads {
                world.part_forces(&map);
            }
        }
        world.read_state(state);
    }
    assert_eq!(states[0], states[1]);
}

#[test]
fn an_unknown_object_is_an_error() {
    let model = Model::from_xml(SCENE).unwrap();
    let error = model.part_map(Some("sphere")).unwrap_err();
    assert!(matches!(&error, WorldError::Element { name, .. } if name == "sphere"), "{error}");
    assert!(model.part_map(None).is_ok());
}
