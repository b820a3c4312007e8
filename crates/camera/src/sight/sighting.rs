//! Whether anyone could see the object in an image.

use crate::{NO_SHAPE, Scene};

use crate::sight::part::Part;
use crate::sight::view::View;

/// The least contrast of an object that a person sees. A hundredth of white is one or two steps of
/// the brightness of an image; this is a few of them.
const LEAST_CONTRAST: f64 = 0.02;

/// The least number of pixels, and the least share of the object, that a person needs.
const LEAST_PIXELS: usize = 3;
const LEAST_SHARE: f64 = 0.1;

/// Pixels up to this distance from the object are around it.
const NEAR: usize = 2;

/// The object in an image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sighting {
    /// Number of its pixels.
    pub pixels: usize,
    /// Share of its pixels that no other shape hides; 0 if the object is not in the image.
    pub visible_share: f64,
    /// Difference of its mean color and that of the pixels around it, as a fraction of white: the
    /// largest one of red, green and blue. 0 if one of them has no pixels.
    pub contrast: f64,
}

impl Sighting {
    /// Measures an image of a view with its segments. `alone` are the segments of the same image of
    /// [`View::object_alone`].
    ///
    /// # Panics
    /// If the lengths of the slices differ from those of an image with this width.
    pub fn new(view: &View, width: usize, rgb: &[u8], segments: &[u16], alone: &[u16]) -> Sighting {
        let is_object =
            |shape: &u16| *shape != NO_SHAPE && view.part(usize::from(*shape)) == Some(Part::Object);
        let pixels = segments.iter().filter(|shape| is_object(shape)).count();
        let whole = alone.iter().filter(|shape| **shape != NO_SHAPE).count();
        let visible_share = if whole == 0 { 0.0 } else { pixels as f64 / whole as f64 };
        let mask: Vec<bool> = segments.iter().map(is_object).collect();
        Sighting { pixels, visible_share, contrast: contrast(rgb, &mask, width) }
    }

    /// Returns whether a person could see the object.
    pub fn is_visible(&self) -> bool {
        self.pixels >= LEAST_PIXELS && self.visible_share >= LEAST_SHARE && self.contrast >= LEAST_CONTRAST
    }
}

impl View {
    /// Returns the scene with nothing but the object.
    pub fn object_alone(&self) -> Scene {
        let is_object = |index: &usize| self.part(*index) == Some(Part::Object);
        let shapes = (0..self.scene.shapes.len()).filter(is_object);
        Scene { shapes: shapes.map(|index| self.scene.shapes[index].clone()).collect(), ..self.scene.clone() }
    }
}

/// Returns the largest difference of the mean colors of an object and of what is around it.
fn contrast(rgb: &[u8], is_object: &[bool], width: usize) -> f64 {
    let height = is_object.len() / width;
    let is_near = |index: usize| {
        let x = index % width;
        let y = index / width;
        let mut rows = y.saturating_sub(NEAR)..(y + NEAR + 1).min(height);
        rows.any(|row| {
            let first = row * width + x.saturating_sub(NEAR);
            is_object[first..row * width + (x + NEAR + 1).min(width)].contains(&true)
        })
    };
    let mut inside = ([0.0; 3], 0.0);
    let mut around = ([0.0; 3], 0.0);
    for (index, is_inside) in is_object.iter().enumerate() {
        let (sum, count) = if *is_inside {
            &mut inside
        } else if is_near(index) {
            &mut around
        } else {
            continue;
        };
        (0..3).for_each(|i| sum[i] += f64::from(rgb[3 * index + i]) / 255.0);
        *count += 1.0;
    }
    if inside.1 == 0.0 || around.1 == 0.0 {
        return 0.0;
    }
    (0..3).map(|i| (inside.0[i] / inside.1 - around.0[i] / around.1).abs()).fold(0.0, f64::max)
}
