//! A robot whose physics another engine steps, many rows at a time. Memory, controls, observations
//! and signals are those of [`RobotWorker`].

use std::convert::Infallible;

use mishandle_rollout::{
    BatchStatus, Environment, EnvironmentWorker, GROUP_ROWS, PerThread, RolloutError, Sample, Scenario,
    ScenarioBatch, ScenarioRows, Seed, StepStatus,
};
use mishandle_world::{
    BatchBuffers, BatchLayout, BatchSpec, Body, ModelField, Outputs, PendingRows, RowStatus, WorldBatch,
    WorldDevice, WorldError, split_rows,
};
use rayon::prelude::*;

use crate::environment::RobotEnvironment;
use crate::worker::RobotWorker;

/// Many rows of a [`RobotEnvironment`] whose physics a [`WorldDevice`] steps.
pub struct RobotBatch {
    worlds: Box<dyn WorldBatch>,
    rows: usize,
    shared: Shared,
    /// Tail of the state row of each row.
    tails: Vec<f64>,
    /// Inputs of the worlds of each group that the next step needs.
    pending: Vec<PendingRows>,
}

/// State that all threads share.
struct Shared {
    environment: RobotEnvironment,
    layout: BatchLayout,
    /// Fields of the model that differ between rows.
    fields: Vec<ModelField>,
    /// Body that pushes act on.
    pushed: Option<Body>,
    threads: PerThread<Thread>,
}

/// Buffers and the worker of one thread.
struct Thread {
    worker: RobotWorker,
    state: Vec<f64>,
    output: Vec<f64>,
    fields: Vec<f64>,
}

impl RobotBatch {
    /// Makes a batch of `rows` rows, whose models differ in these fields, and in which pushes act
    /// on this body. Every row must be started before its first step.
    pub(crate) fn new(
        environment: &RobotEnvironment,
        fields: &[ModelField],
        pushed: Option<Body>,
        device: &dyn WorldDevice,
        rows: usize,
    ) -> Result<RobotBatch, RolloutError> {
        let robot = &environment.robot;
        let spec = BatchSpec {
            model: robot.model.clone(),
            fields: fields.to_vec(),
            pushed: pushed.into_iter().collect(),
            rows,
            substeps: robot.substeps,
            servos: robot.servos.clone(),
            probe: None,
        };
        Ok(RobotBatch {
            worlds: device.batch(&spec).map_err(|error| engine_error(&error))?,
            rows,
            tails: vec![0.0; rows * robot.tail_size()],
            pending: (0..rows.div_ceil(GROUP_ROWS)).map(|_| PendingRows::default()).collect(),
            shared: Shared {
                layout: BatchLayout::new(&robot.model, None),
                environment: environment.clone(),
                fields: spec.fields,
                pushed,
                threads: PerThread::new(),
            },
        })
    }
}

fn engine_error(error: &WorldError) -> RolloutError {
    RolloutError::Engine(error.to_string())
}

impl ScenarioBatch for RobotBatch {
    fn rows(&self) -> usize {
        self.rows
    }

    fn visit(&mut self, visit: &(dyn Fn(usize, &mut dyn ScenarioRows) + Sync)) {
        let RobotBatch { worlds, shared, tails, pending, .. } = self;
        let BatchBuffers { inputs, active, mocap, forces, outputs } = worlds.buffers();
        let sizes = shared.sizes();
        let parts: Vec<_> = split_rows(inputs, GROUP_ROWS * sizes.inputs)
            .zip(split_rows(active, GROUP_ROWS * shared.layout.constraints))
            .zip(split_rows(mocap, GROUP_ROWS * sizes.mocap))
            .zip(split_rows(forces, GROUP_ROWS * sizes.forces))
            .zip(split_rows(tails, GROUP_ROWS * sizes.tail))
            .zip(outputs.chunks_mut(GROUP_ROWS * shared.layout.output_size()))
            .zip(pending)
            .collect();
        parts.into_par_iter().enumerate().for_each(|(index, (parts, pending))| {
            let (((((inputs, active), mocap), forces), tails), outputs) = parts;
            let shared = &*shared;
            let first_row = index * GROUP_ROWS;
            let make = || Ok::<_, Infallible>(Thread::new(shared));
            let Ok(()) = shared.threads.with(make, |thread| {
                let mut group = RobotRows {
                    shared,
                    sizes,
                    thread,
                    first_row,
                    inputs,
                    active,
                    mocap,
                    forces,
                    tails,
                    outputs,
                    pending,
                };
                visit(index, &mut group);
            });
        });
    }

    fn start_step(&mut self) -> Result<(), RolloutError> {
        PendingRows::write(&mut self.pending, &mut *self.worlds).map_err(|error| engine_error(&error))?;
        self.worlds.start_step().map_err(|error| engine_error(&error))
    }

    fn finish_step(&mut self) -> Result<(), RolloutError> {
        self.worlds.finish_step().map_err(|error| engine_error(&error))
    }
}

/// Lengths of the rows of the buffers.
#[derive(Clone, Copy)]
struct Sizes {
    inputs: usize,
    mocap: usize,
    forces: usize,
    tail: usize,
}

impl Shared {
    fn sizes(&self) -> Sizes {
        let robot = &*self.environment.robot;
        Sizes {
            inputs: robot.model.actuators(),
            mocap: 7 * self.layout.mocaps,
            forces: if self.pushed.is_some() { 3 * robot.substeps } else { 0 },
            tail: robot.tail_size(),
        }
    }
}

impl Thread {
    fn new(shared: &Shared) -> Thread {
        Thread {
            worker: shared.environment.robot_worker(GROUP_ROWS),
            state: vec![0.0; shared.environment.state_size()],
            output: vec![0.0; shared.layout.output_size()],
            fields: Vec::new(),
        }
    }
}

/// A group of rows of a [`RobotBatch`], and the thread that visits it.
struct RobotRows<'a> {
    shared: &'a Shared,
    sizes: Sizes,
    thread: &'a mut Thread,
    first_row: usize,
    inputs: &'a mut [f64],
    active: &'a mut [bool],
    mocap: &'a mut [f64],
    forces: &'a mut [f64],
    tails: &'a mut [f64],
    outputs: Outputs<'a>,
    pending: &'a mut PendingRows,
}

impl RobotRows<'_> {
    /// Sets the worker's world to a row.
    fn load(&mut self, row: usize) {
        let Sizes { inputs, mocap, tail, .. } = self.sizes;
        let Thread { worker, output, .. } = &mut *self.thread;
        self.outputs.read(row, output);
        let (positions, velocities) = self.shared.layout.state(output);
        worker.load(
            &self.tails[row * tail..][..tail],
            positions,
            velocities,
            &self.inputs[row * inputs..][..inputs],
            &self.mocap[row * mocap..][..mocap],
        );
    }

    /// Writes the controls and the mocap poses of the worker's world to a row.
    fn write_inputs(&mut self, row: usize) {
        let Sizes { inputs, mocap, .. } = self.sizes;
        let world = self.thread.worker.world();
        self.inputs[row * inputs..][..inputs].copy_from_slice(world.ctrl());
        world.write_mocap_poses(&mut self.mocap[row * mocap..][..mocap]);
    }
}

impl ScenarioRows for RobotRows<'_> {
    fn start(&mut self, row: usize, scenario: &Scenario, seed: Seed, sample: Sample<'_>) -> StepStatus {
        let Thread { worker, state, output, fields } = &mut *self.thread;
        let status = worker.reset(scenario, seed, state, sample);
        if status != StepStatus::Running {
            return status;
        }
        let layout = &self.shared.layout;
        let world = worker.world();
        layout.write(world, output);
        self.outputs.write(row, output);
        self.active[row * layout.constraints..][..layout.constraints].copy_from_slice(world.active());
        let (physics, tail) = state.split_at(world.model().state_size());
        self.tails[row * tail.len()..][..tail.len()].copy_from_slice(tail);
        self.pending.set_state(self.first_row + row, physics);
        if !self.shared.fields.is_empty() {
            fields.clear();
            world.model().read_fields(&self.shared.fields, fields);
            self.pending.set_fields(self.first_row + row, fields);
        }
        self.write_inputs(row);
        StepStatus::Running
    }

    fn sample(&mut self, row: usize, observation: &mut [f32], signals: &mut [f64]) -> BatchStatus {
        self.load(row);
        let Sizes { inputs, tail, .. } = self.sizes;
        match self.shared.layout.status(&self.thread.output) {
            RowStatus::Overflow => return BatchStatus::Overflow,
            RowStatus::Diverged => return BatchStatus::Step(StepStatus::Diverged),
            RowStatus::Running => {}
        }
        // An engine may clamp a control that is not a number.
        if !self.inputs[row * inputs..][..inputs].iter().all(|input| input.is_finite()) {
            return BatchStatus::Step(StepStatus::Diverged);
        }
        let tail = &mut self.tails[row * tail..][..tail];
        let mut sample = Sample { observation, signals, rewards: &mut [] };
        BatchStatus::Step(self.thread.worker.end_step(tail, &mut sample))
    }

    fn command(&mut self, row: usize, action: &[f64], has_arrived: bool) {
        self.load(row);
        let Sizes { forces, tail, .. } = self.sizes;
        let robot = &*self.shared.environment.robot;
        let tail = &mut self.tails[row * tail..][..tail];
        // Controls that are not finite end the episode with its next sample.
        self.thread.worker.begin_step(action, has_arrived, tail);
        if let Some(body) = self.shared.pushed {
            let events = robot.model_parts(tail).events;
            let start = tail[0] * robot.control_dt;
            let own = self.forces[row * forces..][..forces].as_chunks_mut::<3>().0;
            for (substep, force) in own.iter_mut().enumerate() {
                let now = start + substep as f64 * robot.model.timestep();
                *force = robot.force_on(body, events, now);
            }
        }
        self.write_inputs(row);
    }
}
