//! Tests the physics of balls: they rest, roll, bounce and stay in place as on a test bench.

use std::sync::Arc;

use mishandle_stl::{Clock, Monitor, Trace};
use mishandle_tasks::{JOINT_NAMES, Preset, compose, task};
use mishandle_world::frame::rotate;
use mishandle_world::{Joint, Model, World};

/// The scene of a task with the robot in its initial pose. `extra` is additional MJCF.
struct Bench {
    world: World,
    ball: Joint,
}

impl Bench {
    fn new(task_name: &str, extra: &str) -> Bench {
        let task = task(task_name).unwrap();
        let definition = task.definition();
        let xml = compose(task).unwrap().replacen("</mujoco>", &format!("{extra}</mujoco>"), 1);
        let model = Model::from_xml(&xml).unwrap().with_timestep(1.0 / 60.0 / definition.n_substeps as f64);
        let mut world = model.world();
        for (i, (name, q)) in JOINT_NAMES.iter().zip(definition.start).enumerate() {
            world.qpos_mut()[model.joint(name).unwrap().qpos] = q;
            world.ctrl_mut()[i] = q;
        }
        Bench { world, ball: model.joint("ball").unwrap() }
    }

    fn place(&mut self, position: [f64; 3]) {
        self.world.place_free(self.ball, position, [1.0, 0.0, 0.0, 0.0]);
    }

    fn position(&self) -> [f64; 3] {
        self.world.rows().free_position(self.ball)
    }

    fn velocity(&self) -> [f64; 3] {
        self.world.rows().free_velocity(self.ball)
    }

    fn run(&mut self, seconds: f64) {
        let steps = (seconds / self.world.model().timestep()).round() as usize;
        (0..steps).for_each(|_| self.world.step());
    }
}

#[test]
fn a_ball_at_rest_on_the_table_stays_and_penetrates_it_by_less_than_a_millimeter() {
    let mut bench = Bench::new("ball-pushing", "");
    bench.place([0.5, 0.0, 0.44]);
    bench.run(1.0);
    let settled = bench.position();
    bench.run(10.0);
    let after = bench.position();
    assert!((after[2] - 0.44).abs() < 1e-3, "it rests at {}", after[2]);
    assert!((after[0] - settled[0]).hypot(after[1] - settled[1]) < 1e-3, "{settled:?} {after:?}");
}

#[test]
fn a_ball_dropped_on_the_tray_does_not_bounce() {
    let mut bench = Bench::new("ball-balancing", "");
    bench.place([0.342, 0.0, 1.1]);
    bench.run(0.2);
    let mut highest: f64 = 0.0;
    for _ in 0..120 {
        bench.run(1.0 / 120.0);
        highest = highest.max(bench.position()[2]);
    }
    // The fall height is 0.08 m. A restitution of 0.1 would give a rebound of 0.0008 m.
    assert!(highest < 1.0208, "it rises to {highest}");
}

#[test]
fn a_ball_rolls_down_a_slope_with_five_sevenths_of_the_acceleration() {
    // Gravity tilted by 0.1 rad is equivalent to a slope of that angle.
    let (sin, cos) = 0.1_f64.sin_cos();
    let gravity = format!("<option gravity=\"{} 0 {}\"/>", 9.81 * sin, -9.81 * cos);
    let mut bench = Bench::new("ball-balancing", &gravity);
    bench.place([0.25, 0.0, 1.02]);
    bench.run(0.1);
    let tray = bench.world.model().body("tray").unwrap();
    let start = bench.velocity()[0];
    let seconds = 0.4;
    let parts = 48;
    let mut expected = 0.0;
    for _ in 0..parts {
        bench.run(seconds / f64::from(parts));
        // The weight of tray and ball tilts the tray slightly, which the expected acceleration
        // includes.
        bench.world.refresh();
        let normal = rotate(bench.world.rows().quaternion(tray), [0.0, 0.0, 1.0]);
        expected += 5.0 / 7.0 * 9.81 * (sin * normal[2] + cos * normal[0]) / f64::from(parts);
    }
    let acceleration = (bench.velocity()[0] - start) / seconds;
    assert!((acceleration / expected - 1.0).abs() < 0.02, "{acceleration} m/s² instead of {expected}");
}

#[test]
fn a_ball_bounces_on_the_ground_with_a_restitution_of_0_4() {
    for (name, x, radius) in [("ball-balancing", 1.5, 0.02), ("ball-pushing", -1.0, 0.04)] {
        let restitutions: Vec<f64> = (0..20)
            .map(|i| {
                let mut bench = Bench::new(name, "");
                bench.place([x, 0.8, radius + 0.3 + 0.03 * f64::from(i)]);
                let mut down: f64 = 0.0;
                let mut up: f64 = 0.0;
                while up < 0.05 || bench.velocity()[2] > up - 0.3 {
                    bench.world.step();
                    let v = bench.velocity()[2];
                    down = down.min(v);
                    up = up.max(v);
                }
                -up / down
            })
            .collect();
        // The time of contact within a physics step changes a single restitution by up to a
        // quarter.
        assert!(restitutions.iter().all(|e| (0.28..0.53).contains(e)), "{name}: {restitutions:?}");
        let mean = restitutions.iter().sum::<f64>() / restitutions.len() as f64;
        assert!((mean - 0.4).abs() < 0.04, "{name}: {mean}");
    }
}

#[test]
fn a_rolling_ball_keeps_its_speed_on_the_table_and_stays_in_the_pit() {
    let mut bench = Bench::new("ball-pushing", "");
    bench.place([0.5, 0.0, 0.44]);
    let dof = bench.ball.dof;
    // Rolling without slipping: v = ω r.
    bench.world.qvel_mut()[dof] = 0.4;
    bench.world.qvel_mut()[dof + 4] = 10.0;
    bench.run(0.5);
    assert!((bench.velocity()[0] - 0.4).abs() < 0.01, "{:?}", bench.velocity());
    bench.run(4.5);
    let [x, y, z] = bench.position();
    assert!((0.9..1.15).contains(&x) && y.abs() < 0.15, "it is at {x}, {y}");
    assert!((z - 0.34).abs() < 1e-3, "it rests at {z}, the pit's floor is at 0.3 and its radius 0.04");
}

/// Returns the robustness of the strict formula of ball pushing for a ball that stays at
/// `position`.
fn strict_at([x, y, z]: [f64; 3]) -> f64 {
    let definition = task("ball-pushing").unwrap().definition();
    let strict = definition.formulas(Preset::Paper).specification().unwrap().strict.unwrap();
    let names: Arc<[String]> = ["ball_hole_horizontal_distance", "ball_height"].map(str::to_owned).into();
    let mut trace = Trace::new(Arc::clone(&names));
    (0..=300).for_each(|_| trace.push(&[(x - 1.025).hypot(y), z]));
    Monitor::new(&strict, &names, Clock::steps(1.0 / 60.0)).unwrap().robustness(&trace).unwrap()
}

#[test]
fn a_ball_at_rest_in_a_corner_of_the_pit_satisfies_the_strict_formula() {
    for (towards_x, towards_y) in [(1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)] {
        // Gravity tilted by 0.5 rad holds the ball in the corner, deeper in the soft walls than its
        // weight alone would.
        let (sin, cos) = 0.5_f64.sin_cos();
        let gx = 9.81 * sin * towards_x;
        let gy = 9.81 * sin * towards_y;
        let gz = -9.81 * cos;
        let mut bench = Bench::new("ball-pushing", &format!("<option gravity=\"{gx} {gy} {gz}\"/>"));
        bench.place([1.025, 0.0, 0.34]);
        bench.run(2.0);
        let [x, y, z] = bench.position();
        // Half the pit (0.125 m, 0.15 m) minus the ball's radius of 0.04 m.
        let corner = [1.025 + 0.085 * towards_x, 0.11 * towards_y];
        assert!((x - corner[0]).hypot(y - corner[1]) < 1e-3, "it rests at {x}, {y}");
        assert!(strict_at([x, y, z]) > 0.005, "{}", strict_at([x, y, z]));
    }
}

#[test]
fn a_ball_outside_the_pit_violates_the_strict_formula() {
    // On the pit's edge, at rest on the table, and beside the table where its center is 4 cm below
    // the top.
    for position in
        [[1.15, 0.15, 0.44], [0.9, 0.0, 0.44], [0.5, 0.0, 0.44], [1.34, 0.0, 0.36], [1.34, 0.0, 0.04]]
    {
        assert!(strict_at(position) < -0.05, "{position:?}: {}", strict_at(position));
    }
}

#[test]
fn positions_match_the_original_benchmark() {
    let bench = Bench::new("ball-pushing", "");
    let hole = bench.world.model().site("hole").unwrap();
    let mut world = bench.world;
    world.refresh();
    assert_eq!(world.rows().site_position(hole), [1.025, 0.0, 0.295]);

    let mut bench = Bench::new("ball-balancing", "");
    bench.world.refresh();
    let tray = bench.world.model().body("tray").unwrap();
    let p = bench.world.rows().position(tray);
    let q = bench.world.rows().quaternion(tray);
    for (found, expected) in p.iter().chain(&q).zip([0.342, 0.0, 0.89, 1.0, 0.0, 0.0, 0.0]) {
        assert!((found.abs() - expected).abs() < 1e-9, "{p:?} {q:?}");
    }
}
