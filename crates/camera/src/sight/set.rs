//! The numbers that axes of sight set.

use crate::{Form, Lamp, Material, Pattern};

use crate::sight::axes::{CLUTTER_HALF, MOST_CLUTTER, clutter_place};
use crate::sight::part::Part;
use crate::sight::view::View;

/// Rays per pixel with a lens or a shutter.
const BLUR_SAMPLES: u32 = 8;

/// The second color of a pattern, as a fraction of the first one, and the size of the pattern, m.
const DARKER: f32 = 0.45;
const PATTERN_SIZE: f32 = 0.06;

/// Colors of distractors, in the order of their names.
const COLORS: [[f32; 3]; 6] = [
    [0.80, 0.15, 0.12],
    [0.15, 0.60, 0.20],
    [0.15, 0.25, 0.75],
    [0.85, 0.75, 0.15],
    [0.92, 0.92, 0.92],
    [0.08, 0.08, 0.08],
];

/// A number of a view. Indices of lamps and cameras are those in the scene and the view, and those
/// of colors are red, green and blue.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Set {
    LampDirection(usize, usize),
    LampStrength(usize),
    LampColor(usize),
    LampRadius,
    LampShadow,
    Ambient,
    CameraPosition(usize, usize),
    CameraTilt(usize, usize),
    Focal(usize),
    Color(Part, usize),
    Pattern(Part),
    PatternSeed(Part),
    Background(usize),
    ClutterCount,
    ClutterShape(usize),
    ClutterColor(usize),
    ClutterPlace(usize, usize),
    ClutterSize(usize),
    ReadNoise,
    ShotNoise,
    Blur,
    Exposure,
    Cast(usize),
    Vignette,
    Compression,
    PatchSize,
    PatchPlace(usize),
    DeadRows,
    DeadRow,
    Aperture,
    Shutter,
    /// Nothing of the view: which state a camera shows.
    Feed,
}

/// A distractor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Distractor {
    shape: usize,
    color: usize,
    /// Place on what is there, m.
    pub(crate) place: [f32; 2],
    /// Half size, m.
    pub(crate) size: f32,
}

impl Distractor {
    /// The nominal distractor with this index.
    pub(crate) fn nominal(index: usize) -> Distractor {
        Distractor {
            shape: 0,
            color: 0,
            place: clutter_place(index).map(|v| v as f32),
            size: CLUTTER_HALF as f32,
        }
    }

    /// Returns its form and its material.
    pub(crate) fn look(&self) -> (Form, Material) {
        let size = self.size;
        let form = match self.shape {
            0 => Form::Box { half: [size; 3] },
            1 => Form::Sphere { radius: size },
            2 => Form::Cylinder { radius: 0.7 * size, half: size },
            _ => Form::Capsule { radius: 0.5 * size, half: 0.5 * size },
        };
        (form, Material::plain(COLORS[self.color.min(COLORS.len() - 1)]))
    }
}

impl Set {
    /// Returns the only camera that the number belongs to; `None` for one of all cameras.
    pub(super) fn camera(self) -> Option<usize> {
        match self {
            Set::CameraPosition(camera, _) | Set::CameraTilt(camera, _) | Set::Focal(camera) => Some(camera),
            Set::PatchSize | Set::PatchPlace(_) | Set::DeadRows | Set::DeadRow => Some(0),
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
            Set::LampShadow => lamp_of(view, 0).casts_shadows = value == 0.0,
            Set::Ambient => {
                let ambient = &mut view.scene.ambient;
                ambient.above.iter_mut().chain(&mut ambient.below).for_each(|color| *color *= v);
            }
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
                if pattern != Pattern::Plain {
                    view.materials(part, |material| {
                        material.pattern = pattern;
                        material.scale = PATTERN_SIZE;
                        material.colors[1] = material.colors[0].map(|color| DARKER * color);
                    });
                }
            }
            Set::PatternSeed(part) => view.materials(part, |material| material.seed = value as u32),
            Set::Background(i) => {
                let background = &mut view.scene.background;
                for color in [&mut background.above, &mut background.horizon] {
                    color[i] = (color[i] + v).clamp(0.0, 1.0);
                }
            }
            Set::ClutterCount => view.clutter_count = (value as usize).min(MOST_CLUTTER),
            Set::ClutterShape(index) => view.clutter[index].shape = value as usize,
            Set::ClutterColor(index) => view.clutter[index].color = value as usize,
            Set::ClutterPlace(index, i) => view.clutter[index].place[i] = v,
            Set::ClutterSize(index) => view.clutter[index].size = v,
            Set::ReadNoise => view.effects(|effects| effects.read_noise = v),
            Set::ShotNoise => view.effects(|effects| effects.shot_noise = v),
            Set::Blur => view.effects(|effects| effects.blur = v),
            Set::Exposure => view.effects(|effects| effects.exposure = v),
            Set::Cast(i) => view.effects(|effects| effects.color_cast[i] = v),
            Set::Vignette => view.effects(|effects| effects.vignette = v),
            Set::Compression => view.effects(|effects| effects.compression = v),
            Set::PatchSize => view.cameras[0].effects.patch.size = [v; 2],
            Set::PatchPlace(i) => view.cameras[0].effects.patch.center[i] = v,
            Set::DeadRows => view.cameras[0].effects.dead_rows.share = v,
            Set::DeadRow => view.cameras[0].effects.dead_rows.first = v,
            Set::Aperture => blurred(view, v, |optics, v| optics.aperture = v),
            Set::Shutter => blurred(view, v, |optics, v| optics.shutter = v),
            Set::Feed => {}
        }
    }
}

fn lamp_of(view: &mut View, lamp: usize) -> &mut Lamp {
    &mut view.scene.lamps[lamp]
}

/// Sets a number of the optics that needs several rays per pixel unless it is 0.
fn blurred(view: &mut View, value: f32, set: fn(&mut crate::Optics, f32)) {
    if value > 0.0 {
        for camera in &mut view.cameras {
            camera.optics.samples = BLUR_SAMPLES;
            set(&mut camera.optics, value);
        }
    }
}
