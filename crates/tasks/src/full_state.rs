//! Joint positions, velocities and contact forces of recorded states.

use mishandle_world::{Body, ElementKind, FullState, Model, PANDA, RowWorlds, World, WorldError};

use crate::axes::Elements;
use crate::environment::TaskEnvironment;
use crate::row_world::RowWorld;

/// The worlds of state rows of a [`TaskEnvironment`].
struct TaskRows {
    elements: Elements,
    row_world: RowWorld,
}

impl RowWorlds for TaskRows {
    fn of_row(&mut self, row: &[f64]) -> &mut World {
        let world = self.row_world.of_row(row, &self.elements);
        world.set_state(row);
        world
    }
}

impl TaskEnvironment {
    /// Makes a recorder for state rows of this environment. The robot is one part of its contacts.
    ///
    /// # Errors
    /// If the robot's own document does not compile.
    pub fn full_state(&self) -> Result<FullState, WorldError> {
        let model = self.model();
        let names = Model::from_xml(PANDA)?.names(ElementKind::Body);
        let robot: Vec<Body> =
            names[1..].iter().map(|name| model.body(name)).collect::<Result<_, WorldError>>()?;
        let worlds = TaskRows { elements: self.elements().clone(), row_world: self.row_world(1) };
        Ok(FullState::new(Box::new(worlds), model, model.contact_parts(&robot)))
    }
}
