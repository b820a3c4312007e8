//! Further parts of the observation: what a controller knows exactly besides its sensors. The
//! environment writes those that the controller names, and neither noise nor faults act on them.

use mishandle_controllers::JOINT_TARGETS;
use mishandle_world::{Model, Rows};

use crate::definition::{Definition, GripperMode, Quantity};
use crate::robot::{EPISODE_STEPS, JOINTS, Panda};

/// A further part of the observation.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum FurtherPart {
    /// The targets of the servos: the controller's own past commands.
    JointTargets,
    /// Whether the hand holds its object.
    Held,
    /// The time since the start of the episode.
    Time,
}

impl FurtherPart {
    /// Returns the part as a quantity.
    pub fn quantity(self) -> Quantity {
        let (name, size, meaning) = match self {
            FurtherPart::JointTargets => (
                JOINT_TARGETS,
                JOINTS,
                "targets of the joints' servos, mapped from the joints' limits to [-1, 1]",
            ),
            FurtherPart::Held => ("held", 1, "1 while the hand holds the object, 0 after its release"),
            FurtherPart::Time => {
                ("time", 1, "time since the start, as a share of the duration of an episode")
            }
        };
        Quantity { name, unit: "", size, meaning }
    }
}

/// Returns the further parts that a task has, in order.
pub(crate) fn further_parts(definition: &Definition) -> Vec<FurtherPart> {
    let is_released = definition.held.is_some() && matches!(definition.grip, GripperMode::Scene(_));
    let all = [FurtherPart::JointTargets, FurtherPart::Held, FurtherPart::Time];
    all.into_iter().filter(|part| *part != FurtherPart::Held || is_released).collect()
}

/// The values that the further parts show besides the state of the world.
#[derive(Clone, Copy)]
pub(crate) struct Known<'a> {
    /// Targets of the joints, rad for the arm, m for the fingers.
    pub targets: &'a [f64],
    /// Control steps since the start.
    pub steps: f64,
}

/// The further parts that an environment writes.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct FurtherParts(Vec<FurtherPart>);

impl FurtherParts {
    /// Returns the parts with these names; `None` if the task does not have one of them.
    pub fn named(definition: &Definition, names: &[String]) -> Option<FurtherParts> {
        let known = further_parts(definition);
        let named = |part: &FurtherPart| names.iter().any(|name| name == part.quantity().name);
        let parts: Vec<FurtherPart> = known.into_iter().filter(named).collect();
        (parts.len() == names.len()).then_some(FurtherParts(parts))
    }

    /// Returns the number of their numbers.
    pub fn size(&self) -> usize {
        self.0.iter().map(|part| part.quantity().size).sum()
    }

    /// Returns the length of the memory of an episode: the number of control steps, if they show
    /// the time.
    pub fn memory_size(&self) -> usize {
        usize::from(self.0.contains(&FurtherPart::Time))
    }

    /// Writes the parts.
    pub fn write(&self, model: &Model, panda: &Panda, rows: &Rows<'_>, known: Known<'_>, out: &mut [f64]) {
        let mut rest = out;
        for part in &self.0 {
            let (own, after) = rest.split_at_mut(part.quantity().size);
            rest = after;
            match part {
                FurtherPart::JointTargets => panda.map_positions(known.targets, own),
                FurtherPart::Held => own[0] = f64::from(u8::from(model.holds(rows.active))),
                FurtherPart::Time => own[0] = known.steps / EPISODE_STEPS as f64,
            }
        }
    }
}
