//! Writes pictures of images: `gallery FOLDER [SIZE]`.
//!
//! `tasks_N.png` shows what both cameras of each task see at four steps, a row per task.
//! `looks.png` shows one state under other lights, cameras, materials and effects.

#![allow(clippy::print_stdout)]

#[path = "../tests/states/mod.rs"]
mod states;

use std::fs::File;
use std::path::Path;

use mishandle_camera::sight::View;
use mishandle_camera::{
    Camera, Form, Lamp, Material, Optics, Output, Pattern, Pose, Scene, Shape, Size, StateShot, Studio,
};
use mishandle_random::Seed;
use mishandle_tasks::sight::view;
use mishandle_tasks::{TASKS, task};
use mishandle_world::Model;

/// Control steps whose states are shown.
const STEPS: [usize; 4] = [0, 20, 60, 200];

/// Images in a row.
const COLUMNS: usize = 8;

type Error = Box<dyn std::error::Error>;

fn main() -> Result<(), Error> {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let folder = Path::new(words.first().ok_or("the first argument is a folder")?);
    let side = words.get(1).map_or(Ok(64), |word| word.parse())?;
    let size = Size::new(side, side)?;
    for (part, tasks) in TASKS.chunks(4).enumerate() {
        let mut images = Vec::new();
        for task in tasks {
            let states = states::expert_states(*task, 0.4).1;
            let (model, view) = view(*task, size)?;
            for camera in &view.cameras {
                images.extend(STEPS.map(|step| render(&model, &states, step, &view.scene, camera)));
            }
        }
        write(&folder.join(format!("tasks_{}.png", part + 1)), &images, side)?;
    }
    write(&folder.join("looks.png"), &looks(size)?, side)
}

fn render(model: &Model, states: &[Vec<f64>], step: usize, scene: &Scene, camera: &Camera) -> Vec<u8> {
    let mut rgb = vec![0; 3 * camera.size.pixels()];
    let before = Some(&states[step.saturating_sub(1)][..]);
    let shot = StateShot { state: &states[step], before, scene, camera, seed: Seed(0), step: step as u64 };
    Studio::new(model, 1).render(&[shot], &mut [Output { rgb: Some(&mut rgb), depth: None, segments: None }]);
    rgb
}

/// Returns images of one state: the nominal one, and others with a change each.
fn looks(size: Size) -> Result<Vec<Vec<u8>>, Error> {
    type Change = fn(&mut Scene, &mut Camera);
    let changes: [Change; 32] = [
        |_, _| {},
        // Light.
        |scene, _| scene.lamps[0].direction = [1.0, 0.5, 0.5],
        |scene, _| scene.lamps[0].direction = [-0.3, -1.0, 0.6],
        |scene, _| scene.lamps[0].color = [1.0, 0.75, 0.5],
        |scene, _| scene.lamps[0].strength = 0.2,
        |scene, _| scene.lamps[0].strength = 1.0,
        |scene, _| (scene.ambient.above, scene.ambient.below) = ([0.1; 3], [0.05; 3]),
        |scene, _| scene.lamps[1] = Lamp { strength: 0.5, ..Lamp::SECOND },
        |scene, _| (scene.lamps[0].radius, scene.lamps[0].shadow_rays) = (0.15, 16),
        |scene, _| scene.lamps[0].casts_shadows = false,
        // Camera.
        |_, camera| camera.pose.position[1] += 0.2,
        |_, camera| camera.focal_length *= 1.3,
        |_, camera| camera.tilt = [0.1, 0.0, 0.0],
        |_, camera| camera.tilt = [0.0, 0.0, 0.2],
        |_, camera| camera.optics = Optics { samples: 16, aperture: 0.03, focus: 0.9, shutter: 0.0 },
        |_, camera| camera.optics = Optics { samples: 16, shutter: 1.0, ..Optics::NOMINAL },
        // Appearance.
        |scene, _| paint(scene, Pattern::Checker, 0.12),
        |scene, _| paint(scene, Pattern::Noise, 0.1),
        |scene, _| paint(scene, Pattern::Wood, 0.02),
        |scene, _| scene.background.horizon = [0.2, 0.3, 0.2],
        |scene, _| scene.shapes.iter_mut().for_each(|shape| shape.material.colors[0].reverse()),
        // Clutter.
        |scene, _| clutter(scene, 3),
        |scene, _| clutter(scene, 10),
        // Image.
        |_, camera| camera.effects.read_noise = 0.08,
        |_, camera| camera.effects.blur = 1.5,
        |_, camera| camera.effects.exposure = 0.4,
        |_, camera| camera.effects.exposure = 1.8,
        |_, camera| camera.effects.compression = 4.0,
        |_, camera| camera.effects.patch.size = [0.3, 0.2],
        |_, camera| camera.effects.dead_rows.share = 0.08,
        |_, camera| camera.effects.color_cast = [1.1, 1.0, 0.7],
        |_, camera| camera.effects.vignette = 0.8,
    ];
    let own = task("cube-stacking").ok_or("the task exists")?;
    let states = states::expert_states(own, 0.4).1;
    let (model, View { scene, cameras, .. }) = view(own, size)?;
    let look = |change: &Change| {
        let mut scene = scene.clone();
        let mut camera = cameras[0].clone();
        change(&mut scene, &mut camera);
        render(&model, &states, 45, &scene, &camera)
    };
    Ok(changes.iter().map(look).collect())
}

/// Gives the ground a pattern.
fn paint(scene: &mut Scene, pattern: Pattern, scale: f32) {
    for shape in scene.shapes.iter_mut().filter(|shape| matches!(shape.form, Form::Plane { .. })) {
        let colors = [[0.85, 0.8, 0.7], [0.5, 0.42, 0.35]];
        shape.material = Material { pattern, colors, scale, ..shape.material };
    }
}

/// Adds shapes on the ground that nothing touches.
fn clutter(scene: &mut Scene, count: usize) {
    for index in 0..count {
        let [a, b] = [7, 3].map(|factor| (index * factor % 10) as f32 / 10.0);
        let form = match index % 3 {
            0 => Form::Sphere { radius: 0.04 },
            1 => Form::Cylinder { radius: 0.03, half: 0.04 },
            _ => Form::Box { half: [0.03, 0.05, 0.04] },
        };
        let pose = Pose { position: [0.3 + 0.5 * a, -0.4 + 0.9 * b, 0.04], ..Pose::IDENTITY };
        let material = Material::plain([a, 0.5, 1.0 - b]);
        scene.shapes.push(Shape { body: 0, pose, form, material, geom: None });
    }
}

/// Writes images with this side beside each other.
fn write(path: &Path, images: &[Vec<u8>], side: usize) -> Result<(), Error> {
    let enlarge = (192 / side).max(1);
    let [width, height] = [COLUMNS, images.len().div_ceil(COLUMNS)].map(|count| count * side * enlarge);
    let mut pixels = Vec::with_capacity(3 * width * height);
    for y in 0..height {
        for x in 0..width {
            let [column, row] = [x, y].map(|v| v / enlarge);
            let at = 3 * (row % side * side + column % side);
            let image = images.get(row / side * COLUMNS + column / side);
            pixels.extend_from_slice(image.map_or(&[255; 3], |image| &image[at..at + 3]));
        }
    }
    let mut encoder = png::Encoder::new(File::create(path)?, width as u32, height as u32);
    encoder.set_color(png::ColorType::Rgb);
    encoder.write_header()?.write_image_data(&pixels)?;
    println!("{}", path.display());
    Ok(())
}
