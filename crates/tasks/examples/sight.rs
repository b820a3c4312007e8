//! Writes pictures of each axis of sight at both bounds: `sight FOLDER TASK [SIZE]`. A row has four
//! axes, each at its lower bound, at nominal and at its upper bound; the axes are printed in order.

#![allow(clippy::print_stdout)]

use std::error::Error;
use std::fs::File;
use std::path::Path;

use mishandle_camera::{Output, PoseReader, Poses, Renderer, Shot, Size};
use mishandle_rollout::{Axis, Environment, Sample, Scenario, Seed, Space};
use mishandle_sight::SIGHT_SPACES;
use mishandle_tasks::sight::view;
use mishandle_tasks::{CAMERA_NAMES, Preset, Reward, TASKS, Task, TaskEnvironment};

/// Axes in a row of pictures.
const COLUMNS: usize = 4;

fn main() -> Result<(), Box<dyn Error>> {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let [folder, name] = [0, 1].map(|index| words.get(index));
    let (folder, name) = folder.zip(name).ok_or("usage: sight FOLDER TASK [SIZE]")?;
    let task = *TASKS.iter().find(|task| task.definition().name == name).ok_or("no such task")?;
    let side = words.get(2).map_or(Ok(96), |word| word.parse())?;
    let size = Size::new(side, side)?;
    let environment = TaskEnvironment::new(task, Preset::Paper, Reward::Original)?;
    let (_, spaces) = environment.axes_and_spaces(&[])?;
    let axes = spaces.iter().filter(|space| SIGHT_SPACES[..5].contains(&space.name()));
    let axes: Vec<Axis> = axes.flat_map(|space| space.axes().to_vec()).collect();
    let space = Space::new("sight", axes.clone())?;
    let (model, view) = view(task, size)?;
    let (before, now) = states(task, &environment);
    let (mut reader, mut renderer) = (PoseReader::new(&model), Renderer::new());
    let [mut first, mut poses] = [Poses::default(), Poses::default()];
    reader.read(&before, &mut first);
    reader.read(&now, &mut poses);
    let mut images = Vec::new();
    for axis in &axes {
        let camera = usize::from(axis.name.starts_with(CAMERA_NAMES[1]));
        for value in [axis.low, axis.nominal.unwrap_or(axis.low), axis.high] {
            let seen = view.under(&space, &scenario(&space, axis, value), &first);
            let mut rgb = vec![0; 3 * size.pixels()];
            let shot = Shot {
                scene: &seen.scene,
                poses: &poses,
                before: Some(&first),
                camera: &seen.cameras[camera],
                seed: Seed(0),
                step: 0,
            };
            renderer.render(&shot, &mut Output { rgb: &mut rgb, depth: None, segments: None });
            images.push(rgb);
        }
    }
    let path = Path::new(folder).join(format!("sight_{name}.png"));
    write(&path, &images, side, 3 * COLUMNS)?;
    for row in axes.chunks(COLUMNS) {
        println!("{}", row.iter().map(|axis| axis.name.as_str()).collect::<Vec<_>>().join(", "));
    }
    println!("{}", path.display());
    Ok(())
}

/// Returns the nominal scenario with one axis at a value, and what it needs: a second lamp, three
/// distractors, a patch, black rows, a random pattern.
fn scenario(space: &Space, axis: &Axis, value: f64) -> Scenario {
    let of = |own: &Axis| {
        let condition = axis.conditions.iter().find(|condition| condition.axis == own.name)?;
        // Of the patterns, the number 3 is random, too.
        Some(if condition.axis.ends_with("_pattern") { 3.0 } else { own.high })
    };
    let values = space.axes().iter().map(|own| match own.name == axis.name {
        true => Some(value),
        false => of(own).or(own.nominal),
    });
    Scenario::new(values.collect())
}

/// Returns the start of a task and the state of its expert 40 control steps later.
fn states(task: &dyn Task, environment: &TaskEnvironment) -> (Vec<f64>, Vec<f64>) {
    let Ok(expert) = task.expert() else { return (Vec::new(), Vec::new()) };
    let (mut worker, mut controller) = (environment.worker(), expert.worker());
    let mut memory = vec![0.0; expert.state_size()];
    let mut state = vec![0.0; environment.state_size()];
    let mut observation = vec![0.0; environment.observation_size()];
    let mut signals = vec![0.0; environment.signals().len()];
    let mut rewards = vec![0.0; environment.reward_terms().len()];
    let mut output = vec![0.0; environment.action_size()];
    let sample = Sample { observation: &mut observation, signals: &mut signals, rewards: &mut rewards };
    worker.reset(&environment.space().nominal(), Seed(0), &mut state, sample);
    controller.reset(&mut memory, Seed(0));
    let first = state.clone();
    for _ in 0..40 {
        controller.act(1, &observation, &mut memory, &mut output);
        let action: Vec<f64> = output.iter().map(|number| f64::from(*number)).collect();
        let sample = Sample { observation: &mut observation, signals: &mut signals, rewards: &mut rewards };
        worker.step(&action, &mut state, sample);
    }
    (first, state)
}

/// Writes images with this side beside each other, `columns` in a row.
fn write(path: &Path, images: &[Vec<u8>], side: usize, columns: usize) -> Result<(), Box<dyn Error>> {
    let rows = images.len().div_ceil(columns);
    let [width, height] = [columns * side, rows * side];
    let mut pixels = vec![255; 3 * width * height];
    for (index, image) in images.iter().enumerate() {
        let (row, column) = (index / columns, index % columns);
        for (y, line) in image.chunks(3 * side).enumerate() {
            let at = 3 * ((row * side + y) * width + column * side);
            pixels[at..at + line.len()].copy_from_slice(line);
        }
    }
    let mut encoder = png::Encoder::new(File::create(path)?, width as u32, height as u32);
    encoder.set_color(png::ColorType::Rgb);
    encoder.write_header()?.write_image_data(&pixels)?;
    Ok(())
}
