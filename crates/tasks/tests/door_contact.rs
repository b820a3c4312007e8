//! Tests the physics of the door: it turns, stops and is pulled as on a test bench.

use mishandle_tasks::kinematic::{ResolvedRate, rotation_between};
use mishandle_tasks::{JOINT_NAMES, Panda, VELOCITY_LIMIT, compose, task};
use mishandle_world::frame::{add, norm, rotate, rotate_back, scale, sub};
use mishandle_world::{Body, Joint, Model, PANDA, Site, World};

/// A posture in front of the door.
const REST: [f64; 7] = [0.6, -0.2, -0.35, -1.75, -1.0, 2.7, 0.2];

/// Returns the rotation matrix (row-major) of a level hand in the direction `azimuth` with the left
/// finger above.
fn level(azimuth: f64) -> [f64; 9] {
    let (sin, cos) = azimuth.sin_cos();
    [-sin, 0.0, cos, cos, 0.0, sin, 0.0, 1.0, 0.0]
}

/// The scene with the door at (0.8, 0) m. `extra` is additional MJCF.
struct Bench {
    world: World,
    panda: Panda,
    arm: ResolvedRate,
    door: Joint,
    panel: Body,
    handle: Site,
    n_substeps: usize,
    /// Maximum penetration so far, m.
    deepest: f64,
}

impl Bench {
    fn new(extra: &str) -> Bench {
        let task = task("door-opening").unwrap();
        let n_substeps = task.definition().n_substeps;
        let xml = compose(task).unwrap().replacen("</mujoco>", &format!("{extra}</mujoco>"), 1);
        let model = Model::from_xml(&xml).unwrap().with_timestep(1.0 / 60.0 / n_substeps as f64);
        let mut world = model.world();
        let panda = Panda::new(&model).unwrap();
        panda.place(&task.definition().start, &mut world);
        world.ctrl_mut()[..9].copy_from_slice(&task.definition().start);
        let names: [&str; 7] = std::array::from_fn(|i| JOINT_NAMES[i]);
        let arm = ResolvedRate::new(&Model::from_xml(PANDA).unwrap(), &names, "grasp", REST).unwrap();
        Bench {
            world,
            panda,
            arm,
            door: model.joint("door").unwrap(),
            panel: model.body("panel").unwrap(),
            handle: model.site("handle").unwrap(),
            n_substeps,
            deepest: 0.0,
        }
    }

    /// Turns the arm away from the door.
    fn stand_aside(&mut self) {
        let q = [2.8, 0.3, 0.0, -1.5, 0.0, 1.5, 0.0, 0.035, 0.035];
        self.panda.place(&q, &mut self.world);
        self.world.ctrl_mut()[..9].copy_from_slice(&q);
    }

    fn yaw(&self) -> f64 {
        self.world.qpos()[self.door.qpos]
    }

    fn rate(&self) -> f64 {
        self.world.qvel()[self.door.dof]
    }

    fn swing(&mut self, yaw: f64, rate: f64) {
        self.world.qpos_mut()[self.door.qpos] = yaw;
        self.world.qvel_mut()[self.door.dof] = rate;
    }

    fn run(&mut self, seconds: f64) {
        let steps = (seconds / self.world.model().timestep()).round() as usize;
        (0..steps).for_each(|_| self.world.step());
    }

    fn q(&self) -> [f64; 7] {
        std::array::from_fn(|i| self.world.qpos()[self.panda.joints()[i].qpos])
    }

    /// Returns a point of the world frame in the panel's frame.
    fn in_panel(&mut self, point: [f64; 3]) -> [f64; 3] {
        self.world.refresh();
        let rows = self.world.rows();
        rotate_back(rows.quaternion(self.panel), sub(point, rows.position(self.panel)))
    }

    /// Returns a point of the panel's frame in the world frame.
    fn in_world(&mut self, point: [f64; 3]) -> [f64; 3] {
        self.world.refresh();
        let rows = self.world.rows();
        add(rows.position(self.panel), rotate(rows.quaternion(self.panel), point))
    }

    /// Returns the grasp point in the panel's frame.
    fn grasp_in_panel(&mut self) -> [f64; 3] {
        let q = self.q();
        self.arm.set(&q);
        self.in_panel(self.arm.position())
    }

    /// Sets the arm at rest with the grasp point at `point` and the hand's rotation matrix
    /// `rotation`.
    fn pose(&mut self, point: [f64; 3], rotation: &[f64; 9], fingers: f64) {
        let mut q = REST;
        for _ in 0..2000 {
            self.arm.set(&q);
            let turn = rotation_between(&self.arm.rotation(), rotation);
            let error = sub(point, self.arm.position());
            let velocity = self.arm.twist(&q, scale(error, 10.0), scale(turn, 10.0));
            q = std::array::from_fn(|i| q[i] + 0.05 * velocity[i]);
        }
        self.arm.set(&q);
        let gap = norm(sub(point, self.arm.position()));
        assert!(gap < 2e-3, "no posture for {point:?}: {gap} m away at {q:?}");
        let whole = std::array::from_fn(|i| if i < 7 { q[i] } else { fingers });
        self.panda.place(&whole, &mut self.world);
    }

    /// Moves the hand along `direction` at the velocity limits of the joints, and the fingers to
    /// `fingers`.
    fn drive(&mut self, direction: [f64; 3], rotation: &[f64; 9], fingers: f64, seconds: f64) {
        for _ in 0..(60.0 * seconds).round() as usize {
            let q = self.q();
            self.arm.set(&q);
            let turn = scale(rotation_between(&self.arm.rotation(), rotation), 5.0);
            let velocity = self.arm.twist(&q, direction, turn);
            let fastest = (0..7).map(|i| velocity[i].abs() / VELOCITY_LIMIT[i]).fold(0.0, f64::max);
            let full = if norm(direction) > 0.0 { 1.0 / fastest } else { 1.0 };
            // 0.2 s is the lag of the servos: damping over stiffness.
            let targets: [f64; 9] =
                std::array::from_fn(|i| if i < 7 { q[i] + 0.2 * full * velocity[i] } else { fingers });
            for _ in 0..self.n_substeps {
                self.panda.step(&targets, &mut self.world);
                self.deepest = self.deepest.max(self.world.penetration());
            }
        }
    }
}

/// Returns the moment of inertia about the hinge axis of a box with mass `m`, horizontal sides `a`
/// and `b`, and center (x, y) relative to the frame's origin.
fn about_hinge(m: f64, [a, b]: [f64; 2], [x, y]: [f64; 2]) -> f64 {
    m * ((a * a + b * b) / 12.0 + (x - 0.005).powi(2) + (y + 0.464).powi(2))
}

/// Returns the moment of inertia of the whole door: panel, two levers and two key cylinders of
/// 1,000 kg/m³.
fn inertia() -> f64 {
    let panel = about_hinge(1.0, [0.025, 0.762], [0.019, -0.059]);
    let stem = |x| about_hinge(1000.0 * 0.033 * 0.033 * 0.0335, [0.033, 0.033], [x, 0.287]);
    let bar = |x| about_hinge(1000.0 * 0.03 * 0.1091 * 0.0335, [0.03, 0.1091], [x, 0.24895]);
    // A cylinder has the moment m (r²/4 + h²/12) perpendicular to its axis, like a box with sides h
    // and sqrt(3) r.
    let key = |x| {
        let mass = 1000.0 * std::f64::consts::PI * 0.028 * 0.028 * 0.016;
        about_hinge(mass, [0.016, 3.0_f64.sqrt() * 0.028], [x, 0.283])
    };
    panel + stem(-0.0205) + stem(0.0585) + bar(-0.052) + bar(0.09) + key(0.001) + key(0.037)
}

#[test]
fn the_handle_matches_the_original_benchmark_and_opens_towards_the_robot() {
    let mut bench = Bench::new("");
    let at = |bench: &mut Bench, yaw: f64| {
        bench.swing(yaw, 0.0);
        bench.world.refresh();
        bench.world.rows().site_position(bench.handle)
    };
    let near = |a: [f64; 3], b: [f64; 3]| assert!(norm(sub(a, b)) < 1e-9, "{a:?} is not {b:?}");
    near(at(&mut bench, 0.0), [0.7467, 0.1962, 0.8124]);
    // A rotation by 90 degrees about the hinge at (0.805, -0.464) maps the offset (-0.0583, 0.6602)
    // to (-0.6602, -0.0583).
    near(at(&mut bench, std::f64::consts::FRAC_PI_2), [0.1448, -0.5223, 0.8124]);
}

#[test]
fn a_torque_accelerates_the_door_according_to_its_inertia() {
    let mut bench = Bench::new("<actuator><motor name=\"twist\" joint=\"door\"/></actuator>");
    bench.world.ctrl_mut()[9] = 1.0;
    bench.run(0.5);
    // The torque is 1 N m minus the joint friction of 0.01 N m.
    let expected = 0.5 * 0.99 / inertia();
    assert!((bench.rate() / expected - 1.0).abs() < 0.005, "{} rad/s instead of {expected}", bench.rate());
}

#[test]
fn a_released_door_keeps_turning_until_friction_stops_it() {
    let mut bench = Bench::new("");
    let deceleration = 0.01 / inertia();
    bench.stand_aside();
    bench.swing(0.2, 1.0);
    bench.run(1.0);
    let expected = (0.2 + 1.0 - 0.5 * deceleration, 1.0 - deceleration);
    assert!((bench.yaw() - expected.0).abs() < 0.005, "{} instead of {}", bench.yaw(), expected.0);
    assert!((bench.rate() - expected.1).abs() < 0.005, "{} instead of {}", bench.rate(), expected.1);

    // From ω = 0.1 rad/s with the deceleration a the door stops after ω / a = 4.1 s and ω² / 2a =
    // 0.21 rad.
    bench.swing(0.2, 0.1);
    bench.run(8.0);
    let angle = 0.01 / (2.0 * deceleration);
    assert!((bench.yaw() - 0.2 - angle).abs() < 0.02, "{} rad instead of {angle}", bench.yaw() - 0.2);
    assert!(bench.rate().abs() < 1e-3, "it creeps at {} rad/s", bench.rate());
}

#[test]
fn the_hinge_stops_at_both_limits_with_a_small_rebound() {
    let limit = 120.0_f64.to_radians();
    for (from, rate, end) in [(1.5, 3.0, limit), (0.5, -3.0, 0.0), (0.5, -0.5, 0.0)] {
        let mut bench = Bench::new("");
        bench.stand_aside();
        bench.swing(from, rate);
        let mut beyond: f64 = 0.0;
        let mut back: f64 = 0.0;
        for _ in 0..960 {
            bench.world.step();
            beyond = beyond.max((bench.yaw() - end) * rate.signum());
            back = back.max(-bench.rate() * rate.signum());
        }
        assert!(beyond > 0.0 && beyond < 0.0175, "it goes {beyond} rad beyond {end}");
        assert!(back < 0.08 * rate.abs(), "it comes back at {back} rad/s from {rate}");
    }
}

#[test]
fn a_lever_held_between_the_fingers_follows_the_hand_at_full_speed() {
    let mut bench = Bench::new("");
    bench.pose([0.75, 0.215, 0.81], &level(0.0), 0.035);
    bench.drive([0.0; 3], &level(0.0), 0.0, 0.3);
    let held = bench.grasp_in_panel();
    bench.drive([-1.0, 0.0, 0.0], &level(0.0), 0.0, 0.3);
    let slid = norm(sub(bench.grasp_in_panel(), held));
    assert!(bench.yaw() > 0.15, "it is open by {} rad", bench.yaw());
    assert!(slid < 0.015, "the lever slid by {slid} m");
    assert!(bench.deepest < 0.005, "the fingers sink in by {} m", bench.deepest);
}

#[test]
fn a_finger_behind_the_lever_pulls_the_door_without_slipping_off() {
    let mut bench = Bench::new("");
    bench.swing(0.3, 0.0);
    // The hand approaches obliquely from the lever's free end. The lever's back is at x = -0.037 m
    // and y = 0.1944 m, and the panel is at x = 0.0065 m.
    let point = bench.in_world([-0.01, 0.2, 0.81]);
    let oblique = level(bench.yaw() + 0.9);
    bench.pose(point, &oblique, 0.0);
    bench.drive([-1.0, 0.0, 0.0], &oblique, 0.0, 0.3);
    let [x, y, _] = bench.grasp_in_panel();
    assert!(bench.yaw() > 0.5, "it is open by {} rad", bench.yaw());
    assert!(x > -0.03 && y > 0.18, "the finger is no longer behind it, but at {x}, {y}");
    assert!(bench.deepest < 0.005, "the finger sinks in by {} m", bench.deepest);
}

#[test]
fn a_finger_at_full_force_does_not_pass_through_the_lever() {
    let mut bench = Bench::new("");
    bench.swing(0.3, 0.0);
    let point = bench.in_world([-0.052, 0.23, 0.9]);
    bench.pose(point, &level(0.3), 0.0);
    bench.drive([0.0, 0.0, -1.0], &level(0.3), 0.0, 0.4);
    let [_, _, z] = bench.grasp_in_panel();
    // The lever's top is at 0.8275 m.
    assert!(z > 0.8275 && z < 0.86, "the middle between the fingers is at a height of {z} m");
    assert!(bench.deepest > 0.0 && bench.deepest < 0.006, "the finger sinks in by {} m", bench.deepest);
}

#[test]
fn pushing_does_not_open_the_door() {
    // The hand pushes on the lever, on the slab, and on a panel that is slightly open.
    for (yaw, y, seconds) in [(0.0, 0.23, 0.4), (0.0, 0.0, 0.8), (0.2, 0.0, 0.8)] {
        let mut bench = Bench::new("");
        bench.swing(yaw, 0.0);
        bench.pose([0.58, y, 0.81], &level(0.0), 0.0);
        bench.drive([1.0, 0.0, 0.0], &level(0.0), 0.0, seconds);
        let [x, _, _] = bench.grasp_in_panel();
        assert!(bench.yaw().abs() < 0.02, "from {yaw} rad it comes to {}", bench.yaw());
        // The fingertips are 9 mm in front of the grasp point. The lever's front is at -0.067 m,
        // the slab's at -0.016 m.
        let front = if y > 0.0 { -0.067 } else { -0.016 };
        assert!(bench.deepest > 0.0 && x + 0.009 < front + 0.005, "the finger tips are at {}", x + 0.009);
        assert!(bench.deepest < 0.006, "they sink in by {} m", bench.deepest);
    }
}
