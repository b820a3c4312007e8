//! A task whose physics another engine steps, many rows at a time. Observations, signals and
//! rewards are those of [`TaskEnvironment`].

use std::convert::Infallible;

use mishandle_rollout::{
    BatchStatus, Environment, EnvironmentWorker, GROUP_ROWS, PerThread, RolloutError, Sample, Scenario,
    ScenarioBatch, ScenarioRows, Seed, StepStatus,
};
use mishandle_world::{
    BatchBuffers, BatchLayout, BatchSpec, Model, Outputs, PendingRows, RowStatus, WorldBatch, WorldDevice,
    WorldError, split_rows,
};
use rayon::prelude::*;

use crate::environment::{FinishedStep, SceneFunctions, TaskEnvironment, TaskWorker};
use crate::events::Events;
use crate::manner::Manner;
use crate::robot::JOINTS;

/// Many rows of a [`TaskEnvironment`] whose physics a [`WorldDevice`] steps.
pub struct TaskBatch {
    worlds: Box<dyn WorldBatch>,
    rows: usize,
    shared: Shared,
    /// Tail of the state row of each row, which [`Events`] describe.
    tails: Vec<f64>,
    /// Memory of the signals of the manner and of its reward terms of each row.
    memory: Vec<f64>,
    /// Last action of each row.
    actions: Vec<f64>,
    /// Inputs of the worlds of each group that the next step needs.
    pending: Vec<PendingRows>,
}

/// State that all threads share.
struct Shared {
    model: Model,
    layout: BatchLayout,
    functions: SceneFunctions,
    sizes: Sizes,
    events: Events,
    environment: TaskEnvironment,
    threads: PerThread<Thread>,
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
    memory: usize,
}

/// Buffers and the worker of one thread.
struct Thread {
    worker: TaskWorker,
    state: Vec<f64>,
    output: Vec<f64>,
    observation: Vec<f64>,
    fields: Vec<f64>,
}

impl TaskBatch {
    /// Makes a batch of `rows` rows. Every row must be started before its first step.
    ///
    /// # Errors
    /// If `device` cannot make the worlds.
    pub fn new(
        environment: &TaskEnvironment,
        device: &dyn WorldDevice,
        rows: usize,
    ) -> Result<TaskBatch, RolloutError> {
        let model = environment.model().clone();
        let probe = environment.manner().map(Manner::probe);
        let layout = BatchLayout::new(&model, probe);
        let events = Events::new(environment);
        let spec = BatchSpec {
            model: model.clone(),
            fields: events.fields.clone(),
            pushed: events.pushed.clone(),
            rows,
            substeps: environment.substeps(),
            servos: environment.panda().servos().to_vec(),
            probe: probe.cloned(),
        };
        let sizes = Sizes {
            observation: environment.observation_size(),
            state: environment.state_size(),
            physics: model.state_size(),
            output: layout.output_size(),
            active: layout.constraints,
            mocap: 7 * layout.mocaps,
            memory: environment.memory_size(),
        };
        Ok(TaskBatch {
            worlds: device.batch(&spec).map_err(|error| engine_error(&error))?,
            rows,
            tails: vec![0.0; rows * events.size],
            memory: vec![0.0; rows * sizes.memory],
            actions: vec![0.0; rows * JOINTS],
            pending: (0..rows.div_ceil(GROUP_ROWS)).map(|_| PendingRows::default()).collect(),
            shared: Shared {
                model,
                layout,
                functions: environment.functions(),
                sizes,
                events,
                environment: environment.clone(),
                threads: PerThread::new(),
            },
        })
    }

    /// Calls `visit` once for each group of rows, with the index of the group and its entry of
    /// `extras`, on all threads.
    pub(crate) fn visit_with<T: Send>(
        &mut self,
        extras: impl Iterator<Item = T>,
        visit: impl Fn(usize, &mut TaskRows<'_>, T) + Sync,
    ) {
        let TaskBatch { worlds, rows, shared, tails, memory, actions, pending } = self;
        let BatchBuffers { inputs: targets, active, mocap, forces, outputs } = worlds.buffers();
        let Sizes { output, active: active_size, mocap: mocap_size, memory: memory_size, .. } = shared.sizes;
        let parts: Vec<_> = groups(targets, JOINTS)
            .zip(groups(active, active_size))
            .zip(groups(mocap, mocap_size))
            .zip(groups(forces, shared.events.force_size()))
            .zip(groups(tails, shared.events.size))
            .zip(groups(memory, memory_size))
            .zip(groups(actions, JOINTS))
            .zip(outputs.chunks_mut(GROUP_ROWS * output))
            .zip(pending)
            .zip(extras)
            .collect();
        parts.into_par_iter().enumerate().for_each(|(index, (inputs, extra))| {
            let ((inputs, outputs), pending) = inputs;
            let ((((((targets, active), mocap), forces), tails), memory), actions) = inputs;
            let shared = &*shared;
            let first_row = index * GROUP_ROWS;
            let rows = GROUP_ROWS.min(*rows - first_row);
            shared.on_thread(|thread| {
                let mut group = TaskRows {
                    shared,
                    thread,
                    first_row,
                    rows,
                    targets,
                    active,
                    mocap,
                    forces,
                    tails,
                    memory,
                    actions,
                    outputs,
                    pending,
                };
                visit(index, &mut group, extra);
            });
        });
    }

    /// Writes the pending states and fields to the worlds.
    fn write_pending(&mut self) -> Result<(), RolloutError> {
        PendingRows::write(&mut self.pending, &mut *self.worlds).map_err(|error| engine_error(&error))
    }

    /// Copies the states of all rows into `states`, `[rows, state_size]`.
    pub(crate) fn read_states(&mut self, states: &mut [f64]) -> Result<(), RolloutError> {
        self.write_pending()?;
        let Sizes { state: size, physics: physics_size, memory: memory_size, .. } = self.shared.sizes;
        let mut physics = vec![0.0; self.rows * physics_size];
        self.worlds.read_states(&mut physics).map_err(|error| engine_error(&error))?;
        let targets = self.worlds.buffers().inputs.chunks(JOINTS);
        let rows = states.chunks_mut(size).zip(physics.chunks(physics_size)).zip(targets).enumerate();
        let tail_size = self.shared.events.size;
        for (row, ((state, physics), targets)) in rows {
            state[..physics_size].copy_from_slice(physics);
            state[physics_size..][..JOINTS].copy_from_slice(targets);
            let (tail, memory) = state[physics_size + JOINTS..].split_at_mut(tail_size);
            tail.copy_from_slice(&self.tails[row * tail_size..][..tail_size]);
            memory.copy_from_slice(&self.memory[row * memory_size..][..memory_size]);
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

/// Splits rows of `size` numbers into groups.
fn groups<T>(numbers: &mut [T], size: usize) -> impl Iterator<Item = &mut [T]> {
    split_rows(numbers, GROUP_ROWS * size)
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
        self.write_pending()?;
        self.worlds.start_step().map_err(|error| engine_error(&error))
    }

    fn finish_step(&mut self) -> Result<(), RolloutError> {
        self.worlds.finish_step().map_err(|error| engine_error(&error))
    }
}

impl Shared {
    /// Calls `function` with the buffers and the worker of this thread.
    fn on_thread(&self, function: impl FnOnce(&mut Thread)) {
        let Ok(()) =
            self.threads.with(|| Ok::<_, Infallible>(Thread::new(&self.environment, self.sizes)), function);
    }
}

impl Thread {
    fn new(environment: &TaskEnvironment, sizes: Sizes) -> Thread {
        Thread {
            worker: environment.task_worker(GROUP_ROWS),
            state: vec![0.0; sizes.state],
            output: vec![0.0; sizes.output],
            observation: vec![0.0; sizes.observation],
            fields: Vec::new(),
        }
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
    forces: &'a mut [f64],
    tails: &'a mut [f64],
    memory: &'a mut [f64],
    actions: &'a mut [f64],
    outputs: Outputs<'a>,
    pending: &'a mut PendingRows,
}

impl TaskRows<'_> {
    /// Returns the number of rows.
    pub(crate) fn len(&self) -> usize {
        self.rows
    }

    /// Continues a row from a state of its environment.
    fn restore(&mut self, row: usize, state: &[f64]) {
        self.thread.worker.set_state(state);
        self.thread.state.copy_from_slice(state);
        self.write_start(row);
    }

    /// Writes the state of the thread's worker to a row.
    fn write_start(&mut self, row: usize) {
        let Sizes { physics, active, mocap, memory, .. } = self.shared.sizes;
        let events = &self.shared.events;
        let Thread { worker, state, output, fields, .. } = &mut *self.thread;
        let world = worker.world();
        self.shared.layout.write(world, output);
        self.outputs.write(row, output);
        self.targets[row * JOINTS..][..JOINTS].copy_from_slice(&state[physics..][..JOINTS]);
        self.active[row * active..][..active].copy_from_slice(world.active());
        world.write_mocap_poses(&mut self.mocap[row * mocap..][..mocap]);
        let (tail, own_memory) = state[physics + JOINTS..].split_at(events.size);
        self.tails[row * events.size..][..events.size].copy_from_slice(tail);
        self.memory[row * memory..][..memory].copy_from_slice(own_memory);
        self.pending.set_state(self.first_row + row, &state[..physics]);
        if !events.fields.is_empty() {
            fields.clear();
            world.model().read_fields(&events.fields, fields);
            self.pending.set_fields(self.first_row + row, fields);
        }
    }

    /// Writes the sample of a row after the control step of its last [command](Self::command), with
    /// rewards if there is space for them, and returns its status.
    pub(crate) fn rewarded_sample(&mut self, row: usize, sample: Sample<'_>) -> BatchStatus {
        let Shared { model, layout, functions, sizes, .. } = self.shared;
        let Thread { output, observation, .. } = &mut *self.thread;
        self.outputs.read(row, output);
        match layout.status(output) {
            RowStatus::Overflow => BatchStatus::Overflow,
            RowStatus::Diverged => BatchStatus::Step(StepStatus::Diverged),
            RowStatus::Running => {
                let active = &self.active[row * sizes.active..][..sizes.active];
                let view = layout.rows(model, output, active);
                let memory = &mut self.memory[row * sizes.memory..][..sizes.memory];
                let readings = layout.readings(output);
                let action = &self.actions[row * JOINTS..][..JOINTS];
                let targets = &self.targets[row * JOINTS..][..JOINTS];
                let step = FinishedStep { readings: readings.as_ref(), action, targets };
                BatchStatus::Step(functions.write_step(&view, &step, memory, observation, sample))
            }
        }
    }

    /// Applies the push, the jump and the slip of the control step that begins. Returns whether a
    /// body has jumped.
    fn begin_step(&mut self, row: usize) -> bool {
        let Sizes { mocap, .. } = self.shared.sizes;
        let events = &self.shared.events;
        let tail = &mut self.tails[row * events.size..][..events.size];
        let forces = events.force_size();
        events.push(tail, &mut self.forces[row * forces..][..forces]);
        let has_jumped = events.jump(tail, &mut self.mocap[row * mocap..][..mocap]);
        if events.slips(tail) {
            let fields = self.thread.worker.read_fields(tail, &events.fields);
            self.pending.set_fields(self.first_row + row, &fields);
        }
        tail[0] += 1.0;
        has_jumped
    }
}

impl ScenarioRows for TaskRows<'_> {
    fn start(&mut self, row: usize, scenario: &Scenario, seed: Seed, sample: Sample<'_>) -> StepStatus {
        let Thread { worker, state, .. } = &mut *self.thread;
        let status = worker.reset(scenario, seed, state, sample);
        self.write_start(row);
        status
    }

    fn sample(&mut self, row: usize, observation: &mut [f32], signals: &mut [f64]) -> BatchStatus {
        self.rewarded_sample(row, Sample { observation, signals, rewards: &mut [] })
    }

    fn command(&mut self, row: usize, action: &[f64], _has_arrived: bool) {
        let Shared { model, layout, functions, sizes, events, .. } = self.shared;
        self.actions[row * JOINTS..][..JOINTS].copy_from_slice(action);
        let has_jumped = events.size > 0 && self.begin_step(row);
        let Thread { worker, output, .. } = &mut *self.thread;
        if functions.reads_state_to_grip() {
            self.outputs.read(row, output);
            if has_jumped {
                let tail = &self.tails[row * events.size..][..events.size];
                worker.refresh_output(tail, layout, &self.mocap[row * sizes.mocap..][..sizes.mocap], output);
            }
        }
        let active = &mut self.active[row * sizes.active..][..sizes.active];
        let view = layout.rows(model, output, active);
        if functions.move_targets(&view, action, &mut self.targets[row * JOINTS..][..JOINTS]) {
            model.release(active);
        }
    }
}
