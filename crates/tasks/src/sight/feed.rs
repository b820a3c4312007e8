//! Which image arrives from each camera in a control step: faults and delays of cameras.

use mishandle_rollout::{ActiveInterface, Interface, RolloutError, Scenario, Seed, Space};

use super::axes::feed_disturbances;
use crate::cameras::CAMERA_NAMES;

/// The image that arrives from a camera.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Frame {
    /// The camera that took it: another one after an exchange.
    pub camera: usize,
    /// The control step in which it was taken.
    pub step: usize,
}

/// The images of the cameras in one simulation.
///
/// A fault or a delay moves images and never computes with them, so it acts on their numbers
/// through the same code as on observations.
#[derive(Debug)]
pub struct Feed {
    active: ActiveInterface,
    has_effects: bool,
}

impl Feed {
    /// Starts a simulation of a scenario.
    ///
    /// # Errors
    /// If two axes of the space have the same name.
    pub fn new(space: &Space, scenario: &Scenario, seed: Seed) -> Result<Feed, RolloutError> {
        let disturbances = feed_disturbances();
        let is_own = |index: &usize| {
            disturbances.iter().any(|disturbance| disturbance.axis.name == space.axes()[*index].name)
        };
        let own: Vec<usize> = (0..space.axes().len()).filter(is_own).collect();
        let axes = own.iter().map(|index| space.axes()[*index].clone()).collect();
        let values = own.iter().map(|index| scenario.get(*index)).collect();
        let space = Space::new("faults-camera", axes)?;
        let interface = Interface::new(&space, &disturbances, 0)?;
        let active = interface.start(&Scenario::new(values), seed);
        Ok(Feed { active, has_effects: interface.has_effects() })
    }

    /// Returns the image of each camera in a control step. Steps must come in order from 0.
    pub fn next(&mut self, step: usize) -> [Frame; CAMERA_NAMES.len()] {
        // Image `step` of camera `c` has the number `step * cameras + c`.
        let cameras = CAMERA_NAMES.len();
        let mut numbers: [f64; CAMERA_NAMES.len()] =
            std::array::from_fn(|camera| (step * cameras + camera) as f64);
        if self.has_effects {
            self.active.observe(step, &mut numbers);
        }
        numbers.map(|number| {
            let number = number as usize;
            Frame { camera: number % cameras, step: number / cameras }
        })
    }
}
