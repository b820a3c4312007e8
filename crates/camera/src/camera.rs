//! Cameras: where they are, what they see of a scene, and what they do to an image.

use crate::material::Color;
use crate::vector::{Pose, cross, dot, sub, unit};

/// Width and height of an image, pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Size {
    width: u16,
    height: u16,
}

impl Size {
    /// The largest width and height.
    pub const MAX: u16 = 1024;

    /// Makes a size.
    ///
    /// # Errors
    /// If a side is 0 or larger than [`MAX`](Self::MAX).
    pub fn new(width: usize, height: usize) -> Result<Size, CameraError> {
        let side = |side: usize| u16::try_from(side).ok().filter(|side| (1..=Size::MAX).contains(side));
        match (side(width), side(height)) {
            (Some(width), Some(height)) => Ok(Size { width, height }),
            _ => Err(CameraError::Size { width, height }),
        }
    }

    /// Makes a square of at most [`MAX`](Self::MAX) pixels.
    pub(crate) fn square(side: u16) -> Size {
        let side = side.clamp(1, Size::MAX);
        Size { width: side, height: side }
    }

    /// Returns the width, pixels.
    pub fn width(self) -> usize {
        usize::from(self.width)
    }

    /// Returns the height, pixels.
    pub fn height(self) -> usize {
        usize::from(self.height)
    }

    /// Returns the number of pixels.
    pub fn pixels(self) -> usize {
        self.width() * self.height()
    }
}

/// A camera of this crate that cannot be made.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum CameraError {
    /// A size is out of range.
    #[error("an image of {width} x {height} pixels: each side must be from 1 to {max}", max = Size::MAX)]
    Size {
        /// Width, pixels.
        width: usize,
        /// Height, pixels.
        height: usize,
    },
    /// A model has too many shapes.
    #[error("{0} shapes: a scene has at most {max}", max = crate::NO_SHAPE)]
    Shapes(usize),
    /// Only this crate draws something of a scene.
    #[error("a GPU does not draw {0}")]
    OtherDevice(&'static str),
}

/// A camera, as plain numbers.
#[derive(Clone, Debug, PartialEq)]
pub struct Camera {
    /// Size of the image.
    pub size: Size,
    /// The index of the body that the camera moves with; 0 is the world.
    pub body: usize,
    /// Its pose in the frame of the body: it looks along its -z, and its y is up in images.
    pub pose: Pose,
    /// Turn of the camera about its own x, y and z, rad: up, to the left, and counterclockwise as
    /// seen from behind it.
    pub tilt: [f32; 3],
    /// Focal length, image heights: half the height over the tangent of half the vertical field of
    /// view, over the height.
    pub focal_length: f32,
    /// Lens and shutter.
    pub optics: Optics,
    /// Lens faults, sensor and processing.
    pub effects: Effects,
}

/// Lens and shutter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Optics {
    /// Rays per pixel. One ray goes through the center of the pixel; more are spread over its area,
    /// the lens and the time of exposure.
    pub samples: u32,
    /// Radius of the lens, m. 0 is a pinhole, before which everything is sharp.
    pub aperture: f32,
    /// Distance along the axis at which a lens with a radius is sharp, m.
    pub focus: f32,
    /// Time of exposure, as a fraction of the time since the state before. 0 is an instant.
    pub shutter: f32,
}

/// Effects on the light of an image. Nominal effects change no bit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Effects {
    /// Darkening of the corners, as a fraction.
    pub vignette: f32,
    /// Standard deviation of a Gaussian blur, pixels; at most 32.
    pub blur: f32,
    /// A patch of dirt on the lens.
    pub patch: Patch,
    /// Factor of the brightness.
    pub exposure: f32,
    /// Factors of red, green and blue.
    pub color_cast: Color,
    /// Standard deviation of the noise of a black pixel, as a fraction of white.
    pub read_noise: f32,
    /// Standard deviation of the additional noise of a white pixel, as a fraction of white. Its
    /// variance is proportional to the brightness.
    pub shot_noise: f32,
    /// Rows without a signal.
    pub dead_rows: DeadRows,
    /// Coarseness of a compression as in JPEG: factor of the standard's quantization tables. 1 is a
    /// quality of 50, and 0 does not compress.
    pub compression: f32,
}

/// A rectangle of one color in front of the lens. Lengths are fractions of the image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Patch {
    /// Center, from the left and from the top.
    pub center: [f32; 2],
    /// Width and height. A patch without area is not drawn.
    pub size: [f32; 2],
    /// Color.
    pub color: Color,
}

/// Black rows of a damaged sensor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DeadRows {
    /// Where the rows start, as a fraction of the height from the top.
    pub first: f32,
    /// Their height as a fraction of the image.
    pub share: f32,
}

impl Optics {
    /// A pinhole with one ray per pixel.
    pub const NOMINAL: Optics = Optics { samples: 1, aperture: 0.0, focus: 1.0, shutter: 0.0 };
}

impl Effects {
    /// No effects.
    pub const NOMINAL: Effects = Effects {
        vignette: 0.0,
        blur: 0.0,
        patch: Patch { center: [0.5; 2], size: [0.0; 2], color: [0.08; 3] },
        exposure: 1.0,
        color_cast: [1.0; 3],
        read_noise: 0.0,
        shot_noise: 0.0,
        dead_rows: DeadRows { first: 0.5, share: 0.0 },
        compression: 0.0,
    };
}

impl Camera {
    /// Makes a nominal camera on a body, at `from` looking at `to`, both in the frame of the body,
    /// m, which is where a lens with a radius is sharp. `up` is nearly up in its images.
    pub fn looking(size: Size, body: usize, [from, to, up]: [[f32; 3]; 3], focal_length: f32) -> Camera {
        let way = sub(from, to);
        let back = unit(way);
        let right = unit(cross(up, back));
        let pose = Pose { position: from, axes: [right, cross(back, right), back] };
        Camera {
            size,
            body,
            pose,
            tilt: [0.0; 3],
            focal_length,
            optics: Optics { focus: dot(way, way).sqrt(), ..Optics::NOMINAL },
            effects: Effects::NOMINAL,
        }
    }
}
