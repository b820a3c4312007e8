//! The images of a task in a scenario.
//!
//! Axes of sight change images and no physics: the environment ignores them. A [`View`] is the
//! scene with the cameras under a scenario, a [`Feed`] says which state each camera shows in a
//! control step, and [`Sighting`] whether anyone could see the object.

mod axes;
mod feed;
mod part;
mod set;
mod sighting;
mod view;

pub use axes::SIGHT_SPACES;
pub(crate) use axes::sight_axes;
pub use feed::{Feed, Frame};
pub use part::Part;
pub use sighting::Sighting;
pub use view::View;
