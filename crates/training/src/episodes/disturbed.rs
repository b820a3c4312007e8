//! Disturbances and noise between environments and policy.

use mishandle_rollout::{ActiveInterface, EnvironmentSpec, Interface, Noise, Scenario, Seed, Start};
use rayon::prelude::*;

use super::ROWS_PER_TASK;
use crate::{Checkpoint, TrainingError};

/// Disturbances of all rows, and what the policy sees.
pub(super) struct Disturbed {
    interface: Interface,
    noise: Noise,
    rows: Vec<DisturbedRow>,
    /// Observations with their disturbances, `[rows, observation_size]`.
    observations: Vec<f32>,
    /// Scratch buffer of the draws of the observation noise, of the same length.
    draws: Vec<f64>,
    action_size: usize,
    /// Length of the part of an observation on which they act.
    measured_size: usize,
}

/// Disturbances of the episode of a row.
pub(super) struct DisturbedRow {
    pub interface: ActiveInterface,
    scenario: Scenario,
    seed: Seed,
    /// Last action of the policy, which is held while a fault pauses it; empty if none does.
    held: Vec<f32>,
}

impl DisturbedRow {
    fn new(interface: &Interface, scenario: Scenario, seed: Seed, action_size: usize) -> DisturbedRow {
        let interface = interface.start(&scenario, seed);
        let held = if interface.has_pause() { action_size } else { 0 };
        DisturbedRow { interface, scenario, seed, held: vec![0.0; held] }
    }

    /// Returns the action that leaves the policy in a control step: its own, or the last one while
    /// it is paused.
    pub fn answer<'a>(&'a mut self, step: usize, action: &'a [f32]) -> &'a [f32] {
        if self.held.is_empty() {
            return action;
        }
        if !self.interface.is_paused(step) {
            self.held.copy_from_slice(action);
        }
        &self.held
    }
}

impl Disturbed {
    /// Makes the disturbances of rows that have no episode yet.
    pub fn new(
        interface: Interface,
        noise: Noise,
        nominal: &Scenario,
        rows: usize,
        spec: &EnvironmentSpec,
    ) -> Disturbed {
        let action_size = spec.action_size;
        let row = |_| DisturbedRow::new(&interface, nominal.clone(), Seed(0), action_size);
        let rows: Vec<DisturbedRow> = (0..rows).map(row).collect();
        Disturbed {
            observations: vec![0.0; rows.len() * spec.observation_size],
            draws: vec![0.0; rows.len() * spec.observation_size],
            measured_size: spec.observation_size - spec.exact_size,
            rows,
            interface,
            noise,
            action_size,
        }
    }

    pub fn observations(&self) -> &[f32] {
        &self.observations
    }

    pub fn rows_mut(&mut self) -> rayon::slice::IterMut<'_, DisturbedRow> {
        self.rows.par_iter_mut()
    }

    /// Returns whether a fault pauses the policy of a row in a control step.
    pub fn is_paused(&self, row: usize, step: usize) -> bool {
        self.rows[row].interface.is_paused(step)
    }

    /// Starts the disturbances of an episode, and leaves the environment's part of its scenario.
    pub fn start(&mut self, start: &mut Start) {
        let environment = self.interface.environment(&start.scenario);
        let scenario = std::mem::replace(&mut start.scenario, environment);
        self.rows[start.row] = DisturbedRow::new(&self.interface, scenario, start.seed, self.action_size);
    }

    /// Computes what the policy sees in each row for which `step` returns the control step.
    pub fn observe(&mut self, observations: &[f32], step: impl Fn(usize) -> Option<usize> + Sync) {
        let size = observations.len() / self.rows.len();
        let measured = self.measured_size;
        let noise = self.noise;
        let rows = self.rows.par_iter_mut().zip(self.observations.par_chunks_mut(size));
        let rows = rows.zip(self.draws.par_chunks_mut(size)).zip(observations.par_chunks(size));
        rows.with_min_len(ROWS_PER_TASK).enumerate().for_each(
            |(index, (((row, seen), draws), observation))| {
                if let Some(step) = step(index) {
                    seen.copy_from_slice(observation);
                    // Before the delays: a late or repeated observation has the noise of its
                    // measurement.
                    let seen = &mut seen[..measured];
                    noise.on_observation(row.seed, step as u64, seen, &mut draws[..measured]);
                    row.interface.observe(step, seen);
                }
            },
        );
    }

    /// Saves the disturbances to a checkpoint.
    pub fn save(&mut self, checkpoint: &mut Checkpoint) {
        let mut scenarios = Vec::new();
        let mut memory = Vec::new();
        let mut lengths = Vec::new();
        for row in &mut self.rows {
            scenarios.extend(row.scenario.values().iter().map(|value| value.unwrap_or(f64::NAN)));
            let before = memory.len();
            memory.extend(row.held.iter().copied().map(f64::from));
            row.interface.save(&mut memory);
            lengths.push((memory.len() - before) as u64);
        }
        checkpoint.put("disturbed.scenarios", scenarios);
        checkpoint.put("disturbed.memory", memory);
        checkpoint.put("disturbed.lengths", lengths);
        checkpoint.put("disturbed.observations", self.observations.clone());
    }

    /// Restores the disturbances from a checkpoint; `seed` returns the seed of the episode of a
    /// row.
    ///
    /// # Errors
    /// If the checkpoint contains arrays of other sizes.
    pub fn load(
        &mut self,
        checkpoint: &Checkpoint,
        seed: impl Fn(usize) -> Seed,
    ) -> Result<(), TrainingError> {
        let axes = self.rows.first().map_or(0, |row| row.scenario.values().len());
        let scenarios = checkpoint.f64s("disturbed.scenarios", self.rows.len() * axes)?;
        let lengths = checkpoint.u64s("disturbed.lengths", self.rows.len())?;
        let total = lengths.iter().map(|length| *length as usize).fold(0, usize::saturating_add);
        let mut memory = checkpoint.f64s("disturbed.memory", total)?;
        let seen = checkpoint.f32s("disturbed.observations", self.observations.len())?;
        self.observations.copy_from_slice(seen);
        for (index, (row, length)) in self.rows.iter_mut().zip(lengths).enumerate() {
            let values = scenarios[index * axes..][..axes].iter();
            let scenario = Scenario::new(values.map(|x| (!x.is_nan()).then_some(*x)).collect());
            *row = DisturbedRow::new(&self.interface, scenario, seed(index), self.action_size);
            let (own, rest) = memory.split_at(*length as usize);
            let (held, remembered) = own.split_at(row.held.len().min(own.len()));
            row.held.iter_mut().zip(held).for_each(|(held, saved)| *held = *saved as f32);
            row.interface.restore(remembered);
            memory = rest;
        }
        Ok(())
    }
}
