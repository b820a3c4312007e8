//! Captions: lines of text and a time bar, drawn below a scene.

use noto_sans_mono_bitmap::{FontWeight, RasterHeight, get_raster, get_raster_width};

use super::picture::{Color, Picture};

/// A caption of a frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Caption {
    /// The text. A line is broken only between parts.
    pub parts: Vec<CaptionPart>,
    /// Text in the corner of the scene and color of a border, for the frame of an event.
    pub mark: Option<(String, Color)>,
    /// The bar at the bottom.
    pub bar: TimeBar,
}

/// A part of a caption's text.
#[derive(Clone, Debug, PartialEq)]
pub struct CaptionPart {
    /// The text. Only ASCII is drawn; other characters appear as `?`.
    pub text: String,
    /// Its color.
    pub color: Color,
    /// Whether the type is bold.
    pub is_bold: bool,
}

/// A bar that shows the position of a frame in its episode. All positions are fractions of the
/// episode.
#[derive(Clone, Debug, PartialEq)]
pub struct TimeBar {
    /// Position of the frame.
    pub now: f64,
    /// Colored spans, later ones over earlier ones.
    pub spans: Vec<([f64; 2], Color)>,
}

/// Colors of the caption's background, of the empty bar and of the frame's position.
const BACKGROUND: Color = [255, 255, 255];
const BAR: Color = [214, 218, 223];
const NOW: Color = [29, 33, 38];

/// Width of frames, in pixels, from which on each height of the type is used.
const TYPE_HEIGHTS: [(usize, usize); 4] = [(0, 16), (640, 20), (1024, 24), (1536, 32)];

/// Largest fraction of a frame's height that a caption takes, as numerator and denominator.
const MAX_SHARE: (usize, usize) = (2, 5);

/// The place of captions in frames of one size. All captions of a film have the same layout if
/// their parts have the same lengths.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CaptionLayout {
    type_height: usize,
    /// Number of characters of a line.
    columns: usize,
    /// Indices of the first part of each line.
    breaks: Vec<usize>,
    margin: usize,
    bar_height: usize,
}

impl CaptionLayout {
    /// Fits captions with the parts of `caption` into frames of `width` x `height` pixels; `None`
    /// if the frame is too small.
    pub fn new(width: usize, height: usize, caption: &Caption) -> Option<CaptionLayout> {
        let (_, type_height) = TYPE_HEIGHTS.into_iter().rev().find(|(least, _)| width >= *least)?;
        let margin = type_height / 4;
        let columns = width.checked_sub(2 * margin)? / glyph_width(type_height)?;
        let mut breaks = vec![0];
        let mut used = 0;
        for (index, part) in caption.parts.iter().enumerate() {
            let length = part.text.chars().count().min(columns);
            if index > 0 && used + GAP + length > columns {
                breaks.push(index);
                used = length;
            } else {
                used += length + if index > 0 { GAP } else { 0 };
            }
        }
        let layout = CaptionLayout {
            type_height,
            columns,
            breaks,
            margin,
            bar_height: (type_height / 4).next_multiple_of(2),
        };
        let is_small = columns < MIN_COLUMNS || layout.height() * MAX_SHARE.1 > height * MAX_SHARE.0;
        (!is_small).then_some(layout)
    }

    /// Returns the height of a caption in pixels, an even number.
    pub fn height(&self) -> usize {
        let height = self.margin + self.breaks.len() * self.type_height + self.bar_height;
        height.next_multiple_of(2)
    }

    /// Draws a caption at the bottom of the frame, and its mark.
    pub fn draw(&self, caption: &Caption, frame: &mut Picture) {
        let width = frame.width();
        let height = frame.height();
        let top = height - self.height();
        frame.fill(0, top, width, self.height(), BACKGROUND);
        for (line, first) in self.breaks.iter().enumerate() {
            let last = self.breaks.get(line + 1).copied().unwrap_or(caption.parts.len());
            let mut column = 0;
            for part in &caption.parts[(*first).min(last)..last] {
                let text = elided(&part.text, self.columns);
                let left = self.margin + column * glyph_width(self.type_height).unwrap_or(0);
                let top = top + self.margin / 2 + line * self.type_height;
                self.write(&text, left, top, part.color, part.is_bold, frame);
                column += text.chars().count() + GAP;
            }
        }
        self.draw_bar(&caption.bar, frame);
        if let Some((text, color)) = &caption.mark {
            let thickness = self.margin.div_ceil(2).max(2);
            frame.border(0, 0, width, height, thickness, *color);
            let text = elided(text, self.columns.saturating_sub(2));
            let wide = (text.chars().count() + 1) * glyph_width(self.type_height).unwrap_or(0);
            frame.fill(0, 0, thickness + wide, thickness + self.type_height, *color);
            let left = thickness + wide / (2 * text.chars().count() + 2);
            self.write(&text, left, thickness / 2, BACKGROUND, true, frame);
        }
    }

    fn draw_bar(&self, bar: &TimeBar, frame: &mut Picture) {
        let width = frame.width();
        let height = self.bar_height;
        let top = frame.height() - height;
        let margin = self.margin;
        let length = width - 2 * margin;
        let column = |fraction: f64| margin + (fraction.clamp(0.0, 1.0) * length as f64).round() as usize;
        frame.fill(margin, top, length, height, BAR);
        for ([from, to], color) in &bar.spans {
            let from = column(*from);
            let to = column(*to);
            frame.fill(from, top, to.saturating_sub(from).max(1), height, *color);
        }
        let left = column(bar.now) - height / 2;
        frame.fill(left - 2, top, height + 4, height, BACKGROUND);
        frame.fill(left, top, height, height, NOW);
    }

    fn write(&self, text: &str, left: usize, top: usize, color: Color, is_bold: bool, frame: &mut Picture) {
        for (index, character) in text.chars().enumerate() {
            let Some(rows) = glyph(character, self.type_height, is_bold) else { continue };
            let width = glyph_width(self.type_height).unwrap_or(0);
            for (row, weights) in rows.chunks(width.max(1)).enumerate() {
                for (column, weight) in weights.iter().enumerate() {
                    frame.blend(left + index * width + column, top + row, color, *weight);
                }
            }
        }
    }
}

/// Empty columns between two parts of a line.
const GAP: usize = 2;

/// Number of characters that a line must have.
const MIN_COLUMNS: usize = 20;

/// Cuts the middle of a text that is longer than `columns` characters.
fn elided(text: &str, columns: usize) -> String {
    let characters: Vec<char> = text.chars().collect();
    if characters.len() <= columns {
        return text.to_string();
    }
    let kept = columns.saturating_sub(2);
    let start = kept.div_ceil(2);
    let end = kept / 2;
    characters[..start].iter().chain(&['.', '.']).chain(&characters[characters.len() - end..]).collect()
}

fn raster_height(type_height: usize) -> Option<RasterHeight> {
    match type_height {
        16 => Some(RasterHeight::Size16),
        20 => Some(RasterHeight::Size20),
        24 => Some(RasterHeight::Size24),
        32 => Some(RasterHeight::Size32),
        _ => None,
    }
}

/// Returns the width in pixels of all characters of this height; `None` if there is no such type.
fn glyph_width(type_height: usize) -> Option<usize> {
    Some(get_raster_width(FontWeight::Regular, raster_height(type_height)?))
}

/// Returns the weights of a character's pixels, rows from the top.
fn glyph(character: char, type_height: usize, is_bold: bool) -> Option<&'static [u8]> {
    let weight = if is_bold { FontWeight::Bold } else { FontWeight::Regular };
    let raster = |character| get_raster(character, weight, raster_height(type_height)?);
    raster(character).or_else(|| raster('?')).map(|raster| raster.pixels())
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    const INK: Color = [0, 0, 0];
    const MARK: Color = [200, 30, 0];

    fn caption(texts: &[&str]) -> Caption {
        let part = |text: &&str| CaptionPart { text: text.to_string(), color: INK, is_bold: false };
        let bar = TimeBar { now: 0.5, spans: vec![([0.25, 0.75], MARK)] };
        Caption { parts: texts.iter().map(part).collect(), mark: None, bar }
    }

    fn pixel(picture: &Picture, column: usize, row: usize) -> Color {
        picture.pixels()[3 * (row * picture.width() + column)..][..3].try_into().unwrap()
    }

    #[test]
    fn lines_break_between_parts() {
        // 240 pixels less two margins of 4 are 33 characters of 7 pixels.
        let caption = caption(&["0.72 s", "cube_target_horizontal_distance", "0.0581 m", "fails"]);
        let narrow = CaptionLayout::new(240, 180, &caption).unwrap();
        assert_eq!((narrow.columns, narrow.breaks.clone()), (33, vec![0, 1, 2]));
        assert_eq!(narrow.height(), 4 + 3 * 16 + 4);
        // 9-pixel characters: 70 columns hold the 6 + 31 + 8 + 5 characters and three gaps.
        let wide = CaptionLayout::new(640, 480, &caption).unwrap();
        assert_eq!((wide.type_height, wide.breaks.clone()), (20, vec![0]));
        assert_eq!(CaptionLayout::new(240, 100, &caption), None, "three lines would take half of the frame");
        assert_eq!(CaptionLayout::new(120, 480, &caption), None, "17 characters are too few");
    }

    #[test]
    fn a_caption_draws_its_text_its_bar_and_its_mark_and_leaves_the_scene() {
        let mut caption = caption(&["I"]);
        let layout = CaptionLayout::new(240, 180, &caption).unwrap();
        let scene: Color = [10, 200, 10];
        let mut frame = Picture::new(240, 180, scene);
        layout.draw(&caption, &mut frame);
        let top = 180 - layout.height();
        assert!((0..top).all(|row| (0..240).all(|column| pixel(&frame, column, row) == scene)));
        // The letter is in the first of the columns of 7 pixels, behind the margin of 4.
        let is_dark = |column: usize| (top..176).any(|row| pixel(&frame, column, row)[0] < 100);
        assert!((4..11).any(is_dark));
        assert!(!(11..240).any(is_dark));
        // The bar between the margins has 232 pixels: 58 empty ones, 116 colored ones around the
        // position at 120, 58 empty ones.
        let bar = |column: usize| pixel(&frame, column, 178);
        assert_eq!([3, 4, 61, 62].map(bar), [BACKGROUND, BAR, BAR, MARK]);
        assert_eq!([115, 116, 120, 122, 124].map(bar), [MARK, BACKGROUND, NOW, BACKGROUND, MARK]);
        assert_eq!([177, 178, 235, 236].map(bar), [MARK, BAR, BAR, BACKGROUND]);
        caption.mark = Some(("VIOLATION".to_string(), MARK));
        layout.draw(&caption, &mut frame);
        assert_eq!([pixel(&frame, 0, 90), pixel(&frame, 239, 179)], [MARK, MARK]);
        let label = || (0..20).flat_map(|row| (0..80).map(move |column| (column, row)));
        assert!(label().any(|(column, row)| pixel(&frame, column, row) == [255, 255, 255]), "white letters");
        assert_eq!(pixel(&frame, 120, 60), scene);
    }

    #[test]
    fn a_long_text_loses_its_middle_and_unknown_characters_are_question_marks() {
        assert_eq!(elided("abcdefghij", 7), "abc..ij");
        assert_eq!(elided("abcdefg", 7), "abcdefg");
        assert_eq!(glyph('\u{4e16}', 16, false), glyph('?', 16, false));
        assert!(glyph('?', 16, true).is_some());
    }
}
