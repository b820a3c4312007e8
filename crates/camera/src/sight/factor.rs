//! Factors of sight and their severities.

use mishandle_rollout::{Axis, AxisValues, Distribution};

use crate::sight::set::Set;

/// Number of severities of a factor, which count from 1.
pub const SEVERITIES: usize = 5;

/// A group of axes of sight that belong together. Other factors keep their nominal values.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Factor {
    /// Pose and focal length of each camera.
    Camera,
    /// Lamps and ambient light.
    Light,
    /// Color and texture of floor, table and background.
    Background,
    /// Color and texture of the object.
    Object,
    /// Shapes that have nothing to do with the task.
    Distractors,
    /// A patch on each lens.
    Occlusion,
    /// One corruption of the images.
    Image,
}

impl Factor {
    /// All factors with the names that their spaces begin with.
    pub const ALL: [(Factor, &'static str); 7] = [
        (Factor::Camera, "camera"),
        (Factor::Light, "light"),
        (Factor::Background, "background"),
        (Factor::Object, "object"),
        (Factor::Distractors, "distractors"),
        (Factor::Occlusion, "occlusion"),
        (Factor::Image, "image"),
    ];

    /// Returns the name.
    pub fn name(self) -> &'static str {
        Self::ALL.iter().find(|(factor, _)| *factor == self).map_or("", |(_, name)| name)
    }

    /// Returns the name of its space with a severity from 1 to 5.
    pub fn space(self, severity: usize) -> String {
        severity_space(self.name(), severity)
    }
}

/// Returns the name of the space of a factor with a severity.
pub fn severity_space(factor: &str, severity: usize) -> String {
    format!("{factor}-{severity}")
}

/// The bounds of an axis at each severity.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Levels {
    /// The bounds of the axis, whatever the severity.
    Same,
    /// These bounds, on both sides of the nominal value.
    Within([[f64; 2]; SEVERITIES]),
    /// From 0, the nominal value, to these. A random value exceeds the bound of the severity
    /// before; at severity 1, it exceeds half the bound.
    UpTo([f64; SEVERITIES]),
    /// A choice with the first value as nominal one, which no random scenario has.
    AnyButFirst,
    /// As many as the severity.
    Count,
    /// As [`Same`](Self::Same), from the severity on at which [`Count`](Self::Count) has this number.
    OfNumber(usize),
}

/// An axis of sight.
#[derive(Clone, Debug)]
pub(crate) struct SightAxis {
    /// Its factor; `None` for a fault of a camera, which changes no image.
    pub factor: Option<Factor>,
    /// The axis with the bounds of the largest severity.
    pub axis: Axis,
    /// Which number of the view it sets.
    pub set: Set,
    /// Its bounds at each severity.
    pub levels: Levels,
}

impl SightAxis {
    /// Makes an axis of a factor, with the bounds of the largest severity.
    pub fn new(factor: Factor, axis: Axis, set: Set, levels: Levels) -> SightAxis {
        let own = SightAxis { factor: Some(factor), axis, set, levels };
        let widest =
            Axis { distribution: Distribution::Uniform, ..own.at(SEVERITIES).unwrap_or(own.axis.clone()) };
        SightAxis { axis: widest, ..own }
    }

    /// Returns the axis at a severity; `None` if it has no effect there.
    pub fn at(&self, severity: usize) -> Option<Axis> {
        let axis = self.axis.clone();
        let place = severity - 1;
        let upper = |from: f64, high: f64, axis: Axis| Axis {
            low: 0.0,
            high,
            distribution: Distribution::Upper(from),
            ..axis
        };
        match self.levels {
            Levels::Same => Some(axis),
            Levels::Within(bounds) => {
                let [low, high] = bounds[place];
                Some(Axis { low, high, ..axis })
            }
            Levels::UpTo(most) => {
                let before = place.checked_sub(1).map_or(0.5 * most[0], |before| most[before]);
                Some(upper(before / most[place], most[place], axis))
            }
            Levels::AnyButFirst => {
                let count = axis.levels().unwrap_or(1) as f64;
                Some(Axis { distribution: Distribution::Upper(1.0 / count), ..axis })
            }
            Levels::Count => {
                let count = severity as f64;
                Some(upper(count / (count + 1.0), count, axis).with_values(AxisValues::Integer))
            }
            Levels::OfNumber(number) => (number <= severity).then_some(axis),
        }
    }

    /// Returns whether it makes an image depend on the seed.
    pub fn is_random(&self) -> bool {
        matches!(self.set, Set::Corruption | Set::CorruptionSeverity)
    }
}
