//! The robot keeps its position, velocity and effort limits under the servo rule and holds its
//! initial configuration. Its visual shapes have no mass and no contacts.

#![allow(clippy::unwrap_used, reason = "a test may panic")]

use mishandle_world::{Actuator, Joint, Model, PANDA, World};

const JOINTS: [&str; 9] =
    ["joint1", "joint2", "joint3", "joint4", "joint5", "joint6", "joint7", "finger_joint1", "finger_joint2"];
/// Published velocity limits, rad/s and m/s.
const VELOCITY_LIMIT: [f64; 9] = [2.175, 2.175, 2.175, 2.175, 2.61, 2.61, 2.61, 0.2, 0.2];
/// Published effort limits, N m and N.
const EFFORT_LIMIT: [f64; 9] = [87.0, 87.0, 87.0, 87.0, 12.0, 12.0, 12.0, 200.0, 200.0];
/// The maximum difference between control and joint position: velocity limit times damping over
/// stiffness, 80 / 400 s and 100 / 10000 s.
const LEAD: [f64; 9] = [0.435, 0.435, 0.435, 0.435, 0.522, 0.522, 0.522, 0.002, 0.002];
/// The change of the target per control step of 1/60 s at full scale, rad and m.
const FULL_SCALE: [f64; 9] = [0.125, 0.125, 0.125, 0.125, 0.125, 0.125, 0.125, 0.0125, 0.0125];

const HOME: [f64; 9] = [0.0, -0.872, 0.0, -2.0, 0.0, 2.618, 0.785, 0.02, 0.02];

struct Robot {
    world: World,
    joints: [Joint; 9],
    actuators: [Actuator; 9],
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
        Robot {
            world,
            joints: JOINTS.map(|name| model.joint(name).unwrap()),
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
            for (i, lead) in LEAD.into_iter().enumerate() {
                let q = self.world.qpos()[i];
                self.world.ctrl_mut()[i] = q + (self.target[i] - q).clamp(-lead, lead);
            }
            self.world.step();
            for i in 0..9 {
                let (q, v) = (self.world.qpos()[i], self.world.qvel()[i]);
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

#[test]
fn a_single_joint_keeps_its_limits_at_full_scale() {
    for substeps in [2, 4] {
        for (i, sign) in (0..9).flat_map(|i| [(i, 1.0), (i, -1.0)]) {
            let mut action = [0.0; 9];
            action[i] = sign;
            let (peaks, robot) = Robot::there_and_back(PANDA, substeps, action);
            let name = JOINTS[i];
            // It reaches its velocity limit and ends at the other end of its range. One step of 12
            // N m from the edge of the servo's unclamped band, 0.15 rad/s wide, may accelerate a
            // wrist joint a few percent beyond the limit.
            assert!(peaks.velocity[i] > 0.98 && peaks.velocity[i] < 1.02, "{name}: {peaks:?}");
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
fn check_together(xml: &str, every: usize, velocity: [f64; 9], beyond: f64) {
    for signs in (0..128_u32).step_by(every) {
        let action: [f64; 9] = std::array::from_fn(|i| if signs >> i & 1 == 1 { 1.0 } else { -1.0 });
        let (peaks, _) = Robot::there_and_back(xml, 2, action);
        for (i, name) in JOINTS.iter().enumerate() {
            assert!(peaks.effort[i] <= 1.0, "{name} with {action:?}: {peaks:?}");
            assert!(peaks.velocity[i] < velocity[i], "{name} with {action:?}: {peaks:?}");
            assert!(peaks.beyond[i] < beyond, "{name} with {action:?}: {peaks:?}");
        }
    }
}

#[test]
fn all_joints_together_keep_relaxed_limits_at_full_scale() {
    // Under an external torque the velocity of a servo changes by the torque divided by 80 N m s:
    // 0.4 rad/s in joints 1 to 4 for the 30 N m of the moving arm.
    let free = PANDA.replace("conaffinity=\"16\"", "conaffinity=\"0\"");
    assert_ne!(free, PANDA);
    check_together(&free, 1, [1.2, 1.2, 1.2, 1.2, 1.06, 1.06, 1.06, 1.04, 1.04], 0.005);
}

#[test]
fn self_collisions_keep_the_effort_limits() {
    // A collision of the hand with the base accelerates the wrist faster than 12 N m can prevent;
    // it stops at once.
    check_together(PANDA, 3, [1.5, 1.5, 1.5, 1.5, 3.0, 3.0, 3.5, 5.0, 5.0], 0.05);
}

#[test]
fn an_initial_configuration_is_held_without_sag() {
    let starts = [
        [0.0, -0.872, 0.0, -2.0, 0.0, 2.618, 0.785, 0.01, 0.01],
        [0.0, 0.0, 0.0, -0.0698, 0.0, 0.0, 0.0, 0.015, 0.015],
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
                *ctrl = HOME[i] + LEAD[i] * (0.01 * f64::from(step) * (1.0 + i as f64)).sin();
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
