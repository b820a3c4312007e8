//! Images that an environment draws itself: their effects and camera faults.

use crate::{Camera, Developer, Poses, Size};
use mishandle_rollout::{RolloutError, Scenario, Seed, Space};

use crate::sight::cameras::Sight;
use crate::sight::feed::Feed;
use crate::sight::view::View;

/// The images of one simulation, which its environment draws, as they arrive from its cameras.
#[derive(Debug)]
pub struct ImageFeed {
    cameras: Vec<Camera>,
    feed: Feed,
    developer: Developer,
    seed: Seed,
    /// The images of all control steps, if later ones may show them again.
    taken: Vec<Vec<Vec<u8>>>,
}

impl ImageFeed {
    /// Starts a simulation of a scenario. `sizes` are those of the images of each camera.
    ///
    /// # Errors
    /// If two axes of the space have the same name.
    ///
    /// # Panics
    /// If the number of sizes is not that of the cameras.
    pub fn new(
        sight: &Sight,
        sizes: &[Size],
        space: &Space,
        scenario: &Scenario,
        seed: Seed,
    ) -> Result<ImageFeed, RolloutError> {
        assert_eq!(sizes.len(), sight.count(), "a size for each camera");
        // Only the effects of these cameras matter.
        let points = [[0.0, 0.0, 1.0], [0.0; 3], [0.0, 1.0, 0.0]];
        let cameras = sizes.iter().map(|size| Camera::looking(*size, 0, points, 1.0)).collect();
        let view = View::without_scene(sight, cameras).under(space, scenario, &Poses::default());
        let feed = Feed::new(sight, space, scenario, seed)?;
        Ok(ImageFeed {
            cameras: view.cameras,
            feed,
            developer: Developer::default(),
            seed,
            taken: Vec::new(),
        })
    }

    /// Replaces the images that the cameras take in a control step by those that arrive. Steps must
    /// come in order from 0. Cameras with images of different sizes exchange none.
    ///
    /// # Panics
    /// If there is another number of images than of cameras, or one has another size.
    pub fn next(&mut self, step: usize, images: &mut [&mut [u8]]) {
        assert_eq!(images.len(), self.cameras.len(), "an image of each camera");
        for (index, (camera, image)) in self.cameras.iter().zip(&mut *images).enumerate() {
            self.developer.develop_again(camera, self.seed.child(index as u64), step as u64, image);
        }
        if !self.feed.has_effects() {
            return;
        }
        self.taken.push(images.iter().map(|image| image.to_vec()).collect());
        for (index, (frame, image)) in self.feed.next(step).iter().zip(images).enumerate() {
            if self.cameras[frame.camera].size == self.cameras[index].size {
                image.copy_from_slice(&self.taken[frame.step][frame.camera]);
            }
        }
    }
}
