//! The parts of a scene whose appearance axes change.

use crate::{Form, Shape};

/// A part of a scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Part {
    /// The object that the task is about.
    Object,
    /// Tables, blocks, doors and targets: everything else.
    Support,
    /// Planes: the ground.
    Floor,
    /// The robot.
    Robot,
}

impl Part {
    /// All parts with their names, which the axes of all but the robot begin with.
    pub const ALL: [(Part, &'static str); 4] = [
        (Part::Object, "object"),
        (Part::Support, "support"),
        (Part::Floor, "floor"),
        (Part::Robot, "robot"),
    ];

    /// Returns the name.
    pub(crate) fn name(self) -> &'static str {
        Self::ALL.iter().find(|(part, _)| *part == self).map_or("", |(_, name)| name)
    }
}

/// The bodies of the parts of a scene, as indices.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct PartBodies {
    /// Bodies of the object.
    pub object: Vec<usize>,
    /// Bodies of the robot.
    pub robot: Vec<usize>,
}

impl PartBodies {
    /// Returns the part of a shape.
    pub(crate) fn part(&self, shape: &Shape) -> Part {
        match shape.form {
            Form::Plane { .. } => Part::Floor,
            _ if self.object.contains(&shape.body) => Part::Object,
            _ if self.robot.contains(&shape.body) => Part::Robot,
            _ => Part::Support,
        }
    }
}
