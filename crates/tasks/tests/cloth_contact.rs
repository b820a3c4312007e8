//! Tests the physics of the cloth: it hangs, falls, drapes, slides and rests as on a test bench.

use std::sync::Arc;

use mishandle_rollout::{ControllerWorker, Environment, EnvironmentWorker, Sample, Seed};
use mishandle_stl::{Clock, Monitor, Trace};
use mishandle_tasks::{JOINT_NAMES, Preset, Reward, TaskEnvironment, compose, task};
use mishandle_world::frame::{add, cross, norm, norm_xy, scale, sub};
use mishandle_world::{Flex, Model, World};

const GRIDS: [(&str, usize); 2] = [("cloth-placing", 11), ("cloth-placing-7x7", 7)];

/// Gravity, m/s².
const G: f64 = 9.81;

/// Side of the cloth and collision radius of a vertex, m.
const SIDE: f64 = 0.3;
const RADIUS: f64 = 0.005;

/// The scene with the robot in its initial pose and the table far away. `extra` is additional MJCF.
struct Bench {
    world: World,
    cloth: Flex,
    side: usize,
}

impl Bench {
    fn new(name: &str, side: usize, extra: &str) -> Bench {
        let task = task(name).unwrap();
        let definition = task.definition();
        let xml = compose(task).unwrap().replacen("</mujoco>", &format!("{extra}</mujoco>"), 1);
        let model = Model::from_xml(&xml).unwrap().with_timestep(1.0 / 60.0 / definition.n_substeps as f64);
        let mut world = model.world();
        for (i, (name, q)) in JOINT_NAMES.iter().zip(definition.start).enumerate() {
            world.qpos_mut()[model.joint(name).unwrap().qpos] = q;
            world.ctrl_mut()[i] = q;
        }
        let mut bench = Bench { cloth: model.flex("cloth").unwrap(), world, side };
        bench.place_table([1.5, 1.0]);
        bench.world.refresh();
        bench
    }

    fn place_table(&mut self, [x, y]: [f64; 2]) {
        let table = self.world.model().mocap("table").unwrap();
        self.world.place(table, [x, y, 0.0], [1.0, 0.0, 0.0, 0.0]);
    }

    /// Releases the cloth and places it at rest in a horizontal plane with its center at `center`.
    fn lay_out(&mut self, center: [f64; 3]) {
        self.world.switch_all(false);
        let start = self.vertices();
        let first = self.world.qpos().len() - 3 * start.len();
        for (k, from) in start.iter().enumerate() {
            let along = |index: usize| SIDE * (index as f64 / (self.side - 1) as f64 - 0.5);
            let to = add(center, [along(k % self.side), along(k / self.side), 0.0]);
            self.world.qpos_mut()[first + 3 * k..][..3].copy_from_slice(&sub(to, *from));
        }
        self.world.refresh();
    }

    fn vertices(&self) -> Vec<[f64; 3]> {
        self.world.rows().vertices(self.cloth).to_vec()
    }

    fn velocities(&self) -> Vec<[f64; 3]> {
        self.world.rows().vertex_velocities(self.cloth).to_vec()
    }

    fn velocities_mut(&mut self) -> &mut [f64] {
        let first = self.world.qvel().len() - 3 * self.side * self.side;
        &mut self.world.qvel_mut()[first..]
    }

    fn run(&mut self, seconds: f64) {
        let steps = (seconds / self.world.model().timestep()).round() as usize;
        (0..steps).for_each(|_| self.world.step());
        self.world.refresh();
    }

    /// Returns the kinetic plus potential energy of the cloth per mass, J/kg.
    fn energy(&self) -> f64 {
        let each = self
            .vertices()
            .iter()
            .zip(self.velocities())
            .map(|(p, v)| 0.5 * norm(v).powi(2) + G * p[2])
            .sum::<f64>();
        each / self.cloth.vertices as f64
    }

    fn rms_speed(&self) -> f64 {
        let squares = self.velocities().iter().map(|v| norm(*v).powi(2)).sum::<f64>();
        (squares / self.cloth.vertices as f64).sqrt()
    }
}

fn mean(points: &[[f64; 3]]) -> [f64; 3] {
    scale(points.iter().fold([0.0; 3], |sum, p| add(sum, *p)), 1.0 / points.len() as f64)
}

/// Returns the maximum strain of an edge along a row or a column.
fn stretch(vertices: &[[f64; 3]], side: usize) -> f64 {
    let spacing = SIDE / (side - 1) as f64;
    let edge = |a: usize, b: usize| norm(sub(vertices[a], vertices[b])) / spacing - 1.0;
    let along_rows = (0..side * side).filter(|k| k % side + 1 < side).map(|k| edge(k, k + 1));
    let along_columns = (0..side * (side - 1)).map(|k| edge(k, k + side));
    along_rows.chain(along_columns).fold(f64::MIN, f64::max)
}

#[test]
fn initial_position_and_mass_match_the_original_benchmark() {
    for (name, side) in GRIDS {
        let bench = Bench::new(name, side, "");
        let vertices = bench.vertices();
        assert_eq!(vertices.len(), side * side);
        for (k, vertex) in vertices.iter().enumerate() {
            let along = |index: usize| SIDE * (index as f64 / (side - 1) as f64 - 0.5);
            let flat = [0.5 + along(k % side), 0.0, 0.65 + along(k / side)];
            // The amplitude of the waves is 0.2 mm.
            assert!(norm(sub(*vertex, flat)) < 2.1e-4, "{name}: vertex {k} at {vertex:?}");
        }
        let xml = compose(task(name).unwrap()).unwrap();
        let masses = xml.split("<body name=\"cloth_").skip(1).map(|body| {
            let value = body.split("mass=\"").nth(1).unwrap().split('"').next().unwrap();
            value.parse::<f64>().unwrap()
        });
        assert!((masses.sum::<f64>() - 0.605).abs() < 1e-12, "{name}");
    }
}

#[test]
fn the_cloth_hangs_from_the_cell_between_the_fingertips() {
    for (name, side) in GRIDS {
        let mut bench = Bench::new(name, side, "");
        let model = bench.world.model().clone();
        let corners: Vec<_> = (0..4).map(|corner| model.site(&format!("pinch_{corner}")).unwrap()).collect();
        let nearest = |bench: &Bench, point: [f64; 3]| {
            let distances = bench.vertices().into_iter().map(|vertex| norm(sub(vertex, point)));
            distances.enumerate().min_by(|a, b| a.1.total_cmp(&b.1)).unwrap()
        };
        let point = |bench: &Bench, corner: usize| bench.world.rows().site_position(corners[corner]);
        let held: Vec<usize> = (0..4)
            .map(|corner| {
                let (vertex, distance) = nearest(&bench, point(&bench, corner));
                assert!(distance < 1e-9, "{name}: the hand holds a point {distance} m from a vertex");
                vertex
            })
            .collect();
        // The midpoint of the fingertips is inside the cell.
        let tips = bench.world.rows().site_position(model.site("grasp").unwrap());
        let low = bench.vertices()[held[0]];
        let high = bench.vertices()[held[3]];
        assert!(low[0] < tips[0] && tips[0] < high[0] && low[2] < tips[2] && tips[2] < high[2], "{name}");

        bench.run(5.0);
        let vertices = bench.vertices();
        for (corner, vertex) in held.iter().enumerate() {
            let gap = norm(sub(vertices[*vertex], point(&bench, corner)));
            assert!(gap < 4e-3, "{name}: corner {corner} is {gap} m from its vertex");
        }
        // The farthest corner is 0.3 m from the fingertips, and the centroid hangs below them.
        let tips = bench.world.rows().site_position(model.site("grasp").unwrap());
        let lowest = vertices.iter().map(|v| v[2]).fold(f64::MAX, f64::min);
        assert!((0.2..0.32).contains(&(tips[2] - lowest)), "{name}: it hangs down {} m", tips[2] - lowest);
        let below = sub(mean(&vertices), tips);
        assert!(
            norm_xy(below) < 0.03 && below[2] < -0.05,
            "{name}: the centroid is at {below:?} from the tips"
        );
        let longest = stretch(&vertices, side);
        assert!(longest < 0.05, "{name}: an edge is stretched by {longest}");
        assert!(bench.rms_speed() < 0.15, "{name}: it swings at {} m/s", bench.rms_speed());
    }
}

#[test]
fn a_free_cloth_falls_with_gravity_and_internal_forces_conserve_its_momentum() {
    for (name, side) in GRIDS {
        let mut bench = Bench::new(name, side, "");
        bench.lay_out([0.0, 1.0, 1.0]);
        let before = mean(&bench.vertices());
        bench.run(0.25);
        let fall = sub(mean(&bench.vertices()), before);
        let velocity = mean(&bench.velocities());
        assert!((velocity[2] + G * 0.25).abs() < 1e-6, "{name} falls at {} m/s", velocity[2]);
        assert!(norm_xy(fall) < 1e-9, "{name} drifts by {fall:?}");
        // The tolerance is the error of the integrator: half a physics step times the final
        // velocity.
        assert!((fall[2] + 0.5 * G * 0.25 * 0.25).abs() < 0.5 * G * 0.25 / 240.0 + 1e-6, "{name}: {fall:?}");

        let mut bench = Bench::new(name, side, "<option gravity=\"0 0 0\"/>");
        bench.lay_out([0.0, 1.0, 1.0]);
        let mut random = 12345_u64;
        bench.velocities_mut().iter_mut().for_each(|v| {
            random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            *v = (random >> 33) as f64 / f64::from(1_u32 << 31) - 0.5;
        });
        let linear = mean(&bench.velocities());
        let angular = |bench: &Bench| {
            let each: Vec<_> = bench
                .vertices()
                .iter()
                .zip(bench.velocities())
                .map(|(p, v)| cross(sub(*p, [0.0, 1.0, 1.0]), v))
                .collect();
            mean(&each)
        };
        let spin = angular(&bench);
        let kinetic = bench.rms_speed();
        bench.run(0.5);
        assert!(norm(sub(mean(&bench.velocities()), linear)) < 1e-9, "{name}: linear momentum changes");
        let spun = norm(sub(angular(&bench), spin));
        assert!(spun < 2e-3, "{name}: angular momentum changes by {spun} of {spin:?}");
        assert!(bench.rms_speed() < 0.7 * kinetic, "{name}: the edges have no damping");
    }
}

#[test]
fn a_dropped_cloth_drapes_over_the_edge_comes_to_rest_and_gains_no_energy() {
    for (name, side) in GRIDS {
        let mut bench = Bench::new(name, side, "");
        bench.place_table([0.0, 1.0]);
        // A third of the cloth is beyond the table's edge, and friction on the rest holds it.
        bench.lay_out([0.1, 1.0, 0.45]);
        let mut lowest = bench.energy();
        let mut rest = 0.0;
        for tick in 0..300 {
            bench.run(1.0 / 60.0);
            let now = bench.energy();
            // Edges and contacts return stored energy: less than the potential energy of 2 mm.
            assert!(now < lowest + 2e-3 * G, "{name}: energy grows from {lowest} to {now} J/kg");
            lowest = lowest.min(now);
            if bench.rms_speed() > 0.05 {
                rest = f64::from(tick + 1) / 60.0;
            }
        }
        assert!(rest < 2.5, "{name} comes to rest after {rest} s");
        assert!(bench.rms_speed() < 0.02, "{name} moves at {} m/s after 5 s", bench.rms_speed());
        let vertices = bench.vertices();
        let hanging = vertices.iter().filter(|v| v[2] < 0.38).count();
        assert!(hanging * 10 >= vertices.len(), "{name}: {hanging} vertices hang over the edge");
        assert!(vertices.iter().all(|v| v[2] > 0.25), "{name} reaches down too far: it slid off");
        let on_top = vertices.iter().filter(|v| (v[0].abs().max((v[1] - 1.0).abs())) < 0.135);
        let deepest = on_top.map(|v| 0.4 + RADIUS - v[2]).fold(0.0, f64::max);
        assert!(deepest < 2e-3, "{name}: a vertex sinks {deepest} m into the table");
        assert!(stretch(&vertices, side) < 0.05, "{name}: an edge is stretched");
    }
}

#[test]
fn a_cloth_with_nine_tenths_beyond_an_edge_slides_off() {
    // By the capstan equation a right-angled edge with a friction of 1 holds at most a ratio of
    // e^(π/2) = 4.8. The ratio here is 9.
    let ledge = "<worldbody><geom class=\"table\" pos=\"0 3 0.2\" size=\"0.5 0.5 0.2\"/></worldbody>";
    for (name, side) in GRIDS {
        let mut bench = Bench::new(name, side, ledge);
        bench.lay_out([0.62, 3.0, 0.4 + RADIUS]);
        bench.run(5.0);
        let highest = bench.vertices().iter().map(|v| v[2]).fold(0.0, f64::max);
        assert!(highest < 0.2, "{name}: a vertex is still at {highest}");
    }
}

/// Returns the acceleration (m/s²) and displacement (m) of the cloth along x on a level table with
/// gravity tilted by `angle`, which is equivalent to a slope of this angle.
fn slide(name: &str, side: usize, angle: f64) -> (f64, f64) {
    let (sin, cos) = angle.sin_cos();
    let slope = format!(
        "<option gravity=\"{} 0 {}\"/><worldbody><geom class=\"table\" pos=\"0 3 0.1\" size=\"2 1 0.1\"/></worldbody>",
        G * sin,
        -G * cos
    );
    let mut bench = Bench::new(name, side, &slope);
    bench.lay_out([-1.5, 3.0, 0.2 + RADIUS]);
    bench.run(0.2);
    let from = mean(&bench.vertices())[0];
    let start = mean(&bench.velocities())[0];
    bench.run(1.0);
    (mean(&bench.velocities())[0] - start, mean(&bench.vertices())[0] - from)
}

#[test]
fn a_cloth_with_a_friction_of_1_rests_on_a_slope_of_40_degrees_and_slides_on_55_degrees() {
    for (name, side) in GRIDS {
        // tan 40° = 0.84 < 1. The remaining displacement is the creep of MuJoCo's soft contacts.
        let (_, displacement) = slide(name, side, 40_f64.to_radians());
        assert!(displacement.abs() < 0.02, "{name} slides {displacement} m in a second on 40°");
        let angle = 55_f64.to_radians();
        let (acceleration, _) = slide(name, side, angle);
        // a = g (sin - μ cos)
        let friction = angle.tan() - acceleration / (G * angle.cos());
        assert!(
            (friction - 1.0).abs() < 0.1,
            "{name} slides at {acceleration} m/s²: a friction of {friction}"
        );
    }
}

/// An episode of the expert that a test steps.
struct ExpertEpisode {
    environment: TaskEnvironment,
    worker: Box<dyn EnvironmentWorker>,
    controller: Box<dyn ControllerWorker>,
    memory: Vec<f64>,
    state: Vec<f64>,
    observation: Vec<f32>,
    signals: Vec<f64>,
    rewards: Vec<f64>,
}

impl ExpertEpisode {
    fn new(name: &str, x0: &[f64]) -> ExpertEpisode {
        let task = task(name).unwrap();
        let environment = TaskEnvironment::new(task, Preset::Paper, Reward::Shaped).unwrap();
        let expert = task.expert().unwrap();
        let environment = environment.with_further_parts(expert.further_parts()).unwrap();
        let mut episode = ExpertEpisode {
            worker: environment.worker(),
            controller: expert.worker(),
            memory: vec![0.0; expert.state_size()],
            state: vec![0.0; environment.state_size()],
            observation: vec![0.0; environment.observation_size()],
            signals: vec![0.0; environment.signals().len()],
            rewards: vec![0.0; environment.reward_terms().len()],
            environment,
        };
        let worker = &mut episode.worker;
        let sample = Sample {
            observation: &mut episode.observation,
            signals: &mut episode.signals,
            rewards: &mut episode.rewards,
        };
        worker.reset(&x0.into(), Seed(0), &mut episode.state, sample);
        episode
    }

    fn step(&mut self, action: &[f64]) {
        let sample = Sample {
            observation: &mut self.observation,
            signals: &mut self.signals,
            rewards: &mut self.rewards,
        };
        self.worker.step(action, &mut self.state, sample);
    }

    fn expert_step(&mut self) {
        let mut action = [0.0; 9];
        self.controller.act(1, &self.observation, &mut self.memory, &mut action);
        self.step(&action.map(f64::from));
    }

    fn signal(&self, name: &str) -> f64 {
        self.signals[self.environment.signals().iter().position(|signal| signal == name).unwrap()]
    }
}

#[test]
fn the_expert_causes_small_edge_strains_and_small_penetrations() {
    for (name, side) in GRIDS {
        for x0 in [[0.45, -0.35], [0.75, 0.35], [0.6, 0.1]] {
            let mut episode = ExpertEpisode::new(name, &x0);
            let model = episode.environment.model().clone();
            let cloth = model.flex("cloth").unwrap();
            let mut world = model.world();
            let mut longest: f64 = 0.0;
            let mut deepest: f64 = 0.0;
            for _ in 0..300 {
                episode.expert_step();
                world.set_state(&episode.state);
                world.refresh();
                let vertices = world.rows().vertices(cloth).to_vec();
                longest = longest.max(stretch(&vertices, side));
                let inside =
                    vertices.iter().filter(|v| (v[0] - x0[0]).abs().max((v[1] - x0[1]).abs()) < 0.135);
                deepest = inside.map(|v| 0.4 + RADIUS - v[2]).fold(deepest, f64::max);
            }
            println!("{name} {x0:?}: longest {longest:.3} deepest {deepest:.4}");
            assert!(longest < 0.25, "{name} from {x0:?}: an edge is stretched by {longest}");
            assert!(deepest < 5e-3, "{name} from {x0:?}: a vertex is {deepest} m deep");
        }
    }
}

#[test]
fn the_gripper_opens_automatically_above_the_table() {
    let far = [0.75, 0.35];
    for (name, _) in GRIDS {
        // The cloth starts at rest within 0.07 m of this table's center.
        let mut above = ExpertEpisode::new(name, &[0.52, 0.03]);
        assert_eq!(above.signal("cloth_released"), 0.0);
        above.step(&[0.0; 9]);
        assert_eq!(above.signal("cloth_released"), 1.0, "{name}");

        let mut away = ExpertEpisode::new(name, &far);
        (0..60).for_each(|_| away.step(&[0.0; 9]));
        assert_eq!(away.signal("cloth_released"), 0.0, "{name}");
    }
}

#[test]
fn an_open_finger_releases_the_cloth_permanently() {
    for (name, _) in GRIDS {
        let mut episode = ExpertEpisode::new(name, &[0.75, 0.35]);
        let with_fingers = |a: f64| [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, a, a];
        // 0.3 times 0.0125 m is less than the finger position of 0.005 m that releases the cloth.
        episode.step(&with_fingers(0.3));
        (0..10).for_each(|_| episode.step(&with_fingers(0.0)));
        assert_eq!(episode.signal("cloth_released"), 0.0, "{name}");
        (0..10).for_each(|_| episode.step(&with_fingers(1.0)));
        assert_eq!(episode.signal("cloth_released"), 1.0, "{name}");
        (0..30).for_each(|_| episode.step(&with_fingers(-1.0)));
        assert_eq!(episode.signal("cloth_released"), 1.0, "{name}");
        assert!(episode.signal("cloth_height_above_target") < 0.0, "{name}: it has not fallen");
    }
}

#[test]
fn the_fraction_over_the_table_counts_vertices() {
    // The cloth is in the plane y = 0 with columns of vertices every 3 cm from x = 0.35 to 0.65.
    // The columns at 0.35, 0.38 … 0.59 are over a table from x = 0.30 to 0.60.
    let over = |x0: &[f64]| ExpertEpisode::new("cloth-placing", x0).signal("cloth_vertices_over_table");
    assert!((over(&[0.45, 0.0]) - 9.0 / 11.0).abs() < 1e-12);
    assert_eq!(over(&[0.45, 0.2]), 0.0);
}

/// Returns the robustness of the strict formula for a released cloth at rest above the middle of
/// the table, with its centroid at this height above the table (m).
fn strict_at(height: f64) -> f64 {
    let strict = task("cloth-placing").unwrap().definition().paper.specification().unwrap().strict.unwrap();
    let signals = [
        ("cloth_target_horizontal_distance", 0.0),
        ("cloth_vertices_over_table", 1.0),
        ("cloth_height_above_target", height),
        ("cloth_speed", 0.0),
        ("cloth_released", 1.0),
    ];
    let names: Arc<[String]> = signals.iter().map(|(name, _)| (*name).to_owned()).collect();
    let mut trace = Trace::new(Arc::clone(&names));
    (0..=300).for_each(|_| trace.push(&signals.map(|(_, value)| value)));
    Monitor::new(&strict, &names, Clock::steps(1.0 / 60.0)).unwrap().robustness(&trace).unwrap()
}

#[test]
fn a_released_cloth_that_hangs_above_the_table_violates_the_strict_formula() {
    // A flat cloth on top of the rim, which is 0.02 m high, is on the table.
    assert!(strict_at(0.02 + RADIUS) > 0.02);
    // The lowest cloth that hangs from the fingertips without a fold, half its side above the
    // table.
    assert!(strict_at(0.5 * SIDE) < -0.05);
}

#[test]
fn both_grids_have_the_same_layout_formulas_and_initial_box() {
    let [fine, coarse] = GRIDS.map(|(name, _)| task(name).unwrap().definition());
    assert_eq!(coarse.variant_of, Some(fine.name));
    assert_eq!(
        (fine.layout(), fine.paper, fine.initial_box),
        (coarse.layout(), coarse.paper, coarse.initial_box)
    );
    let _: [Arc<dyn mishandle_rollout::Controller>; 2] =
        GRIDS.map(|(name, _)| task(name).unwrap().expert().unwrap());
}
