//! Writes a picture of each factor at each severity: `sight FOLDER TASK [SIZE] [NUMBER]`. The
//! first row is nominal: both cameras at the start and 40 control steps later. Each other row is a
//! factor, with both cameras at the severities 1 to 5, in random scenario NUMBER of its space.

#![allow(clippy::print_stdout)]

use std::error::Error;
use std::fs::File;
use std::path::Path;

use mishandle_camera::sight::{SEVERITIES, View};
use mishandle_camera::{Output, PoseReader, Poses, Renderer, Shot, Size};
use mishandle_rollout::{Controller, Environment, Sample, Scenario, Seed};
use mishandle_tasks::sight::view;
use mishandle_tasks::{CAMERA_NAMES, Preset, Reward, TASKS, TaskEnvironment};

/// Pictures in a row.
const COLUMNS: usize = 2 * SEVERITIES;

/// Control steps after the start.
const STEPS: usize = 40;

fn main() -> Result<(), Box<dyn Error>> {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let [folder, name] = [0, 1].map(|index| words.get(index));
    let (folder, name) = folder.zip(name).ok_or("usage: sight FOLDER TASK [SIZE] [NUMBER]")?;
    let task = *TASKS.iter().find(|task| task.definition().name == name).ok_or("no such task")?;
    let side = words.get(2).map_or(Ok(96), |word| word.parse())?;
    let number = words.get(3).map_or(Ok(0), |word| word.parse())?;
    let size = Size::new(side, side)?;
    let expert = task.expert()?;
    let environment = TaskEnvironment::new(task, Preset::Paper, Reward::Original)?
        .with_further_parts(expert.further_parts())?;
    let (_, spaces) = environment.axes_and_spaces(&[], &[])?;
    let (model, view) = view(task, size)?;
    let mut eyes = Eyes { reader: PoseReader::new(&model), renderer: Renderer::new(), size };
    let nominal = states(&environment, &*expert, &environment.space().nominal());
    let mut images = eyes.images(&view, &nominal, 0);
    images.extend(eyes.images(&view, &nominal, STEPS));
    let mut names = vec!["nominal".to_string()];
    let start = eyes.poses(&nominal[0]);
    for space in spaces.iter().filter(|space| space.name().ends_with(|c: char| c.is_ascii_digit())) {
        let (factor, severity) = space.name().split_once('-').ok_or("a factor and a severity")?;
        if severity == "1" {
            images.resize(COLUMNS * names.len(), Vec::new());
            names.push(factor.to_string());
        }
        let scenario = space.sample(Seed(0), number);
        let changed = view.under(space, &scenario, &start);
        images.extend(if factor == "posture" {
            let own = environment.with_space(space.clone())?;
            eyes.images(&view, &states(&own, &*expert, &scenario), 0)
        } else {
            eyes.images(&changed, &nominal, STEPS)
        });
    }
    let path = Path::new(folder).join(format!("sight_{name}.png"));
    write(&path, &images, side)?;
    println!("{}: {}; cameras {}", path.display(), names.join(", "), CAMERA_NAMES.join(", "));
    Ok(())
}

/// The cameras of a task.
struct Eyes {
    reader: PoseReader,
    renderer: Renderer,
    size: Size,
}

impl Eyes {
    fn poses(&mut self, state: &[f64]) -> Poses {
        let mut poses = Poses::default();
        self.reader.read(state, &mut poses);
        poses
    }

    /// Returns the images of both cameras at a control step.
    fn images(&mut self, view: &View, states: &[Vec<f64>], step: usize) -> Vec<Vec<u8>> {
        let poses = self.poses(&states[step]);
        let before = self.poses(&states[step.saturating_sub(1)]);
        let image = |camera| {
            let mut rgb = vec![0; 3 * self.size.pixels()];
            let scene = &view.scene;
            let step = step as u64;
            let shot = Shot { scene, poses: &poses, before: Some(&before), camera, seed: Seed(0), step };
            self.renderer.render(&shot, &mut Output { rgb: Some(&mut rgb), depth: None, segments: None });
            rgb
        };
        view.cameras.iter().map(image).collect()
    }
}

/// Returns the states of a simulation of the expert.
fn states(environment: &TaskEnvironment, expert: &dyn Controller, scenario: &Scenario) -> Vec<Vec<f64>> {
    let mut worker = environment.worker();
    let mut controller = expert.worker();
    let mut memory = vec![0.0; expert.state_size()];
    let mut state = vec![0.0; environment.state_size()];
    let mut observation = vec![0.0; environment.observation_size()];
    let mut signals = vec![0.0; environment.signals().len()];
    let mut rewards = vec![0.0; environment.reward_terms().len()];
    let mut output = vec![0.0; environment.action_size()];
    let sample = Sample { observation: &mut observation, signals: &mut signals, rewards: &mut rewards };
    worker.reset(scenario, Seed(0), &mut state, sample);
    controller.reset(&mut memory, Seed(0));
    let mut states = vec![state.clone()];
    for _ in 0..STEPS {
        controller.act(1, &observation, &mut memory, &mut output);
        let action: Vec<f64> = output.iter().map(|number| f64::from(*number)).collect();
        let sample = Sample { observation: &mut observation, signals: &mut signals, rewards: &mut rewards };
        worker.step(&action, &mut state, sample);
        states.push(state.clone());
    }
    states
}

/// Writes images with this side beside each other. An empty one is white.
fn write(path: &Path, images: &[Vec<u8>], side: usize) -> Result<(), Box<dyn Error>> {
    let rows = images.len().div_ceil(COLUMNS);
    let [width, height] = [COLUMNS * side, rows * side];
    let mut pixels = vec![255; 3 * width * height];
    for (index, image) in images.iter().enumerate() {
        let row = index / COLUMNS;
        let column = index % COLUMNS;
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
