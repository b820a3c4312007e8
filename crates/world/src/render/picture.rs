//! Images, and text drawn into them.

/// Color of a pixel: red, green, blue.
pub type Color = [u8; 3];

/// An image with three bytes per pixel (red, green, blue), rows from the top.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Picture {
    width: usize,
    height: usize,
    pixels: Vec<u8>,
}

impl Picture {
    /// Creates an image of one color.
    pub fn new(width: usize, height: usize, color: Color) -> Picture {
        Picture { width, height, pixels: color.repeat(width * height) }
    }

    /// Makes an image of pixels that are squares, as large as an image in `most` allows. An image
    /// that is larger than that keeps its size.
    pub fn enlarged(pixels: &[u8], [width, height]: [usize; 2], most: [usize; 2]) -> Picture {
        let factor = (most[0] / width).min(most[1] / height).max(1);
        let mut enlarged = Vec::with_capacity(pixels.len() * factor * factor);
        for row in pixels.chunks(3 * width) {
            let first = enlarged.len();
            row.chunks(3).for_each(|pixel| enlarged.extend(pixel.repeat(factor)));
            (1..factor).for_each(|_| enlarged.extend_from_within(first..first + 3 * width * factor));
        }
        Picture { width: width * factor, height: height * factor, pixels: enlarged }
    }

    /// Returns the width in pixels.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Returns the height in pixels.
    pub fn height(&self) -> usize {
        self.height
    }

    /// Returns the bytes of all pixels.
    pub fn pixels(&self) -> &[u8] {
        &self.pixels
    }

    /// Copies an image of this width, whose first pixel comes to column `left` and row `top`.
    ///
    /// # Panics
    /// If it does not fit.
    pub fn paste(&mut self, left: usize, top: usize, width: usize, pixels: &[u8]) {
        for (row, pixels) in pixels.chunks(3 * width).enumerate() {
            self.pixels[3 * ((top + row) * self.width + left)..][..3 * width].copy_from_slice(pixels);
        }
    }

    /// Fills a rectangle. Parts outside the image are cut.
    pub(super) fn fill(&mut self, left: usize, top: usize, width: usize, height: usize, color: Color) {
        let right = (left + width).min(self.width);
        for row in top..(top + height).min(self.height) {
            for column in left..right {
                self.blend(column, row, color, u8::MAX);
            }
        }
    }

    /// Draws a border inside the edges of a rectangle.
    pub(super) fn border(
        &mut self,
        left: usize,
        top: usize,
        width: usize,
        height: usize,
        thickness: usize,
        color: Color,
    ) {
        let right = left + width - thickness.min(width);
        let bottom = top + height - thickness.min(height);
        self.fill(left, top, width, thickness, color);
        self.fill(left, bottom, width, thickness, color);
        self.fill(left, top, thickness, height, color);
        self.fill(right, top, thickness, height, color);
    }

    /// Mixes a color into a pixel. `weight` is from 0 to 255.
    pub(super) fn blend(&mut self, column: usize, row: usize, color: Color, weight: u8) {
        if column >= self.width || row >= self.height {
            return;
        }
        let pixel = &mut self.pixels[3 * (row * self.width + column)..][..3];
        let weight = u16::from(weight);
        for (value, new) in pixel.iter_mut().zip(color) {
            let mixed = (255 - weight) * u16::from(*value) + weight * u16::from(new) + 127;
            *value = (mixed / 255) as u8;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn enlarged_pixels_are_squares() {
        let rgb = |reds: &[u8]| reds.iter().flat_map(|red| [*red, 0, 9]).collect::<Vec<u8>>();
        let picture = Picture::enlarged(&rgb(&[1, 2]), [2, 1], [5, 7]);
        assert_eq!((picture.width(), picture.height()), (4, 2));
        assert_eq!(picture.pixels(), rgb(&[1, 1, 2, 2, 1, 1, 2, 2]));
        assert_eq!(Picture::enlarged(&rgb(&[1, 2]), [2, 1], [1, 1]).pixels(), rgb(&[1, 2]));
    }

    #[test]
    fn rectangles_are_cut_at_the_edges_and_colors_are_mixed() {
        let mut picture = Picture::new(3, 2, [0, 0, 0]);
        picture.fill(2, 1, 5, 5, [9, 9, 9]);
        picture.blend(0, 0, [255, 0, 51], 128);
        picture.blend(7, 0, [1, 1, 1], 255);
        let mut expected = vec![0; 18];
        expected[..3].copy_from_slice(&[128, 0, 26]);
        expected[15..].fill(9);
        assert_eq!(picture.pixels(), expected);
    }
}
