//! The rays of an image, and which of its pixels a shape may cover.

use crate::camera::Camera;
use crate::lanes::{LANES, Lanes};
use crate::vector::{Pose, add, dot, scale, sub};

/// The rays of an image: those of pixel (x, y) start at `eye` and go along
/// `forward + u(x) right + v(y) up`, so that a ray's parameter is the distance along the axis.
#[derive(Clone, Copy, Debug)]
pub(crate) struct View {
    pub eye: [f32; 3],
    pub right: [f32; 3],
    pub up: [f32; 3],
    pub forward: [f32; 3],
    /// Slopes at the center of the first pixel.
    pub first: [f32; 2],
    /// Change of a slope from pixel to pixel.
    pub step: f32,
    pub width: usize,
    pub height: usize,
}

/// The pixels of a rectangle: the first and the last column and row.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Rectangle {
    pub columns: [usize; 2],
    pub rows: [usize; 2],
}

impl View {
    /// Returns the rays of a camera on a body with this pose. `pixel` moves them in the pixels, and
    /// `lens` on the lens, m.
    pub fn new(camera: &Camera, body: &Pose, pixel: [f32; 2], lens: [f32; 2]) -> View {
        let pose = body.of(&camera.pose.tilted(camera.tilt));
        let [right, up, back] = pose.axes;
        let width = camera.size.width();
        let height = camera.size.height();
        let step = 1.0 / (camera.focal_length * height as f32);
        // The focus of a pinhole has no meaning, and may be 0.
        let turn = lens.map(|v| if v == 0.0 { 0.0 } else { v / camera.optics.focus });
        View {
            eye: add(pose.position, add(scale(right, lens[0]), scale(up, lens[1]))),
            right,
            up,
            forward: scale(back, -1.0),
            first: [
                (0.5 + pixel[0] - 0.5 * width as f32) * step - turn[0],
                (0.5 * height as f32 - 0.5 - pixel[1]) * step - turn[1],
            ],
            step,
            width,
            height,
        }
    }

    /// Returns the slopes to the right of the rays of the pixels from column `8 packet`.
    #[inline(always)]
    pub fn u(&self, packet: usize) -> Lanes {
        let mut out = [0.0; LANES];
        for (lane, out) in out.iter_mut().enumerate() {
            *out = self.first[0] + (LANES * packet + lane) as f32 * self.step;
        }
        Lanes(out)
    }

    /// Returns the slope upwards of the rays of a row.
    #[inline(always)]
    pub fn v(&self, row: usize) -> f32 {
        self.first[1] - row as f32 * self.step
    }

    /// Returns the direction of the rays with these slopes.
    #[inline(always)]
    pub fn direction(&self, u: f32, v: f32) -> [f32; 3] {
        add(self.forward, add(scale(self.right, u), scale(self.up, v)))
    }

    /// Returns the whole image.
    pub fn whole(&self) -> Rectangle {
        Rectangle { columns: [0, self.width - 1], rows: [0, self.height - 1] }
    }

    /// Returns the pixels that a box may cover, if it covers any.
    pub fn bounds(&self, pose: &Pose, center: [f32; 3], half: [f32; 3]) -> Option<Rectangle> {
        if !half.iter().all(|half| half.is_finite()) {
            return Some(self.whole());
        }
        let middle = sub(pose.point(center), self.eye);
        let middle = [self.right, self.up, self.forward].map(|axis| dot(middle, axis));
        let sides = [0, 1, 2].map(|i| {
            let side = scale(pose.axes[i], half[i]);
            [self.right, self.up, self.forward].map(|axis| dot(side, axis))
        });
        let mut low = [f32::INFINITY; 2];
        let mut high = [f32::NEG_INFINITY; 2];
        let mut in_front = false;
        let mut behind = false;
        for corner in 0..8 {
            let mut p = middle;
            for (i, side) in sides.iter().enumerate() {
                p = if corner >> i & 1 == 0 { sub(p, *side) } else { add(p, *side) };
            }
            if p[2] <= NEAR {
                behind = true;
                continue;
            }
            in_front = true;
            for i in 0..2 {
                let slope = p[i] / p[2];
                low[i] = low[i].min(slope);
                high[i] = high[i].max(slope);
            }
        }
        match (in_front, behind) {
            (false, _) => None,
            // A box on both sides of the lens may cover anything.
            (true, true) => Some(self.whole()),
            (true, false) => self.rectangle(low, high),
        }
    }

    /// Returns the pixels with slopes from `low` to `high`.
    fn rectangle(&self, low: [f32; 2], high: [f32; 2]) -> Option<Rectangle> {
        let columns =
            range((low[0] - self.first[0]) / self.step, (high[0] - self.first[0]) / self.step, self.width)?;
        let rows =
            range((self.first[1] - high[1]) / self.step, (self.first[1] - low[1]) / self.step, self.height)?;
        Some(Rectangle { columns, rows })
    }
}

/// Distance along the axis at which a corner of a box is no longer in front of the lens, m.
const NEAR: f32 = 1e-3;

/// Returns the pixels between two places, and one more at each side for rounding.
fn range(low: f32, high: f32, count: usize) -> Option<[usize; 2]> {
    let low = low.floor() - 1.0;
    let high = high.ceil() + 1.0;
    if high < 0.0 || low > (count - 1) as f32 {
        return None;
    }
    Some([low.max(0.0) as usize, (high as usize).min(count - 1)])
}
