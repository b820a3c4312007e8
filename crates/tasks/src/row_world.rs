//! The world of a worker, with the model of the row that it steps.

use std::collections::HashMap;

use mishandle_world::{Change, Model, World};

use crate::axes::{self, Constant, Elements, SLIP_SIZE};
use crate::robot::JOINTS;

/// Number of models that a worker keeps besides one for each of its rows.
const MORE_MODELS: usize = 16;

/// The world of one worker. The constants of a state row determine its model, so that one worker
/// can step rows with different constants.
///
/// Making a model takes as long as a control step of a light scene, so those of all rows are kept.
pub(crate) struct RowWorld {
    world: World,
    plain: Model,
    nominal: Vec<(Constant, f64)>,
    /// Number of parameters in a state row.
    tail_size: usize,
    /// Models by the bits of the values of the constants, in the order of `nominal`, and of the
    /// slip.
    recent: HashMap<Vec<u64>, Model>,
    /// Models that were used before the last one was added to a full `recent`.
    older: HashMap<Vec<u64>, Model>,
    /// Largest number of recent models.
    limit: usize,
    /// Scratch buffer of the bits of the required values.
    required: Vec<u64>,
}

impl RowWorld {
    /// Makes the world of a worker that steps this number of rows in turn.
    pub fn new(plain: &Model, nominal: Vec<(Constant, f64)>, tail_size: usize, rows: usize) -> RowWorld {
        RowWorld {
            world: plain.world(),
            plain: plain.clone(),
            nominal,
            tail_size,
            recent: HashMap::new(),
            older: HashMap::new(),
            limit: rows + MORE_MODELS,
            required: Vec::new(),
        }
    }

    /// Splits a state row into MuJoCo's state, the joint targets, the tail, and the memory of the
    /// signals of the manner and of its reward terms.
    pub fn split<'a>(
        &self,
        state: &'a mut [f64],
    ) -> (&'a mut [f64], &'a mut [f64], &'a mut [f64], &'a mut [f64]) {
        let (physics, rest) = state.split_at_mut(self.plain.state_size());
        let (targets, rest) = rest.split_at_mut(JOINTS);
        let (tail, memory) = rest.split_at_mut(self.tail_size);
        (physics, targets, tail, memory)
    }

    /// Returns the parameters of the events in a tail; `None` in an empty one.
    pub fn events<'a>(&self, tail: &'a [f64]) -> Option<&'a [f64]> {
        tail.get(1 + self.nominal.len()..)
    }

    /// Returns the world with the model that it has.
    pub fn world(&self) -> &World {
        &self.world
    }

    /// As [`world`](Self::world).
    pub fn world_mut(&mut self) -> &mut World {
        &mut self.world
    }

    /// Returns the world with the model of a state row.
    pub fn of_row(&mut self, state: &[f64], elements: &Elements) -> &mut World {
        let tail = state.get(self.plain.state_size() + JOINTS..).and_then(|rest| rest.get(..self.tail_size));
        self.of_tail(tail.unwrap_or_default(), elements)
    }

    /// Returns the world with the model of a state row with this tail.
    pub fn of_tail(&mut self, tail: &[f64], elements: &Elements) -> &mut World {
        // A space without axes of constants or events never changes the model.
        if !tail.is_empty() {
            let model = self.model(tail, elements).clone();
            self.world.set_model(&model);
        }
        &mut self.world
    }

    /// Returns the model of a state row with this tail.
    pub fn model(&mut self, tail: &[f64], elements: &Elements) -> &Model {
        if tail.is_empty() {
            return &self.plain;
        }
        let (values, slip) = self.require(tail);
        if !self.recent.contains_key(&self.required) {
            let known = self.older.remove(&self.required);
            let model = known.unwrap_or_else(|| self.changed(values, slip, elements));
            if self.recent.len() == self.limit {
                self.older = std::mem::take(&mut self.recent);
            }
            self.recent.insert(self.required.clone(), model);
        }
        &self.recent[&self.required]
    }

    /// Sets the required values: the constants and the slip of a tail, which it returns.
    fn require<'a>(&mut self, tail: &'a [f64]) -> (&'a [f64], [f64; 2]) {
        let values = &tail[1..][..self.nominal.len()];
        let slip = axes::slip(&tail[tail.len() - SLIP_SIZE..], tail[0] as usize);
        self.required.clear();
        self.required.extend(values.iter().chain(&slip).map(|value| value.to_bits()));
        (values, slip)
    }

    /// Makes the model with these values of the constants.
    fn changed(&self, values: &[f64], slip: [f64; 2], elements: &Elements) -> Model {
        let changed = self.nominal.iter().zip(values).filter(|((_, nominal), value)| nominal != *value);
        let changes: Vec<Change> = changed
            .map(|((constant, _), value)| elements.change(*constant, *value))
            .chain(elements.slip(slip))
            .collect();
        if changes.is_empty() { self.plain.clone() } else { self.plain.changed(&changes) }
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "tests")]

    use super::*;
    use crate::{Preset, Reward, TaskEnvironment, task};

    #[test]
    fn the_model_of_a_row_is_made_once_in_an_episode() {
        const ROWS: usize = 40;
        let environment =
            TaskEnvironment::new(task("point-reaching").unwrap(), Preset::Paper, Reward::Shaped).unwrap();
        let (_, spaces) = environment.axes_and_spaces(&[], &[]).unwrap();
        let dynamics = spaces.into_iter().find(|space| space.name() == "dynamics").unwrap();
        let environment = environment.with_space(dynamics).unwrap();
        let mut world = environment.row_world(ROWS);
        let elements = environment.elements().clone();
        let tail = |episode: usize, world: &RowWorld| {
            let mut tail = vec![0.0; world.tail_size];
            let nominal = world.nominal.iter().map(|(_, nominal)| *nominal);
            tail[1..][..world.nominal.len()].iter_mut().zip(nominal).for_each(|(value, x)| *value = x);
            tail[1] += 1e-3 * (episode + 1) as f64;
            tail
        };
        // In each round, all rows are stepped in turn, and then some get a new episode.
        let mut episodes: Vec<usize> = (0..ROWS).collect();
        for episode in &episodes {
            world.model(&tail(*episode, &world), &elements);
        }
        let mut next = ROWS;
        for round in 0..30 {
            for (row, episode) in episodes.iter().enumerate() {
                let tail = tail(*episode, &world);
                world.require(&tail);
                let is_kept =
                    [&world.recent, &world.older].iter().any(|map| map.contains_key(&world.required));
                assert!(is_kept, "row {row} of round {round}");
                world.model(&tail, &elements);
            }
            for row in (0..ROWS).filter(|row| (row * 7 + round) % 10 < round % 5 || round == 17) {
                (episodes[row], next) = (next, next + 1);
                world.model(&tail(episodes[row], &world), &elements);
            }
            assert!(world.recent.len() + world.older.len() <= 2 * world.limit);
        }
    }
}
