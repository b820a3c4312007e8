//! Shapes that have nothing to do with a task.

use crate::form::Form;
use crate::material::{Color, Material};

/// Names of shapes: a carton, a ball, a can and a bottle.
pub(crate) const SHAPES: [&str; 4] = ["box", "sphere", "cylinder", "capsule"];

/// Colors with their names.
pub(crate) const COLORS: [(&str, Color); 6] = [
    ("red", [0.80, 0.15, 0.12]),
    ("green", [0.15, 0.60, 0.20]),
    ("blue", [0.15, 0.25, 0.75]),
    ("yellow", [0.85, 0.75, 0.15]),
    ("purple", [0.50, 0.20, 0.60]),
    ("black", [0.08, 0.08, 0.08]),
];

/// A distractor. It is drawn and touches nothing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Distractor {
    pub shape: usize,
    pub color: usize,
    /// The requested place, m.
    pub requested: [f32; 2],
    /// The share of the image that it has at the start.
    pub share: f32,
}

impl Distractor {
    /// Returns the nominal distractor with this index. Their requested places are apart.
    pub fn nominal(index: usize) -> Distractor {
        let [x, y] = [[0.75, -0.3], [0.75, 0.3], [0.3, -0.4], [0.3, 0.4], [0.9, 0.0]][index];
        Distractor {
            shape: index % SHAPES.len(),
            color: index % COLORS.len(),
            requested: [x, y],
            share: 0.025,
        }
    }

    /// Returns its form for half a height, m.
    pub fn form(&self, size: f32) -> Form {
        match self.shape {
            0 => Form::Box { half: [0.55 * size, 0.8 * size, size] },
            1 => Form::Sphere { radius: size },
            2 => Form::Cylinder { radius: 0.6 * size, half: size },
            _ => Form::Capsule { radius: 0.5 * size, half: 0.5 * size },
        }
    }

    /// Returns its surface.
    pub fn material(&self) -> Material {
        Material::plain(COLORS[self.color.min(COLORS.len() - 1)].1)
    }
}
