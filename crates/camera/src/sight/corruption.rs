//! Corruptions of images: their kinds, and how strong they are at each severity.

use crate::camera::{Camera, DeadRows, Optics};
use crate::sight::factor::SEVERITIES;

/// Rays per pixel with a lens or a shutter.
const BLUR_SAMPLES: u32 = 8;

/// A kind of corruption.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Corruption {
    None,
    GaussianNoise,
    ShotNoise,
    Blur,
    Bright,
    Dark,
    Warm,
    Cold,
    Vignette,
    Compression,
    DeadRows,
    Defocus,
    MotionBlur,
}

/// The corruption of the images of a simulation.
#[derive(Clone, Copy, Debug)]
pub(crate) struct CorruptImages {
    pub kind: Corruption,
    pub severity: f32,
    /// Place of dead rows, from the top.
    pub row: f32,
}

impl CorruptImages {
    /// No corruption.
    pub const NOMINAL: CorruptImages = CorruptImages { kind: Corruption::None, severity: 0.0, row: 0.5 };
}

use Corruption as C;

/// The kinds with their names, and the number that each sets at the severities 1 to 5. Those that
/// need the scene come last.
const ALL: [(Corruption, &str, [f32; SEVERITIES]); 13] = [
    (C::None, "none", [0.0; SEVERITIES]),
    // Standard deviation, as a fraction of white.
    (C::GaussianNoise, "gaussian-noise", [0.04, 0.08, 0.12, 0.15, 0.18]),
    // That of a white pixel that counts 250, 100, 50, 30 or 15 photons.
    (C::ShotNoise, "shot-noise", [0.063_25, 0.1, 0.141_42, 0.182_57, 0.258_2]),
    // Standard deviation, pixels.
    (C::Blur, "blur", [0.5, 0.75, 1.0, 1.25, 1.5]),
    // Change of the brightness, as a fraction.
    (C::Bright, "bright", [0.1, 0.2, 0.3, 0.4, 0.5]),
    (C::Dark, "dark", [0.15, 0.3, 0.45, 0.6, 0.75]),
    // Red and blue change by this fraction, in opposite directions.
    (C::Warm, "warm", [0.08, 0.16, 0.24, 0.32, 0.4]),
    (C::Cold, "cold", [0.08, 0.16, 0.24, 0.32, 0.4]),
    // Darkening of the corners, as a fraction.
    (C::Vignette, "vignette", [0.2, 0.4, 0.6, 0.8, 1.0]),
    // Coarseness of a JPEG quality of 65, 58, 50, 40 or 25.
    (C::Compression, "compression", [0.7, 0.84, 1.0, 1.25, 2.0]),
    // Share of the height.
    (C::DeadRows, "dead-rows", [0.04, 0.08, 0.12, 0.16, 0.2]),
    // Radius of the lens, m.
    (C::Defocus, "defocus", [0.005, 0.01, 0.015, 0.02, 0.03]),
    // Time of exposure, control steps.
    (C::MotionBlur, "motion-blur", [0.2, 0.4, 0.6, 0.8, 1.0]),
];

/// Number of kinds that need the scene.
const OF_SCENE: usize = 2;

impl Corruption {
    /// Returns the names of the kinds, the nominal one first.
    pub fn names(has_scene: bool) -> Vec<&'static str> {
        let count = if has_scene { ALL.len() } else { ALL.len() - OF_SCENE };
        ALL[..count].iter().map(|(_, name, _)| *name).collect()
    }

    /// Returns the kind with a number.
    pub fn numbered(number: usize) -> Corruption {
        ALL.get(number).map_or(C::None, |(kind, _, _)| *kind)
    }

    /// Returns the number of the kind.
    pub fn number(self) -> usize {
        ALL.iter().position(|(kind, _, _)| *kind == self).unwrap_or_default()
    }

    /// Returns the number that this kind sets at a severity from 0, where it has no effect.
    fn strength(self, severity: f32) -> f32 {
        let levels = ALL[self.number()].2;
        let at = |level: usize| level.checked_sub(1).map_or(0.0, |place| levels[place.min(SEVERITIES - 1)]);
        let level = severity.max(0.0) as usize;
        at(level) + (severity - level as f32) * (at(level + 1) - at(level))
    }
}

impl CorruptImages {
    /// Corrupts the images of a camera.
    pub fn apply(self, camera: &mut Camera) {
        let v = self.kind.strength(self.severity);
        let Camera { effects, optics, .. } = camera;
        match self.kind {
            C::GaussianNoise => effects.read_noise = v,
            C::ShotNoise => effects.shot_noise = v,
            C::Blur => effects.blur = v,
            C::Bright => effects.exposure = 1.0 + v,
            C::Dark => effects.exposure = 1.0 - v,
            C::Warm => effects.color_cast = [1.0 + v, 1.0, 1.0 - v],
            C::Cold => effects.color_cast = [1.0 - v, 1.0, 1.0 + v],
            C::Vignette => effects.vignette = v,
            C::Compression => effects.compression = v,
            C::DeadRows => effects.dead_rows = DeadRows { first: self.row * (1.0 - v), share: v },
            C::Defocus if v > 0.0 => *optics = Optics { samples: BLUR_SAMPLES, aperture: v, ..*optics },
            C::MotionBlur if v > 0.0 => *optics = Optics { samples: BLUR_SAMPLES, shutter: v, ..*optics },
            C::None | C::Defocus | C::MotionBlur => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn strengths_grow_from_nothing_through_their_levels() {
        for (kind, name, levels) in &ALL[1..] {
            assert_eq!(kind.strength(0.0), 0.0, "{name}");
            for (level, expected) in (1..).zip(levels) {
                assert_eq!(kind.strength(level as f32), *expected, "{name}");
            }
            assert!(levels.windows(2).all(|pair| pair[0] < pair[1]), "{name}");
            let half = kind.strength(2.5);
            assert!((half - 0.5 * (levels[1] + levels[2])).abs() < 1e-6, "{name}");
        }
    }
}
