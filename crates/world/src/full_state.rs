//! All that a full record has of a state: coordinates, actuators, poses and contact forces.

use crate::{Actuator, Body, ContactParts, Coordinate, ElementKind, Model, World};

/// Gives the worlds of state rows.
pub trait RowWorlds {
    /// Returns a world with the model and the MuJoCo state of a state row.
    ///
    /// # Panics
    /// If the row is too short.
    fn of_row(&mut self, row: &[f64]) -> &mut World;
}

/// Computes the values of a full record from state rows.
pub struct FullState {
    worlds: Box<dyn RowWorlds>,
    coordinates: Vec<Coordinate>,
    actuators: Vec<String>,
    bodies: Vec<(String, Body)>,
    parts: ContactParts,
    forces: Vec<f64>,
}

impl FullState {
    /// Makes a recorder of joints and contact forces. `worlds` are those of `model` or of models
    /// that were changed from it.
    pub fn new(worlds: Box<dyn RowWorlds>, model: &Model, parts: ContactParts) -> FullState {
        let coordinates = model.coordinates();
        FullState {
            worlds,
            coordinates,
            actuators: Vec::new(),
            bodies: Vec::new(),
            parts,
            forces: Vec::new(),
        }
    }

    /// Also records the actuators, and the positions of the bodies with names. An actuator without
    /// a name has its number, from 1.
    #[must_use]
    pub fn with_actuators_and_bodies(mut self, model: &Model) -> FullState {
        let named = |(index, name): (usize, String)| {
            if name.is_empty() { (index + 1).to_string() } else { name }
        };
        self.actuators = model.names(ElementKind::Actuator).into_iter().enumerate().map(named).collect();
        let bodies = model.names(ElementKind::Body).into_iter().enumerate().skip(1);
        let bodies = bodies.filter(|(_, name)| !name.is_empty());
        self.bodies = bodies.map(|(index, name)| (name, Body(index))).collect();
        self
    }

    /// Returns the names and units of the values: `q_NAME` and `dq_NAME` of each joint; if they are
    /// recorded, `control_NAME` and `force_NAME` of each actuator, and `x_NAME`, `y_NAME` and
    /// `z_NAME` of each body; `contact_A_B` with the norm of the net contact force between two
    /// parts, and `contact_largest`, the largest force at a single contact point.
    pub fn columns(&self) -> Vec<(String, &'static str)> {
        let mut columns: Vec<(String, &'static str)> = Vec::new();
        for Coordinate { name, unit, is_velocity, .. } in &self.coordinates {
            let prefix = if *is_velocity { "dq" } else { "q" };
            columns.push((format!("{prefix}_{name}"), unit));
        }
        // Their units depend on the actuator.
        for prefix in ["control", "force"] {
            columns.extend(self.actuators.iter().map(|name| (format!("{prefix}_{name}"), "")));
        }
        for (name, _) in &self.bodies {
            columns.extend(["x", "y", "z"].map(|axis| (format!("{axis}_{name}"), "m")));
        }
        let pair = |[first, second]: [&str; 2]| (format!("contact_{first}_{second}"), "N");
        columns.extend(self.parts.pairs().map(pair));
        columns.push(("contact_largest".to_string(), "N"));
        columns
    }

    /// Appends the values of a state row, in the order of [`columns`](Self::columns).
    ///
    /// Forces are those of MuJoCo's forward dynamics in the state, under its controls.
    ///
    /// # Panics
    /// If the row is too short.
    pub fn measure(&mut self, row: &[f64], out: &mut Vec<f64>) {
        let world = self.worlds.of_row(row);
        for coordinate in &self.coordinates {
            let values = if coordinate.is_velocity { world.qvel() } else { world.qpos() };
            out.push(values[coordinate.index]);
        }
        world.contact_forces(&self.parts, &mut self.forces);
        if !self.actuators.is_empty() {
            out.extend_from_slice(world.ctrl());
            out.extend((0..self.actuators.len()).map(|index| world.actuator_force(Actuator(index))));
        }
        let rows = world.rows();
        out.extend(self.bodies.iter().flat_map(|(_, body)| rows.position(*body)));
        out.extend_from_slice(&self.forces);
    }
}
