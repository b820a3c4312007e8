//! The cameras of a target, and its axes of sight.

use std::sync::Arc;

use crate::Lamp;
use mishandle_rollout::{Axis, Disturbance, Image, RolloutError, Space};

use crate::sight::axes::{CAMERA_FAULTS, feed_disturbances, image_axes, sight_axes};
use crate::sight::factor::{Factor, SEVERITIES, SightAxis};
use crate::sight::part::Part;

/// A camera of a target, as its axes see it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SightCamera {
    /// Its name, with which the names of its axes begin.
    pub name: String,
    /// Whether it is mounted on a body; the others stand in the world. A bracket on a body moves
    /// less than a stand.
    pub is_mounted: bool,
}

/// The cameras of a target, and its axes of sight.
#[derive(Clone, Debug)]
pub struct Sight {
    cameras: Vec<SightCamera>,
    /// Direction to the nominal lamp, of any length.
    pub(crate) lamp: [f64; 3],
    pub(crate) axes: Arc<[SightAxis]>,
    pub(crate) disturbances: Vec<Disturbance>,
    /// Control steps of an episode.
    pub(crate) episode_steps: usize,
}

impl Sight {
    /// Makes the sight of a target with at least one camera. `parts` are those that its scene has,
    /// `lamp` is the direction to its lamp for a vertical part of 1, and an episode has
    /// `episode_steps` control steps of `control_dt` s.
    pub fn new(
        cameras: Vec<SightCamera>,
        parts: &[Part],
        lamp: [f64; 3],
        control_dt: f64,
        episode_steps: usize,
    ) -> Sight {
        let disturbances = feed_disturbances(&cameras, control_dt, episode_steps);
        let axes = sight_axes(&cameras, parts, lamp, &disturbances).into();
        Sight { cameras, lamp, axes, disturbances, episode_steps }
    }

    /// Makes the sight of an environment with images of its own: axes of images that do not need
    /// its scene, and camera faults.
    pub fn of_images(names: Vec<String>, control_dt: f64, episode_steps: usize) -> Sight {
        let camera = |name| SightCamera { name, is_mounted: false };
        let cameras: Vec<SightCamera> = names.into_iter().map(camera).collect();
        let disturbances = feed_disturbances(&cameras, control_dt, episode_steps);
        let axes = image_axes(&disturbances).into();
        let lamp = Lamp::NOMINAL.direction.map(f64::from);
        Sight { cameras, lamp, axes, disturbances, episode_steps }
    }

    /// Returns the names of the axes that make images depend on the seed.
    pub fn random_axes(&self) -> impl Iterator<Item = &str> {
        let faults = self.disturbances.iter().filter(|disturbance| disturbance.effect.is_random());
        let noise = self.axes.iter().filter(|own| own.is_random()).map(|own| &own.axis);
        noise.chain(faults.map(|disturbance| &disturbance.axis)).map(|axis| axis.name.as_str())
    }

    /// Returns the names of the cameras.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.cameras.iter().map(|camera| camera.name.as_str())
    }

    /// Returns the number of cameras.
    pub(crate) fn count(&self) -> usize {
        self.cameras.len()
    }

    /// Returns all axes with the bounds of the largest severity.
    pub fn axes(&self) -> impl Iterator<Item = &Axis> {
        self.axes.iter().map(|own| &own.axis)
    }

    /// Returns the names of the axes that change nothing of these images.
    pub fn unseen_axes(&self, images: &[Image]) -> Vec<String> {
        let is_seen = |index: usize| images.iter().any(|image| image.camera == self.cameras[index].name);
        let is_unseen = |own: &&SightAxis| match own.set.camera() {
            Some(camera) => !is_seen(camera),
            None => images.is_empty(),
        };
        self.axes.iter().filter(is_unseen).map(|own| own.axis.name.clone()).collect()
    }

    /// Returns the spaces of sight: for each factor that has axes, one space per severity, in this
    /// order; then the space of the camera faults.
    ///
    /// # Errors
    /// If two axes have the same name.
    pub fn spaces(&self) -> Result<Vec<Space>, RolloutError> {
        let of_factor = |factor: Option<Factor>, severity: usize| -> Vec<Axis> {
            let own = self.axes.iter().filter(|own| own.factor == factor);
            own.filter_map(|own| own.at(severity)).collect()
        };
        let severities = |(factor, _): (Factor, &str)| {
            (1..=SEVERITIES).map(move |severity| (factor.space(severity), Some(factor), severity))
        };
        let all = Factor::ALL.into_iter().flat_map(severities);
        all.chain([(CAMERA_FAULTS.to_string(), None, SEVERITIES)])
            .map(|(name, factor, severity)| (name, of_factor(factor, severity)))
            .filter(|(_, axes)| !axes.is_empty())
            .map(|(name, axes)| Space::new(&name, axes))
            .collect()
    }
}
