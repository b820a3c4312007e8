//! The parts of a scene whose appearance axes change.

/// A part of a scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Part {
    /// The object that the task is about.
    Object,
    /// Tables, blocks, doors and targets.
    Support,
    /// The ground.
    Floor,
    /// The arm and its hand.
    Robot,
}

impl Part {
    /// All parts with the names that their axes begin with.
    pub const ALL: [(Part, &'static str); 4] = [
        (Part::Object, "object"),
        (Part::Support, "support"),
        (Part::Floor, "floor"),
        (Part::Robot, "robot"),
    ];
}
