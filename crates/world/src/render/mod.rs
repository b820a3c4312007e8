//! Pictures of a scene: cameras for people, marks of contacts, captions, image files, and
//! MuJoCo's renderer, without a display.
//!
//! The renderer in the module `enabled` is used with the feature `render`. Without it, the one of
//! `disabled` is an error with the command to build with the feature.

use std::sync::Arc;

use crate::{Assets, Model, Visuals, WorldError};

mod animation;
mod caption;
mod contacts;
#[cfg(feature = "render")]
mod enabled;
#[cfg(feature = "render")]
mod light;
mod palette;
mod picture;
mod stage;
mod view;
#[cfg(feature = "render")]
pub use enabled::Renderer;

pub use animation::{animated_png, png};
pub use caption::{Caption, CaptionLayout, CaptionPart, TimeBar};
pub use contacts::Arrow;
pub use picture::{Color, Picture};
pub use stage::{Stage, Viewpoint};

#[cfg(not(feature = "render"))]
mod disabled;
#[cfg(not(feature = "render"))]
pub use disabled::Renderer;

/// The scene of pictures, with all its visual elements.
#[derive(Clone, Debug)]
pub struct PictureModel {
    /// The MJCF document. A state of the model without visual elements fits that with them.
    pub document: String,
    /// The files that it refers to.
    pub assets: Arc<Assets>,
    /// The body that the camera `close` follows. Without one it is the first body of the robot with
    /// a free joint, or the last one of its longest chain of joints.
    pub follows: Option<String>,
    /// Whether the document is of others: a child process tries it before this process compiles it.
    pub is_untrusted: bool,
}

impl PictureModel {
    /// Makes the model of a document of our own that refers to no files.
    pub fn new(document: impl Into<String>) -> PictureModel {
        PictureModel { document: document.into(), assets: Arc::default(), follows: None, is_untrusted: false }
    }

    /// Makes the model of a document of others and the files that it refers to.
    pub fn from_untrusted(document: impl Into<String>, assets: Arc<Assets>) -> PictureModel {
        PictureModel { assets, is_untrusted: true, ..PictureModel::new(document) }
    }

    /// Compiles the model.
    ///
    /// # Errors
    /// If MuJoCo rejects the document.
    pub fn compile(&self) -> Result<Model, WorldError> {
        if self.is_untrusted {
            Model::from_untrusted(&self.document, &self.assets, Visuals::Keep)
        } else {
            Model::from_xml_with_assets(&self.document, &self.assets)
        }
    }
}

/// The width and height of an image in pixels. Both are even, as video encoders require.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Size {
    width: u32,
    height: u32,
}

/// Names of the cameras that every scene has. `auto` is the camera `view` of the scene if it has
/// one, otherwise a view from a corner; `front`, `left`, `right` and `back` are sides of the robot,
/// and `close` follows its hand or its base.
pub const CAMERAS: [&str; 7] = ["auto", "front", "left", "right", "back", "top", "close"];

/// Quality of a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Quality {
    /// One light. Shadows have hard edges.
    Fast,
    /// Soft shadows, and smooth edges of all objects. Without a graphics card this takes about four
    /// times as long.
    Fine,
}

impl Size {
    /// The allowed widths and heights. OpenGL 4.1 and later support the maximum.
    pub const RANGE: std::ops::RangeInclusive<u32> = 16..=4096;

    /// Creates a size; `None` unless both sides are even and in [`RANGE`](Self::RANGE).
    ///
    /// # Example
    /// ```
    /// use mishandle_world::Size;
    /// assert_eq!(Size::new(960, 720).unwrap().width(), 960);
    /// assert!(Size::new(961, 720).is_none());
    /// assert!(Size::new(960, 0).is_none());
    /// ```
    pub fn new(width: u32, height: u32) -> Option<Size> {
        let fits = |side: u32| Self::RANGE.contains(&side) && side.is_multiple_of(2);
        (fits(width) && fits(height)).then_some(Size { width, height })
    }

    /// Returns the width in pixels.
    pub fn width(&self) -> u32 {
        self.width
    }

    /// Returns the height in pixels.
    pub fn height(&self) -> u32 {
        self.height
    }
}
