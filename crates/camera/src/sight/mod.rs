//! The sight of the cameras of a target in a scenario.
//!
//! A [`Sight`] names the cameras of a target and has its axes of sight, which change images and no
//! physics: environments ignore them. Each [`Factor`] has a space for each severity. A [`View`] is
//! the scene with the cameras under a scenario, a [`Feed`] says which state each camera shows in a
//! control step, [`SightEyes`] render both for a controller that sees, and [`Sighting`] measures
//! whether anyone could see the object. An [`ImageFeed`] does to images of other renderers what
//! axes of images and camera faults do.

mod axes;
mod cameras;
mod corruption;
mod distractor;
mod eyes;
mod factor;
mod feed;
mod images;
mod part;
mod placing;
mod set;
mod sighting;
mod view;

pub use axes::{CAMERA_FAULTS, MOST_DISTRACTORS};
pub use cameras::{Sight, SightCamera};
pub use eyes::{SightEyes, image_size};
pub use factor::{Factor, SEVERITIES, severity_space};
pub use feed::{Feed, Frame};
pub use images::ImageFeed;
pub use part::{Part, PartBodies};
pub use sighting::Sighting;
pub use view::View;
