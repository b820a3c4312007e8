//! The cameras of a controller that sees.

use std::sync::Arc;

use crate::{Camera, Output, Size, StateRenderer};
use mishandle_rollout::{Eyes, EyesWorker, Image, RolloutError, Scenario, Seed, Space};
use mishandle_world::Model;

use crate::sight::cameras::Sight;
use crate::sight::feed::{Feed, FeedAxes, Frame};
use crate::sight::view::View;

/// The cameras of a target that a controller sees through.
#[derive(Clone)]
pub struct SightEyes {
    model: Model,
    /// The nominal view.
    view: View,
    space: Space,
    feed: FeedAxes,
    /// The camera of each image, by its place in the [`Sight`], and its size.
    images: Arc<[(usize, Size)]>,
    episode_steps: usize,
}

impl SightEyes {
    /// Makes the cameras of a controller that sees `images`. `model` and `view` are those of a
    /// target with this sight, `space` has the axes of its scenarios, and `name` is that of the
    /// target in errors.
    ///
    /// # Errors
    /// If a camera does not exist, a size is out of range, or two axes have the same name.
    pub fn new(
        name: &str,
        sight: &Sight,
        model: Model,
        view: View,
        space: &Space,
        images: &[Image],
    ) -> Result<SightEyes, RolloutError> {
        let image = |image: &Image| {
            let camera = sight.names().position(|known| known == image.camera);
            let camera = camera.ok_or_else(|| RolloutError::NoCamera {
                environment: name.to_string(),
                camera: image.camera.clone(),
                known: sight.names().map(ToString::to_string).collect(),
            })?;
            Ok((camera, image_size(image)?))
        };
        let images: Arc<[(usize, Size)]> = images.iter().map(image).collect::<Result<_, RolloutError>>()?;
        let feed = FeedAxes::new(sight, space)?;
        let episode_steps = sight.episode_steps;
        Ok(SightEyes { model, view, space: space.clone(), feed, images, episode_steps })
    }
}

/// Returns the size of an image.
///
/// # Errors
/// If it is out of range.
pub fn image_size(image: &Image) -> Result<Size, RolloutError> {
    Size::new(image.width, image.height)
        .map_err(|error| RolloutError::Image { camera: image.camera.clone(), what: error.to_string() })
}

impl Eyes for SightEyes {
    fn worker(&self, rows: usize) -> Box<dyn EyesWorker> {
        Box::new(Worker {
            renderer: StateRenderer::new(&self.model),
            eyes: self.clone(),
            rows: (0..rows).map(|_| None).collect(),
        })
    }
}

struct Worker {
    eyes: SightEyes,
    renderer: StateRenderer,
    rows: Vec<Option<Row>>,
}

/// A simulation that is seen.
struct Row {
    view: View,
    feed: Feed,
    seed: Seed,
    /// The states of all control steps so far: a late image shows an earlier one.
    states: Vec<f64>,
    /// The last frame of each image, which is in its buffer.
    shown: Vec<Option<Frame>>,
}

impl EyesWorker for Worker {
    fn start(&mut self, row: usize, scenario: &Scenario, seed: Seed, state: &[f64]) {
        let Worker { eyes, renderer, rows } = self;
        rows[row] = Some(Row {
            view: eyes.view.under(&eyes.space, scenario, renderer.poses(state)),
            feed: eyes.feed.start(scenario, seed),
            seed,
            states: Vec::with_capacity((eyes.episode_steps + 1) * state.len()),
            shown: vec![None; eyes.images.len()],
        });
    }

    fn look(&mut self, row: usize, step: usize, state: &[f64], images: Option<&mut [u8]>) {
        let Some(Row { view, feed, seed, states, shown }) = &mut self.rows[row] else { return };
        states.extend_from_slice(state);
        let frames = feed.next(step);
        let Some(mut rest) = images else { return };
        for ((camera, size), shown) in self.eyes.images.iter().zip(shown) {
            let (rgb, others) = std::mem::take(&mut rest).split_at_mut(3 * size.pixels());
            rest = others;
            let frame = frames[*camera];
            // A frozen image is still in the buffer.
            if *shown == Some(frame) {
                continue;
            }
            *shown = Some(frame);
            let camera = Camera { size: *size, ..view.cameras[frame.camera].clone() };
            let state_at = |step: usize| &states[step * state.len()..][..state.len()];
            let shot = frame.shot(&view.scene, &camera, state_at, *seed);
            self.renderer.render(&shot, &mut Output { rgb: Some(rgb), depth: None, segments: None });
        }
    }
}
