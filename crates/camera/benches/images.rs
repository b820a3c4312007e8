//! Measures images per second on one thread.
//!
//! `cargo bench -p mishandle-camera --bench images` measures all tasks, `-- cloth-placing` the
//! named ones. An image has one ray per pixel and a lamp with hard shadows; its time includes the
//! poses of its state. States are those of an episode of the expert. The time of a state is the
//! minimum of many repetitions, because other programs disturb some of them.
//!
//! With `--features mishandle-world/render`, the last column is MuJoCo's renderer with the first
//! camera and its fast quality, 64 x 64, for eight states. It needs OpenGL.

#![allow(clippy::print_stdout)]

#[path = "../tests/states/mod.rs"]
mod states;

use std::time::{Duration, Instant};

use mishandle_camera::{Camera, Output, Scene, Size, StateShot, Studio};
use mishandle_random::Seed;
use mishandle_tasks::sight::view;
use mishandle_tasks::{TASKS, Task};
use mishandle_world::{Model, PictureModel, Quality, Renderer, with_elements};

const REPETITIONS: usize = 20;

/// Repetitions of MuJoCo's renderer, which is slow without a GPU.
const MUJOCO_REPETITIONS: usize = 3;

/// Control steps between rendered states.
const STRIDE: usize = 6;

fn main() {
    println!(
        "{:<18} {:>6} {:>12} {:>12} {:>12} {:>12} {:>12}",
        "task", "shapes", "over 64", "wrist 64", "over 96", "over 128", "MuJoCo 64"
    );
    let names: Vec<String> = std::env::args().skip(1).filter(|word| !word.starts_with('-')).collect();
    let is_selected =
        |task: &&&dyn Task| names.is_empty() || names.iter().any(|n| n == task.definition().name);
    for task in TASKS.iter().filter(is_selected) {
        let (model, states) = states::expert_states(*task, 0.4);
        let states: Vec<&[f64]> = states.iter().step_by(STRIDE).map(Vec::as_slice).collect();
        let scene = Scene::of_model(&model).expect("the scene has few shapes");
        let cameras = |side: usize| {
            let size = Size::new(side, side).expect("the size is in range");
            view(*task, size).expect("the task has a view").1.cameras
        };
        let rate = |side: usize, camera: usize| own_rate(&model, &scene, &cameras(side)[camera], &states);
        let own = [rate(64, 0), rate(64, 1), rate(96, 0), rate(128, 0)].map(Some);
        let other = mujoco_rate(&model, &cameras(64)[0], &states);
        let texts = own.iter().chain([&other]).map(|rate| match rate {
            Some(rate) => format!("{rate:>10.0} /s"),
            None => format!("{:>12}", "-"),
        });
        let texts: Vec<String> = texts.collect();
        println!("{:<18} {:>6} {}", task.definition().name, scene.shapes.len(), texts.join(" "));
    }
}

/// Returns images per second of a function that renders a state.
fn rate(repetitions: usize, states: &[&[f64]], mut render: impl FnMut(&[f64])) -> f64 {
    let mut least = vec![Duration::MAX; states.len()];
    for _ in 0..repetitions {
        for (least, state) in least.iter_mut().zip(states) {
            let start = Instant::now();
            render(state);
            *least = start.elapsed().min(*least);
        }
    }
    states.len() as f64 / least.iter().sum::<Duration>().as_secs_f64()
}

fn own_rate(model: &Model, scene: &Scene, camera: &Camera, states: &[&[f64]]) -> f64 {
    let mut studio = Studio::new(model, 1);
    let mut rgb = vec![0; 3 * camera.size.pixels()];
    rate(REPETITIONS, states, |state| {
        let shot = StateShot { state, before: None, scene, camera, seed: Seed(0), step: 0 };
        studio.render(&[shot], &mut [Output { rgb: Some(&mut rgb), depth: None, segments: None }]);
    })
}

/// Returns the rate of MuJoCo's renderer with the same camera, if this build has it and OpenGL
/// works.
fn mujoco_rate(model: &Model, camera: &Camera, states: &[&[f64]]) -> Option<f64> {
    let numbers = |v: &[f32]| v.iter().map(f32::to_string).collect::<Vec<_>>().join(" ");
    let [x, y, _] = camera.pose.axes;
    let place = format!(
        r#"<worldbody><camera name="bench" pos="{}" xyaxes="{} {}" fovy="{}"/></worldbody>"#,
        numbers(&camera.pose.position),
        numbers(&x),
        numbers(&y),
        2.0 * (0.5 / f64::from(camera.focal_length)).atan().to_degrees(),
    );
    let picture = PictureModel::new(with_elements(model.document(), &place));
    let size = mishandle_world::Size::new(64, 64)?;
    let mut renderer = Renderer::new(&picture, size, Quality::Fast, "bench").ok()?;
    Some(rate(MUJOCO_REPETITIONS, &states[..8], |state| {
        renderer.draw(state).expect("OpenGL works");
    }))
}
