//! The cameras of the tasks see objects and the hand, and are inside of nothing.

use crate::states::expert_states;
use mishandle_camera::sight::{Factor, SEVERITIES, View};
use mishandle_camera::{Camera, Form, Output, Pose, PoseReader, Poses, Renderer, Shape, Shot, Size};
use mishandle_rollout::Seed;
use mishandle_tasks::sight::{sight, view};
use mishandle_tasks::{TASKS, Task};
use mishandle_world::Model;

const SIZE: usize = 64;

fn looking(task: &dyn Task) -> (Model, View) {
    view(task, Size::new(SIZE, SIZE).unwrap()).unwrap()
}

/// Returns the place of a point in the image of a camera, in image heights from its center; `None`
/// behind the camera.
fn place(camera: &Camera, point: [f32; 3]) -> Option<[f32; 2]> {
    let p = camera.pose.local_point(point);
    (p[2] < 0.0).then(|| [p[0], p[1]].map(|v| v / -p[2] * camera.focal_length))
}

fn is_in_image(place: Option<[f32; 2]>) -> bool {
    place.is_some_and(|place| place.iter().all(|v| v.abs() < 0.5))
}

/// Along the expert's episodes from both corners and the center of the initial box, the object is
/// in the image of the camera over the table for at least 90 % of the time.
#[test]
fn the_camera_over_the_table_sees_the_object() {
    for task in TASKS {
        let definition = task.definition();
        let camera = looking(*task).1.cameras.swap_remove(0);
        for corner in [0.0, 0.5, 1.0] {
            let (model, states) = expert_states(*task, corner);
            let object = definition.object.unwrap_or("target");
            let mut world = model.world();
            let mut is_seen = |state: &&Vec<f64>| {
                world.set_state(state);
                world.refresh();
                let at = match model.flex(object) {
                    Ok(flex) => world.rows().vertices(flex)[0],
                    Err(_) => world.rows().position(model.body(object).unwrap()),
                };
                is_in_image(place(&camera, at.map(|v| v as f32)))
            };
            let seen = states.iter().filter(|state| is_seen(state)).count() as f64 / states.len() as f64;
            assert!(seen > 0.9, "{} from {corner} of its box: {seen} of the time", definition.name);
        }
    }
}

/// At the start of every task, all of the hand and the fingers is within the image of the camera
/// over the table, and some of it is visible. The tray of ball balancing hides the hand below it.
#[test]
fn the_hand_is_in_view_at_the_start() {
    for task in TASKS {
        let name = task.definition().name;
        let (model, view) = looking(*task);
        let mut poses = Poses::default();
        PoseReader::new(&model).read(&expert_states(*task, 0.5).1[0], &mut poses);
        let hand = ["hand", "left_finger", "right_finger"].map(|name| model.body(name).unwrap().index());
        let camera = &view.cameras[0];
        let is_of_hand = |shape: &Shape| hand.contains(&shape.body) && shape.material.opacity == 1.0;
        for shape in view.scene.shapes.iter().filter(|shape| hand.contains(&shape.body)) {
            let center = poses.bodies[shape.body].of(&shape.pose).position;
            assert!(is_in_image(place(camera, center)), "{name}: {:?} at {center:?}", shape.form);
        }
        let mut segments = vec![0; SIZE * SIZE];
        let mut scene = view.scene.clone();
        // What is not opaque hides nothing.
        scene.shapes.iter_mut().filter(|shape| shape.material.opacity < 1.0).for_each(|shape| {
            shape.material.opacity = 0.0;
        });
        let shot = Shot { scene: &scene, poses: &poses, before: None, camera, seed: Seed(0), step: 0 };
        let mut output = Output { rgb: None, depth: None, segments: Some(&mut segments) };
        Renderer::new().render(&shot, &mut output);
        let is_seen = |shape: &&u16| scene.shapes.get(usize::from(**shape)).is_some_and(is_of_hand);
        let pixels = segments.iter().filter(is_seen).count();
        assert!(pixels >= 10 || name == "ball-balancing", "{name}: {pixels} pixels of the hand");
    }
}

/// Returns how far a point is outside of a form, m, at least; less than 0 inside.
fn outside(form: Form, p: [f32; 3]) -> f32 {
    let length = |v: [f32; 3]| (v[0] * v[0] + v[1] * v[1] + v[2] * v[2]).sqrt();
    match form {
        Form::Plane { .. } => p[2],
        Form::Sphere { radius } => length(p) - radius,
        Form::Box { half } => (0..3).map(|i| p[i].abs() - half[i]).fold(f32::NEG_INFINITY, f32::max),
        Form::Capsule { radius, half } => length([p[0], p[1], p[2] - p[2].clamp(-half, half)]) - radius,
        Form::Cylinder { radius, half } => (length([p[0], p[1], 0.0]) - radius).max(p[2].abs() - half),
        Form::Ellipsoid { half } => {
            let least = half.into_iter().fold(f32::INFINITY, f32::min);
            (length([0, 1, 2].map(|i| p[i] / half[i])) - 1.0) * least
        }
        // A sheet has no inside.
        Form::Mesh(_) | Form::Cloth(_) => f32::INFINITY,
    }
}

/// Along the expert's episodes from both corners and the center of the initial box, no camera is
/// inside a body, also where the axes of the largest severity put it. The target of a task without
/// an object is a mark in the air: hand and camera may pass through it.
#[test]
fn no_camera_is_inside_a_body() {
    for task in TASKS {
        let name = task.definition().name;
        let (model, view) = looking(*task);
        let spaces = sight(task.definition()).spaces().unwrap();
        let space = spaces.iter().find(|space| space.name() == Factor::Camera.space(SEVERITIES)).unwrap();
        let eyes: Vec<(usize, [f32; 3])> = (0..8)
            .flat_map(|corner| {
                let bound = |axis: usize| f64::from(corner >> (axis % 7) & 1);
                let scenario = space.at(&(0..space.dimension()).map(bound).collect::<Vec<f64>>());
                view.under(space, &scenario, &Poses::default()).cameras
            })
            .map(|camera| (camera.body, camera.pose.position))
            .collect();
        let mark = task.definition().object.is_none().then(|| model.body("target").unwrap().index());
        let mut reader = PoseReader::new(&model);
        let mut poses = Poses::default();
        for corner in [0.0, 0.5, 1.0] {
            let states = expert_states(*task, corner).1;
            for (step, state) in states.iter().enumerate().step_by(3) {
                reader.read(state, &mut poses);
                for (body, eye) in &eyes {
                    let eye = poses.bodies[*body].point(*eye);
                    let inside = |shape: &Shape| {
                        let pose: Pose = poses.bodies[shape.body].of(&shape.pose);
                        outside(shape.form, pose.local_point(eye)) < 1e-3
                    };
                    let found =
                        view.scene.shapes.iter().find(|shape| Some(shape.body) != mark && inside(shape));
                    assert!(
                        found.is_none(),
                        "{name}, step {step} from {corner}: a camera on body {body} is in {found:?}"
                    );
                }
            }
        }
    }
}
