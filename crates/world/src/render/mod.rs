//! Pictures of a scene, drawn off screen by MuJoCo's own renderer, without a display.
//!
//! With the feature `render` it is `enabled`, without it `disabled`: the same functions, which say how to build with it.

#[cfg(feature = "render")]
mod enabled;
#[cfg(feature = "render")]
mod view;
#[cfg(feature = "render")]
pub use enabled::{Renderer, png};

#[cfg(not(feature = "render"))]
mod disabled;
#[cfg(not(feature = "render"))]
pub use disabled::{Renderer, png};

/// Width and height of a picture, pixels: even numbers, as video encoders want them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Size {
    width: u32,
    height: u32,
}

impl Size {
    /// The smallest and the largest side: every OpenGL since version 4.1 can draw the largest.
    pub const RANGE: std::ops::RangeInclusive<u32> = 16..=4096;

    /// A size; `None` unless both sides are even and in [`RANGE`](Self::RANGE).
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

    /// Width.
    pub fn width(&self) -> u32 {
        self.width
    }

    /// Height.
    pub fn height(&self) -> u32 {
        self.height
    }
}
