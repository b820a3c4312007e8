//! Images of many states on many threads.

use mishandle_random::Seed;
use mishandle_world::Model;
use rayon::prelude::*;

use crate::camera::Camera;
use crate::of_model::PoseReader;
use crate::renderer::{Output, Renderer, Shot};
use crate::scene::{Poses, Scene};

/// One image of a state.
#[derive(Clone, Copy, Debug)]
pub struct StateShot<'a> {
    /// The state: a row of an environment.
    pub state: &'a [f64],
    /// The state before, for motion blur.
    pub before: Option<&'a [f64]>,
    /// Shapes and light.
    pub scene: &'a Scene,
    /// The camera.
    pub camera: &'a Camera,
    /// Seed of the noise.
    pub seed: Seed,
    /// Number of the image in its episode.
    pub step: u64,
}

/// Renders images of states on several threads. An image does not depend on the other images or on
/// the number of threads.
#[derive(Debug)]
pub struct Studio {
    workers: Vec<StateRenderer>,
}

/// Renders images of states on one thread.
#[derive(Debug)]
pub struct StateRenderer {
    reader: PoseReader,
    renderer: Renderer,
    poses: Poses,
    before: Poses,
}

impl Studio {
    /// Makes a studio for states of a model.
    pub fn new(model: &Model, threads: usize) -> Studio {
        Studio { workers: (0..threads.max(1)).map(|_| StateRenderer::new(model)).collect() }
    }

    /// Renders an image per shot, each into its own output.
    ///
    /// # Panics
    /// As [`Renderer::render`], if a state is too short, or if there are fewer outputs than shots.
    pub fn render(&mut self, shots: &[StateShot<'_>], outputs: &mut [Output<'_>]) {
        assert_eq!(shots.len(), outputs.len(), "an output for each shot");
        let share = shots.len().div_ceil(self.workers.len()).max(1);
        let parts = shots.par_chunks(share).zip(outputs.par_chunks_mut(share));
        parts.zip(&mut self.workers).for_each(|((shots, outputs), worker)| {
            for (shot, output) in shots.iter().zip(outputs) {
                worker.render(shot, output);
            }
        });
    }
}

impl StateRenderer {
    /// Makes a renderer of states of a model.
    pub fn new(model: &Model) -> StateRenderer {
        StateRenderer {
            reader: PoseReader::new(model),
            renderer: Renderer::new(),
            poses: Poses::default(),
            before: Poses::default(),
        }
    }

    /// Returns the poses of a state.
    pub fn poses(&mut self, state: &[f64]) -> &Poses {
        self.reader.read(state, &mut self.poses);
        &self.poses
    }

    /// Renders an image.
    ///
    /// # Panics
    /// As [`Renderer::render`], or if a state is too short.
    pub fn render(&mut self, shot: &StateShot<'_>, output: &mut Output<'_>) {
        let StateShot { state, before, scene, camera, seed, step } = *shot;
        self.reader.read(state, &mut self.poses);
        let before = before.filter(|_| camera.optics.shutter > 0.0).map(|before| {
            self.reader.read(before, &mut self.before);
            &self.before
        });
        self.renderer.render(&Shot { scene, poses: &self.poses, before, camera, seed, step }, output);
    }
}
