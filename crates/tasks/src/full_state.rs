//! Joint positions, velocities and contact forces of recorded states.

use mishandle_world::{ContactParts, Coordinate, WorldError};

use crate::axes::Elements;
use crate::environment::TaskEnvironment;
use crate::row_world::RowWorld;

/// Computes joint positions, joint velocities and contact forces from state rows of a
/// [`TaskEnvironment`].
pub struct FullState {
    coordinates: Vec<Coordinate>,
    parts: ContactParts,
    elements: Elements,
    row_world: RowWorld,
    forces: Vec<f64>,
}

impl TaskEnvironment {
    /// Makes a recorder for state rows of this environment.
    ///
    /// # Errors
    /// If the robot's own document does not compile.
    pub fn full_state(&self) -> Result<FullState, WorldError> {
        Ok(FullState {
            coordinates: self.model().coordinates(),
            parts: self.model().contact_parts()?,
            elements: self.elements().clone(),
            row_world: self.row_world(1),
            forces: Vec::new(),
        })
    }
}

impl FullState {
    /// Returns the names and units of the values: `q_NAME` and `dq_NAME` of each joint,
    /// `contact_A_B` with the norm of the net contact force between two parts, and
    /// `contact_largest`, the largest force at a single contact point.
    pub fn columns(&self) -> Vec<(String, &'static str)> {
        let coordinate = |coordinate: &Coordinate| {
            let prefix = if coordinate.is_velocity { "dq" } else { "q" };
            (format!("{prefix}_{}", coordinate.name), coordinate.unit)
        };
        let pair = |[first, second]: [&str; 2]| (format!("contact_{first}_{second}"), "N");
        let mut columns: Vec<_> = self.coordinates.iter().map(coordinate).collect();
        columns.extend(self.parts.pairs().map(pair));
        columns.push(("contact_largest".to_string(), "N"));
        columns
    }

    /// Appends the values of a state row, in the order of [`columns`](Self::columns).
    ///
    /// # Panics
    /// If the row is too short.
    pub fn measure(&mut self, state: &[f64], out: &mut Vec<f64>) {
        let world = self.row_world.of_row(state, &self.elements);
        world.set_state(state);
        for coordinate in &self.coordinates {
            let values = if coordinate.is_velocity { world.qvel() } else { world.qpos() };
            out.push(values[coordinate.index]);
        }
        world.contact_forces(&self.parts, &mut self.forces);
        out.extend_from_slice(&self.forces);
    }
}
