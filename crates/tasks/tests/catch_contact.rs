//! Tests the physics of ball catching: the box catches balls, no ball tunnels through it, and the
//! ball moves as on a test bench.

use std::sync::Arc;

use mishandle_rollout::{Environment, Noise, Request, Rollout, Seed, System};
use mishandle_stl::Formula;
use mishandle_tasks::{
    JOINT_NAMES, JOINTS, Panda, Preset, Reward, TaskEnvironment, VELOCITY_LIMIT, compose, task,
};
use mishandle_world::frame::{add, cross, dot, norm, sub};
use mishandle_world::{Joint, Model, Site, World};

/// The box's cavity: half its width and its depth, m.
const HALF_WIDTH: f64 = 0.035;
const DEPTH: f64 = 0.1;

/// Middle planes of walls and floor, m. A ball whose center passes one of them is on the other
/// side.
const WALL_MIDDLE: f64 = 0.0375;
const FLOOR_MIDDLE: f64 = -0.01;

/// Height of the floor above the tool point, m.
const FLOOR: f64 = 0.005;

const RADIUS: f64 = 0.01;
const MASS: f64 = 0.001;
const GRAVITY: f64 = 9.81;

/// The scene with the robot in its initial pose. The servos hold it or drive it at full speed.
struct Bench {
    world: World,
    panda: Panda,
    ball: Joint,
    tool: Site,
    targets: [f64; JOINTS],
}

impl Bench {
    fn new(extra: &str) -> Bench {
        let task = task("ball-catching").unwrap();
        let definition = task.definition();
        let xml = compose(task).unwrap().replacen("</mujoco>", &format!("{extra}</mujoco>"), 1);
        let model = Model::from_xml(&xml).unwrap().with_timestep(1.0 / 60.0 / definition.n_substeps as f64);
        let mut bench = Bench {
            world: model.world(),
            panda: Panda::new(&model).unwrap(),
            ball: model.joint("ball").unwrap(),
            tool: model.site("tool").unwrap(),
            targets: definition.start,
        };
        bench.reset();
        bench
    }

    fn reset(&mut self) {
        let start = task("ball-catching").unwrap().definition().start;
        self.world.reset();
        self.panda.place(&start, &mut self.world);
        self.targets = start;
        self.world.refresh();
    }

    /// Moves the arm at its velocity limits in the directions `signs`.
    fn move_at_full_speed(&mut self, signs: [f64; 7]) {
        for (i, sign) in signs.iter().enumerate() {
            let dof = self.world.model().joint(JOINT_NAMES[i]).unwrap().dof;
            self.world.qvel_mut()[dof] = sign * VELOCITY_LIMIT[i];
            self.targets[i] += 3.0 * sign;
        }
        self.world.refresh();
    }

    /// Places the ball at a position (m) and with a velocity (m/s) in the box's frame, whose origin
    /// is the middle of its floor.
    fn throw(&mut self, position: [f64; 3], velocity: [f64; 3]) {
        let at = add(self.tool_position(), self.turned([position[0], position[1], position[2] + FLOOR]));
        let v = add(self.turned(velocity), self.box_velocity(at));
        self.world.place_free(self.ball, at, [1.0, 0.0, 0.0, 0.0]);
        self.world.qvel_mut()[self.ball.dof..][..3].copy_from_slice(&v);
    }

    /// Returns a vector of the box's frame in the world frame.
    fn turned(&self, v: [f64; 3]) -> [f64; 3] {
        let r = self.world.rows().site_rotation(self.tool);
        std::array::from_fn(|i| dot([r[3 * i], r[3 * i + 1], r[3 * i + 2]], v))
    }

    fn tool_position(&self) -> [f64; 3] {
        self.world.rows().site_position(self.tool)
    }

    /// Returns the velocity of the box at a point of the world frame.
    fn box_velocity(&self, at: [f64; 3]) -> [f64; 3] {
        let body = self.world.model().body("box").unwrap();
        let (linear, angular) = self.world.rows().twist(body);
        add(linear, cross(angular, sub(at, self.world.rows().position(body))))
    }

    /// Returns the position of the ball in the box's frame, whose origin is the middle of its
    /// floor, m.
    fn ball_in_box(&mut self) -> [f64; 3] {
        self.world.refresh();
        let from_tool = sub(self.position(), self.tool_position());
        let r = self.world.rows().site_rotation(self.tool);
        let p: [f64; 3] = std::array::from_fn(|i| dot([r[i], r[3 + i], r[6 + i]], from_tool));
        [p[0], p[1], p[2] - FLOOR]
    }

    fn position(&self) -> [f64; 3] {
        self.world.rows().free_position(self.ball)
    }

    fn velocity(&self) -> [f64; 3] {
        self.world.rows().free_velocity(self.ball)
    }

    fn step(&mut self) {
        self.panda.step(&self.targets, &mut self.world);
    }

    fn steps(&self, seconds: f64) -> usize {
        (seconds / self.world.model().timestep()).round() as usize
    }

    fn run(&mut self, seconds: f64) {
        (0..self.steps(seconds)).for_each(|_| self.step());
    }

    /// Returns the kinetic energy (including the rotation) plus the potential energy of the ball,
    /// J.
    fn energy(&self) -> f64 {
        let v = self.velocity();
        let spin = self.world.rows().free_angular_velocity(self.ball);
        let inertia = 0.4 * MASS * RADIUS * RADIUS;
        0.5 * (MASS * dot(v, v) + inertia * dot(spin, spin)) + MASS * GRAVITY * self.position()[2]
    }
}

/// Region of the ball relative to the box.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Place {
    Inside,
    Outside,
    Above,
}

fn place([x, y, height]: [f64; 3]) -> Place {
    let within = x.abs().max(y.abs()) < WALL_MIDDLE;
    match () {
        () if height > DEPTH => Place::Above,
        () if within && height > FLOOR_MIDDLE => Place::Inside,
        () => Place::Outside,
    }
}

/// Returns element `k` of a low-discrepancy sequence in [-1, 1]. Each `stream` is another sequence.
fn low_discrepancy(k: usize, stream: i32) -> f64 {
    // This is an additive recurrence with powers of the inverse of the root of x^7 = x + 1.
    let step = 1.112_775_684_278_706_f64.powi(-stream);
    2.0 * (0.5 + step * k as f64).fract() - 1.0
}

/// Simulates a throw. Returns the transition through a floor or a wall, if there was one, and the
/// final region.
fn fly(bench: &mut Bench, seconds: f64) -> (Option<(Place, Place)>, Place) {
    let mut before = place(bench.ball_in_box());
    for _ in 0..bench.steps(seconds) {
        bench.step();
        let now = place(bench.ball_in_box());
        match (before, now) {
            (Place::Inside, Place::Outside) | (Place::Outside, Place::Inside) => {
                return (Some((before, now)), now);
            }
            _ => before = now,
        }
    }
    (None, before)
}

/// Directions of the joints towards a ball from the front and from above, and to both sides.
const DIRECTIONS: [[f64; 7]; 4] = [
    [0.0, 1.0, 0.0, 1.0, 0.0, 1.0, 0.0],
    [0.0, -1.0, 0.0, 1.0, 0.0, 1.0, 0.0],
    [1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0],
    [-1.0, 1.0, 0.0, -1.0, 0.0, -1.0, 0.0],
];

#[test]
fn every_ball_that_enters_the_mouth_stays_in_the_box() {
    let mut bench = Bench::new("");
    for k in 0..1000 {
        bench.reset();
        // The ball starts inside the mouth with 1 to 6.5 m/s downwards and up to 2 m/s sideways.
        // The ball of the task has at most 5.4 m/s, at the ground, and meets the expert's box with
        // 5 m/s.
        let [x, y] = [1, 2].map(|i| 0.024 * low_discrepancy(k, i));
        let down = -3.75 + 2.75 * low_discrepancy(k, 3);
        bench.throw([x, y, DEPTH], [2.0 * low_discrepancy(k, 4), 2.0 * low_discrepancy(k, 5), down]);
        let (tunnel, end) = fly(&mut bench, 0.2);
        assert_eq!((tunnel, end), (None, Place::Inside), "throw {k}");
    }
}

#[test]
fn no_ball_tunnels_through_the_box_at_full_speed_of_the_arm() {
    let mut bench = Bench::new("");
    for k in 0..1000 {
        bench.reset();
        bench.move_at_full_speed(DIRECTIONS[k % DIRECTIONS.len()]);
        let [x, y] = [1, 2].map(|i| 0.024 * low_discrepancy(k, i));
        bench.throw(
            [x, y, DEPTH],
            [2.0 * low_discrepancy(k, 3), 2.0 * low_discrepancy(k, 4), -5.0 + 3.0 * low_discrepancy(k, 5)],
        );
        let (tunnel, _) = fly(&mut bench, 0.06);
        assert_eq!(tunnel, None, "throw {k}");
    }
}

#[test]
fn no_ball_at_the_rim_or_an_outer_wall_tunnels_through_the_box() {
    let mut bench = Bench::new("");
    for k in 0..1000 {
        bench.reset();
        if k % 2 == 0 {
            bench.move_at_full_speed(DIRECTIONS[k / 2 % DIRECTIONS.len()]);
        }
        let along = 0.05 * low_discrepancy(k, 1);
        let (position, velocity) = match k % 4 {
            // A ball falls onto the rim.
            0 | 1 => {
                let x = WALL_MIDDLE + 0.01 * low_discrepancy(k, 2);
                (
                    [x, along, DEPTH + 0.02],
                    [low_discrepancy(k, 3), low_discrepancy(k, 4), -4.0 + 3.0 * low_discrepancy(k, 5)],
                )
            }
            // A ball hits the front wall from outside.
            _ => (
                [0.06, along, 0.05 + 0.04 * low_discrepancy(k, 2)],
                [-3.0 + 2.0 * low_discrepancy(k, 3), low_discrepancy(k, 4), 0.0],
            ),
        };
        bench.throw(position, velocity);
        let (tunnel, _) = fly(&mut bench, 0.06);
        assert_eq!(tunnel, None, "throw {k}");
    }
}

#[test]
fn free_flight_is_a_parabola() {
    let task = task("ball-catching").unwrap();
    let environment = TaskEnvironment::new(task, Preset::Paper, Reward::Shaped).unwrap();
    let dt = environment.model().timestep();
    let mut bench = Bench::new("");
    bench.world.place_free(bench.ball, [1.1, 0.03, 1.5], [1.0, 0.0, 0.0, 0.0]);
    bench.world.qvel_mut()[bench.ball.dof] = -1.0;
    for step in 1..=bench.steps(0.3) {
        bench.step();
        let t = step as f64 * dt;
        let [x, y, z] = bench.position();
        assert!((x - (1.1 - t)).abs() < 1e-9 && (y - 0.03).abs() < 1e-12, "{x} {y} at {t} s");
        // The semi-implicit integrator uses the velocity at the end of a step. Its error is g t dt
        // / 2: 3 mm after 0.3 s.
        let parabola = 1.5 - 0.5 * GRAVITY * t * t;
        assert!((z - (parabola - 0.5 * GRAVITY * t * dt)).abs() < 1e-9, "{z} at {t} s");
    }
}

#[test]
fn a_ball_dropped_in_the_box_does_not_bounce_and_stays_for_ten_seconds() {
    let mut bench = Bench::new("");
    bench.throw([0.0, 0.0, DEPTH], [0.0, 0.0, -4.5]);
    // The ball reaches the floor after 20 ms.
    bench.run(0.03);
    let highest = (0..bench.steps(0.5)).fold(0.0_f64, |highest, _| {
        bench.step();
        highest.max(bench.ball_in_box()[2])
    });
    // A restitution of 0.05 would give a rebound of (0.05 * 4.6 m/s)² / 2 g = 2.7 mm.
    assert!(highest < RADIUS + 0.0027, "it rises to {highest}");
    let mut deepest: f64 = 0.0;
    for _ in 0..bench.steps(10.0) {
        bench.step();
        deepest = deepest.max(bench.world.penetration());
        assert_eq!(place(bench.ball_in_box()), Place::Inside);
    }
    assert!(deepest < 2e-4, "it sinks in by {deepest} m");
    assert!((bench.ball_in_box()[2] - RADIUS).abs() < 2e-4, "{:?}", bench.ball_in_box());
    // The weight of the box tilts it by 8e-5 rad. Without rolling resistance the ball gains at most
    // 5/7 g 8e-5 10 s = 6 mm/s in 10 s and comes to rest at the wall.
    assert!(norm(bench.velocity()) < 0.006, "{:?}", bench.velocity());
}

/// Returns the final position of the ball in the box under gravity tilted by 0.5 rad in the
/// direction (x, y).
fn rolled(x: f64, y: f64) -> [f64; 3] {
    let (sin, cos) = 0.5_f64.sin_cos();
    let gx = GRAVITY * sin * x;
    let gy = GRAVITY * sin * y;
    let gz = -GRAVITY * cos;
    let mut bench = Bench::new(&format!("<option gravity=\"{gx} {gy} {gz}\"/>"));
    bench.throw([0.0, 0.0, RADIUS], [0.0; 3]);
    bench.run(2.0);
    bench.ball_in_box()
}

#[test]
fn the_cavity_has_its_nominal_width_and_a_ball_in_its_corner_is_caught() {
    let reach = HALF_WIDTH - RADIUS;
    for (x, y) in [(1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0)] {
        let p = rolled(x, y);
        assert!((p[0] * x + p[1] * y - reach).abs() < 3e-4, "{x} {y}: {p:?}");
        assert!((p[2] - RADIUS).abs() < 3e-4, "{p:?}");
    }
    let aside = rolled(1.0, 1.0)[0].hypot(rolled(1.0, 1.0)[1]);
    assert!((aside - reach * 2.0_f64.sqrt()).abs() < 3e-4, "{aside}");
    // The bound of the strict formula is farther than a corner and nearer than a ball that touches
    // the box from outside.
    let strict = task("ball-catching").unwrap().definition().paper.strict;
    assert!(strict.contains("ball_box_horizontal_distance <= 0.04 ") && aside < 0.04, "{strict}");
}

#[test]
fn a_throw_gains_no_energy_in_the_box() {
    let mut bench = Bench::new("");
    for k in 0..200 {
        bench.reset();
        let [x, y] = [1, 2].map(|i| 0.024 * low_discrepancy(k, i));
        bench.throw(
            [x, y, DEPTH],
            [low_discrepancy(k, 3), low_discrepancy(k, 4), -4.0 + 2.0 * low_discrepancy(k, 5)],
        );
        let thrown = 0.5 * MASS * dot(bench.velocity(), bench.velocity());
        let mut least = bench.energy();
        for _ in 0..bench.steps(0.5) {
            bench.step();
            let energy = bench.energy();
            // A hard landing presses the ball into the floor, which returns a small amount of
            // energy.
            assert!(
                energy < least + 0.05 * thrown,
                "throw {k}: {energy} J after {least} J, thrown with {thrown} J"
            );
            least = least.min(energy);
        }
    }
}

#[test]
fn a_ball_bounces_on_the_ground_with_a_restitution_of_0_37() {
    let mut bench = Bench::new("");
    let restitutions: Vec<f64> = (0..40)
        .map(|i| {
            bench.reset();
            let height = RADIUS + 0.3 + 0.03 * f64::from(i);
            bench.world.place_free(bench.ball, [-1.0, 0.8, height], [1.0, 0.0, 0.0, 0.0]);
            let mut down: f64 = 0.0;
            let mut up: f64 = 0.0;
            while up < 0.05 || bench.velocity()[2] > up - 0.3 {
                bench.step();
                let v = bench.velocity()[2];
                down = down.min(v);
                up = up.max(v);
            }
            -up / down
        })
        .collect();
    // The time of contact within a physics step changes a single restitution by up to a twelfth.
    assert!(restitutions.iter().all(|e| (0.34..0.4).contains(e)), "{restitutions:?}");
    let mean = restitutions.iter().sum::<f64>() / restitutions.len() as f64;
    assert!((mean - 0.37).abs() < 0.01, "{mean}");
}

#[test]
fn positions_match_the_original_benchmark() {
    let bench = Bench::new("");
    let found = bench.tool_position();
    assert!(norm(sub(found, [0.35, 0.0, 0.885])) < 1e-9, "{found:?}");
    assert!(bench.turned([0.0, 0.0, 1.0])[2] > 1.0 - 1e-9, "the box is level");
}

#[test]
fn the_expert_catches_carefully_from_the_whole_initial_box() {
    // The test shows that the whole initial box is reachable: the expert moves within the limits of
    // Franka's data sheet, and meets far balls after their first bounce.
    let task = task("ball-catching").unwrap();
    let environment = TaskEnvironment::new(task, Preset::Paper, Reward::Shaped).unwrap();
    let formulas = &task.definition().paper;
    let mut specification = formulas.specification().unwrap();
    specification.careful = Some(Formula::parse(&formulas.careful().unwrap()).unwrap());
    let at = |u: &[f64]| environment.space().at(u);
    let requests: Vec<Request> = (0..63)
        .map(|i| Request::new(at(&[0.05 * f64::from(i % 21), 0.5 * f64::from(i / 21)]), Seed(1)))
        .collect();
    let expert = task.expert().unwrap();
    let environment = environment.with_manner().with_further_parts(expert.further_parts()).unwrap();
    let mut rollout = Rollout::new(Arc::new(environment), expert, specification, Noise::default()).unwrap();
    for episode in rollout.rollout(&requests).unwrap() {
        let start = &episode.request.scenario;
        let verdict = &episode.verdict;
        assert!(verdict.strict > Some(0.0) && verdict.is_careful_success(), "{verdict:?} from {start:?}");
    }
}
