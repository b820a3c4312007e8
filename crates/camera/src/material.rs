//! Materials: colors that depend on the point of a shape.

use mishandle_random::philox4x32;

/// Red, green and blue, from 0 to 1.
pub type Color = [f32; 3];

/// A pattern of the colors of a material.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Pattern {
    /// The first color everywhere.
    #[default]
    Plain,
    /// Cubes of both colors in turn; squares on a flat face.
    Checker,
    /// Smooth random spots between both colors.
    Noise,
    /// Rings of both colors around the x axis, like those of a board that is cut along the trunk.
    Wood,
}

/// The surface of a shape.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Material {
    /// How the two colors are distributed.
    pub pattern: Pattern,
    /// The two colors.
    pub colors: [Color; 2],
    /// Size of squares and spots, or distance of rings, m.
    pub scale: f32,
    /// Seed of the random spots and of the bends of the rings.
    pub seed: u32,
    /// Opacity, from 0 to 1. A shape that is not opaque casts no shadow.
    pub opacity: f32,
    /// Strength of highlights, from 0 to 1.
    pub specular: f32,
    /// Sharpness of highlights: the exponent of the cosine.
    pub exponent: u32,
    /// Light of its own, as a fraction of the color.
    pub emission: f32,
}

impl Material {
    /// Returns a plain material without highlights.
    pub const fn plain(color: Color) -> Material {
        Material {
            pattern: Pattern::Plain,
            colors: [color; 2],
            scale: 0.05,
            seed: 0,
            opacity: 1.0,
            specular: 0.0,
            exponent: 16,
            emission: 0.0,
        }
    }

    /// Returns the color at a point in the frame of the shape, m.
    pub(crate) fn color(&self, p: [f32; 3]) -> Color {
        let share = match self.pattern {
            Pattern::Plain => return self.colors[0],
            Pattern::Checker => {
                // A face of a box through 0 lies inside cells, not between them.
                let cell = p.map(|v| (v / self.scale + 0.25).floor() as i32);
                (cell[0].wrapping_add(cell[1]).wrapping_add(cell[2]) & 1) as f32
            }
            Pattern::Noise => spots(p.map(|v| v / self.scale), self.seed),
            Pattern::Wood => {
                let [x, y, z] = p.map(|v| v / self.scale);
                // A trunk bends slowly along its axis, and its rings are not round.
                let bend = 2.0 * lattice([0.15 * x, 0.5 * y, 0.5 * z], self.seed);
                let y = y - 9.5;
                let z = z + 5.2;
                let ring = (y * y + z * z).sqrt() + bend;
                let part = ring - ring.floor();
                // Spring wood grows slowly darker, and the ring ends within a short part.
                if part < 0.8 { part * part * 1.5625 } else { 5.0 * (1.0 - part) }
            }
        };
        let [a, b] = self.colors;
        [0, 1, 2].map(|i| a[i] + share * (b[i] - a[i]))
    }
}

/// Returns random spots from 0 to 1: three octaves of [`lattice`].
fn spots(p: [f32; 3], seed: u32) -> f32 {
    let octave = |k: u32, factor: f32| lattice(p.map(|v| v * factor), seed.wrapping_add(k));
    let sum = (4.0 * octave(0, 1.0) + 2.0 * octave(1, 2.03) + octave(2, 4.01)) / 7.0;
    // A mean of random numbers is near 0.5; the contrast of the spots is that of the colors.
    (2.2 * (sum - 0.5) + 0.5).clamp(0.0, 1.0)
}

/// Returns a smooth random number from 0 to 1: values at whole points, interpolated.
fn lattice(p: [f32; 3], seed: u32) -> f32 {
    let base = p.map(f32::floor);
    let part = [0, 1, 2].map(|i| p[i] - base[i]);
    let ease = part.map(|t| t * t * (3.0 - 2.0 * t));
    let mix = |a: f32, b: f32, t: f32| a + t * (b - a);
    // One block has the values of four points: those of a face across x.
    let values = |dx: i32| -> [f32; 4] {
        let [x, y, z] = base.map(|v| v as i32);
        std::array::from_fn(|k| {
            let y = y.wrapping_add(k as i32 & 1);
            let z = z.wrapping_add(k as i32 >> 1);
            unit_hash([x.wrapping_add(dx), y, z], seed)
        })
    };
    let near = values(0);
    let far = values(1);
    let corner: [f32; 4] = std::array::from_fn(|k| mix(near[k], far[k], ease[0]));
    mix(mix(corner[0], corner[1], ease[1]), mix(corner[2], corner[3], ease[1]), ease[2])
}

/// Returns the random number of a whole point, from 0 to 1.
fn unit_hash(p: [i32; 3], seed: u32) -> f32 {
    let word = philox4x32([p[0] as u32, p[1] as u32, p[2] as u32, 0], [seed, 0])[0];
    (word >> 8) as f32 / 16_777_216.0
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shares(pattern: Pattern, seed: u32, step: f32) -> Vec<f32> {
        let material = Material {
            pattern,
            colors: [[0.0; 3], [1.0; 3]],
            scale: 0.05,
            seed,
            ..Material::plain([0.0; 3])
        };
        let at = |i: u32| [step * (i % 50) as f32 - 0.7, step * (i / 50) as f32 - 0.6, 0.013];
        (0..2500).map(|i| material.color(at(i))[0]).collect()
    }

    #[test]
    fn squares_of_a_checker_have_the_stated_size() {
        let material = |x: f32, y: f32| {
            Material { pattern: Pattern::Checker, colors: [[0.0; 3], [1.0; 3]], ..Material::plain([0.0; 3]) }
                .color([x, y, 0.0])[0]
        };
        for (x, y) in [(0.0, 0.0), (0.21, -0.13), (-0.4, 0.33)] {
            assert!(material(x, y) != material(x + 0.05, y), "the next square has the other color");
            assert!(material(x, y) != material(x, y - 0.05));
            assert_eq!(material(x, y), material(x + 0.05, y + 0.05));
        }
    }

    #[test]
    fn random_patterns_are_smooth_use_both_colors_and_depend_on_their_seed() {
        for pattern in [Pattern::Noise, Pattern::Wood] {
            let values = shares(pattern, 1, 0.02);
            let mean = values.iter().sum::<f32>() / 2500.0;
            assert!((0.3..0.7).contains(&mean), "{pattern:?}: {mean}");
            assert!(values.iter().all(|share| (0.0..=1.0).contains(share)), "{pattern:?}");
            let many =
                |range: std::ops::Range<f32>| values.iter().filter(|v| range.contains(v)).count() > 150;
            assert!(many(0.0..0.2) && many(0.8..1.0), "{pattern:?}");
            assert!(values != shares(pattern, 2, 0.02), "{pattern:?}");
            // Neighbors differ less the nearer they are.
            let change = |step: f32| {
                let values = shares(pattern, 1, step);
                values.windows(2).filter(|pair| (pair[0] - pair[1]).abs() > 0.1).count()
            };
            assert!(change(0.0005) < change(0.02) / 4, "{pattern:?}");
        }
    }
}
