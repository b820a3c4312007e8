//! Sensors, contact forces and poses of geoms, compared with hand calculation.

use mishandle_world::{ElementKind, JointKind, Model};

/// A cube of 2 kg on the ground beside a pendulum of 3 kg, 0.5 m long, with a keyframe.
const SCENE: &str = r#"<mujoco><option timestep="0.002"/>
  <worldbody>
    <geom name="floor" type="plane" size="1 1 0.1"/>
    <body name="cube" pos="1 0 0.1"><freejoint name="cube"/>
      <geom name="side" type="box" size="0.1 0.1 0.1" mass="2"/>
      <site name="imu" pos="0 0 0.1"/></body>
    <body name="pendulum" pos="0 0 2"><joint name="hinge" axis="0 1 0" range="-90 90"/>
      <geom name="bob" type="sphere" size="0.05" pos="0.5 0 0" mass="3"/></body>
    <body name="gimbal" pos="0 1 2"><joint name="ball" type="ball"/><geom size="0.1" mass="1"/></body>
  </worldbody>
  <sensor><accelerometer name="acceleration" site="imu"/><jointpos name="angle" joint="hinge"/></sensor>
  <actuator><motor name="free" joint="hinge"/><motor name="bounded" joint="hinge" ctrlrange="-2 3"/></actuator>
  <keyframe><key name="bent" qpos="1 0 0.1 1 0 0 0  0.5  1 0 0 0" qvel="0 0 0 0 0 0 0.25 0 0 0" ctrl="1 2"/></keyframe>
</mujoco>"#;

fn forces(world: &mishandle_world::World, name: &str) -> Vec<f64> {
    let mut all = Vec::new();
    let geom = world.model().find(ElementKind::Geom, name).unwrap();
    world.contact_forces_of_geom(geom, &mut |force| all.push(force));
    all
}

#[test]
fn the_floor_carries_the_weight_of_a_resting_cube() {
    let model = Model::from_xml(SCENE).unwrap();
    let mut world = model.world();
    (0..1000).for_each(|_| world.step());
    for name in ["floor", "side"] {
        let forces = forces(&world, name);
        assert_eq!(forces.len(), 4, "one contact per corner");
        assert!((forces.iter().sum::<f64>() - 2.0 * 9.81).abs() < 1e-3, "{forces:?}");
    }
    assert!(forces(&world, "bob").is_empty());
    let mut of_body = Vec::new();
    world.contact_forces_of_body(model.body("cube").unwrap(), &mut |force| of_body.push(force));
    assert_eq!(of_body, forces(&world, "side"));
    // An accelerometer at rest measures gravity.
    world.refresh_sensors();
    let acceleration = &world.sensordata()[model.sensor(0)];
    assert!((acceleration[2] - 9.81).abs() < 1e-3 && acceleration[0].abs() < 1e-3, "{acceleration:?}");
    assert!((forces(&world, "floor").iter().sum::<f64>() - 2.0 * 9.81).abs() < 1e-3);
}

#[test]
fn sensors_are_of_the_start_of_a_step_until_they_are_refreshed() {
    let model = Model::from_xml(SCENE).unwrap();
    let mut world = model.world();
    let hinge = model.joint("hinge").unwrap();
    world.qpos_mut()[hinge.qpos] = 0.3;
    world.step();
    let angle = model.sensor(model.find(ElementKind::Sensor, "angle").unwrap());
    assert_eq!(world.sensordata()[angle.clone()], [0.3]);
    assert_ne!(world.qpos()[hinge.qpos], 0.3);
    world.refresh_sensors();
    assert_eq!(world.sensordata()[angle], [world.qpos()[hinge.qpos]]);
}

#[test]
fn refreshing_sensors_changes_no_bit_of_the_state_or_of_later_steps() {
    let model = Model::from_xml(SCENE).unwrap();
    let mut plain = model.world();
    let mut refreshed = model.world();
    let mut states = [vec![0.0; model.state_size()], vec![0.0; model.state_size()]];
    for step in 0..600 {
        let control = f64::from(step % 7) - 2.0;
        for world in [&mut plain, &mut refreshed] {
            world.ctrl_mut()[0] = control;
            world.step();
        }
        refreshed.refresh_sensors();
        plain.read_state(&mut states[0]);
        refreshed.read_state(&mut states[1]);
        assert!(states[0].iter().zip(&states[1]).all(|(a, b)| a.to_bits() == b.to_bits()), "step {step}");
    }
}

#[test]
fn poses_and_bias_forces_of_a_pendulum_are_those_of_its_angle() {
    let model = Model::from_xml(SCENE).unwrap();
    let mut world = model.world();
    let hinge = model.joint("hinge").unwrap();
    let angle: f64 = 0.4;
    world.qpos_mut()[hinge.qpos] = angle;
    world.refresh();
    // Positive about y turns x toward -z.
    let expected = [0.5 * angle.cos(), 0.0, 2.0 - 0.5 * angle.sin()];
    let close = |found: [f64; 3]| found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-12);
    let bob = model.find(ElementKind::Geom, "bob").unwrap();
    let pendulum = model.body("pendulum").unwrap();
    assert!(close(world.geom_position(bob)) && close(world.body_inertial_position(pendulum)));
    let rotation = world.body_rotation(pendulum);
    assert!((rotation[0] - angle.cos()).abs() < 1e-12 && (rotation[6] + angle.sin()).abs() < 1e-12);
    world.refresh_sensors();
    assert!(close(world.subtree_com(pendulum)));
    // The torque that holds it: minus m g l cos(angle) about y.
    let torque = world.bias_forces()[hinge.dof];
    assert!((torque + 3.0 * 9.81 * 0.5 * angle.cos()).abs() < 1e-9, "{torque}");
}

#[test]
fn elements_have_names_indices_and_facts() {
    let model = Model::from_xml(SCENE).unwrap();
    assert_eq!(model.names(ElementKind::Body), ["world", "cube", "pendulum", "gimbal"]);
    assert_eq!(model.names(ElementKind::Geom), ["floor", "side", "bob", ""]);
    assert_eq!(model.joint_count(), 3);
    let kinds: Vec<JointKind> = (0..3).map(|joint| model.joint_kind(joint)).collect();
    assert_eq!(kinds, [JointKind::Free, JointKind::Hinge, JointKind::Ball]);
    let joint = model.joint_at(2);
    assert_eq!((joint.qpos, joint.dof), (8, 7));
    assert_eq!(
        kinds.iter().map(|kind| kind.positions()).sum::<usize>(),
        model.qpos_size(),
        "positions of all joints"
    );
    assert_eq!(kinds.iter().map(|kind| kind.velocities()).sum::<usize>(), model.qvel_size());
    assert_eq!(model.actuator_range(0), None);
    assert_eq!(model.actuator_range(1), Some([-2.0, 3.0]));
    assert_eq!(model.actuator_joint(0), Some(1));
    assert_eq!(model.body_of_geom(2), model.body("pendulum").unwrap());
    assert_eq!(model.sensor(1), 3..4);
    assert_eq!(model.key_qpos(0)[7], 0.5);
    assert_eq!(model.key_qvel(0)[6], 0.25);
    assert_eq!(model.key_ctrl(0), [1.0, 2.0]);
    assert_eq!(model.qpos0()[2], 0.1);
    let coordinates = model.coordinates();
    let names = |first: usize| coordinates[first..][..4].iter().map(|c| c.name.as_str()).collect::<Vec<_>>();
    assert_eq!(names(8), ["ball_qw", "ball_qx", "ball_qy", "ball_qz"]);
    assert_eq!(names(18), ["hinge", "ball_wx", "ball_wy", "ball_wz"]);
    assert_eq!((coordinates[21].index, coordinates[21].unit), (9, "rad/s"));
    let error = model.find(ElementKind::Joint, "elbow").unwrap_err().to_string();
    assert_eq!(error, "the model has no joint named `elbow`; known names: cube, hinge, ball");
    // A geom has no name; the empty name does not find it.
    assert!(model.find(ElementKind::Geom, "").is_err());
}

#[test]
fn damping_is_added_to_all_velocities_of_a_joint() {
    let model = Model::from_xml(SCENE).unwrap();
    let joints = vec![model.joint("hinge").unwrap(), model.joint("ball").unwrap()];
    let changed = model.changed(&[mishandle_world::Change::Damping(joints, 0.5)]);
    let damping = changed.field(mishandle_world::ModelField::DofDamping);
    assert_eq!(damping, [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.5, 0.5, 0.5, 0.5]);
}

#[test]
fn the_twist_below_a_ball_joint_is_the_derivative_of_the_pose() {
    let chain = r#"<mujoco><worldbody>
      <body name="upper" pos="0 0 1" euler="10 20 30"><joint name="shoulder" type="ball" pos="0.02 0 0.01"/>
        <geom size="0.02" pos="0.3 0 0" mass="1"/>
        <body name="lower" pos="0.3 0.1 0" euler="0 40 0"><joint name="slide" type="slide" axis="1 1 0"/>
          <joint name="wrist" type="ball" pos="0 0.05 0"/><geom size="0.02" pos="0.2 0 0" mass="1"/>
          <body name="tip" pos="0.2 0 0.1"><joint name="finger" axis="0 0 1"/><geom size="0.01" mass="0.1"/></body>
      </body></body></worldbody></mujoco>"#;
    let model = Model::from_xml(chain).unwrap();
    let tip = model.body("tip").unwrap();
    let mut world = model.world();
    for (index, velocity) in world.qvel_mut().iter_mut().enumerate() {
        *velocity = 0.7 - 0.3 * index as f64;
    }
    // Some pose that is not the initial one: integrate the velocity for a while without forces.
    let velocity = world.qvel().to_vec();
    let integrate = |world: &mut mishandle_world::World, dt: f64| {
        let moved = moved(&model, world.qpos(), &velocity, dt);
        world.qpos_mut().copy_from_slice(&moved);
        world.refresh();
    };
    integrate(&mut world, 0.8);
    let (linear, angular) = world.rows().twist(tip);
    let h = 1e-6;
    integrate(&mut world, -h);
    let before = world.rows().position(tip);
    let from = world.rows().quaternion(tip);
    integrate(&mut world, 2.0 * h);
    let after = world.rows().position(tip);
    let to = world.rows().quaternion(tip);
    for axis in 0..3 {
        let speed = (after[axis] - before[axis]) / (2.0 * h);
        assert!((speed - linear[axis]).abs() < 1e-6, "axis {axis}: {speed} and {}", linear[axis]);
    }
    // Twice the vector part of to * conjugate(from), per time.
    let turned = product(to, [from[0], -from[1], -from[2], -from[3]]);
    for axis in 0..3 {
        let speed = 2.0 * turned[1 + axis] / (2.0 * h);
        assert!((speed - angular[axis]).abs() < 1e-6, "axis {axis}: {speed} and {}", angular[axis]);
    }
}

fn product(a: [f64; 4], b: [f64; 4]) -> [f64; 4] {
    [
        a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
        a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
        a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
        a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0],
    ]
}

/// Positions after a time at constant velocity. A ball turns about an axis of its own frame.
fn moved(model: &Model, qpos: &[f64], qvel: &[f64], dt: f64) -> Vec<f64> {
    let mut out = qpos.to_vec();
    for joint in (0..model.joint_count()).map(|index| model.joint_at(index)) {
        match joint.kind {
            JointKind::Ball => {
                let w = [0, 1, 2].map(|axis| qvel[joint.dof + axis] * dt);
                let angle = w.iter().map(|w| w * w).sum::<f64>().sqrt();
                let s = (0.5 * angle).sin() / angle;
                let turn = [(0.5 * angle).cos(), s * w[0], s * w[1], s * w[2]];
                let old = [0, 1, 2, 3].map(|i| qpos[joint.qpos + i]);
                out[joint.qpos..][..4].copy_from_slice(&product(old, turn));
            }
            _ => out[joint.qpos] += qvel[joint.dof] * dt,
        }
    }
    out
}

#[test]
fn an_actuator_with_several_controls_is_refused() {
    let xml = r#"<mujoco><worldbody><body><joint name="b" type="ball"/><geom size="0.1"/></body></worldbody>
        <actuator><orientation joint="b" kp="1"/></actuator></mujoco>"#;
    let error = Model::from_xml(xml).unwrap_err().to_string();
    assert!(error.contains("only actuators with one of each are supported"), "{error}");
}
