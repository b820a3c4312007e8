//! The numbers that axes of sight set.

use crate::{Lamp, Pattern};

use crate::sight::axes::MOST_DISTRACTORS;
use crate::sight::corruption::Corruption;
use crate::sight::part::Part;
use crate::sight::view::View;

/// Size of a pattern, m. A plane is larger than an object, and far from the camera.
const PATTERN_SIZE: f32 = 0.06;
const FLOOR_PATTERN_SIZE: f32 = 0.25;

/// A number of a view. Indices of lamps and cameras are those in the scene and the view, and those
/// of colors are red, green and blue.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Set {
    LampDirection(usize, usize),
    LampStrength(usize),
    LampColor(usize),
    LampRadius,
    Ambient,
    CameraPosition(usize, usize),
    CameraTilt(usize, usize),
    Focal(usize),
    Color(Part, usize),
    Pattern(Part),
    Contrast(Part),
    PatternSeed(Part),
    Background(usize),
    DistractorCount,
    DistractorShape(usize),
    DistractorColor(usize),
    DistractorPlace(usize, usize),
    DistractorShare(usize),
    PatchSize,
    PatchPlace(usize),
    Corruption,
    CorruptionSeverity,
    CorruptionRow,
    /// Nothing of the view: which state a camera shows.
    Feed,
}

impl Set {
    /// Returns the only camera that the number belongs to; `None` for one of all cameras.
    pub(super) fn camera(self) -> Option<usize> {
        match self {
            Set::CameraPosition(camera, _) | Set::CameraTilt(camera, _) | Set::Focal(camera) => Some(camera),
            _ => None,
        }
    }

    /// Sets the number.
    pub(crate) fn apply(self, view: &mut View, value: f64) {
        let v = value as f32;
        match self {
            Set::LampDirection(lamp, i) => lamp_of(view, lamp).direction[i] = v,
            Set::LampStrength(lamp) => lamp_of(view, lamp).strength = v,
            Set::LampColor(i) => lamp_of(view, 0).color[i] *= v,
            Set::LampRadius => lamp_of(view, 0).radius = v,
            Set::Ambient => view.scene.ambient.above.iter_mut().for_each(|color| *color *= v),
            Set::CameraPosition(camera, i) => view.cameras[camera].pose.position[i] += v,
            Set::CameraTilt(camera, i) => view.cameras[camera].tilt[i] = v,
            Set::Focal(camera) => view.cameras[camera].focal_length *= v,
            Set::Color(part, i) => view.materials(part, |material| {
                for color in &mut material.colors {
                    color[i] = (color[i] + v).clamp(0.0, 1.0);
                }
            }),
            Set::Pattern(part) => {
                let pattern = [Pattern::Plain, Pattern::Checker, Pattern::Noise, Pattern::Wood];
                let pattern = pattern[(value as usize).min(pattern.len() - 1)];
                let scale = if part == Part::Floor { FLOOR_PATTERN_SIZE } else { PATTERN_SIZE };
                view.materials(part, |material| (material.pattern, material.scale) = (pattern, scale));
            }
            Set::Contrast(part) => view.materials(part, |material| {
                material.colors[1] = material.colors[0].map(|color| (1.0 - v) * color);
            }),
            Set::PatternSeed(part) => view.materials(part, |material| material.seed = value as u32),
            Set::Background(i) => {
                let background = &mut view.scene.background;
                for color in [&mut background.above, &mut background.horizon] {
                    color[i] = (color[i] + v).clamp(0.0, 1.0);
                }
            }
            Set::DistractorCount => view.distractor_count = (value as usize).min(MOST_DISTRACTORS),
            Set::DistractorShape(index) => view.distractors[index].shape = value as usize,
            Set::DistractorColor(index) => view.distractors[index].color = value as usize,
            Set::DistractorPlace(index, i) => view.distractors[index].requested[i] = v,
            Set::DistractorShare(index) => view.distractors[index].share = v,
            Set::PatchSize => view.effects(|effects| effects.patch.size = [v; 2]),
            Set::PatchPlace(i) => view.effects(|effects| effects.patch.center[i] = v),
            Set::Corruption => view.corruption.kind = Corruption::numbered(value as usize),
            Set::CorruptionSeverity => view.corruption.severity = v,
            Set::CorruptionRow => view.corruption.row = v,
            Set::Feed => {}
        }
    }
}

fn lamp_of(view: &mut View, lamp: usize) -> &mut Lamp {
    &mut view.scene.lamps[lamp]
}
