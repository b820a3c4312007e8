//! The axes of sight, as data: what each factor changes, and how far at each severity.

use std::sync::Arc;

use mishandle_rollout::fault::{Channel, FaultSite, Side};
use mishandle_rollout::{Axis, AxisKind, AxisValues, Condition, Disturbance, Effect, Holds};

use crate::sight::cameras::SightCamera;
use crate::sight::corruption::Corruption;
use crate::sight::distractor::{COLORS, Distractor, SHAPES};
use crate::sight::factor::{Factor, Levels, SEVERITIES, SightAxis};
use crate::sight::part::Part;
use crate::sight::set::Set;

/// The name of the space of camera faults, which have no severity.
pub const CAMERA_FAULTS: &str = "faults-camera";

/// Largest number of distractors.
pub const MOST_DISTRACTORS: usize = SEVERITIES;

/// Displacement (m) of a camera in the world and of one on a body, and tilt (rad), for a severity
/// of 1.
const DISPLACED: [f64; 2] = [0.1 / 3.0, 0.01 / 3.0];
const TILTED: f64 = 0.05 / 3.0;

/// Smallest and largest strength of the lamp, and factors of its red and blue and of the light of
/// the sky. Brighter light would saturate the floor.
const LAMP: [[f64; 2]; SEVERITIES] = [[0.5, 0.62], [0.4, 0.64], [0.3, 0.66], [0.24, 0.66], [0.18, 0.66]];
const LAMP_COLOR: [[f64; 2]; SEVERITIES] = [[0.85, 1.05], [0.7, 1.1], [0.55, 1.1], [0.4, 1.1], [0.3, 1.1]];
const AMBIENT: [[f64; 2]; SEVERITIES] = [[0.9, 1.05], [0.8, 1.1], [0.7, 1.1], [0.6, 1.1], [0.5, 1.1]];

/// Largest change of a color, which has the range \[0, 1\], and of the second color of a texture.
const RECOLORED: [f64; SEVERITIES] = [0.1, 0.2, 0.3, 0.4, 0.5];
const CONTRAST: [f64; SEVERITIES] = [0.15, 0.3, 0.45, 0.6, 0.75];

/// Sides of a patch on the lens, as a fraction of the image.
const PATCH: [f64; SEVERITIES] = [0.1, 0.2, 0.3, 0.4, 0.5];

/// Region of the requested places of distractors, m, and the share of the image that they cover.
const DISTRACTOR_X: [f64; 2] = [0.2, 0.9];
const DISTRACTOR_Y: [f64; 2] = [-0.5, 0.5];
const DISTRACTOR_SHARE: [f64; 2] = [0.025, 0.04];

const COLOR_NAMES: [&str; 3] = ["red", "green", "blue"];

/// Returns the axes of images that others took, and of camera faults.
pub(crate) fn image_axes(disturbances: &[Disturbance]) -> Vec<SightAxis> {
    let factors = [occlusion(), image(false)].concat();
    factors.into_iter().chain(faults(disturbances)).collect()
}

/// Returns the axes of sight of a target with these cameras and parts, whose lamp is in this
/// direction.
pub(crate) fn sight_axes(
    cameras: &[SightCamera],
    parts: &[Part],
    lamp: [f64; 3],
    disturbances: &[Disturbance],
) -> Vec<SightAxis> {
    let has = |part: &Part| parts.contains(part);
    let behind = [Part::Floor, Part::Support].into_iter().filter(has);
    let background = behind.flat_map(|part| looks(Factor::Background, part)).chain(background());
    let object = [Part::Object].into_iter().filter(has).flat_map(|part| looks(Factor::Object, part));
    camera(cameras)
        .into_iter()
        .chain(light(lamp))
        .chain(background)
        .chain(object)
        .chain(distractors())
        .chain(occlusion())
        .chain(image(true))
        .chain(faults(disturbances))
        .collect()
}

fn number(name: &str, unit: &str, nominal: f64, meaning: &str) -> Axis {
    Axis::new(AxisKind::Model, name, unit, [nominal; 2], Some(nominal)).meaning(meaning)
}

/// An axis of a factor: logarithmic, 1 at nominal.
fn scale(name: &str, meaning: &str) -> Axis {
    number(name, "", 1.0, meaning).with_values(AxisValues::Logarithmic)
}

/// An axis of names, the first of which is nominal.
fn choice(name: &str, names: &[&str], meaning: &str) -> Axis {
    let values = names.iter().map(ToString::to_string).collect::<Arc<[String]>>();
    Axis { high: (names.len() - 1) as f64, ..number(name, "", 0.0, meaning) }
        .with_values(AxisValues::Categorical(values))
}

/// An axis with these bounds at every severity.
fn bounded(name: &str, unit: &str, [low, high]: [f64; 2], nominal: f64, meaning: &str) -> Axis {
    Axis { low, high, ..number(name, unit, nominal, meaning) }
}

/// The bounds `nominal - step s` to `nominal + step s` at a severity s.
fn around(nominal: f64, step: f64) -> Levels {
    Levels::Within(std::array::from_fn(|place| {
        let far = step * (place + 1) as f64;
        [nominal - far, nominal + far]
    }))
}

/// The bounds from `-most` to `most` at each severity.
fn both_ways(most: [f64; SEVERITIES]) -> Levels {
    Levels::Within(most.map(|most| [-most, most]))
}

/// A condition that another axis is not at its nominal value 0.
fn unless_zero(axis: &str) -> [Condition; 1] {
    [Condition { axis: axis.to_string(), nominal: 0.0, holds: Holds::Except(0.0) }]
}

/// A condition that another axis, nominal at 0, has one of these values.
fn one_of(axis: &str, values: impl IntoIterator<Item = usize>) -> Condition {
    let values: Vec<f64> = values.into_iter().map(|value| value as f64).collect();
    Condition { axis: axis.to_string(), nominal: 0.0, holds: Holds::OneOf(values.into()) }
}

fn camera(cameras: &[SightCamera]) -> Vec<SightAxis> {
    let of = |axis, set, levels| SightAxis::new(Factor::Camera, axis, set, levels);
    let mut axes = Vec::new();
    for (index, SightCamera { name, is_mounted }) in cameras.iter().enumerate() {
        let step = DISPLACED[usize::from(*is_mounted)];
        for (i, axis) in ["x", "y", "z"].into_iter().enumerate() {
            let meaning =
                format!("displacement of the camera `{name}` along the {axis} axis of what it is mounted on");
            let axis = number(&format!("{name}_camera_{axis}"), "m", 0.0, &meaning);
            axes.push(of(axis, Set::CameraPosition(index, i), around(0.0, step)));
        }
        for (i, (turn, side)) in
            [("pitch", "up"), ("yaw", "to the left"), ("roll", "counterclockwise")].into_iter().enumerate()
        {
            let meaning = format!("tilt of the camera `{name}` {side}");
            let axis = number(&format!("{name}_camera_{turn}"), "rad", 0.0, &meaning);
            axes.push(of(axis, Set::CameraTilt(index, i), around(0.0, TILTED)));
        }
        let meaning = format!("factor of the focal length of the camera `{name}`");
        let focal = Levels::Within(std::array::from_fn(|place| {
            let most = 1.0 + 0.04 * (place + 1) as f64;
            [1.0 / most, most]
        }));
        axes.push(of(scale(&format!("{name}_camera_focal_scale"), &meaning), Set::Focal(index), focal));
    }
    axes
}

fn light([x, y, _]: [f64; 3]) -> Vec<SightAxis> {
    let of = |axis, set, levels| SightAxis::new(Factor::Light, axis, set, levels);
    let direction = "direction to the lamp: its horizontal part, for a vertical part of 1";
    let second = |name: &str, nominal: f64| {
        let axis =
            bounded(name, "", [-1.2, 1.2], nominal, "direction to the second lamp, as lamp_x and lamp_y");
        axis.only_if(unless_zero("lamp2_strength"))
    };
    let mut axes = vec![
        of(number("lamp_x", "", x, direction), Set::LampDirection(0, 0), around(x, 0.3)),
        of(number("lamp_y", "", y, direction), Set::LampDirection(0, 1), around(y, 0.3)),
    ];
    let strength = number("lamp_strength", "", 0.6, "brightness of a white surface that faces the lamp");
    axes.push(of(strength, Set::LampStrength(0), Levels::Within(LAMP)));
    for (i, color) in [(0, "red"), (2, "blue")] {
        let axis = scale(&format!("lamp_{color}"), &format!("factor of the {color} light of the lamp"));
        axes.push(of(axis, Set::LampColor(i), Levels::Within(LAMP_COLOR)));
    }
    let ambient = scale("ambient_scale", "factor of the light of the sky");
    axes.push(of(ambient, Set::Ambient, Levels::Within(AMBIENT)));
    let radius = number("lamp_radius", "rad", 0.0, "radius of the lamp; shadows are soft unless it is 0");
    axes.push(of(radius, Set::LampRadius, Levels::UpTo([0.03, 0.06, 0.09, 0.12, 0.15])));
    let strength = "brightness of a white surface that faces the second lamp";
    let strength = number("lamp2_strength", "", 0.0, strength);
    axes.push(of(strength, Set::LampStrength(1), Levels::UpTo([0.06, 0.12, 0.18, 0.24, 0.3])));
    axes.push(of(second("lamp2_x", -0.5), Set::LampDirection(1, 0), Levels::Same));
    axes.push(of(second("lamp2_y", 0.6), Set::LampDirection(1, 1), Levels::Same));
    axes
}

/// The color and the texture of a part.
fn looks(factor: Factor, part: Part) -> Vec<SightAxis> {
    let name = part.name();
    let of = |axis, set, levels| SightAxis::new(factor, axis, set, levels);
    let mut axes = Vec::new();
    for (i, color) in COLOR_NAMES.into_iter().enumerate() {
        let meaning = format!("change of the {color} of the {name}");
        let axis = number(&format!("{name}_{color}"), "", 0.0, &meaning);
        axes.push(of(axis, Set::Color(part, i), both_ways(RECOLORED)));
    }
    let pattern = format!("{name}_pattern");
    let has_pattern = || one_of(&pattern, 1..=3);
    let meaning = format!("pattern of the {name}");
    let contrast_name = format!("{name}_contrast");
    let patterns = choice(&pattern, &["plain", "checker", "noise", "wood"], &meaning)
        .only_if(unless_zero(&contrast_name));
    axes.push(of(patterns, Set::Pattern(part), Levels::AnyButFirst));
    let meaning = format!("how much darker the second color of the pattern of the {name} is, as a fraction");
    let contrast = number(&contrast_name, "", 0.0, &meaning).only_if([has_pattern()]);
    axes.push(of(contrast, Set::Contrast(part), Levels::UpTo(CONTRAST)));
    let meaning = format!("number of the random pattern of the {name}");
    let seed = bounded(&format!("{name}_pattern_seed"), "", [0.0, 99.0], 0.0, &meaning)
        .with_values(AxisValues::Integer)
        .only_if([one_of(&pattern, 2..=3)]);
    axes.push(of(seed, Set::PatternSeed(part), Levels::Same));
    axes
}

fn background() -> impl Iterator<Item = SightAxis> {
    COLOR_NAMES.into_iter().enumerate().map(|(i, color)| {
        let meaning = format!("change of the {color} of the background");
        let axis = number(&format!("background_{color}"), "", 0.0, &meaning);
        SightAxis::new(Factor::Background, axis, Set::Background(i), both_ways(RECOLORED))
    })
}

fn distractors() -> Vec<SightAxis> {
    let of = |axis, set, levels| SightAxis::new(Factor::Distractors, axis, set, levels);
    let count = "number of distractors, which touch nothing";
    let count = number("distractor_count", "", 0.0, count);
    let mut axes = vec![of(count, Set::DistractorCount, Levels::Count)];
    for index in 0..MOST_DISTRACTORS {
        let number_of = index + 1;
        let exists = || [one_of("distractor_count", number_of..=MOST_DISTRACTORS)];
        let name = |what: &str| format!("distractor{number_of}_{what}");
        let meaning = |what: &str| format!("{what} of distractor {number_of}");
        let nominal = Distractor::nominal(index);
        let [x, y] = nominal.requested.map(f64::from);
        let choice = |what: &str, names: &[&str], nominal: usize| Axis {
            nominal: Some(nominal as f64),
            ..choice(&name(what), names, &meaning(what))
        };
        let colors = COLORS.map(|(color, _)| color);
        let place = meaning("requested place; it stands at the nearest one that is free and in view");
        let share = meaning("share of the image of the first camera that is its own at the start");
        let own = [
            (choice("shape", &SHAPES, nominal.shape), Set::DistractorShape(index)),
            (choice("color", &colors, nominal.color), Set::DistractorColor(index)),
            (bounded(&name("x"), "m", DISTRACTOR_X, x, &place), Set::DistractorPlace(index, 0)),
            (bounded(&name("y"), "m", DISTRACTOR_Y, y, &place), Set::DistractorPlace(index, 1)),
            (
                bounded(&name("share"), "", DISTRACTOR_SHARE, DISTRACTOR_SHARE[0], &share),
                Set::DistractorShare(index),
            ),
        ];
        let own =
            own.into_iter().map(|(axis, set)| of(axis.only_if(exists()), set, Levels::OfNumber(number_of)));
        axes.extend(own);
    }
    axes
}

fn occlusion() -> Vec<SightAxis> {
    let of = |axis, set, levels| SightAxis::new(Factor::Occlusion, axis, set, levels);
    let size = "side of a dark patch on each lens, as a fraction of the image";
    let place = |name: &str, from: &str| {
        let meaning = format!("center of the patch, from the {from}");
        bounded(name, "", [0.0, 1.0], 0.5, &meaning).only_if(unless_zero("occlusion_size"))
    };
    vec![
        of(number("occlusion_size", "", 0.0, size), Set::PatchSize, Levels::UpTo(PATCH)),
        of(place("occlusion_x", "left"), Set::PatchPlace(0), Levels::Same),
        of(place("occlusion_y", "top"), Set::PatchPlace(1), Levels::Same),
    ]
}

fn image(has_scene: bool) -> Vec<SightAxis> {
    let of = |axis, set, levels| SightAxis::new(Factor::Image, axis, set, levels);
    let names = Corruption::names(has_scene);
    let kind = choice("corruption", &names, "kind of the corruption of the images of all cameras")
        .only_if(unless_zero("corruption_severity"));
    let severity = "severity of the corruption; 1 to 5 are the levels of docs/reference/sight.md";
    let severity =
        number("corruption_severity", "", 0.0, severity).only_if([one_of("corruption", 1..names.len())]);
    let row = "where dead rows are, from the top";
    let row = bounded("corruption_row", "", [0.0, 1.0], 0.5, row)
        .only_if([one_of("corruption", [Corruption::DeadRows.number()])]);
    vec![
        of(kind, Set::Corruption, Levels::AnyButFirst),
        of(severity, Set::CorruptionSeverity, Levels::UpTo([1.0, 2.0, 3.0, 4.0, 5.0])),
        of(row, Set::CorruptionRow, Levels::Same),
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
    let late =
        bounded("camera_delay", "control steps", [0.0, 6.0], 0.0, "delay of the images of all cameras")
            .with_values(AxisValues::Integer);
    let mut all = site.disturbances();
    all.push(Disturbance { axis: late, effect: Effect::ObservationDelay });
    all
}

fn faults(disturbances: &[Disturbance]) -> impl Iterator<Item = SightAxis> {
    let fault = |disturbance: &Disturbance| SightAxis {
        factor: None,
        axis: disturbance.axis.clone(),
        set: Set::Feed,
        levels: Levels::Same,
    };
    disturbances.iter().map(fault)
}
