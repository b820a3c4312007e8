//! From light to bytes: what lens, sensor and processing do.

use std::ops::Range;

use mishandle_random::{Seed, Stream};

use crate::camera::{Camera, DeadRows, Effects, Patch, Size};
use crate::compression::compress;
use crate::lanes::Lanes3;

/// Largest standard deviation of a blur, pixels: its time grows with the square.
const WIDEST_BLUR: f32 = 32.0;

/// Turns the light of pixels into bytes. Its buffers grow to the largest image.
#[derive(Debug, Default)]
pub struct Developer {
    /// Red, green and blue of each pixel.
    planes: [Vec<f32>; 3],
    scratch: Vec<f32>,
}

impl Developer {
    /// Writes the image whose light is in packets of eight pixels of a row.
    ///
    /// # Panics
    /// If the length of `rgb` is not three times the number of pixels.
    pub(crate) fn develop(
        &mut self,
        colors: &[Lanes3],
        packets: usize,
        camera: &Camera,
        seed: Seed,
        step: u64,
        rgb: &mut [u8],
    ) {
        let width = camera.size.width();
        let height = camera.size.height();
        assert_eq!(rgb.len(), 3 * width * height, "three bytes for each pixel");
        for (channel, plane) in self.planes.iter_mut().enumerate() {
            plane.clear();
            for row in colors.chunks(packets).take(height) {
                let lanes = row.iter().flat_map(|packet| &packet[channel].0);
                plane.extend(lanes.take(width));
            }
        }
        self.finish(camera, seed, step, rgb);
    }

    /// Does to the image of another camera what the effects of this one do. Nominal effects change
    /// no byte.
    ///
    /// # Panics
    /// If the length of `rgb` is not three times the number of pixels of the camera.
    pub fn develop_again(&mut self, camera: &Camera, seed: Seed, step: u64, rgb: &mut [u8]) {
        assert_eq!(rgb.len(), 3 * camera.size.pixels(), "three bytes for each pixel");
        for (channel, plane) in self.planes.iter_mut().enumerate() {
            plane.clear();
            plane.extend(rgb.as_chunks::<3>().0.iter().map(|pixel| f32::from(pixel[channel]) / 255.0));
        }
        self.finish(camera, seed, step, rgb);
    }

    fn finish(&mut self, camera: &Camera, seed: Seed, step: u64, rgb: &mut [u8]) {
        let width = camera.size.width();
        let effects = &camera.effects;
        self.darken_corners(effects.vignette, width);
        self.cover(&effects.patch, camera.size);
        self.blur(effects.blur, width);
        self.amplify(effects);
        self.add_noise(effects, seed, step);
        self.cut_rows(&effects.dead_rows, camera.size);
        if effects.compression > 0.0 {
            compress(&mut self.planes, width, effects.compression);
        }
        for (pixel, out) in rgb.as_chunks_mut::<3>().0.iter_mut().enumerate() {
            *out = [0, 1, 2].map(|channel| byte(self.planes[channel][pixel]));
        }
    }

    fn darken_corners(&mut self, vignette: f32, width: usize) {
        if vignette == 0.0 {
            return;
        }
        let height = self.planes[0].len() / width;
        let place = |index: usize, count: usize| (2 * index + 1) as f32 / count as f32 - 1.0;
        for plane in &mut self.planes {
            for (row, pixels) in plane.chunks_mut(width).enumerate() {
                let y = place(row, height);
                for (column, pixel) in pixels.iter_mut().enumerate() {
                    let x = place(column, width);
                    // The square of the distance from the center is 2 at the corners.
                    let factor = 1.0 - vignette * 0.5 * (x * x + y * y);
                    *pixel *= factor.max(0.0);
                }
            }
        }
    }

    fn cover(&mut self, patch: &Patch, size: Size) {
        let [columns, rows] = patch.pixels(size);
        for (plane, color) in self.planes.iter_mut().zip(patch.color) {
            for row in rows.clone() {
                plane[row * size.width()..][columns.clone()].fill(color);
            }
        }
    }

    /// Blurs by passes of three pixels, whose variances add up to that of the Gaussian.
    fn blur(&mut self, deviation: f32, width: usize) {
        let (passes, weight) = blur_passes(deviation);
        let height = self.planes[0].len() / width;
        let scratch = &mut self.scratch;
        for plane in &mut self.planes {
            for _ in 0..passes {
                for pixels in plane.chunks_mut(width) {
                    let mut before = pixels[0];
                    for column in 0..width {
                        let now = pixels[column];
                        let after = pixels[(column + 1).min(width - 1)];
                        pixels[column] = now + weight * ((before - now) + (after - now));
                        before = now;
                    }
                }
                scratch.clone_from(plane);
                for row in 0..height {
                    let [before, after] = [row.saturating_sub(1), (row + 1).min(height - 1)];
                    for column in 0..width {
                        let [before, now, after] =
                            [before, row, after].map(|row| scratch[row * width + column]);
                        plane[row * width + column] = now + weight * ((before - now) + (after - now));
                    }
                }
            }
        }
    }

    fn amplify(&mut self, effects: &Effects) {
        for (plane, factor) in self.planes.iter_mut().zip(effects.factors()) {
            if factor != 1.0 {
                plane.iter_mut().for_each(|pixel| *pixel *= factor);
            }
        }
    }

    fn add_noise(&mut self, effects: &Effects, seed: Seed, step: u64) {
        let read = effects.read_noise;
        let shot = effects.shot_noise;
        if read == 0.0 && shot == 0.0 {
            return;
        }
        let read = read * read;
        let shot = shot * shot;
        let mut index = 0;
        let mut spare = None;
        for pixel in self.planes.iter_mut().flatten() {
            let normal = spare.take().unwrap_or_else(|| {
                let [a, b] = normal_pair(seed, step, index);
                index += 1;
                spare = Some(b);
                a
            });
            // Light above white saturates the sensor.
            let light = pixel.clamp(0.0, 1.0);
            *pixel = pixel.min(1.0) + (read + shot * light).sqrt() * normal;
        }
    }

    fn cut_rows(&mut self, dead_rows: &DeadRows, size: Size) {
        let rows = dead_rows.rows(size);
        for plane in &mut self.planes {
            plane[rows.start * size.width()..rows.end * size.width()].fill(0.0);
        }
    }
}

impl Effects {
    /// Returns the factors of red, green and blue.
    pub(crate) fn factors(&self) -> [f32; 3] {
        self.color_cast.map(|cast| self.exposure * cast)
    }
}

impl Patch {
    /// Returns the columns and the rows that the patch covers.
    pub(crate) fn pixels(&self, size: Size) -> [Range<usize>; 2] {
        let sides = [size.width(), size.height()];
        [0, 1].map(|axis| {
            if self.size.iter().all(|size| *size > 0.0) {
                let edge = |side: f32| self.center[axis] + side * 0.5 * self.size[axis];
                whole(edge(-1.0), sides[axis])..whole(edge(1.0), sides[axis])
            } else {
                0..0
            }
        })
    }
}

impl DeadRows {
    /// Returns the rows without a signal.
    pub(crate) fn rows(&self, size: Size) -> Range<usize> {
        let edge = |share: f32| whole(share, size.height());
        if self.share > 0.0 { edge(self.first)..edge(self.first + self.share) } else { 0..0 }
    }
}

/// Returns the pixel at a place, a fraction of `count` pixels.
fn whole(place: f32, count: usize) -> usize {
    (place * count as f32 + 0.5).clamp(0.0, count as f32) as usize
}

/// Returns the number of passes of a blur with this standard deviation, pixels, and the weight of
/// each neighbor of a pixel in a pass.
pub(crate) fn blur_passes(deviation: f32) -> (usize, f32) {
    if deviation <= 0.0 {
        return (0, 0.0);
    }
    let deviation = deviation.min(WIDEST_BLUR);
    let variance = deviation * deviation;
    let passes = (2.0 * variance).ceil().max(1.0);
    // The variance of (w, 1 - 2 w, w) is 2 w.
    (passes as usize, 0.5 * variance / passes)
}

/// Returns two independent random numbers with mean 0 and variance 1: sums of eight random bytes
/// each, which need no logarithm. Their excess kurtosis is -0.15.
pub(crate) fn normal_pair(seed: Seed, step: u64, index: u32) -> [f32; 2] {
    let words = seed.block(Stream::CameraNoise, step, index);
    let sum = |a: u32, b: u32| {
        let sum: u32 = a.to_le_bytes().iter().chain(&b.to_le_bytes()).map(|byte| u32::from(*byte)).sum();
        // The mean of the sum is 8 * 127.5, and its variance 8 (256^2 - 1) / 12 = 43690.
        (sum as f32 - 1020.0) * (1.0 / 209.021_53)
    };
    [sum(words[0], words[1]), sum(words[2], words[3])]
}

/// Returns the byte of a brightness from 0 to 1.
fn byte(value: f32) -> u8 {
    (value * 255.0 + 0.5) as u8
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn an_image_of_another_camera_keeps_its_bytes_at_nominal_and_gets_darker_by_half() {
        let size = Size::new(16, 16).unwrap();
        let points = [[0.0, 0.0, 1.0], [0.0; 3], [0.0, 1.0, 0.0]];
        let mut camera = Camera::looking(size, 0, points, 1.0);
        let bytes: Vec<u8> = (0..3 * 256).map(|index| (index / 3) as u8).collect();
        let mut developer = Developer::default();
        let mut rgb = bytes.clone();
        developer.develop_again(&camera, Seed(1), 2, &mut rgb);
        assert_eq!(rgb, bytes);
        camera.effects.exposure = 0.5;
        developer.develop_again(&camera, Seed(1), 2, &mut rgb);
        assert!(rgb.iter().zip(&bytes).all(|(half, byte)| half.abs_diff(byte / 2) <= 1));
    }

    #[test]
    fn noise_has_mean_zero_and_variance_one() {
        let pairs: Vec<f64> =
            (0..100_000).flat_map(|index| normal_pair(Seed(5), 3, index)).map(f64::from).collect();
        let n = pairs.len() as f64;
        let mean = pairs.iter().sum::<f64>() / n;
        let variance = pairs.iter().map(|x| (x - mean) * (x - mean)).sum::<f64>() / n;
        assert!(mean.abs() < 5.0 / n.sqrt(), "{mean}");
        assert!((variance - 1.0).abs() < 5.0 * (2.0 / n).sqrt(), "{variance}");
        // The two numbers of a pair are independent.
        let product = pairs.chunks(2).map(|pair| pair[0] * pair[1]).sum::<f64>() / (n / 2.0);
        assert!(product.abs() < 5.0 / (n / 2.0).sqrt(), "{product}");
    }
}
