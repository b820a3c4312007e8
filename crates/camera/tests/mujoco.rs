//! Depth, segments and shadows against MuJoCo's own rays, on states of all tasks.

use crate::states::expert_states;
use mishandle_camera::{Camera, NO_SHAPE, Output, Scene, Size, StateShot, Studio};
use mishandle_random::Seed;
use mishandle_tasks::sight::view;
use mishandle_tasks::{TASKS, Task};
use mishandle_world::{Model, World};

const SIDE: usize = 64;

/// Turn of a ray that rounding in single precision may stand for.
const JITTER: f64 = 2e-5;

/// Offsets of a ray by the jitter.
const AROUND: [[f64; 2]; 5] = [[0.0, 0.0], [1.0, 1.0], [-1.0, 1.0], [1.0, -1.0], [-1.0, -1.0]];

fn name(task: &dyn Task) -> &'static str {
    task.definition().name
}

struct Images {
    rgb: Vec<u8>,
    depth: Vec<f32>,
    segments: Vec<u16>,
}

fn render(model: &Model, state: &[f64], scene: &Scene, camera: &Camera) -> Images {
    let pixels = camera.size.pixels();
    let mut rgb = vec![0; 3 * pixels];
    let mut depth = vec![0.0; pixels];
    let mut segments = vec![0; pixels];
    let shot = StateShot { state, before: None, scene, camera, seed: Seed(0), step: 0 };
    let output = Output { rgb: Some(&mut rgb), depth: Some(&mut depth), segments: Some(&mut segments) };
    Studio::new(model, 1).render(&[shot], &mut [output]);
    Images { rgb, depth, segments }
}

/// The rays of a camera, in double precision.
struct Rays {
    eye: [f64; 3],
    axes: [[f64; 3]; 3],
    step: f64,
}

impl Rays {
    fn new(world: &World, camera: &Camera) -> Rays {
        let body = world.model().body_at(camera.body);
        let turn = world.body_rotation(body);
        let at = world.rows().position(body);
        let direction = |v: [f32; 3]| {
            let v = v.map(f64::from);
            [0, 1, 2].map(|i| turn[3 * i] * v[0] + turn[3 * i + 1] * v[1] + turn[3 * i + 2] * v[2])
        };
        let eye = direction(camera.pose.position);
        Rays {
            eye: [0, 1, 2].map(|i| at[i] + eye[i]),
            axes: camera.pose.axes.map(direction),
            step: 1.0 / (f64::from(camera.focal_length) * SIDE as f64),
        }
    }

    /// Returns the direction of a pixel's ray, moved by a number of jitters.
    fn direction(&self, pixel: usize, [dx, dy]: [f64; 2]) -> [f64; 3] {
        let half = 0.5 * SIDE as f64;
        let u = ((pixel % SIDE) as f64 + 0.5 - half) * self.step + JITTER * dx;
        let v = (half - (pixel / SIDE) as f64 - 0.5) * self.step + JITTER * dy;
        let [right, up, back] = self.axes;
        [0, 1, 2].map(|i| u * right[i] + v * up[i] - back[i])
    }
}

/// Calls `check` with each task, its model, world, state and scene without cloths, which
/// MuJoCo's rays do not meet, for some states.
fn for_states(mut check: impl FnMut(&dyn Task, &Model, &mut World, &[f64], Scene)) {
    for task in TASKS {
        let (model, states) = expert_states(*task, 0.3);
        // The size of a plane is that of MuJoCo's pictures, where its rays end, too.
        let ground = "type=\"plane\" size=\"2 2 0.1\"";
        let endless = model.document().replace(ground, "type=\"plane\" size=\"0 0 0.1\"");
        let model = Model::from_xml(&endless).unwrap();
        let mut world = model.world();
        for state in states.iter().step_by(75) {
            world.set_state(state);
            world.refresh_sensors();
            let mut scene = Scene::of_model(&model).unwrap();
            scene.shapes.retain(|shape| shape.geom.is_some());
            check(*task, &model, &mut world, state, scene);
        }
    }
}

/// Compares depth and segments of an image with MuJoCo's rays. Returns how many pixels show the
/// same shape, and how many rays graze one, so that only neighbors agree.
fn compare(what: &str, world: &mut World, scene: &Scene, camera: &Camera, images: &Images) -> [usize; 2] {
    let rays = Rays::new(world, camera);
    let mut compared = 0;
    let mut grazing = 0;
    for pixel in 0..SIDE * SIDE {
        let depth = images.depth[pixel];
        let segment = images.segments[pixel];
        assert_eq!(segment == NO_SHAPE, depth == f32::INFINITY, "{what}, pixel {pixel}");
        let own = (segment != NO_SHAPE).then(|| scene.shapes[usize::from(segment)].geom).flatten();
        let truth = world.ray(rays.eye, rays.direction(pixel, [0.0; 2]));
        let is_near = |truth: Option<(usize, f64)>, tolerance: f64| match (truth, own) {
            (None, None) => true,
            // Coplanar shapes may be exchanged.
            (Some((_, t)), Some(_)) => (t - f64::from(depth)).abs() < tolerance * t.max(0.1),
            _ => false,
        };
        if !is_near(truth, 2e-5) {
            // The ray grazes a shape: its depth changes fast beside it.
            let mut around = AROUND.iter().map(|jitter| rays.direction(pixel, *jitter));
            let agrees = around.any(|direction| is_near(world.ray(rays.eye, direction), 3e-3));
            assert!(agrees, "{what}, pixel {pixel}: depth {depth} of {own:?}, MuJoCo {truth:?}");
            grazing += 1;
        }
        compared += usize::from(own.is_some() && truth.map(|(geom, _)| geom) == own);
    }
    [compared, grazing]
}

#[test]
fn depth_and_segments_are_those_of_mujocos_rays() {
    let mut compared = 0;
    let mut grazing = 0;
    for_states(|task, model, world, state, scene| {
        for camera in view(task, Size::new(SIDE, SIDE).unwrap()).unwrap().1.cameras {
            let images = render(model, state, &scene, &camera);
            let [same, grazed] = compare(name(task), world, &scene, &camera, &images);
            compared += same;
            grazing += grazed;
        }
    });
    // 9 tasks, 5 states, 2 cameras; most pixels show a shape.
    assert!(compared > 9 * 5 * 2 * SIDE * SIDE / 2, "{compared}");
    assert!(grazing < compared / 2000, "{grazing} of {compared}");
}

/// A model of every kind of shape, with a mesh that is not convex, a shape that is hidden and one
/// that moves.
const EVERY_SHAPE: &str = r#"<mujoco>
  <asset><mesh name="notch" vertex="0 0 0  .4 0 0  .4 .3 0  0 .3 0  0 0 .2  .4 0 .2  .4 .3 .2  0 .3 .2  .2 .15 .05"
    face="0 2 1  0 3 2  0 1 5  0 5 4  1 2 6  1 6 5  2 3 7  2 7 6  3 0 4  3 4 7  4 5 8  5 6 8  6 7 8  7 4 8"/></asset>
  <worldbody>
    <geom type="plane" size="0 0 1"/>
    <body pos=".1 .2 .6" euler="30 40 50"><freejoint/>
      <geom type="mesh" mesh="notch"/>
      <geom type="ellipsoid" size=".1 .2 .15" pos="-.4 0 0" euler="0 20 70"/>
      <geom type="capsule" size=".07 .2" pos="0 -.4 0" euler="80 0 10"/>
      <geom type="cylinder" size=".1 .05" pos="0 .3 .2" euler="20 30 0"/>
      <geom type="box" size=".3 .3 .3" group="3"/>
    </body>
    <geom type="sphere" size=".15" pos=".6 -.3 .2"/>
    <geom type="box" size=".1 .3 .2" pos="-.5 .5 .2" euler="0 0 33"/>
  </worldbody></mujoco>"#;

#[test]
fn every_kind_of_shape_is_where_mujocos_rays_meet_it() {
    let model = Model::from_xml(EVERY_SHAPE).unwrap();
    let scene = Scene::of_model(&model).unwrap();
    assert_eq!(scene.shapes.len(), 7, "one of eight is hidden");
    let mut world = model.world();
    let mut state = vec![0.0; model.state_size()];
    world.read_state(&mut state);
    world.refresh_sensors();
    for eye in [[2.0, 0.5, 1.5], [-0.3, -1.6, 1.1], [0.2, 0.1, 2.4], [-1.7, 1.0, 0.3]] {
        let points = [eye, [0.05, 0.1, 0.4], [0.1, 0.2, 1.0]];
        let camera = Camera::looking(Size::new(SIDE, SIDE).unwrap(), 0, points, 1.0);
        let images = render(&model, &state, &scene, &camera);
        let [compared, grazing] = compare("every shape", &mut world, &scene, &camera, &images);
        assert!(compared > SIDE * SIDE / 2 && grazing < 20, "{compared}, {grazing}");
        let meshes = images.segments.iter().filter(|segment| **segment != NO_SHAPE).filter(|segment| {
            matches!(scene.shapes[usize::from(**segment)].form, mishandle_camera::Form::Mesh(_))
        });
        assert!(meshes.count() > 50);
    }
}

#[test]
fn a_point_is_dark_exactly_if_a_ray_to_the_lamp_hits_a_shape() {
    let mut dark = 0;
    let mut bright = 0;
    let mut unclear = 0;
    for_states(|task, model, world, state, mut scene| {
        scene.ambient.above = [0.0; 3];
        scene.ambient.below = [0.0; 3];
        scene.lamps[0].strength = 1.0;
        for shape in &mut scene.shapes {
            shape.material = mishandle_camera::Material::plain([1.0; 3]);
        }
        let toward = scene.lamps[0].direction.map(f64::from);
        let mut open = scene.clone();
        open.lamps[0].casts_shadows = false;
        for camera in view(task, Size::new(SIDE, SIDE).unwrap()).unwrap().1.cameras {
            let images = render(model, state, &scene, &camera);
            let without = render(model, state, &open, &camera);
            let rays = Rays::new(world, &camera);
            for pixel in 0..SIDE * SIDE {
                let lit = images.rgb[3 * pixel];
                let full = without.rgb[3 * pixel];
                if images.segments[pixel] == NO_SHAPE || full < 20 {
                    continue;
                }
                assert!(lit == 0 || lit == full, "{}, pixel {pixel}: {lit} of {full}", name(task));
                // From a little in front of the surface, also 0.2 mm beside the point.
                let depth = f64::from(images.depth[pixel]);
                let beside = 2e-4 / JITTER / depth;
                let hits: Vec<Option<f64>> = AROUND
                    .iter()
                    .filter_map(|[x, y]| {
                        let direction = rays.direction(pixel, [beside * x, beside * y]);
                        let (_, t) = world.ray(rays.eye, direction)?;
                        let from = [0, 1, 2].map(|i| rays.eye[i] + (t - 1e-5) * direction[i]);
                        Some(world.ray(from, toward).map(|(_, distance)| distance))
                    })
                    .collect();
                let is_close = hits.iter().flatten().any(|distance| *distance < 1e-3);
                let hits: Vec<bool> = hits.iter().map(Option::is_some).collect();
                if is_close || hits.iter().any(|hit| *hit != hits[0]) {
                    unclear += 1;
                    continue;
                }
                assert_eq!(lit == 0, hits[0], "{}, pixel {pixel}: {lit} of {full}", name(task));
                if hits[0] { dark += 1 } else { bright += 1 }
            }
        }
    });
    assert!(dark > 5000 && bright > 50_000, "{dark} dark, {bright} bright");
    assert!(unclear < bright / 50, "{unclear} points near the edge of a shadow");
}
