//! Palettes: at most 255 colors for the pixels of a film.

use super::{Color, Picture};

/// Number of colors of a palette. One index of a byte is left for transparent pixels.
const COLORS: usize = 255;

/// Bits of each channel that distinguish colors before the palette is made.
const BITS: u32 = 5;

/// Pixels with nearly the same color.
#[derive(Clone, Copy)]
struct Cell {
    index: usize,
    count: u64,
    sum: [u64; 3],
}

impl Cell {
    fn mean(&self, channel: usize) -> u64 {
        self.sum[channel] / self.count.max(1)
    }
}

/// The palette of some pictures, by median cut.
///
/// # Reference
/// Heckbert, "Color image quantization for frame buffer display", SIGGRAPH 1982.
pub(super) struct Palette {
    pub colors: Vec<Color>,
    /// Index of the color of each cell.
    indices: Vec<u8>,
}

impl Palette {
    pub(super) fn new<'a>(pictures: impl Iterator<Item = &'a Picture>) -> Palette {
        let cells = 1 << (3 * BITS);
        let mut all: Vec<Cell> = (0..cells).map(|index| Cell { index, count: 0, sum: [0; 3] }).collect();
        for pixel in pictures.flat_map(|picture| picture.pixels().as_chunks::<3>().0) {
            let cell = &mut all[cell(*pixel)];
            cell.count += 1;
            cell.sum.iter_mut().zip(pixel).for_each(|(sum, value)| *sum += u64::from(*value));
        }
        all.retain(|cell| cell.count > 0);
        let mut boxes = vec![all];
        while boxes.len() < COLORS {
            let Some((widest, (_, channel))) = boxes
                .iter()
                .map(|cells| spread(cells))
                .enumerate()
                .filter(|(_, (spread, _))| *spread > 0)
                .max_by_key(|(index, (spread, _))| (*spread, usize::MAX - index))
            else {
                break;
            };
            let mut cells = boxes.swap_remove(widest);
            cells.sort_unstable_by_key(|cell| (cell.mean(channel), cell.index));
            let half = cells.iter().map(|cell| cell.count).sum::<u64>() / 2;
            let mut below = 0;
            let middle = cells.iter().position(|cell| {
                below += cell.count;
                below > half
            });
            let rest = cells.split_off(middle.unwrap_or(1).clamp(1, cells.len() - 1));
            boxes.extend([cells, rest]);
        }
        let mut palette = Palette { colors: Vec::new(), indices: vec![0; cells] };
        for (index, cells) in boxes.iter().enumerate() {
            let count = cells.iter().map(|cell| cell.count).sum::<u64>().max(1);
            let mean = |channel| (cells.iter().map(|cell| cell.sum[channel]).sum::<u64>() / count) as u8;
            palette.colors.push([mean(0), mean(1), mean(2)]);
            cells.iter().for_each(|cell| palette.indices[cell.index] = index as u8);
        }
        palette
    }

    /// Returns the index of each pixel's color.
    pub(super) fn indices(&self, picture: &Picture) -> Vec<u8> {
        picture.pixels().as_chunks::<3>().0.iter().map(|pixel| self.indices[cell(*pixel)]).collect()
    }
}

/// Returns the range of the channel with the largest one, weighted with the number of pixels, and
/// the channel.
fn spread(cells: &[Cell]) -> (u64, usize) {
    if cells.len() < 2 {
        return (0, 0);
    }
    let range = |channel: usize| {
        let means = || cells.iter().map(|cell| cell.mean(channel));
        means().max().unwrap_or(0) - means().min().unwrap_or(0)
    };
    let (range, channel) = (0..3).map(|channel| (range(channel), channel)).max().unwrap_or((0, 0));
    let pixels = cells.iter().map(|cell| cell.count).sum::<u64>();
    // The square root, so that a small object of another color keeps its colors.
    ((range + 1) * pixels.isqrt(), channel)
}

fn cell(pixel: Color) -> usize {
    pixel.iter().fold(0, |index, value| (index << BITS) | usize::from(*value >> (8 - BITS)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn few_colors_stay_as_they_are() {
        let mut picture = Picture::new(30, 30, [200, 210, 220]);
        picture.fill(3, 3, 2, 1, [240, 140, 20]);
        let palette = Palette::new([&picture].into_iter());
        let again: Vec<u8> =
            palette.indices(&picture).iter().flat_map(|index| palette.colors[usize::from(*index)]).collect();
        assert_eq!(again, picture.pixels());
    }

    #[test]
    fn many_colors_become_255_near_ones() {
        let mut picture = Picture::new(64, 64, [0; 3]);
        for index in 0..64 * 64 {
            let column = index % 64;
            let row = index / 64;
            picture.fill(column, row, 1, 1, [4 * column as u8, 4 * row as u8, 128]);
        }
        let palette = Palette::new([&picture].into_iter());
        assert_eq!(palette.colors.len(), 255);
        let indices = palette.indices(&picture);
        let far = picture.pixels().as_chunks::<3>().0.iter().zip(&indices).map(|(pixel, index)| {
            let color = palette.colors[usize::from(*index)];
            pixel.iter().zip(color).map(|(a, b)| a.abs_diff(b)).max().unwrap_or(0)
        });
        assert!(far.max() <= Some(24), "16 steps of 16 in each direction would do");
    }
}
