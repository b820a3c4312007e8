//! Writes pictures of each axis of sight at both bounds: `sight FOLDER TASK [SIZE]`. A row has four
//! axes, each at its lower bound, at nominal and at its upper bound, seen by the camera whose image
//! it changes more; the axes are printed in order, with this camera.

#![allow(clippy::print_stdout)]

use std::error::Error;
use std::fs::File;
use std::path::Path;

use mishandle_camera::sight::SIGHT_SPACES;
use mishandle_camera::{Output, PoseReader, Poses, Renderer, Shot, Size};
use mishandle_rollout::{Axis, Environment, Sample, Scenario, Seed, Space};
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
    let (_, spaces) = environment.axes_and_spaces(&[], &[])?;
    let axes = spaces.iter().filter(|space| SIGHT_SPACES[..5].contains(&space.name()));
    let axes: Vec<Axis> = axes.flat_map(|space| space.axes().to_vec()).collect();
    let space = Space::new("sight", axes.clone())?;
    let (model, view) = view(task, size)?;
    let mut reader = PoseReader::new(&model);
    let mut renderer = Renderer::new();
    let [first, before, poses] = states(task, &environment)?.map(|state| {
        let mut poses = Poses::default();
        reader.read(&state, &mut poses);
        poses
    });
    let mut images = Vec::new();
    let mut names = Vec::new();
    for axis in &axes {
        let values = [axis.low, axis.nominal.unwrap_or(axis.low), axis.high];
        let views = values.map(|value| view.under(&space, &scenario(&space, axis, value), &first));
        let seen = [0, 1].map(|camera| {
            views.each_ref().map(|view| {
                let mut rgb = vec![0; 3 * size.pixels()];
                let scene = &view.scene;
                let camera = &view.cameras[camera];
                let shot =
                    Shot { scene, poses: &poses, before: Some(&before), camera, seed: Seed(0), step: 0 };
                renderer.render(&shot, &mut Output { rgb: Some(&mut rgb), depth: None, segments: None });
                rgb
            })
        });
        let change = |[low, _, high]: &[Vec<u8>; 3]| {
            low.iter().zip(high).map(|(a, b)| u64::from(a.abs_diff(*b))).sum::<u64>()
        };
        let camera = usize::from(change(&seen[1]) > change(&seen[0]));
        names.push(format!("{} ({})", axis.name, CAMERA_NAMES[camera]));
        images.extend(seen[camera].clone());
    }
    let path = Path::new(folder).join(format!("sight_{name}.png"));
    write(&path, &images, side, 3 * COLUMNS)?;
    for row in names.chunks(COLUMNS) {
        println!("{}", row.join(", "));
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
    let values = space
        .axes()
        .iter()
        .map(|own| if own.name == axis.name { Some(value) } else { of(own).or(own.nominal) });
    Scenario::new(values.collect())
}

/// Returns the start of a task, and the states of its expert 39 and 40 control steps later.
fn states(task: &dyn Task, environment: &TaskEnvironment) -> Result<[Vec<f64>; 3], Box<dyn Error>> {
    let expert = task.expert()?;
    let mut worker = environment.worker();
    let mut controller = expert.worker();
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
    let mut before = first.clone();
    for _ in 0..40 {
        before.clone_from(&state);
        controller.act(1, &observation, &mut memory, &mut output);
        let action: Vec<f64> = output.iter().map(|number| f64::from(*number)).collect();
        let sample = Sample { observation: &mut observation, signals: &mut signals, rewards: &mut rewards };
        worker.step(&action, &mut state, sample);
    }
    Ok([first, before, state])
}

/// Writes images with this side beside each other, `columns` in a row.
fn write(path: &Path, images: &[Vec<u8>], side: usize, columns: usize) -> Result<(), Box<dyn Error>> {
    let rows = images.len().div_ceil(columns);
    let [width, height] = [columns * side, rows * side];
    let mut pixels = vec![255; 3 * width * height];
    for (index, image) in images.iter().enumerate() {
        let row = index / columns;
        let column = index % columns;
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
