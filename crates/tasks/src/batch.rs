//! A task whose physics another engine steps, many rows at a time. Observations, signals and rewards are those of
//! [`TaskEnvironment`].

use std::sync::{Mutex, PoisonError};

use mishandle_rollout::{
    BatchStatus, Environment, EnvironmentWorker, GROUP_ROWS, RolloutError, Sample, Scenario, ScenarioBatch,
    ScenarioRows, Seed, StepStatus,
};
use mishandle_world::{
    Backend, BatchBuffers, BatchLayout, BatchSpec, Model, Outputs, RowStatus, WorldBatch, WorldError,
};
use rayon::prelude::*;

use crate::environment::{SceneFunctions, TaskEnvironment, TaskWorker};
use crate::robot::JOINTS;

/// Many rows of a [`TaskEnvironment`] whose physics a [`Backend`] steps.
pub struct TaskBatch {
    worlds: Box<dyn WorldBatch>,
    rows: usize,
    shared: Shared,
    /// Rows of each group that have started since the last step.
    starts: Vec<Starts>,
}

/// What all threads share.
struct Shared {
    model: Model,
    layout: BatchLayout,
    functions: SceneFunctions,
    sizes: Sizes,
    environment: TaskEnvironment,
    /// Buffers and workers that no thread uses now.
    threads: Mutex<Vec<Thread>>,
}

/// Lengths of the rows of the buffers.
#[derive(Clone, Copy)]
struct Sizes {
    observation: usize,
    state: usize,
    physics: usize,
    output: usize,
    active: usize,
    mocap: usize,
}

/// Buffers and the worker of one thread.
struct Thread {
    worker: TaskWorker,
    state: Vec<f64>,
    output: Vec<f64>,
    observation: Vec<f64>,
}

/// Rows that start, and their physical states, one after another.
#[derive(Default)]
struct Starts {
    rows: Vec<usize>,
    states: Vec<f64>,
}

impl TaskBatch {
    /// Makes a batch of `rows` rows. Every row must be started before its first step.
    ///
    /// # Errors
    /// If the space has an axis that changes steps after the start (a constant of the model or an event), or `backend` cannot make the
    /// worlds.
    pub fn new(
        environment: &TaskEnvironment,
        backend: &dyn Backend,
        rows: usize,
    ) -> Result<TaskBatch, RolloutError> {
        if environment.has_tail() {
            return Err(RolloutError::ScreenedSpace {
                environment: environment.name().to_string(),
                space: environment.space().name().to_string(),
            });
        }
        let model = environment.model().clone();
        let layout = BatchLayout::new(&model);
        let spec = BatchSpec {
            model: model.clone(),
            rows,
            substeps: environment.substeps(),
            servos: environment.panda().servos().to_vec(),
        };
        let sizes = Sizes {
            observation: environment.observation_size(),
            state: environment.state_size(),
            physics: model.state_size(),
            output: layout.output_size(),
            active: layout.constraints,
            mocap: 7 * layout.mocaps,
        };
        Ok(TaskBatch {
            worlds: backend.batch(&spec).map_err(|error| engine_error(&error))?,
            rows,
            starts: (0..rows.div_ceil(GROUP_ROWS)).map(|_| Starts::default()).collect(),
            shared: Shared {
                model,
                layout,
                functions: environment.functions(),
                sizes,
                environment: environment.clone(),
                threads: Mutex::new(Vec::new()),
            },
        })
    }

    /// Calls `visit` once for each group of rows, with the index of the group and its entry of `extras`, on all threads.
    pub(crate) fn visit_with<T: Send>(
        &mut self,
        extras: impl Iterator<Item = T>,
        visit: impl Fn(usize, &mut TaskRows<'_>, T) + Sync,
    ) {
        let TaskBatch { worlds, rows, shared, starts } = self;
        let BatchBuffers { targets, active, mocap, outputs } = worlds.buffers();
        let Sizes { output, active: active_size, mocap: mocap_size, .. } = shared.sizes;
        let parts: Vec<_> = groups(targets, JOINTS)
            .zip(groups(active, active_size))
            .zip(groups(mocap, mocap_size))
            .zip(outputs.chunks_mut(GROUP_ROWS * output))
            .zip(starts)
            .zip(extras)
            .collect();
        let parts = parts.into_par_iter().with_max_len(1).enumerate();
        parts.for_each(|(index, (((((targets, active), mocap), outputs), starts), extra))| {
            let (shared, first_row) = (&*shared, index * GROUP_ROWS);
            let rows = GROUP_ROWS.min(*rows - first_row);
            let mut thread = shared.take_thread();
            let mut group = TaskRows {
                shared,
                thread: &mut thread,
                first_row,
                rows,
                targets,
                active,
                mocap,
                outputs,
                starts,
            };
            visit(index, &mut group, extra);
            shared.return_thread(thread);
        });
    }

    /// Writes the states of the rows that have started since the last step to the worlds.
    fn write_starts(&mut self) -> Result<(), RolloutError> {
        let mut all = Starts::default();
        for starts in &mut self.starts {
            all.rows.append(&mut starts.rows);
            all.states.append(&mut starts.states);
        }
        match all.rows.is_empty() {
            true => Ok(()),
            false => self.worlds.write_states(&all.rows, &all.states).map_err(|error| engine_error(&error)),
        }
    }

    /// Copies the states of all rows into `states`, `[rows, state_size]`.
    pub(crate) fn read_states(&mut self, states: &mut [f64]) -> Result<(), RolloutError> {
        self.write_starts()?;
        let Sizes { state: size, physics: physics_size, .. } = self.shared.sizes;
        let mut physics = vec![0.0; self.rows * physics_size];
        self.worlds.read_states(&mut physics).map_err(|error| engine_error(&error))?;
        let targets = self.worlds.buffers().targets.chunks(JOINTS);
        for ((state, physics), targets) in
            states.chunks_mut(size).zip(physics.chunks(physics_size)).zip(targets)
        {
            state[..physics_size].copy_from_slice(physics);
            state[physics_size..].copy_from_slice(targets);
        }
        Ok(())
    }

    /// Restores all rows from the states of a checkpoint.
    pub(crate) fn write_states(&mut self, states: &[f64]) {
        let size = self.shared.sizes.state;
        self.visit_with(states.chunks(GROUP_ROWS * size), |_, rows, states| {
            states.chunks(size).enumerate().for_each(|(row, state)| rows.restore(row, state));
        });
    }
}

/// Splits rows of `size` numbers into groups, which are empty if `size` is 0.
fn groups<T>(numbers: &mut [T], size: usize) -> impl Iterator<Item = &mut [T]> {
    let mut rest = numbers;
    std::iter::repeat_with(move || {
        let length = (GROUP_ROWS * size).min(rest.len());
        rest.split_off_mut(..length).unwrap_or_default()
    })
}

fn engine_error(error: &WorldError) -> RolloutError {
    RolloutError::Engine(error.to_string())
}

impl ScenarioBatch for TaskBatch {
    fn rows(&self) -> usize {
        self.rows
    }

    fn visit(&mut self, visit: &(dyn Fn(usize, &mut dyn ScenarioRows) + Sync)) {
        self.visit_with(std::iter::repeat(()), |index, rows, ()| visit(index, rows));
    }

    fn start_step(&mut self) -> Result<(), RolloutError> {
        self.write_starts()?;
        self.worlds.start_step().map_err(|error| engine_error(&error))
    }

    fn finish_step(&mut self) -> Result<(), RolloutError> {
        self.worlds.finish_step().map_err(|error| engine_error(&error))
    }
}

impl Shared {
    /// Returns buffers and a worker for one visit. A visit may be inside another one of the same thread, while that waits.
    fn take_thread(&self) -> Thread {
        let free = self.threads.lock().unwrap_or_else(PoisonError::into_inner).pop();
        free.unwrap_or_else(|| Thread {
            worker: self.environment.task_worker(),
            state: vec![0.0; self.sizes.state],
            output: vec![0.0; self.sizes.output],
            observation: vec![0.0; self.sizes.observation],
        })
    }

    fn return_thread(&self, thread: Thread) {
        self.threads.lock().unwrap_or_else(PoisonError::into_inner).push(thread);
    }
}

/// A group of rows of a [`TaskBatch`], and the thread that visits it.
pub(crate) struct TaskRows<'a> {
    shared: &'a Shared,
    thread: &'a mut Thread,
    first_row: usize,
    rows: usize,
    targets: &'a mut [f64],
    active: &'a mut [bool],
    mocap: &'a mut [f64],
    outputs: Outputs<'a>,
    starts: &'a mut Starts,
}

impl TaskRows<'_> {
    /// Returns the number of rows.
    pub(crate) fn len(&self) -> usize {
        self.rows
    }

    /// Continues a row from a state of its environment.
    fn restore(&mut self, row: usize, state: &[f64]) {
        self.thread.worker.set_state(&state[..self.shared.sizes.physics]);
        self.thread.state.copy_from_slice(state);
        self.write_start(row);
    }

    /// Writes the state of the thread's worker to a row.
    fn write_start(&mut self, row: usize) {
        let Sizes { physics, active, mocap, .. } = self.shared.sizes;
        let Thread { worker, state, output, .. } = &mut *self.thread;
        let world = worker.nominal_world();
        self.shared.layout.write(world, output);
        self.outputs.write(row, output);
        self.targets[row * JOINTS..][..JOINTS].copy_from_slice(&state[physics..][..JOINTS]);
        self.active[row * active..][..active].copy_from_slice(world.active());
        let (positions, quaternions) = world.mocap_poses();
        let poses = self.mocap[row * mocap..][..mocap].as_chunks_mut::<7>().0;
        for ((pose, position), quaternion) in poses.iter_mut().zip(positions).zip(quaternions) {
            pose[..3].copy_from_slice(position);
            pose[3..].copy_from_slice(quaternion);
        }
        self.starts.rows.push(self.first_row + row);
        self.starts.states.extend_from_slice(&state[..physics]);
    }
}

impl ScenarioRows for TaskRows<'_> {
    fn start(&mut self, row: usize, scenario: &Scenario, seed: Seed, sample: Sample<'_>) {
        let Thread { worker, state, .. } = &mut *self.thread;
        worker.reset(scenario, seed, state, sample);
        self.write_start(row);
    }

    fn sample(&mut self, row: usize, action: &[f64], sample: Sample<'_>) -> BatchStatus {
        let Shared { model, layout, functions, sizes, .. } = self.shared;
        let Thread { output, observation, .. } = &mut *self.thread;
        self.outputs.read(row, output);
        match layout.status(output) {
            RowStatus::Overflow => BatchStatus::Overflow,
            RowStatus::Diverged => BatchStatus::Step(StepStatus::Diverged),
            RowStatus::Running => {
                let active = &self.active[row * sizes.active..][..sizes.active];
                let view = layout.rows(model, output, active);
                BatchStatus::Step(functions.write_step(&view, action, observation, sample))
            }
        }
    }

    fn command(&mut self, row: usize, action: &[f64]) {
        let Shared { model, layout, functions, sizes, .. } = self.shared;
        let output = &mut self.thread.output;
        if functions.reads_state_to_grip() {
            self.outputs.read(row, output);
        }
        let active = &mut self.active[row * sizes.active..][..sizes.active];
        let view = layout.rows(model, output, active);
        if functions.move_targets(&view, action, &mut self.targets[row * JOINTS..][..JOINTS]) {
            model.release(active);
        }
    }
}
