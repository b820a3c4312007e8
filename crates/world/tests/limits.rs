//! The robot keeps its position, velocity and effort limits under the servo rule and holds its
//! initial configuration. Its visual shapes have no mass and no contacts.

use mishandle_world::{Actuator, Joint, Model, PANDA, Servo, World};

const JOINTS: [&str; 9] =
    ["joint1", "joint2", "joint3", "joint4", "joint5", "joint6", "joint7", "finger_joint1", "finger_joint2"];
/// Published velocity limits, rad/s and m/s.
const VELOCITY_LIMIT: [f64; 9] = [2.175, 2.175, 2.175, 2.175, 2.61, 2.61, 2.61, 0.2, 0.2];
/// Published effort limits, N m and N.
const EFFORT_LIMIT: [f64; 9] = [87.0, 87.0, 87.0, 87.0, 12.0, 12.0, 12.0, 200.0, 200.0];
/// The change of the target per control step of 1/60 s at full scale, rad and m.
const FULL_SCALE: [f64; 9] = [0.125, 0.125, 0.125, 0.125, 0.125, 0.125, 0.125, 0.0125, 0.0125];

const HOME: [f64; 9] = [0.0, -0.872, 0.0, -2.0, 0.0, 2.618, 0.785, 0.02, 0.02];

struct Robot {
    world: World,
    joints: [Joint; 9],
    actuators: [Actuator; 9],
    servos: [Servo; 9],
    target: [f64; 9],
}

/// Maxima: velocity relative to its limit, effort relative to its limit, distance beyond the
/// joint's range.
#[derive(Clone, Copy, Debug, Default)]
struct Peaks {
    velocity: [f64; 9],
    effort: [f64; 9],
    beyond: [f64; 9],
}

impl Robot {
    fn new(xml: &str, substeps: u32, at: [f64; 9]) -> Robot {
        let model = Model::from_xml(xml).unwrap().with_timestep(1.0 / 60.0 / f64::from(substeps));
        let mut world = model.world();
        world.qpos_mut().copy_from_slice(&at);
        let joints = JOINTS.map(|name| model.joint(name).unwrap());
        Robot {
            world,
            joints,
            servos: std::array::from_fn(|i| Servo {
                qpos: joints[i].qpos,
                dof: joints[i].dof,
                max_velocity: VELOCITY_LIMIT[i],
                max_effort: EFFORT_LIMIT[i],
            }),
            actuators: JOINTS.map(|name| model.actuator(name).unwrap()),
            target: at,
        }
    }

    /// Takes one control step: the targets move by `action` times full scale, and the servos
    /// follow.
    fn control_step(&mut self, substeps: u32, action: &[f64; 9], peaks: &mut Peaks) {
        for i in 0..9 {
            let joint = self.joints[i];
            self.target[i] = (self.target[i] + action[i] * FULL_SCALE[i]).clamp(joint.low, joint.high);
        }
        for _ in 0..substeps {
            self.world.step_servos(&self.servos, &self.target);
            for i in 0..9 {
                let q = self.world.qpos()[i];
                let v = self.world.qvel()[i];
                let force = self.world.actuator_force(self.actuators[i]);
                let beyond = (q - self.joints[i].high).max(self.joints[i].low - q);
                peaks.velocity[i] = peaks.velocity[i].max(v.abs() / VELOCITY_LIMIT[i]);
                peaks.effort[i] = peaks.effort[i].max(force.abs() / EFFORT_LIMIT[i]);
                peaks.beyond[i] = peaks.beyond[i].max(beyond);
            }
        }
    }

    /// Drives by `action` to the limits (2.5 s) and then to the opposite limits (4.5 s).
    fn there_and_back(xml: &str, substeps: u32, action: [f64; 9]) -> (Peaks, Robot) {
        let mut robot = Robot::new(xml, substeps, HOME);
        let mut peaks = Peaks::default();
        for (action, control_steps) in [(action, 150), (action.map(|a| -a), 270)] {
            for _ in 0..control_steps {
                robot.control_step(substeps, &action, &mut peaks);
            }
        }
        (peaks, robot)
    }
}

/// The robot without its collisions.
fn in_free_motion() -> String {
    let free = PANDA.replace("<option ", "<option><flag contact=\"disable\"/></option>\n  <option ");
    assert_ne!(free, PANDA);
    free
}

#[test]
fn a_single_joint_keeps_its_limits_at_full_scale() {
    for substeps in [2, 4] {
        for (i, sign) in (0..9).flat_map(|i| [(i, 1.0), (i, -1.0)]) {
            let mut action = [0.0; 9];
            action[i] = sign;
            let (peaks, robot) = Robot::there_and_back(&in_free_motion(), substeps, action);
            let name = JOINTS[i];
            // It reaches its velocity limit and ends at the other end of its range.
            assert!(peaks.velocity[i] > 0.98 && peaks.velocity[i] < 1.005, "{name}: {peaks:?}");
            let end = if sign > 0.0 { robot.joints[i].low } else { robot.joints[i].high };
            let off = (robot.world.qpos()[i] - end).abs();
            assert!(off < 1e-3, "{name} ends {off} from {end}");
            for (j, name) in JOINTS.iter().enumerate() {
                assert!(peaks.effort[j] <= 1.0, "{name}: {peaks:?}");
                assert!(peaks.beyond[j] < 2e-4, "{name}: {peaks:?}");
            }
        }
    }
}

/// Drives all joints at full scale, in every `every`-th of the 128 combinations of directions.
#[track_caller]
fn check_together(xml: &str, substeps: u32, every: usize, velocity: f64, beyond: f64) {
    for signs in (0..128_u32).step_by(every) {
        let action: [f64; 9] = std::array::from_fn(|i| if signs >> i & 1 == 1 { 1.0 } else { -1.0 });
        let (peaks, _) = Robot::there_and_back(xml, substeps, action);
        for (i, name) in JOINTS.iter().enumerate() {
            assert!(peaks.effort[i] <= 1.0, "{name} with {action:?}: {peaks:?}");
            assert!(peaks.velocity[i] < velocity, "{name} with {action:?}: {peaks:?}");
            assert!(peaks.beyond[i] < beyond, "{name} with {action:?}: {peaks:?}");
        }
    }
}

#[test]
fn all_joints_together_keep_their_limits_at_full_scale() {
    check_together(&in_free_motion(), 2, 1, 1.05, 0.005);
    check_together(&in_free_motion(), 4, 1, 1.05, 0.005);
}

/// The stiffness and damping of the arm's servos times `factor`.
fn with_gain(factor: f64) -> String {
    let kp = 400.0 * factor;
    let kv = 80.0 * factor;
    let scaled = in_free_motion().replace("kp=\"400\" kv=\"80\"", &format!("kp=\"{kp}\" kv=\"{kv}\""));
    assert_ne!(scaled, in_free_motion());
    scaled
}

#[test]
fn stronger_and_weaker_servos_keep_the_limits() {
    for factor in [0.8, 1.25] {
        check_together(&with_gain(factor), 4, 3, 1.05, 0.005);
    }
}

#[test]
fn random_reversals_of_all_joints_exceed_the_velocity_limits_by_less_than_a_tenth() {
    let mut deviate = 0x9e37_79b9_7f4a_7c15_u64;
    let mut largest = [0.0_f64; 2];
    for (case, substeps) in [2, 4].into_iter().enumerate() {
        for hold in [1, 2, 3, 5, 8, 13, 21, 34, 55] {
            for _ in 0..4 {
                let mut robot = Robot::new(&in_free_motion(), substeps, HOME);
                let mut peaks = Peaks::default();
                let mut action = [0.0; 9];
                for step in 0..300 {
                    if step % hold == 0 {
                        action = std::array::from_fn(|_| {
                            deviate = deviate.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
                            if deviate >> 63 == 1 { 1.0 } else { -1.0 }
                        });
                    }
                    robot.control_step(substeps, &action, &mut peaks);
                }
                assert!(peaks.effort.iter().all(|effort| *effort <= 1.0), "{peaks:?}");
                largest[case] = peaks.velocity.into_iter().fold(largest[case], f64::max);
            }
        }
    }
    assert!(largest.iter().all(|velocity| *velocity < 1.1), "{largest:?}");
}

#[test]
fn self_collisions_keep_the_effort_limits() {
    // A collision of the hand with the base accelerates the wrist faster than 12 N m can prevent;
    // it stops at once.
    check_together(PANDA, 4, 3, 3.0, 0.05);
}

#[test]
fn an_initial_configuration_is_held_without_sag() {
    let starts = [
        [0.0, -0.872, 0.0, -2.0, 0.0, 2.618, 0.785, 0.01, 0.01],
        [0.0, 0.0, 0.0, -0.0698, 0.0, 0.3, 0.0, 0.015, 0.015],
        [1.157, -1.066, -0.155, -2.239, -1.841, 1.003, 0.469, 0.035, 0.035],
        [0.0, 0.0, 0.0, -1.0, 0.0, 1.0, 0.5, 0.0001, 0.0001],
    ];
    for start in starts {
        let mut robot = Robot::new(PANDA, 2, start);
        for _ in 0..600 {
            robot.control_step(2, &[0.0; 9], &mut Peaks::default());
        }
        for (q, start) in robot.world.qpos().iter().zip(start) {
            // Gravity is compensated.
            assert!((q - start).abs() < 1e-12, "{q} instead of {start}");
        }
        assert_eq!(robot.world.penetration(), 0.0, "the robot touches itself at {start:?}");
    }
}

#[test]
fn visual_shapes_do_not_change_the_simulation() {
    let bare = PANDA.replace("<compiler ", "<compiler discardvisual=\"true\" ");
    assert_ne!(bare, PANDA);
    let mut worlds = [PANDA, &bare].map(|xml| Model::from_xml(xml).unwrap().world());
    let mut rows = [(); 2].map(|()| vec![0.0; worlds[0].model().state_size()]);
    for step in 0..1000 {
        for (world, row) in worlds.iter_mut().zip(&mut rows) {
            for (i, ctrl) in world.ctrl_mut().iter_mut().enumerate() {
                *ctrl = HOME[i] + 0.4 * (0.01 * f64::from(step) * (1.0 + i as f64)).sin();
            }
            world.step();
            world.read_state(row);
        }
        assert!(rows[0].iter().zip(&rows[1]).all(|(a, b)| a.to_bits() == b.to_bits()), "step {step}");
    }
}

#[test]
fn the_hand_does_not_pass_through_the_base() {
    // Without contacts, the folded arm would end with the hand inside link 0 and the links above
    // it.
    let mut robot = Robot::new(PANDA, 2, HOME);
    let folded = [0.0, 1.7, 0.0, -3.05, 0.0, 0.0, 0.785, 0.0, 0.0];
    let mut deepest: f64 = 0.0;
    let mut touched = false;
    for _ in 0..300 {
        robot.target = folded;
        robot.control_step(2, &[0.0; 9], &mut Peaks::default());
        touched |= robot.world.penetration() > 0.0;
        deepest = deepest.max(robot.world.penetration());
    }
    assert!(touched, "the hand ends at {:?}", robot.world.qpos());
    assert!(deepest < 0.02, "the hand is {deepest} m deep in the robot's own links");
}

#[test]
fn divergence_is_reported_once_and_leaves_no_log_file() {
    let mut world = Model::from_xml(PANDA).unwrap().world();
    assert!(!world.take_divergence());
    world.qvel_mut()[0] = 1e12;
    world.step();
    assert!(world.take_divergence());
    assert!(!world.take_divergence());
    assert!(!std::path::Path::new("MUJOCO_LOG.TXT").exists());
}
