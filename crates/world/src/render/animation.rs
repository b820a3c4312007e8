//! PNG, and animated PNG: films that every browser shows, without scripts and without a video
//! codec.

use png::{BitDepth, BlendOp, ColorType, Compression, DisposeOp, Encoder, EncodingError};

use super::Picture;
use super::palette::Palette;
use crate::WorldError;

/// Index of the transparent color.
const TRANSPARENT: u8 = u8::MAX;

/// Encodes an image as PNG. It has three bytes per pixel and rows from the top.
///
/// # Errors
/// If the number of bytes does not match the size.
pub fn png(width: u32, height: u32, pixels: &[u8]) -> Result<Vec<u8>, WorldError> {
    let mut file = Vec::new();
    let mut encoder = Encoder::new(&mut file, width, height);
    encoder.set_color(ColorType::Rgb);
    encoder.set_depth(BitDepth::Eight);
    encoder.set_compression(Compression::High);
    let written = encoder.write_header().and_then(|mut writer| writer.write_image_data(pixels));
    written.map_err(|error| WorldError::Picture(error.to_string()))?;
    Ok(file)
}

/// Encodes pictures of the same size as an animated PNG, which repeats. Each picture is shown for a
/// number of milliseconds.
///
/// The film has 255 colors, which keeps it small. A frame contains only the rectangle that differs
/// from the frame before it, and its other pixels are transparent.
///
/// # Errors
/// If there is no picture, or the sizes differ.
pub fn animated_png(frames: &[(Picture, u16)]) -> Result<Vec<u8>, WorldError> {
    let is_same_size = |pair: &[(Picture, u16)]| {
        pair[0].0.width() == pair[1].0.width() && pair[0].0.height() == pair[1].0.height()
    };
    if frames.is_empty() || !frames.windows(2).all(is_same_size) {
        return Err(WorldError::Picture("a film needs pictures of one size".to_string()));
    }
    encode(frames).map_err(|error| WorldError::Picture(error.to_string()))
}

fn encode(frames: &[(Picture, u16)]) -> Result<Vec<u8>, EncodingError> {
    let Some((first, delay)) = frames.first() else { return Ok(Vec::new()) };
    let width = first.width() as u32;
    let height = first.height() as u32;
    let mut file = Vec::new();
    let mut encoder = Encoder::new(&mut file, width, height);
    encoder.set_color(ColorType::Indexed);
    let palette = Palette::new(frames.iter().map(|(picture, _)| picture));
    let mut colors = palette.colors.clone();
    colors.resize(usize::from(TRANSPARENT) + 1, [0; 3]);
    encoder.set_palette(colors.into_flattened());
    let mut opacity = vec![u8::MAX; usize::from(TRANSPARENT)];
    opacity.push(0);
    encoder.set_trns(opacity);
    encoder.set_depth(BitDepth::Eight);
    encoder.set_compression(Compression::High);
    encoder.set_animated(frames.len() as u32, 0)?;
    encoder.set_frame_delay(*delay, 1000)?;
    encoder.set_blend_op(BlendOp::Over)?;
    encoder.set_dispose_op(DisposeOp::None)?;
    let mut writer = encoder.write_header()?;
    let mut before = palette.indices(first);
    writer.write_image_data(&before)?;
    for (picture, delay) in frames.iter().skip(1) {
        let after = palette.indices(picture);
        let changed = Changed::new(&before, &after, width as usize);
        writer.set_frame_delay(*delay, 1000)?;
        writer.reset_frame_position()?;
        writer.set_frame_dimension(changed.size.0 as u32, changed.size.1 as u32)?;
        writer.set_frame_position(changed.corner.0 as u32, changed.corner.1 as u32)?;
        writer.write_image_data(&changed.pixels)?;
        before = after;
    }
    writer.finish()?;
    Ok(file)
}

/// The rectangle in which two pictures differ; a pixel if they do not.
struct Changed {
    corner: (usize, usize),
    size: (usize, usize),
    /// Indices of colors, transparent where the pictures are the same.
    pixels: Vec<u8>,
}

impl Changed {
    fn new(before: &[u8], after: &[u8], width: usize) -> Changed {
        let mut left = width;
        let mut top = after.len() / width;
        let mut right = 0;
        let mut bottom = 0;
        for (index, _) in before.iter().zip(after).enumerate().filter(|(_, (before, after))| before != after)
        {
            let column = index % width;
            let row = index / width;
            (left, right) = (left.min(column), right.max(column + 1));
            (top, bottom) = (top.min(row), bottom.max(row + 1));
        }
        if right == 0 {
            (left, top, right, bottom) = (0, 0, 1, 1);
        }
        let pixels = (top..bottom)
            .flat_map(|row| (left..right).map(move |column| row * width + column))
            .map(|index| if before[index] == after[index] { TRANSPARENT } else { after[index] })
            .collect();
        Changed { corner: (left, top), size: (right - left, bottom - top), pixels }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    /// Decodes an animated PNG to the pixels of each frame on its canvas, and the delays.
    fn decoded(file: &[u8]) -> Vec<(Vec<u8>, u16)> {
        let mut decoder = png::Decoder::new(std::io::Cursor::new(file));
        decoder.set_transformations(png::Transformations::EXPAND);
        let mut reader = decoder.read_info().unwrap();
        let frames = reader.info().animation_control.unwrap().num_frames;
        let width = reader.info().width as usize;
        let mut canvas = vec![0; width * reader.info().height as usize * 3];
        let mut buffer = vec![0; reader.output_buffer_size().unwrap()];
        (0..frames)
            .map(|_| {
                let size = reader.next_frame(&mut buffer).unwrap();
                let control = *reader.info().frame_control().unwrap();
                for (index, pixel) in buffer[..size.buffer_size()].chunks(4).enumerate() {
                    let column = control.x_offset as usize + index % size.width as usize;
                    let row = control.y_offset as usize + index / size.width as usize;
                    if pixel[3] == 255 {
                        canvas[3 * (row * width + column)..][..3].copy_from_slice(&pixel[..3]);
                    }
                }
                (canvas.clone(), control.delay_num)
            })
            .collect()
    }

    #[test]
    fn each_frame_is_the_picture_again() {
        let mut pictures = vec![Picture::new(20, 10, [9, 8, 7])];
        for (left, top, color) in [(3, 4, [1, 2, 3]), (19, 9, [80, 0, 0]), (0, 0, [255, 0, 255])] {
            let mut next = pictures[pictures.len() - 1].clone();
            next.fill(left, top, 5, 2, color);
            pictures.push(next.clone());
            pictures.push(next); // a frame that is the same
        }
        let frames: Vec<(Picture, u16)> = pictures.into_iter().zip(50..).collect();
        let found = decoded(&animated_png(&frames).unwrap());
        let expected: Vec<(Vec<u8>, u16)> =
            frames.iter().map(|(picture, delay)| (picture.pixels().to_vec(), *delay)).collect();
        assert_eq!(found, expected);
    }

    #[test]
    fn pictures_of_different_sizes_are_an_error() {
        let frames = [(Picture::new(4, 4, [0; 3]), 1), (Picture::new(4, 2, [0; 3]), 1)];
        assert!(animated_png(&frames).is_err());
        assert!(animated_png(&[]).is_err());
    }
}
