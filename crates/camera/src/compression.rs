//! A compression as in JPEG: cosine transforms of blocks, whose coefficients are rounded.

/// Side of a block, pixels.
pub(crate) const SIDE: usize = 8;

/// Row k, column x: the factor of pixel x in coefficient k, `c_k cos((2 x + 1) k π / 16)`, with
/// which the transform keeps lengths.
pub(crate) const COSINES: [[f32; SIDE]; SIDE] = {
    // Half of cos(k π / 16), k from 0 to 8.
    const HALF: [f32; 9] = [
        0.5,
        0.490_392_64,
        0.461_939_77,
        0.415_734_8,
        0.353_553_38,
        0.277_785_12,
        0.191_341_72,
        0.097_545_16,
        0.0,
    ];
    let mut out = [[0.353_553_38; SIDE]; SIDE];
    let mut k = 1;
    while k < SIDE {
        let mut x = 0;
        while x < SIDE {
            let angle = (2 * x + 1) * k % 32;
            // The cosine falls to -1 at 16 and rises again.
            let angle = if angle > 16 { 32 - angle } else { angle };
            out[k][x] = if angle > 8 { -HALF[16 - angle] } else { HALF[angle] };
            x += 1;
        }
        k += 1;
    }
    out
};

/// Steps of the coefficients of brightness, for a quality of 50.
///
/// # Reference
/// ITU-T T.81 (1992), table K.1.
pub(crate) const BRIGHTNESS: [[u8; SIDE]; SIDE] = [
    [16, 11, 10, 16, 24, 40, 51, 61],
    [12, 12, 14, 19, 26, 58, 60, 55],
    [14, 13, 16, 24, 40, 57, 69, 56],
    [14, 17, 22, 29, 51, 87, 80, 62],
    [18, 22, 37, 56, 68, 109, 103, 77],
    [24, 35, 55, 64, 81, 104, 113, 92],
    [49, 64, 78, 87, 103, 121, 120, 101],
    [72, 92, 95, 98, 112, 100, 103, 99],
];

/// Steps of the coefficients of color, for a quality of 50.
///
/// # Reference
/// ITU-T T.81 (1992), table K.2.
pub(crate) const COLOR: [[u8; SIDE]; SIDE] = [
    [17, 18, 24, 47, 99, 99, 99, 99],
    [18, 21, 26, 66, 99, 99, 99, 99],
    [24, 26, 56, 99, 99, 99, 99, 99],
    [47, 66, 99, 99, 99, 99, 99, 99],
    [99, 99, 99, 99, 99, 99, 99, 99],
    [99, 99, 99, 99, 99, 99, 99, 99],
    [99, 99, 99, 99, 99, 99, 99, 99],
    [99, 99, 99, 99, 99, 99, 99, 99],
];

/// Compresses an image and expands it again: red, green and blue from 0 to 1, in rows of `width`
/// pixels. Colors keep the resolution of the image.
pub(crate) fn compress(planes: &mut [Vec<f32>; 3], width: usize, coarseness: f32) {
    let height = planes[0].len() / width;
    for pixel in 0..planes[0].len() {
        let [r, g, b] = [0, 1, 2].map(|channel| 255.0 * planes[channel][pixel].clamp(0.0, 1.0));
        let y = 0.299 * r + 0.587 * g + 0.114 * b;
        planes[0][pixel] = y - 128.0;
        planes[1][pixel] = (b - y) / 1.772;
        planes[2][pixel] = (r - y) / 1.402;
    }
    for (channel, plane) in planes.iter_mut().enumerate() {
        let steps = if channel == 0 { &BRIGHTNESS } else { &COLOR };
        for y in (0..height).step_by(SIDE) {
            for x in (0..width).step_by(SIDE) {
                compress_block(plane, [x, y], [width, height], steps, coarseness);
            }
        }
    }
    for pixel in 0..planes[0].len() {
        let [y, cb, cr] = [0, 1, 2].map(|channel| planes[channel][pixel]);
        let y = y + 128.0;
        let r = 1.402 * cr;
        let b = 1.772 * cb;
        let g = y - (0.299 * r + 0.114 * b) / 0.587;
        planes[0][pixel] = (y + r) / 255.0;
        planes[1][pixel] = g / 255.0;
        planes[2][pixel] = (y + b) / 255.0;
    }
}

/// Rounds the coefficients of a block. Pixels beyond the image repeat those at its edge.
fn compress_block(
    plane: &mut [f32],
    [x, y]: [usize; 2],
    [width, height]: [usize; 2],
    steps: &[[u8; SIDE]; SIDE],
    coarseness: f32,
) {
    let at = |row: usize, column: usize| (y + row).min(height - 1) * width + (x + column).min(width - 1);
    let block: [[f32; SIDE]; SIDE] =
        std::array::from_fn(|row| std::array::from_fn(|column| plane[at(row, column)]));
    // Rows, then columns of the transposed result, twice.
    let mut coefficients = transformed(&transformed(&block));
    for (row, steps) in coefficients.iter_mut().zip(steps) {
        for (value, step) in row.iter_mut().zip(steps) {
            let step = (f32::from(*step) * coarseness).clamp(1.0, 255.0);
            *value = (*value / step + 0.5).floor() * step;
        }
    }
    let block = restored(&restored(&coefficients));
    for (row, values) in block.iter().enumerate().take(height - y) {
        for (column, value) in values.iter().enumerate().take(width - x) {
            plane[at(row, column)] = *value;
        }
    }
}

/// Returns the transposed transform of the rows of a block.
fn transformed(block: &[[f32; SIDE]; SIDE]) -> [[f32; SIDE]; SIDE] {
    std::array::from_fn(|k| {
        std::array::from_fn(|row| {
            let mut sum = 0.0;
            for x in 0..SIDE {
                sum += COSINES[k][x] * block[row][x];
            }
            sum
        })
    })
}

/// Returns the transposed block whose rows have these transforms.
fn restored(block: &[[f32; SIDE]; SIDE]) -> [[f32; SIDE]; SIDE] {
    std::array::from_fn(|x| {
        std::array::from_fn(|row| {
            let mut sum = 0.0;
            for k in 0..SIDE {
                sum += COSINES[k][x] * block[row][k];
            }
            sum
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_rows_of_the_transform_are_cosines() {
        for (k, row) in COSINES.iter().enumerate() {
            for (x, value) in row.iter().enumerate() {
                let angle = (2 * x + 1) as f64 * k as f64 * std::f64::consts::PI / 16.0;
                let factor = if k == 0 { 0.125_f64.sqrt() } else { 0.5 };
                assert!((f64::from(*value) - factor * angle.cos()).abs() < 1e-7, "{k} {x}");
            }
        }
    }

    #[test]
    fn a_fine_compression_changes_little_and_a_coarse_one_more() {
        let image = || {
            let plane =
                |shift: usize| (0..20 * 13).map(move |i| ((i * 7 + shift) % 97) as f32 / 97.0).collect();
            [plane(0), plane(31), plane(62)]
        };
        let error = |coarseness: f32| {
            let before = image();
            let mut after = image();
            compress(&mut after, 20, coarseness);
            let pairs = before.iter().flatten().zip(after.iter().flatten());
            pairs.map(|(a, b)| (a - b) * (a - b)).sum::<f32>() / (3.0 * 20.0 * 13.0)
        };
        assert!(error(1e-3) < 1e-4, "{}", error(1e-3));
        assert!(error(0.5) > error(0.05) && error(2.0) > error(0.5));
    }
}
