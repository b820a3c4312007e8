//! Tests the physics of cubes: they are held, fall, rest, slide and topple as on a test bench.

use mishandle_tasks::{JOINTS, Panda, compose, task};
use mishandle_world::frame::{norm, sub};
use mishandle_world::{Joint, Model, World};

const G: f64 = 9.81;

/// The scene with the robot in its initial pose. `extra` is additional MJCF.
struct Bench {
    world: World,
    panda: Panda,
    targets: [f64; JOINTS],
    cube: Joint,
    target: Joint,
}

impl Bench {
    fn new(extra: &str) -> Bench {
        let task = task("cube-stacking").unwrap();
        let definition = task.definition();
        let xml = compose(task).unwrap().replacen("</mujoco>", &format!("{extra}</mujoco>"), 1);
        let model = Model::from_xml(&xml).unwrap().with_timestep(1.0 / 60.0 / definition.n_substeps as f64);
        let panda = Panda::new(&model).unwrap();
        let mut world = model.world();
        panda.place(&definition.start, &mut world);
        let mut targets = definition.start;
        targets[7..].fill(0.005);
        Bench {
            world,
            panda,
            targets,
            cube: model.joint("cube").unwrap(),
            target: model.joint("target").unwrap(),
        }
    }

    /// Releases the cube and places it at `from_target` relative to the target cube, rotated by
    /// `lean` about y.
    fn with_cube_at(extra: &str, from_target: [f64; 3], lean: f64) -> Bench {
        let mut bench = Bench::new(extra);
        bench.release();
        let [x, y, z] = from_target;
        let (sin, cos) = (0.5 * lean).sin_cos();
        bench.world.place_free(bench.target, [0.6, 0.1, 0.025], [1.0, 0.0, 0.0, 0.0]);
        bench.world.place_free(bench.cube, [0.6 + x, 0.1 + y, 0.025 + z], [cos, 0.0, sin, 0.0]);
        bench
    }

    fn release(&mut self) {
        let weld = self.world.model().equality("cube").unwrap();
        self.world.switch(weld, false);
        self.targets[7..].fill(0.04);
    }

    fn step(&mut self) {
        self.panda.step(&self.targets, &mut self.world);
    }

    fn run(&mut self, seconds: f64) {
        let steps = (seconds / self.world.model().timestep()).round() as usize;
        (0..steps).for_each(|_| self.step());
    }

    fn position(&self, joint: Joint) -> [f64; 3] {
        self.world.rows().free_position(joint)
    }

    fn cube_from_target(&self) -> [f64; 3] {
        sub(self.position(self.cube), self.position(self.target))
    }

    fn velocity(&self, joint: Joint) -> [f64; 3] {
        self.world.rows().free_velocity(joint)
    }

    fn speed(&self, joint: Joint) -> f64 {
        norm(self.velocity(joint))
    }

    /// Returns the distance between the cube's center and the midpoint of the fingertips.
    fn slip(&mut self) -> f64 {
        self.world.refresh();
        let rows = self.world.rows();
        norm(sub(rows.site_position(self.panda.grasp), rows.free_position(self.cube)))
    }
}

/// Returns MJCF with gravity tilted towards `heading`, which is equivalent to a slope of this
/// gradient.
fn slope(gradient: f64, heading: f64) -> String {
    let (sin, cos) = gradient.atan().sin_cos();
    let x = G * sin * heading.cos();
    let y = G * sin * heading.sin();
    format!("<option gravity=\"{x} {y} {}\"/>", -G * cos)
}

#[test]
fn stacked_cubes_stay_in_place_and_penetrate_by_less_than_half_a_millimeter() {
    let mut bench = Bench::with_cube_at("", [0.01, 0.005, 0.05], 0.0);
    bench.run(1.0);
    let settled = [bench.position(bench.cube), bench.position(bench.target)];
    bench.run(10.0);
    let after = [bench.position(bench.cube), bench.position(bench.target)];
    for (before, now) in settled.iter().zip(after) {
        assert!(norm(sub(now, *before)) < 1e-5, "{before:?} {now:?}");
    }
    let into_ground = 0.025 - after[1][2];
    let into_target = 0.05 - bench.cube_from_target()[2];
    assert!((0.0..5e-4).contains(&into_ground), "the target cube sinks {into_ground} m into the ground");
    assert!((0.0..1e-4).contains(&into_target), "the cube sinks {into_target} m into the target cube");
}

#[test]
fn a_cube_dropped_by_3_cm_comes_to_rest_on_top() {
    for (offset, lean, rest) in [(0.0, 0.0, 0.3), (0.015, 0.0, 0.3), (0.0, 0.1, 0.6), (-0.008, -0.3, 0.6)] {
        let mut bench = Bench::with_cube_at("", [offset, 0.0, 0.08], lean);
        let mut seconds = 0.0;
        let mut moved = 0.0;
        while seconds < 2.0 {
            bench.step();
            seconds += bench.world.model().timestep();
            if bench.speed(bench.cube).max(bench.speed(bench.target)) > 0.02 {
                moved = seconds;
            }
        }
        let [x, y, z] = bench.cube_from_target();
        assert!(moved < rest, "from {offset} m at {lean} rad it rests after {moved} s");
        assert!((z - 0.05).abs() < 2e-4 && x.hypot(y) < 0.02, "from {offset} m at {lean} rad: {x} {y} {z}");
    }
}

#[test]
fn a_cube_starts_to_slide_on_the_ground_at_a_slope_of_0_75_in_any_direction() {
    for heading in [0.0, 0.4, std::f64::consts::FRAC_PI_4] {
        let speed_after_a_second = |gradient: f64| {
            let mut bench = Bench::with_cube_at(&slope(gradient, heading), [0.5, 0.0, 0.0], 0.0);
            bench.run(1.0);
            bench.speed(bench.target)
        };
        // The speed of a sliding cube after 1 s is g (sin - 0.75 cos) times 1 s, which is 0.38 m/s
        // at 0.8.
        let below = speed_after_a_second(0.7);
        let above = speed_after_a_second(0.8);
        assert!(below < 2e-3, "towards {heading} it creeps at {below} m/s");
        assert!(above > 0.2, "towards {heading} it slides at {above} m/s only");
    }
}

#[test]
fn a_sliding_cube_stops_after_the_distance_of_coulomb_friction() {
    let distances: Vec<f64> = (0..16)
        .map(|i| {
            let (sin, cos) = (0.4 * f64::from(i)).sin_cos();
            let mut bench = Bench::with_cube_at("", [0.5, 0.0, 0.0], 0.0);
            bench.run(0.5);
            let before = bench.position(bench.target);
            let dof = bench.target.dof;
            bench.world.qvel_mut()[dof] = cos;
            bench.world.qvel_mut()[dof + 1] = sin;
            bench.run(1.0);
            assert!(bench.speed(bench.target) < 1e-3, "it does not stop");
            norm(sub(bench.position(bench.target), before))
        })
        .collect();
    let mean = distances.iter().sum::<f64>() / 16.0;
    let expected = 1.0 / (2.0 * 0.75 * G);
    // The cube almost topples and rattles while it slides, so single distances differ.
    assert!((mean / expected - 1.0).abs() < 0.1, "{mean} m instead of {expected}: {distances:?}");
}

#[test]
fn a_cube_stays_on_a_fixed_one_up_to_a_slope_of_1() {
    let moves = |gradient: f64| {
        let fixed = "<equality><weld name=\"fixed\" body1=\"target\"/></equality>";
        let mut bench =
            Bench::with_cube_at(&format!("{}{fixed}", slope(gradient, 0.0)), [0.0, 0.0, 0.05], 0.0);
        bench.run(1.0);
        norm(sub(bench.cube_from_target(), [0.0, 0.0, 0.05]))
    };
    assert!(moves(0.9) < 2e-3, "it moves by {}", moves(0.9));
    assert!(moves(1.1) > 0.05, "it moves by {}", moves(1.1));
}

#[test]
fn a_stack_topples_where_the_slope_exceeds_width_over_height() {
    // The stack is 0.05 m wide and 0.1 m high, so the critical slope is 0.5. The compliance of the
    // ground and the sudden start of the slope reduce it by a tenth.
    let lowest = |gradient: f64| {
        let mut bench = Bench::with_cube_at(&slope(gradient, 0.0), [0.0, 0.0, 0.05], 0.0);
        bench.run(1.5);
        bench.cube_from_target()[2]
    };
    assert!(lowest(0.44) > 0.049, "it falls at 0.44");
    assert!(lowest(0.52) < 0.03, "it stands at 0.52");
}

#[test]
fn a_cube_bounces_on_the_ground_with_a_restitution_of_0_4() {
    let restitutions: Vec<f64> = (0..20)
        .map(|i| {
            let mut bench = Bench::with_cube_at("", [-1.2, 0.5, 0.3 + 0.03 * f64::from(i)], 0.0);
            let mut down: f64 = 0.0;
            let mut up: f64 = 0.0;
            while up < 0.05 || bench.velocity(bench.cube)[2] > up - 0.3 {
                bench.step();
                let v = bench.velocity(bench.cube)[2];
                down = down.min(v);
                up = up.max(v);
            }
            -up / down
        })
        .collect();
    // The time of contact within a physics step changes a single restitution.
    assert!(restitutions.iter().all(|e| (0.28..0.53).contains(e)), "{restitutions:?}");
    let mean = restitutions.iter().sum::<f64>() / restitutions.len() as f64;
    assert!((mean - 0.4).abs() < 0.03, "{mean}");
}

#[test]
fn a_cube_does_not_bounce_on_the_other() {
    let mut bench = Bench::with_cube_at("", [0.0, 0.0, 0.15], 0.0);
    bench.run(0.25);
    let mut highest: f64 = 0.0;
    for _ in 0..120 {
        bench.step();
        highest = highest.max(bench.cube_from_target()[2]);
    }
    // The fall height is 0.1 m. A restitution of 0.1 would give a rebound of 0.001 m.
    assert!(highest < 0.051, "it rises to {highest}");
}

#[test]
fn the_fingers_hold_the_cube_still_and_penetrate_it_by_less_than_a_millimeter() {
    let mut bench = Bench::new("");
    bench.run(0.5);
    let before = bench.position(bench.cube);
    let mut fastest: f64 = 0.0;
    for _ in 0..240 {
        bench.step();
        fastest = fastest.max(bench.speed(bench.cube));
    }
    assert!(bench.world.penetration() < 8e-4, "{}", bench.world.penetration());
    assert!(fastest < 1e-3, "it shakes at {fastest} m/s");
    assert!(norm(sub(bench.position(bench.cube), before)) < 1e-4, "it creeps");
}

#[test]
fn the_held_cube_slips_by_less_than_two_millimeters_at_the_velocity_limits_of_the_arm() {
    let mut bench = Bench::new("");
    bench.run(0.2);
    let start = bench.slip();
    let mut largest: f64 = 0.0;
    for swing in 0..6 {
        let side = if swing % 2 == 0 { 1.0 } else { -1.0 };
        bench.targets[0] = 1.5 * side;
        bench.targets[1] = -0.872 + 0.5 * side;
        bench.targets[3] = -2.0 - 0.6 * side;
        bench.targets[6] = 0.785 + 1.5 * side;
        for _ in 0..240 {
            bench.step();
            largest = largest.max((bench.slip() - start).abs());
        }
    }
    assert!(largest < 2e-3, "it slips by {largest} m");
}

#[test]
fn a_released_cube_falls_freely_from_between_the_fingers() {
    let mut bench = Bench::new("");
    bench.run(0.3);
    bench.release();
    // A finger opens at up to 0.2 m/s and loses contact with the cube's face within 0.02 s.
    bench.run(0.05);
    let before = bench.velocity(bench.cube);
    bench.run(0.1);
    let after = bench.velocity(bench.cube);
    assert!((before[2] - after[2] - 0.1 * G).abs() < 0.01 * G * 0.1, "{before:?} {after:?}");
    assert!(after[0].hypot(after[1]) < 0.01, "it is pushed aside: {after:?}");
    assert!(before[2] < -0.3 * G * 0.05, "it sticks: {before:?}");
}
