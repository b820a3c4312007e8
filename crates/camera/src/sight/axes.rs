//! The axes of sight, as data.

use std::sync::Arc;

use mishandle_rollout::fault::{Channel, FaultSite, Side};
use mishandle_rollout::{Axis, AxisKind, AxisValues, Condition, Disturbance, Effect, Holds};

use crate::sight::cameras::SightCamera;
use crate::sight::part::Part;
use crate::sight::set::Set;

/// The names of the spaces of sight, in their order.
pub const SIGHT_SPACES: [&str; 6] = ["light", "camera", "appearance", "clutter", "image", "faults-camera"];

/// Largest number of distractors.
pub const MOST_CLUTTER: usize = 3;

/// Largest displacement (m) and tilt (rad) of a camera in the world and of one on a body.
const DISPLACED: [f64; 2] = [0.05, 0.01];
const TILTED: [f64; 2] = [0.1, 0.05];

/// Region of the distractors, m, and their half sizes, m.
const CLUTTER_X: [f64; 2] = [0.2, 0.9];
const CLUTTER_Y: [f64; 2] = [-0.5, 0.5];
const CLUTTER_SIZE: [f64; 2] = [0.015, 0.05];

/// Nominal half size of a distractor, m.
pub(crate) const CLUTTER_HALF: f64 = 0.03;

/// Returns the nominal place of a distractor, m. They stand apart.
pub(crate) fn clutter_place(index: usize) -> [f64; 2] {
    [0.55, 0.3 * index as f64 - 0.3]
}

/// Largest change of a color, which has the range \[0, 1\].
const RECOLORED: f64 = 0.3;

/// An axis of sight.
#[derive(Clone, Debug)]
pub(crate) struct SightAxis {
    /// Its space, an index of [`SIGHT_SPACES`].
    pub space: usize,
    /// The axis.
    pub axis: Axis,
    /// Which number of the view it sets.
    pub(crate) set: Set,
}

impl SightAxis {
    /// Returns whether it makes an image depend on the seed.
    pub(crate) fn is_random(&self) -> bool {
        matches!(self.set, Set::ReadNoise | Set::ShotNoise)
    }
}

/// Returns the axes of images that others took, and of camera faults. Lens and shutter need the
/// scene.
pub(crate) fn image_axes(cameras: &[SightCamera], disturbances: &[Disturbance]) -> Vec<SightAxis> {
    let needs_scene = |own: &SightAxis| matches!(own.set, Set::Aperture | Set::Shutter);
    let is_kept = |own: &SightAxis| ["image", "faults-camera"].contains(&SIGHT_SPACES[own.space]);
    let all = sight_axes(cameras, &[], disturbances).into_iter();
    all.filter(|own| is_kept(own) && !needs_scene(own)).collect()
}

/// Returns the axes of sight of a target with these cameras and parts.
pub(crate) fn sight_axes(
    cameras: &[SightCamera],
    parts: &[Part],
    disturbances: &[Disturbance],
) -> Vec<SightAxis> {
    let first = cameras.first().map_or("", |camera| camera.name.as_str());
    let spaces = [light(), camera(cameras), appearance(parts), clutter(), image(first), faults(disturbances)];
    let of_space = |(space, axes): (usize, Vec<(Axis, Set)>)| {
        axes.into_iter().map(move |(axis, set)| SightAxis { space, axis, set })
    };
    spaces.into_iter().enumerate().flat_map(of_space).collect()
}

fn number(name: &str, unit: &str, bounds: [f64; 2], nominal: f64, meaning: &str) -> Axis {
    Axis::new(AxisKind::Model, name, unit, bounds, Some(nominal)).meaning(meaning)
}

/// An axis of a factor: logarithmic, 1 at nominal.
fn factor(name: &str, bounds: [f64; 2], meaning: &str) -> Axis {
    number(name, "", bounds, 1.0, meaning).with_values(AxisValues::Logarithmic)
}

/// An axis of names, the first of which is nominal.
fn choice(name: &str, names: &[&str], meaning: &str) -> Axis {
    let values = names.iter().map(ToString::to_string).collect::<Arc<[String]>>();
    number(name, "", [0.0, (names.len() - 1) as f64], 0.0, meaning)
        .with_values(AxisValues::Categorical(values))
}

/// A condition that another axis is not at its nominal value.
fn unless_nominal(axis: &str, nominal: f64) -> [Condition; 1] {
    [Condition { axis: axis.to_string(), nominal, holds: Holds::Except(nominal) }]
}

fn light() -> Vec<(Axis, Set)> {
    let second = || unless_nominal("lamp2_strength", 0.0);
    let direction = "direction to the lamp: its horizontal part, for a vertical part of 1";
    let second_direction = "direction to the second lamp, as lamp_x and lamp_y";
    vec![
        (number("lamp_x", "", [-1.2, 1.2], 0.35, direction), Set::LampDirection(0, 0)),
        (number("lamp_y", "", [-1.2, 1.2], -0.3, direction), Set::LampDirection(0, 1)),
        (
            number(
                "lamp_strength",
                "",
                [0.2, 0.85],
                0.6,
                "brightness of a white surface that faces the lamp",
            ),
            Set::LampStrength(0),
        ),
        (factor("lamp_red", [0.6, 1.6], "factor of the red light of the lamp"), Set::LampColor(0)),
        (factor("lamp_blue", [0.6, 1.6], "factor of the blue light of the lamp"), Set::LampColor(2)),
        (factor("ambient_scale", [0.3, 1.4], "factor of the light from everywhere"), Set::Ambient),
        (
            number(
                "lamp_radius",
                "rad",
                [0.0, 0.15],
                0.0,
                "radius of the lamp; shadows are soft unless it is 0",
            ),
            Set::LampRadius,
        ),
        (choice("lamp_shadow", &["hard", "none"], "shadows of the lamp without a radius"), Set::LampShadow),
        (
            number(
                "lamp2_strength",
                "",
                [0.0, 0.3],
                0.0,
                "brightness of a white surface that faces the second lamp",
            ),
            Set::LampStrength(1),
        ),
        (
            number("lamp2_x", "", [-1.2, 1.2], -0.5, second_direction).only_if(second()),
            Set::LampDirection(1, 0),
        ),
        (
            number("lamp2_y", "", [-1.2, 1.2], 0.6, second_direction).only_if(second()),
            Set::LampDirection(1, 1),
        ),
    ]
}

fn camera(cameras: &[SightCamera]) -> Vec<(Axis, Set)> {
    let mut axes = Vec::new();
    for (index, SightCamera { name, is_mounted }) in cameras.iter().enumerate() {
        let far = DISPLACED[usize::from(*is_mounted)];
        let tilt = TILTED[usize::from(*is_mounted)];
        for (i, axis) in ["x", "y", "z"].into_iter().enumerate() {
            let meaning =
                format!("displacement of the camera `{name}` along the {axis} axis of what it is mounted on");
            axes.push((
                number(&format!("{name}_camera_{axis}"), "m", [-far, far], 0.0, &meaning),
                Set::CameraPosition(index, i),
            ));
        }
        for (i, (turn, side)) in
            [("pitch", "up"), ("yaw", "to the left"), ("roll", "counterclockwise")].into_iter().enumerate()
        {
            let meaning = format!("tilt of the camera `{name}` {side}");
            axes.push((
                number(&format!("{name}_camera_{turn}"), "rad", [-tilt, tilt], 0.0, &meaning),
                Set::CameraTilt(index, i),
            ));
        }
        let meaning = format!("factor of the focal length of the camera `{name}`");
        axes.push((factor(&format!("{name}_camera_focal_scale"), [0.9, 1.1], &meaning), Set::Focal(index)));
    }
    axes
}

fn appearance(parts: &[Part]) -> Vec<(Axis, Set)> {
    let mut axes = Vec::new();
    let bounds = [-RECOLORED, RECOLORED];
    for (part, name) in Part::ALL.into_iter().filter(|(part, _)| parts.contains(part)) {
        for (i, color) in ["red", "green", "blue"].into_iter().enumerate() {
            let meaning = format!("change of the {color} of the {name}");
            axes.push((number(&format!("{name}_{color}"), "", bounds, 0.0, &meaning), Set::Color(part, i)));
        }
        let pattern = format!("{name}_pattern");
        let meaning = format!("pattern of the {name}; its second color is darker");
        axes.push((choice(&pattern, &["plain", "checker", "noise", "wood"], &meaning), Set::Pattern(part)));
        let meaning = format!("number of the random pattern of the {name}");
        let is_random = Condition { axis: pattern, nominal: 0.0, holds: Holds::OneOf([2.0, 3.0].into()) };
        let seed = number(&format!("{name}_pattern_seed"), "", [0.0, 99.0], 0.0, &meaning)
            .with_values(AxisValues::Integer)
            .only_if([is_random]);
        axes.push((seed, Set::PatternSeed(part)));
    }
    for (i, color) in ["red", "green", "blue"].into_iter().enumerate() {
        let meaning = format!("change of the {color} of the background");
        axes.push((number(&format!("background_{color}"), "", bounds, 0.0, &meaning), Set::Background(i)));
    }
    axes
}

fn clutter() -> Vec<(Axis, Set)> {
    let count = number(
        "clutter_count",
        "",
        [0.0, MOST_CLUTTER as f64],
        0.0,
        "number of distractors, which touch nothing",
    )
    .with_values(AxisValues::Integer);
    let mut axes = vec![(count, Set::ClutterCount)];
    for index in 0..MOST_CLUTTER {
        let number_of = index + 1;
        let exists = || {
            let counts: Vec<f64> = (number_of..=MOST_CLUTTER).map(|count| count as f64).collect();
            [Condition {
                axis: "clutter_count".to_string(),
                nominal: 0.0,
                holds: Holds::OneOf(counts.into()),
            }]
        };
        let [x, y] = clutter_place(index);
        let name = |what: &str| format!("clutter{number_of}_{what}");
        let meaning = |what: &str| format!("{what} of distractor {number_of}");
        axes.extend([
            (
                choice(&name("shape"), &["box", "sphere", "cylinder", "capsule"], &meaning("shape"))
                    .only_if(exists()),
                Set::ClutterShape(index),
            ),
            (
                choice(
                    &name("color"),
                    &["red", "green", "blue", "yellow", "white", "black"],
                    &meaning("color"),
                )
                .only_if(exists()),
                Set::ClutterColor(index),
            ),
            (
                number(&name("x"), "m", CLUTTER_X, x, &meaning("place")).only_if(exists()),
                Set::ClutterPlace(index, 0),
            ),
            (
                number(&name("y"), "m", CLUTTER_Y, y, &meaning("place")).only_if(exists()),
                Set::ClutterPlace(index, 1),
            ),
            (
                number(&name("size"), "m", CLUTTER_SIZE, CLUTTER_HALF, &meaning("half size"))
                    .only_if(exists()),
                Set::ClutterSize(index),
            ),
        ]);
    }
    axes
}

/// Patch and black rows are on the camera `first`.
fn image(first: &str) -> Vec<(Axis, Set)> {
    let patch_size =
        format!("side of a dark patch on the lens of the camera `{first}`, as a fraction of the image");
    let dead_rows = format!("black rows of the camera `{first}`, as a fraction of the image");
    let patch = || unless_nominal("image_patch_size", 0.0);
    vec![
        (
            number(
                "image_noise",
                "",
                [0.0, 0.08],
                0.0,
                "standard deviation of the noise of a black pixel, as a fraction of white",
            ),
            Set::ReadNoise,
        ),
        (
            number(
                "image_shot_noise",
                "",
                [0.0, 0.08],
                0.0,
                "standard deviation of the additional noise of a white pixel, as a fraction of white",
            ),
            Set::ShotNoise,
        ),
        (number("image_blur", "px", [0.0, 1.5], 0.0, "standard deviation of a Gaussian blur"), Set::Blur),
        (factor("image_exposure", [0.5, 1.7], "factor of the brightness"), Set::Exposure),
        (factor("image_red", [0.75, 1.35], "factor of red"), Set::Cast(0)),
        (factor("image_blue", [0.75, 1.35], "factor of blue"), Set::Cast(2)),
        (
            number("image_vignette", "", [0.0, 0.6], 0.0, "darkening of the corners, as a fraction"),
            Set::Vignette,
        ),
        (
            number(
                "image_compression",
                "",
                [0.0, 4.0],
                0.0,
                "coarseness of a compression as in JPEG; 1 is a quality of 50",
            ),
            Set::Compression,
        ),
        (number("image_patch_size", "", [0.0, 0.35], 0.0, &patch_size), Set::PatchSize),
        (
            number("image_patch_x", "", [0.0, 1.0], 0.5, "center of the patch, from the left")
                .only_if(patch()),
            Set::PatchPlace(0),
        ),
        (
            number("image_patch_y", "", [0.0, 1.0], 0.5, "center of the patch, from the top")
                .only_if(patch()),
            Set::PatchPlace(1),
        ),
        (number("image_dead_rows", "", [0.0, 0.15], 0.0, &dead_rows), Set::DeadRows),
        (
            number("image_dead_row", "", [0.0, 0.95], 0.5, "where the black rows start, from the top")
                .only_if(unless_nominal("image_dead_rows", 0.0)),
            Set::DeadRow,
        ),
        (
            number(
                "lens_aperture",
                "m",
                [0.0, 0.02],
                0.0,
                "radius of the lens; what is nearer or farther than the focus is blurred",
            ),
            Set::Aperture,
        ),
        (
            number(
                "shutter",
                "",
                [0.0, 1.0],
                0.0,
                "time of exposure, as a fraction of a control step, which blurs what moves",
            ),
            Set::Shutter,
        ),
    ]
}

/// Returns the disturbances of the images of all cameras: faults and late images. The number that
/// each of them disturbs says which state a camera shows; see [`Feed`](crate::sight::Feed).
pub(crate) fn feed_disturbances(
    cameras: &[SightCamera],
    control_dt: f64,
    episode_steps: usize,
) -> Vec<Disturbance> {
    let channel =
        |(index, camera): (usize, &SightCamera)| Channel { name: camera.name.clone(), entries: vec![index] };
    let site = FaultSite {
        side: Side::Sensing,
        name: "camera_fault".to_string(),
        number: 0,
        channels: cameras.iter().enumerate().map(channel).collect(),
        ranges: vec![[0.0, episode_steps as f64]; cameras.len()],
        // Images can be lost and exchanged. Nothing computes with them.
        has_numbers: false,
        control_dt,
        episode_steps,
    };
    let late = number("camera_delay", "control steps", [0.0, 6.0], 0.0, "delay of the images of all cameras")
        .with_values(AxisValues::Integer);
    let mut all = site.disturbances();
    all.push(Disturbance { axis: late, effect: Effect::ObservationDelay });
    all
}

fn faults(disturbances: &[Disturbance]) -> Vec<(Axis, Set)> {
    disturbances.iter().map(|disturbance| (disturbance.axis.clone(), Set::Feed)).collect()
}
