//! Measures images per second on one thread.
//!
//! `cargo bench -p mishandle-camera --bench images` measures all tasks, `-- cloth-placing` the
//! named ones. An image has one ray per pixel and a lamp with hard shadows; its time includes the
//! poses of its state. States are those of an episode of the expert. Times are the minimum of many
//! repetitions of all states.

#![allow(clippy::print_stdout)]

#[path = "../tests/states/mod.rs"]
mod states;

use std::time::{Duration, Instant};

use mishandle_camera::{Camera, Output, Scene, Size, StateShot, Studio};
use mishandle_random::Seed;
use mishandle_tasks::{TASKS, Task};
use mishandle_world::Model;

const REPETITIONS: usize = 20;

/// Control steps between rendered states.
const STRIDE: usize = 6;

fn main() {
    println!(
        "{:<18} {:>7} {:>14} {:>14} {:>14} {:>14}",
        "task", "shapes", "over 64", "wrist 64", "over 96", "over 128"
    );
    let names: Vec<String> = std::env::args().skip(1).filter(|word| !word.starts_with('-')).collect();
    let is_selected =
        |task: &&&dyn Task| names.is_empty() || names.iter().any(|n| n == task.definition().name);
    for task in TASKS.iter().filter(is_selected) {
        let (model, states) = states::expert_states(*task, 0.4);
        let scene = Scene::of_model(&model).expect("the scene has few shapes");
        let rate = |side: usize, camera: usize| {
            let size = Size::new(side, side).expect("the size is in range");
            images_per_second(&model, &scene, &states::cameras(*task, &model, size)[camera], &states)
        };
        let rates =
            [rate(64, 0), rate(64, 1), rate(96, 0), rate(128, 0)].map(|rate| format!("{rate:>10.0} /s"));
        println!("{:<18} {:>7} {:>14}", task.definition().name, scene.shapes.len(), rates.join("  "));
    }
}

fn images_per_second(model: &Model, scene: &Scene, camera: &Camera, states: &[Vec<f64>]) -> f64 {
    let mut studio = Studio::new(model, 1);
    let mut rgb = vec![0; 3 * camera.size.pixels()];
    let states: Vec<&Vec<f64>> = states.iter().step_by(STRIDE).collect();
    let mut least = Duration::MAX;
    for _ in 0..REPETITIONS {
        let start = Instant::now();
        for (step, state) in states.iter().enumerate() {
            let shot = StateShot { state, before: None, scene, camera, seed: Seed(0), step: step as u64 };
            studio.render(&[shot], &mut [Output { rgb: &mut rgb, depth: None, segments: None }]);
        }
        least = least.min(start.elapsed());
    }
    states.len() as f64 / least.as_secs_f64()
}
