//! Whether anyone could see the object in an image.

use mishandle_camera::{Camera, NO_SHAPE, Output, Poses, Renderer, Scene, Shot};
use mishandle_random::Seed;

use super::part::Part;
use super::view::View;

/// The least contrast of an object that a person sees: the smallest difference of brightness that
/// displays and eyes resolve is a hundredth of white or less; this is a few of them.
const LEAST_CONTRAST: f64 = 0.02;

/// The least number of pixels, and the least share of the object, that a person needs.
const LEAST_PIXELS: usize = 3;
const LEAST_SHARE: f64 = 0.1;

/// What an image shows of the object.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sighting {
    /// Number of its pixels.
    pub pixels: usize,
    /// Share of its pixels that nothing hides: other shapes, or the edge of the image when it is
    /// not in it at all.
    pub visible_share: f64,
    /// Difference of its mean color and that of the pixels around it, as a fraction of white: the
    /// largest one of red, green and blue.
    pub contrast: f64,
}

impl Sighting {
    /// Returns whether a person could see the object.
    pub fn is_visible(&self) -> bool {
        self.pixels >= LEAST_PIXELS && self.visible_share >= LEAST_SHARE && self.contrast >= LEAST_CONTRAST
    }
}

/// Measures what images show of the object.
#[derive(Debug, Default)]
pub struct Witness {
    renderer: Renderer,
    rgb: Vec<u8>,
    segments: Vec<u16>,
    alone: Vec<u16>,
}

impl Witness {
    /// Measures an image of a state, without its noise's seed. Returns `None` for a task without an
    /// object.
    pub fn look(&mut self, view: &View, camera: &Camera, poses: &Poses, step: u64) -> Option<Sighting> {
        let is_object = |shape: u16| shape != NO_SHAPE && view.part(usize::from(shape)) == Some(Part::Object);
        let object: Vec<usize> =
            (0..view.scene.shapes.len()).filter(|shape| view.part(*shape) == Some(Part::Object)).collect();
        if object.is_empty() {
            return None;
        }
        let pixels = camera.size.pixels();
        self.rgb.resize(3 * pixels, 0);
        self.segments.resize(pixels, 0);
        self.alone.resize(pixels, 0);
        let (rgb, segments) = (&mut self.rgb, &mut self.segments);
        shoot(&mut self.renderer, (&view.scene, camera, poses, step), rgb, segments);
        let alone = Scene {
            shapes: object.iter().map(|shape| view.scene.shapes[*shape].clone()).collect(),
            ..view.scene.clone()
        };
        let mut unused = vec![0; 3 * pixels];
        shoot(&mut self.renderer, (&alone, camera, poses, step), &mut unused, &mut self.alone);
        let seen = self.segments.iter().filter(|shape| is_object(**shape)).count();
        let whole = self.alone.iter().filter(|shape| **shape != NO_SHAPE).count();
        let visible_share = if whole == 0 { 0.0 } else { seen as f64 / whole as f64 };
        let contrast = contrast(&self.rgb, &self.segments, camera.size.width(), is_object);
        Some(Sighting { pixels: seen, visible_share, contrast })
    }
}

fn shoot(
    renderer: &mut Renderer,
    (scene, camera, poses, step): (&Scene, &Camera, &Poses, u64),
    rgb: &mut [u8],
    segments: &mut [u16],
) {
    let shot = Shot { scene, poses, before: None, camera, seed: Seed(0), step };
    renderer.render(&shot, &mut Output { rgb, depth: None, segments: Some(segments) });
}

/// Returns the difference of the mean colors of an object and of the pixels within two of it.
fn contrast(rgb: &[u8], segments: &[u16], width: usize, is_object: impl Fn(u16) -> bool) -> f64 {
    let height = segments.len() / width;
    let (mut inside, mut around) = (([0.0; 3], 0.0), ([0.0; 3], 0.0));
    for (index, shape) in segments.iter().enumerate() {
        let (x, y) = (index % width, index / width);
        let near = || {
            let rows = y.saturating_sub(2)..(y + 3).min(height);
            rows.flat_map(|row| {
                (x.saturating_sub(2)..(x + 3).min(width)).map(move |column| row * width + column)
            })
            .any(|other| is_object(segments[other]))
        };
        let sum = match is_object(*shape) {
            true => &mut inside,
            false if near() => &mut around,
            false => continue,
        };
        (0..3).for_each(|i| sum.0[i] += f64::from(rgb[3 * index + i]) / 255.0);
        sum.1 += 1.0;
    }
    if inside.1 == 0.0 || around.1 == 0.0 {
        return 0.0;
    }
    (0..3).map(|i| (inside.0[i] / inside.1 - around.0[i] / around.1).abs()).fold(0.0, f64::max)
}
