//! Tests the physics of the peg: it falls, stands, jams and is held as on a test bench.

use std::f64::consts::TAU;

use mishandle_rollout::{Environment, Sample, Seed};
use mishandle_tasks::{JOINTS, Panda, Preset, Reward, TaskEnvironment, compose, task};
use mishandle_world::frame::{norm, norm_xy, rotate, rotate_back, sub};
use mishandle_world::{Body, Equality, Joint, Model, World};

/// Horizontal position of the block and its hole, m.
const HOLE: [f64; 2] = [0.5, 0.0];

/// Heights of the peg's origin while the peg stands on the block and on the hole's floor, m.
const ON_BLOCK: f64 = 0.43;
const IN_HOLE: f64 = 0.38;

/// Radii and lengths of hole and shaft, m.
const HOLE_RADIUS: f64 = 0.01;
const SHAFT_RADIUS: f64 = 0.006;
const SHAFT: f64 = 0.06;

const UPRIGHT: [f64; 4] = [0.5, 0.5, 0.5, 0.5];

/// The scene with the servos of the environment.
struct Bench {
    world: World,
    panda: Panda,
    peg: Joint,
    weld: Equality,
    hand: Body,
    targets: [f64; JOINTS],
}

impl Bench {
    fn new() -> Bench {
        Bench::with("")
    }

    /// Makes the scene with additional MJCF.
    fn with(extra: &str) -> Bench {
        let task = task("peg-in-hole").unwrap();
        let definition = task.definition();
        let xml = compose(task).unwrap().replacen("</mujoco>", &format!("{extra}</mujoco>"), 1);
        let model = Model::from_xml(&xml).unwrap().with_timestep(1.0 / 60.0 / definition.n_substeps as f64);
        let panda = Panda::new(&model).unwrap();
        let mut bench = Bench {
            world: model.world(),
            panda,
            peg: model.joint("peg").unwrap(),
            weld: model.equality("peg").unwrap(),
            hand: model.body("hand").unwrap(),
            targets: definition.start,
        };
        panda.place(&definition.start, &mut bench.world);
        let block = model.mocap("block").unwrap();
        bench.world.place(block, [HOLE[0], HOLE[1], 0.0], [1.0, 0.0, 0.0, 0.0]);
        bench
    }

    /// Makes the scene with a released peg at rest. Its origin is at `offset` from the hole's axis.
    fn loose(offset: [f64; 2], height: f64, quaternion: [f64; 4]) -> Bench {
        let mut bench = Bench::new();
        bench.world.switch(bench.weld, false);
        bench.world.place_free(bench.peg, [HOLE[0] + offset[0], HOLE[1] + offset[1], height], quaternion);
        bench
    }

    fn step(&mut self) {
        self.panda.step(&self.targets, &mut self.world);
    }

    /// Runs the simulation and returns the maximum penetration, m.
    fn run(&mut self, seconds: f64) -> f64 {
        let steps = (seconds / self.world.model().timestep()).round() as usize;
        (0..steps).fold(0.0, |deepest: f64, _| {
            self.step();
            deepest.max(self.world.penetration())
        })
    }

    fn position(&self) -> [f64; 3] {
        self.world.rows().free_position(self.peg)
    }

    /// Returns the angle between the peg's axis and the vertical, rad.
    fn tilt(&self) -> f64 {
        let axis = rotate(self.quaternion(), [0.0, 1.0, 0.0]);
        norm_xy(axis).atan2(axis[2])
    }

    fn quaternion(&self) -> [f64; 4] {
        [3, 4, 5, 6].map(|i| self.world.qpos()[self.peg.qpos + i])
    }

    /// Returns the peg's origin and axis in the hand's frame.
    fn in_hand(&mut self) -> ([f64; 3], [f64; 3]) {
        self.world.refresh();
        let rows = self.world.rows();
        let p = rows.position(self.hand);
        let q = rows.quaternion(self.hand);
        (rotate_back(q, sub(self.position(), p)), rotate_back(q, rotate(self.quaternion(), [0.0, 1.0, 0.0])))
    }
}

/// Returns the quaternion of a peg whose axis leans towards -x by `angle`.
fn leaning(angle: f64) -> [f64; 4] {
    let (s, c) = (0.5 * angle).sin_cos();
    // The product of a rotation by -angle about y and the upright orientation.
    let [w, x, y, z] = UPRIGHT;
    [c * w + s * y, c * x - s * z, c * y - s * w, c * z + s * x]
}

#[test]
fn the_clearance_is_four_millimeters_in_every_direction() {
    // The walls are tangent to the circle of 10 mm. At the corners of the polygon the clearance of
    // a shaft of 6 mm is 4 mm / cos(π / 16) = 4.08 mm.
    for i in 0..64 {
        let (sin, cos) = (TAU * f64::from(i) / 64.0).sin_cos();
        let touches = |offset: f64| {
            let mut bench = Bench::loose([offset * cos, offset * sin], 0.39, UPRIGHT);
            bench.step();
            bench.world.penetration() > 0.0
        };
        assert!(!touches(0.0039), "direction {i} of 64");
        assert!(touches(0.0041), "direction {i} of 64");
    }
}

#[test]
fn an_upright_peg_falls_into_the_hole_and_stays() {
    for offset in [0.0, 0.002, 0.0038] {
        let mut bench = Bench::loose([offset, 0.0], ON_BLOCK + 0.005, UPRIGHT);
        let deepest = bench.run(1.0);
        assert!((bench.position()[2] - IN_HOLE).abs() < 1e-4, "{:?}", bench.position());
        // The peg arrives at 1 m/s and moves 4 mm per physics step.
        assert!(deepest < 0.002, "{deepest}");
        let before = bench.position();
        assert!(bench.run(10.0) < 1e-4);
        assert!(norm(sub(bench.position(), before)) < 1e-4, "{before:?} {:?}", bench.position());
    }
}

#[test]
fn a_peg_beside_the_hole_stands_on_the_block() {
    // The peg stands on the edge of a wall, on the seam of two boxes, and on one box.
    for offset in [[0.02, 0.0], [0.05, 0.003], [0.1, 0.1]] {
        let mut bench = Bench::loose(offset, ON_BLOCK, UPRIGHT);
        bench.run(0.5);
        let before = bench.position();
        assert!((before[2] - ON_BLOCK).abs() < 1e-4, "{before:?}");
        assert!(bench.run(10.0) < 1e-4);
        assert!(norm(sub(bench.position(), before)) < 1e-3, "{before:?} {:?}", bench.position());
        assert!(bench.tilt() < 1e-3);
    }
}

#[test]
fn a_peg_bounces_on_the_ground_with_a_restitution_of_0_4_and_not_on_the_block() {
    let restitution = |offset: [f64; 2], surface: f64, fall: f64| {
        // Below a cylinder that stands exactly upright, MuJoCo finds two contacts that are 1.5
        // radii deeper than its end. They throw it up.
        let (sin, cos) = (0.25 * std::f64::consts::PI + 0.05).sin_cos();
        let mut bench = Bench::loose(offset, surface + 0.5 * SHAFT + fall, [cos, sin, 0.0, 0.0]);
        let mut down: f64 = 0.0;
        let mut up: f64 = 0.0;
        for _ in 0..480 {
            bench.step();
            let v = bench.world.rows().free_velocity(bench.peg)[2];
            down = down.min(v);
            up = up.max(v);
        }
        -up / down
    };
    // The time of contact within a physics step changes a single restitution by up to a half.
    let mean = |offset: [f64; 2], surface: f64| {
        (0..20).map(|i| restitution(offset, surface, 0.2 + 0.013 * f64::from(i))).sum::<f64>() / 20.0
    };
    let ground = mean([0.5, 0.5], 0.0);
    let block = mean([0.08, 0.08], 0.4);
    assert!((ground - 0.4).abs() < 0.05, "{ground} on the ground");
    // It is 0.09 to 0.105, depending on how the peg leans.
    assert!(block < 0.12, "{block} on the block");
}

/// Returns the depth of the lowest point of a jammed shaft that leans by `angle`.
///
/// In the plane of the axis and the vertical, one edge of the lower end is at the far wall, x = 2
/// R. The end is 2 r cos(angle) wide. From its lowest point the side of the shaft rises at `angle`
/// to the vertical up to the near rim, x = 0. So depth · tan(angle) = 2 R - 2 r cos(angle).
fn depth_leaning(angle: f64) -> f64 {
    2.0 * (HOLE_RADIUS - SHAFT_RADIUS * angle.cos()) / angle.tan()
}

/// Simulates a peg that slides down slowly with a constant lean, and returns the final depth of its
/// lowest point, m.
fn depth_reached(angle: f64) -> f64 {
    let (sin, cos) = angle.sin_cos();
    // The distance between the edge of the lower end and the far wall is 0.05 mm.
    let x = HOLE[0] + HOLE_RADIUS - 0.00005 - SHAFT_RADIUS * cos - 0.5 * SHAFT * sin;
    let lowest_below_origin = 0.5 * SHAFT * cos + SHAFT_RADIUS * sin;
    let height = 0.4 + lowest_below_origin;
    let q = leaning(angle);
    let mut bench = Bench::with(&format!(
        "<worldbody><body name=\"slide\" pos=\"{x} {y} {height}\"><joint type=\"slide\" axis=\"1 0 0\"/>
         <joint type=\"slide\" axis=\"0 1 0\"/><joint type=\"slide\" axis=\"0 0 1\" damping=\"10\"/>
         <inertial pos=\"0 0 0\" mass=\"0.02\" diaginertia=\"1 1 1\"/></body></worldbody>
         <equality><weld body1=\"slide\" body2=\"peg\" relpose=\"0 0 0 {} {} {} {}\" torquescale=\"30\"/></equality>",
        q[0],
        q[1],
        q[2],
        q[3],
        y = HOLE[1],
    ));
    bench.world.switch(bench.weld, false);
    bench.world.place_free(bench.peg, [x, HOLE[1], height], q);
    bench.run(2.0);
    assert!((bench.tilt() - angle).abs() < 1e-4, "it leans by {}", bench.tilt());
    0.4 - (bench.position()[2] - lowest_below_origin)
}

#[test]
fn a_leaning_peg_jams_at_the_depth_of_the_geometry() {
    // At the limit of 9.3 degrees the lowest point just reaches the floor at a depth of 50 mm.
    assert!((depth_leaning(0.1616) - 0.05).abs() < 1e-4);
    for angle in [0.05, 0.10, 0.14] {
        let depth = depth_reached(angle);
        assert!((depth - 0.05).abs() < 1e-4, "leaning by {angle} rad it stops at {depth}");
    }
    for angle in [0.2, 0.3, 0.4, 0.5] {
        let depth = depth_reached(angle);
        let limit = depth_leaning(angle);
        assert!((depth - limit).abs() < 5e-4, "leaning by {angle} rad it stops at {depth}, not {limit}");
    }
}

#[test]
fn a_peg_at_rest_in_the_hole_has_no_phantom_contact() {
    // The pose of a peg 3.2 s after its release. With MuJoCo's tolerance, the collider finds the
    // shaft 16.6 mm deep in a wall 4 mm away, and the peg leaps at 0.8 m/s.
    let position = [0.4585358399216042, -0.14656435906776086, 0.37999982457500825];
    let quaternion = [0.48743543499110314, 0.4875645987480442, 0.5122535905661927, 0.5121364249052563];
    let block = [0.456231817368353, -0.14819145803561518, 0.0];
    let deepest = |extra: &str| {
        let mut bench = Bench::with(extra);
        bench.world.switch(bench.weld, false);
        let mocap = bench.world.model().mocap("block").unwrap();
        bench.world.place(mocap, block, [1.0, 0.0, 0.0, 0.0]);
        bench.world.place_free(bench.peg, position, quaternion);
        bench.step();
        (bench.world.penetration(), norm(bench.world.rows().free_velocity(bench.peg)))
    };
    let (depth, speed) = deepest("");
    assert!(depth < 1e-4, "the peg is {depth} m in the block");
    assert!(speed < 0.01, "the peg leaps at {speed} m/s");
    // The pose is one that the tolerance of MuJoCo fails on.
    assert!(deepest("<option ccd_tolerance=\"1e-6\"/>").0 > 0.01);
}

#[test]
fn the_hand_holds_the_peg_without_penetrating_it() {
    let mut bench = Bench::new();
    let start = bench.in_hand();
    let deepest = bench.run(1.0);
    let after = bench.in_hand();
    assert!(deepest < 1e-5, "the pads are {deepest} in the cap");
    assert!(norm(sub(after.0, start.0)) < 1e-4);
    let before = bench.position();
    bench.run(0.5);
    assert!(norm(sub(bench.position(), before)) < 1e-6, "the peg trembles");
    // The pads are at the surface of the cap: half a millimeter closer they penetrate it.
    for finger in [7, 8] {
        let mut closer = Bench::new();
        closer.targets[finger] -= 5e-4;
        closer.panda.place(&closer.targets, &mut closer.world);
        closer.step();
        assert!(closer.world.penetration() > 0.0, "finger {finger}");
    }
}

#[test]
fn a_held_peg_does_not_slip_at_full_speed_of_the_arm() {
    let mut bench = Bench::new();
    let start = bench.in_hand();
    let mut slip: f64 = 0.0;
    let mut turn: f64 = 0.0;
    // Each joint moves back and forth at full speed, far above the block.
    for step in 0..240 {
        let sign = if (step / 20) % 2 == 0 { 1.0 } else { -1.0 };
        bench.panda.move_targets(&[sign, sign * 0.2, -sign, -sign, sign, sign, -sign], &mut bench.targets);
        for _ in 0..4 {
            bench.step();
            let now = bench.in_hand();
            slip = slip.max(norm(sub(now.0, start.0)));
            turn = turn.max(norm(sub(now.1, start.1)));
        }
    }
    assert!(slip < 1e-3, "it slips by {slip}");
    assert!(turn < 0.02, "it turns by {turn}");
}

#[test]
fn the_full_force_of_the_arm_does_not_press_the_peg_into_the_block() {
    let mut bench = Bench::new();
    // Above the block, 4 cm beside its hole.
    let above = [0.08, -0.137, 0.0, -1.572, 0.0, 1.486, 2.4];
    bench.targets[..7].copy_from_slice(&above);
    bench.run(3.0);
    let start = bench.in_hand();
    let mut lowest: f64 = f64::INFINITY;
    let mut speed: f64 = 0.0;
    for _ in 0..120 {
        bench.panda.move_targets(&[0.0, 1.0, 0.0, -1.0, 0.0, 0.0, 0.0], &mut bench.targets);
        for _ in 0..8 {
            bench.step();
            let axis = rotate(bench.quaternion(), [0.0, 1.0, 0.0]);
            let tip = bench.position()[2] - 0.5 * SHAFT * axis[2] - SHAFT_RADIUS * norm_xy(axis);
            speed = speed.max(-bench.world.rows().free_velocity(bench.peg)[2]);
            lowest = lowest.min(tip);
        }
    }
    // The peg comes down at 1.7 m/s, 3.5 mm per physics step. This is the maximum penetration, also
    // under the full torque after the contact.
    assert!(speed > 1.5, "it comes down at {speed} m/s");
    assert!(lowest > 0.4 - 1.1 * speed / 480.0, "its tip gets down to {lowest} at {speed} m/s");
    let now = bench.in_hand();
    assert!(
        norm(sub(now.0, start.0)) < 1e-3 && norm(sub(now.1, start.1)) < 0.01,
        "it slipped: {start:?} {now:?}"
    );
}

#[test]
fn the_gripper_releases_the_peg_near_the_hole_for_every_position_of_the_block() {
    let task = task("peg-in-hole").unwrap();
    let environment = TaskEnvironment::new(task, Preset::Paper, Reward::Shaped).unwrap();
    let expert = task.expert().unwrap();
    let environment = environment.with_further_parts(expert.further_parts()).unwrap();
    let mut worker = environment.worker();
    let mut controller = expert.worker();
    let mut state = vec![0.0; environment.state_size()];
    let mut memory = vec![0.0; expert.state_size()];
    let mut observation = vec![0.0; environment.observation_size()];
    let mut signals = vec![0.0; environment.signals().len()];
    let mut rewards = vec![0.0; environment.reward_terms().len()];
    let mut output = vec![0.0; JOINTS];
    let mut action = vec![0.0; JOINTS];
    macro_rules! sample {
        () => {
            Sample { observation: &mut observation, signals: &mut signals, rewards: &mut rewards }
        };
    }
    // The hole is in the middle of the initial box and at its corners, which include the nearest
    // and the farthest holes.
    for hole in [HOLE, [0.3, -0.2], [0.3, 0.2], [0.7, -0.2], [0.7, 0.2]] {
        worker.reset(&hole.into(), Seed(0), &mut state, sample!());
        controller.reset(&mut memory, Seed(0));
        assert_eq!(observation[18..25], [0.109, 0.0, 0.786, 0.5, 0.5, 0.5, 0.5].map(|x: f64| x as f32));
        let mut held = true;
        for step in 1..=300 {
            let [x, y, z] = [25, 26, 27].map(|i| f64::from(observation[i]));
            // The site of the hole is at its floor, and the release point is 4 cm above it.
            let near = norm([x, y, z - 0.04]) <= 0.024;
            controller.act(1, &observation, &mut memory, &mut output);
            action.iter_mut().zip(&output).for_each(|(action, output)| *action = f64::from(*output));
            worker.step(&action, &mut state, sample!());
            held &= !near;
            assert_eq!(signals[4], if held { 1.0 } else { 0.0 }, "hole at {hole:?}, step {step}");
        }
        assert!(!held, "hole at {hole:?}");
        // The peg is fully inserted, and the fingers are open.
        assert!((signals[1] - 0.05).abs() < 1e-3 && signals[0] < 0.005, "hole at {hole:?}: {signals:?}");
        assert!(observation[7] > 0.99 && observation[8] > 0.99);
    }
}

#[test]
fn the_block_has_the_position_of_the_scenario_and_does_not_touch_the_base() {
    let mut bench = Bench::new();
    let model = bench.world.model().clone();
    // For the nearest holes the block is 0.15 m from the base's axis.
    for y in [-0.2, 0.0, 0.2] {
        bench.world.place(model.mocap("block").unwrap(), [0.3, y, 0.0], [1.0, 0.0, 0.0, 0.0]);
        bench.world.refresh();
        assert_eq!(bench.world.rows().site_position(model.site("hole").unwrap()), [0.3, y, 0.35]);
        assert!(bench.run(0.2) < 1e-5, "the block has contacts");
    }
}
