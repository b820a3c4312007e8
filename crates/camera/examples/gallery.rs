//! Writes pictures of what the cameras of all tasks see: `gallery FOLDER [SIZE]`.

#![allow(clippy::print_stdout)]

#[path = "../tests/states/mod.rs"]
mod states;

use std::fs::File;
use std::path::Path;

use mishandle_camera::{Output, Scene, Size, StateShot, Studio};
use mishandle_random::Seed;
use mishandle_tasks::TASKS;

/// Control steps whose states are shown.
const STEPS: [usize; 4] = [0, 20, 60, 200];

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let folder = words.first().ok_or("the first argument is a folder")?;
    let side = words.get(1).map_or(Ok(64), |word| word.parse())?;
    let (size, enlarge) = (Size::new(side, side)?, (192 / side).max(1));
    for (part, tasks) in TASKS.chunks(4).enumerate() {
        let mut all = Vec::new();
        for task in tasks {
            let (model, states) = states::expert_states(*task, 0.4);
            let (scene, cameras) = (Scene::of_model(&model)?, states::cameras(*task, &model, size));
            let mut studio = Studio::new(&model, 1);
            let mut images = vec![vec![0; 3 * size.pixels()]; cameras.len() * STEPS.len()];
            let shot = |camera, step: &usize| StateShot {
                state: &states[*step],
                before: None,
                scene: &scene,
                camera,
                seed: Seed(0),
                step: *step as u64,
            };
            let of_camera = |camera| STEPS.iter().map(move |step| shot(camera, step));
            let shots: Vec<StateShot<'_>> = cameras.iter().flat_map(of_camera).collect();
            let mut outputs: Vec<Output<'_>> =
                images.iter_mut().map(|rgb| Output { rgb, depth: None, segments: None }).collect();
            studio.render(&shots, &mut outputs);
            all.extend(images);
        }
        let path = Path::new(folder).join(format!("tasks_{}.png", part + 1));
        write(&path, &all, [side, enlarge, 2 * STEPS.len()])?;
        println!("{}", path.display());
    }
    Ok(())
}

/// Writes images with this side beside each other, `columns` in a row.
fn write(
    path: &Path,
    images: &[Vec<u8>],
    [side, enlarge, columns]: [usize; 3],
) -> Result<(), Box<dyn std::error::Error>> {
    let rows = images.len() / columns;
    let [width, height] = [columns, rows].map(|count| count * side * enlarge);
    let mut pixels = Vec::with_capacity(3 * width * height);
    for y in 0..height {
        for x in 0..width {
            let [column, row] = [x, y].map(|v| v / enlarge);
            let image = &images[row / side * columns + column / side];
            let at = 3 * (row % side * side + column % side);
            pixels.extend_from_slice(&image[at..at + 3]);
        }
    }
    let mut encoder = png::Encoder::new(File::create(path)?, width as u32, height as u32);
    encoder.set_color(png::ColorType::Rgb);
    encoder.write_header()?.write_image_data(&pixels)?;
    Ok(())
}
