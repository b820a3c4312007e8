//! A task whose physics another engine steps, many rows at a time. Observations, signals and rewards are those of
//! [`TaskEnvironment`].

use mishandle_rollout::{
    BatchSamples, BatchStatus, Environment, EnvironmentWorker, RolloutError, Sample, Scenario, ScenarioBatch,
    Seed, StepStatus,
};
use mishandle_world::{
    Backend, BatchBuffers, BatchLayout, BatchSpec, Model, ModelField, RowStatus, WorldBatch, WorldError,
};
use rayon::prelude::*;

use crate::environment::{SceneFunctions, TaskEnvironment, TaskWorker};
use crate::robot::JOINTS;
use crate::row_events::RowEvents;

/// Rows that one thread handles at a time.
const CHUNK: usize = 16;

/// Many rows of a [`TaskEnvironment`] whose physics a [`Backend`] steps.
pub struct TaskBatch {
    model: Model,
    layout: BatchLayout,
    worlds: Box<dyn WorldBatch>,
    chunks: Vec<Chunk>,
    rows: usize,
    sizes: Sizes,
    observations: Vec<f32>,
    signals: Vec<f64>,
    rewards: Vec<f64>,
    statuses: Vec<BatchStatus>,
    functions: SceneFunctions,
    /// Workers that start episodes and events, one per thread.
    workers: Vec<TaskWorker>,
    events: RowEvents,
}

/// Lengths of the rows of the buffers.
#[derive(Clone, Copy)]
struct Sizes {
    observation: usize,
    action: usize,
    signals: usize,
    rewards: usize,
    state: usize,
    output: usize,
    active: usize,
    mocap: usize,
}

/// Scratch buffer of one chunk of rows.
struct Chunk {
    observation: Vec<f64>,
}

impl TaskBatch {
    /// Makes a batch of `rows` rows. Every row must be started before its first step.
    ///
    /// # Errors
    /// If `backend` cannot make the worlds.
    pub fn new(
        environment: &TaskEnvironment,
        backend: &dyn Backend,
        rows: usize,
    ) -> Result<TaskBatch, RolloutError> {
        let model = environment.model().clone();
        let (layout, events) = (BatchLayout::new(&model), RowEvents::new(environment, rows));
        let spec = BatchSpec {
            model: model.clone(),
            fields: events.fields.clone(),
            pushed: events.pushed.clone(),
            rows,
            substeps: environment.substeps(),
            servos: environment.panda().servos().to_vec(),
        };
        let worlds = backend.batch(&spec).map_err(|error| engine_error(&error))?;
        let sizes = Sizes {
            observation: environment.observation_size(),
            action: environment.action_size(),
            signals: environment.signals().len(),
            rewards: environment.reward_terms().len(),
            state: environment.state_size(),
            output: layout.output_size(),
            active: layout.constraints,
            mocap: 7 * layout.mocaps,
        };
        let chunk = || Chunk { observation: vec![0.0; sizes.observation] };
        Ok(TaskBatch {
            worlds,
            chunks: (0..rows.div_ceil(CHUNK)).map(|_| chunk()).collect(),
            rows,
            observations: vec![0.0; rows * sizes.observation],
            signals: vec![0.0; rows * sizes.signals],
            rewards: vec![0.0; rows * sizes.rewards],
            statuses: vec![BatchStatus::Step(StepStatus::Running); rows],
            functions: environment.functions(),
            workers: (0..rayon::current_num_threads()).map(|_| environment.task_worker()).collect(),
            events,
            model,
            layout,
            sizes,
        })
    }

    /// Moves the targets of all rows by their actions, from the states before the step.
    fn command(&mut self, actions: &[f64]) {
        let TaskBatch { model, layout, functions, sizes, worlds, rows, .. } = self;
        let BatchBuffers { targets, active, outputs, .. } = worlds.buffers();
        // Zero-sized chunks are not allowed, and a model may have no equality constraint.
        let mut no_constraints = vec![false; if sizes.active == 0 { *rows } else { 0 }];
        let (active, active_size) =
            if sizes.active == 0 { (&mut no_constraints[..], 1) } else { (active, sizes.active) };
        targets
            .par_chunks_mut(CHUNK * JOINTS)
            .zip(active.par_chunks_mut(CHUNK * active_size))
            .zip(outputs.par_chunks(CHUNK * sizes.output))
            .zip(actions.par_chunks(CHUNK * sizes.action))
            .for_each(|(((targets, active), outputs), actions)| {
                let rows = targets
                    .chunks_mut(JOINTS)
                    .zip(active.chunks_mut(active_size))
                    .zip(outputs.chunks(sizes.output))
                    .zip(actions.chunks(sizes.action));
                for (((targets, active), output), action) in rows {
                    let view = layout.rows(model, output, active);
                    if functions.move_targets(&view, action, targets) {
                        model.release(active);
                    }
                }
            });
    }

    /// Writes the samples of all rows after a step.
    fn write_samples(&mut self, actions: &[f64]) {
        let TaskBatch { model, layout, functions, sizes, worlds, chunks, .. } = self;
        let BatchBuffers { active, outputs, .. } = worlds.buffers();
        let active = &*active;
        chunks
            .par_iter_mut()
            .zip(outputs.par_chunks(CHUNK * sizes.output))
            .zip(actions.par_chunks(CHUNK * sizes.action))
            .zip(self.observations.par_chunks_mut(CHUNK * sizes.observation))
            .zip(self.signals.par_chunks_mut(CHUNK * sizes.signals))
            .zip(self.rewards.par_chunks_mut(CHUNK * sizes.rewards))
            .zip(self.statuses.par_chunks_mut(CHUNK))
            .enumerate()
            .for_each(|(index, ((((((chunk, outputs), actions), o), s), r), statuses))| {
                for (i, status) in statuses.iter_mut().enumerate() {
                    let output = &outputs[i * sizes.output..][..sizes.output];
                    *status = match layout.status(output) {
                        RowStatus::Overflow => BatchStatus::Overflow,
                        RowStatus::Diverged => BatchStatus::Step(StepStatus::Diverged),
                        RowStatus::Running => {
                            let active = &active[(index * CHUNK + i) * sizes.active..][..sizes.active];
                            let sample = Sample {
                                observation: &mut o[i * sizes.observation..][..sizes.observation],
                                signals: &mut s[i * sizes.signals..][..sizes.signals],
                                rewards: &mut r[i * sizes.rewards..][..sizes.rewards],
                            };
                            let action = &actions[i * sizes.action..][..sizes.action];
                            let view = layout.rows(model, output, active);
                            BatchStatus::Step(functions.write_step(
                                &view,
                                action,
                                &mut chunk.observation,
                                sample,
                            ))
                        }
                    };
                }
            });
    }

    /// Copies the states of all rows into `states`, `[rows, state_size]`.
    pub(crate) fn read_states(&mut self, states: &mut [f64]) -> Result<(), RolloutError> {
        let physics_size = self.model.state_size();
        let mut physics = vec![0.0; self.rows * physics_size];
        self.worlds.read_states(&mut physics).map_err(|error| engine_error(&error))?;
        let targets = self.worlds.buffers().targets.chunks(JOINTS);
        let rows = states.chunks_mut(self.sizes.state).zip(physics.chunks(physics_size)).zip(targets);
        for (row, ((state, physics), targets)) in rows.enumerate() {
            state[..physics_size].copy_from_slice(physics);
            state[physics_size..][..JOINTS].copy_from_slice(targets);
            state[physics_size + JOINTS..].copy_from_slice(self.events.tail(row));
        }
        Ok(())
    }

    /// Restores all rows from the states and observations of a checkpoint.
    pub(crate) fn write_states(&mut self, states: &[f64], observations: &[f32]) -> Result<(), RolloutError> {
        let (sizes, layout, fields) = (self.sizes, self.layout, &self.events.fields);
        let Some(worker) = self.workers.first_mut() else { return Ok(()) };
        let rows = states.chunks(sizes.state).zip(observations.chunks(sizes.observation)).enumerate();
        let starts: Vec<Start> = rows
            .map(|(row, (state, observation))| {
                worker.set_state(state);
                let signals = vec![0.0; sizes.signals];
                sizes.start_at(worker, &layout, fields, (row, state.to_vec(), observation.to_vec(), signals))
            })
            .collect();
        self.write_starts(&starts)
    }

    /// Replaces the states and samples of the rows that start.
    fn write_starts(&mut self, starts: &[Start]) -> Result<(), RolloutError> {
        let sizes = self.sizes;
        let (mut rows, mut states, mut fields) = (Vec::with_capacity(starts.len()), Vec::new(), Vec::new());
        let BatchBuffers { targets, active, mocap, outputs, .. } = self.worlds.buffers();
        let size = self.model.state_size();
        for start in starts {
            let row = start.row;
            rows.push(row);
            states.extend_from_slice(&start.state[..size]);
            fields.extend_from_slice(&start.fields);
            self.events.set_tail(row, &start.state[size + JOINTS..]);
            targets[row * JOINTS..][..JOINTS].copy_from_slice(&start.state[size..][..JOINTS]);
            active[row * sizes.active..][..sizes.active].copy_from_slice(&start.active);
            mocap[row * sizes.mocap..][..sizes.mocap].copy_from_slice(&start.mocap);
            outputs[row * sizes.output..][..sizes.output].copy_from_slice(&start.output);
            self.observations[row * sizes.observation..][..sizes.observation]
                .copy_from_slice(&start.observation);
            self.signals[row * sizes.signals..][..sizes.signals].copy_from_slice(&start.signals);
            self.rewards[row * sizes.rewards..][..sizes.rewards].fill(0.0);
            self.statuses[row] = BatchStatus::Step(StepStatus::Running);
        }
        if !fields.is_empty() {
            self.worlds.write_fields(&rows, &fields).map_err(|error| engine_error(&error))?;
        }
        self.worlds.write_states(&rows, &states).map_err(|error| engine_error(&error))
    }
}

pub(crate) fn engine_error(error: &WorldError) -> RolloutError {
    RolloutError::Engine(error.to_string())
}

/// A row at the start of an episode or at the state of a checkpoint, computed by a thread.
struct Start {
    row: usize,
    state: Vec<f64>,
    /// Values of the varying fields of the model.
    fields: Vec<f64>,
    output: Vec<f64>,
    active: Vec<bool>,
    mocap: Vec<f64>,
    observation: Vec<f32>,
    signals: Vec<f64>,
}

impl Sizes {
    /// Starts an episode at a scenario.
    fn start(
        &self,
        worker: &mut TaskWorker,
        layout: &BatchLayout,
        fields: &[ModelField],
        (row, scenario, seed): (usize, &Scenario, Seed),
    ) -> Start {
        let (mut state, mut observation) = (vec![0.0; self.state], vec![0.0; self.observation]);
        let mut signals = vec![0.0; self.signals];
        let sample = Sample {
            observation: &mut observation,
            signals: &mut signals,
            rewards: &mut vec![0.0; self.rewards],
        };
        worker.reset(scenario, seed, &mut state, sample);
        self.start_at(worker, layout, fields, (row, state, observation, signals))
    }

    /// Starts at the state of the worker's world.
    fn start_at(
        &self,
        worker: &TaskWorker,
        layout: &BatchLayout,
        fields: &[ModelField],
        (row, state, observation, signals): (usize, Vec<f64>, Vec<f32>, Vec<f64>),
    ) -> Start {
        let world = worker.world();
        let (mut output, mut values) = (vec![0.0; self.output], Vec::new());
        world.model().read_fields(fields, &mut values);
        layout.write(world, &mut output);
        let (positions, quaternions) = world.mocap_poses();
        let poses = positions.iter().zip(quaternions);
        let mocap = poses.flat_map(|(position, quaternion)| position.iter().chain(quaternion).copied());
        Start {
            row,
            state,
            fields: values,
            output,
            active: world.active().to_vec(),
            mocap: mocap.collect(),
            observation,
            signals,
        }
    }
}

impl ScenarioBatch for TaskBatch {
    fn rows(&self) -> usize {
        self.rows
    }

    fn start(&mut self, starts: &[(usize, &Scenario, Seed)]) -> Result<(), RolloutError> {
        let (sizes, layout, fields) = (self.sizes, self.layout, &self.events.fields);
        let share = starts.len().div_ceil(self.workers.len()).max(1);
        let starts: Vec<Start> = self
            .workers
            .par_iter_mut()
            .zip(starts.par_chunks(share))
            .flat_map_iter(|(worker, starts)| {
                starts.iter().map(move |start| sizes.start(worker, &layout, fields, *start))
            })
            .collect();
        self.write_starts(&starts)
    }

    fn step(&mut self, actions: &[f64]) -> Result<(), RolloutError> {
        self.events.begin_step(&mut *self.worlds, &mut self.workers, &self.layout)?;
        self.command(actions);
        self.worlds.step().map_err(|error| engine_error(&error))?;
        self.write_samples(actions);
        Ok(())
    }

    fn samples(&self) -> BatchSamples<'_> {
        BatchSamples {
            observations: &self.observations,
            signals: &self.signals,
            rewards: &self.rewards,
            statuses: &self.statuses,
        }
    }
}
