//! Which image arrives from each camera in a control step: faults and delays of cameras.

use crate::{Camera, Scene, StateShot};
use mishandle_rollout::{ActiveInterface, Interface, RolloutError, Scenario, Seed, Space};

use crate::sight::cameras::Sight;

/// The image that arrives from a camera.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Frame {
    /// The camera that took it: another one after an exchange.
    pub camera: usize,
    /// The control step in which it was taken.
    pub step: usize,
}

impl Frame {
    /// Returns the shot of this image by `camera`, which is that of the frame. `states` has the
    /// state of each control step so far, and `seed` is that of the simulation.
    pub fn shot<'a>(
        self,
        scene: &'a Scene,
        camera: &'a Camera,
        state: impl Fn(usize) -> &'a [f64],
        seed: Seed,
    ) -> StateShot<'a> {
        StateShot {
            state: state(self.step),
            before: self.step.checked_sub(1).map(state),
            scene,
            camera,
            seed: seed.child(self.camera as u64),
            step: self.step as u64,
        }
    }
}

/// The axes of a space that change which images arrive.
#[derive(Clone, Debug)]
pub(crate) struct FeedAxes {
    /// Their places in the space.
    places: Vec<usize>,
    interface: Interface,
    cameras: usize,
}

impl FeedAxes {
    pub(crate) fn new(sight: &Sight, space: &Space) -> Result<FeedAxes, RolloutError> {
        let is_own = |index: &usize| {
            sight.disturbances.iter().any(|disturbance| disturbance.axis.name == space.axes()[*index].name)
        };
        let places: Vec<usize> = (0..space.axes().len()).filter(is_own).collect();
        let axes = places.iter().map(|index| space.axes()[*index].clone()).collect();
        let interface = Interface::new(&Space::new("faults-camera", axes)?, &sight.disturbances, 0)?;
        Ok(FeedAxes { places, interface, cameras: sight.count() })
    }

    /// Starts a simulation of a scenario.
    pub(crate) fn start(&self, scenario: &Scenario, seed: Seed) -> Feed {
        let values = self.places.iter().map(|index| scenario.get(*index)).collect();
        let active = self.interface.start(&Scenario::new(values), seed);
        let frames = vec![Frame { camera: 0, step: 0 }; self.cameras];
        let has_effects = self.interface.has_effects();
        Feed { active, has_effects, numbers: vec![0.0; frames.len()], frames }
    }
}

/// The images of the cameras in one simulation.
///
/// A fault or a delay moves images and never computes with them, so it acts on their numbers
/// through the same code as on observations.
#[derive(Debug)]
pub struct Feed {
    active: ActiveInterface,
    has_effects: bool,
    numbers: Vec<f64>,
    frames: Vec<Frame>,
}

impl Feed {
    /// Starts a simulation of a scenario.
    ///
    /// # Errors
    /// If two axes of the space have the same name.
    pub fn new(sight: &Sight, space: &Space, scenario: &Scenario, seed: Seed) -> Result<Feed, RolloutError> {
        Ok(FeedAxes::new(sight, space)?.start(scenario, seed))
    }

    /// Returns whether an image ever arrives in another step, or from another camera.
    pub(crate) fn has_effects(&self) -> bool {
        self.has_effects
    }

    /// Returns the image of each camera in a control step. Steps must come in order from 0.
    pub fn next(&mut self, step: usize) -> &[Frame] {
        // Image `step` of camera `c` has the number `step * cameras + c`.
        let cameras = self.numbers.len();
        for (camera, number) in self.numbers.iter_mut().enumerate() {
            *number = (step * cameras + camera) as f64;
        }
        if self.has_effects {
            self.active.observe(step, &mut self.numbers);
        }
        for (frame, number) in self.frames.iter_mut().zip(&self.numbers) {
            let number = *number as usize;
            *frame = Frame { camera: number % cameras, step: number / cameras };
        }
        &self.frames
    }
}
