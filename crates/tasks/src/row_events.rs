//! Constants and events of the rows of a batch: what the tails of their state rows say about the next control step.

use mishandle_rollout::RolloutError;
use mishandle_world::{BatchBuffers, BatchLayout, Body, Change, Mocap, ModelField, WorldBatch};
use rayon::prelude::*;

use crate::axes::{self, JUMP_SIZE, PUSH_SIZE, Parameter, Push, SLIP_SIZE};
use crate::batch::engine_error;
use crate::environment::{TaskEnvironment, TaskWorker};

/// Tails of the state rows of a batch, and what the axes of the space can change. Without such axes it is empty and costs nothing.
pub(crate) struct RowEvents {
    /// Length of a tail, 0 if no axis of the space affects steps after the start.
    size: usize,
    /// `[rows, size]`: control step, constants, push, jump, slip.
    tails: Vec<f64>,
    /// Fields of the model that constants and slips change.
    pub fields: Vec<ModelField>,
    /// Bodies that a push pushes.
    pub pushed: Vec<Body>,
    /// Mocap body that jumps.
    jump: Option<Mocap>,
    has_slip: bool,
    reads_poses_to_grip: bool,
    /// Physics step, s.
    timestep: f64,
    substeps: usize,
    /// Rows with a jump or a changing slip in the present control step.
    due: Vec<usize>,
}

/// New inputs of a row.
struct Event {
    row: usize,
    /// Pose of the mocap bodies and state and poses of the row, if it jumps.
    jumped: Option<(Vec<f64>, Vec<f64>)>,
    /// Values of the fields, if it slips.
    fields: Option<Vec<f64>>,
}

impl RowEvents {
    pub(crate) fn new(environment: &TaskEnvironment, rows: usize) -> RowEvents {
        let (size, elements) = (environment.tail_size(), environment.elements());
        let has = |kind: fn(&Parameter) -> bool| environment.space_parameters().iter().any(kind);
        let has_slip = has(|parameter| matches!(parameter, Parameter::Slip(_)));
        let has_push = has(|parameter| matches!(parameter, Parameter::Push(_)));
        let has_jump = has(|parameter| matches!(parameter, Parameter::Jump(_)));
        RowEvents {
            size,
            tails: vec![0.0; rows * size],
            fields: varying_fields(environment, has_slip),
            pushed: if has_push { elements.push.clone() } else { Vec::new() },
            jump: elements.jump.filter(|_| has_jump),
            has_slip,
            reads_poses_to_grip: environment.functions().reads_state_to_grip(),
            timestep: environment.model().timestep(),
            substeps: environment.substeps(),
            due: Vec::new(),
        }
    }

    /// Returns the tail of a row.
    pub(crate) fn tail(&self, row: usize) -> &[f64] {
        &self.tails[row * self.size..][..self.size]
    }

    /// Replaces the tail of a row whose episode starts.
    pub(crate) fn set_tail(&mut self, row: usize, tail: &[f64]) {
        self.tails[row * self.size..][..self.size].copy_from_slice(tail);
    }

    /// Applies the pushes, jumps and slips of the control step that begins, and counts it.
    pub(crate) fn begin_step(
        &mut self,
        worlds: &mut dyn WorldBatch,
        workers: &mut [TaskWorker],
        layout: &BatchLayout,
    ) -> Result<(), RolloutError> {
        if self.size == 0 {
            return Ok(());
        }
        if !self.pushed.is_empty() {
            self.write_forces(worlds.buffers().forces);
        }
        if self.jump.is_some() || self.has_slip {
            self.find_due();
        }
        if !self.due.is_empty() {
            self.apply_due(worlds, workers, layout)?;
        }
        self.tails.chunks_mut(self.size).for_each(|tail| tail[0] += 1.0);
        Ok(())
    }

    /// Writes the force of the push of each row in each physics step.
    fn write_forces(&self, forces: &mut [f64]) {
        let RowEvents { size, timestep, substeps, .. } = *self;
        let rows = forces.par_chunks_mut(3 * substeps).zip(self.tails.par_chunks(size));
        rows.with_min_len(64).for_each(|(forces, tail)| {
            let push = Push::new(events(tail).0);
            for (substep, force) in forces.as_chunks_mut::<3>().0.iter_mut().enumerate() {
                *force = push.map_or([0.0; 3], |push| push.substep_force(tail[0], substep, timestep));
            }
        });
    }

    /// Finds the rows with a jump or a changing slip.
    fn find_due(&mut self) {
        let has_jump = self.jump.is_some();
        let is_due = |tail: &[f64]| {
            let (step, (_, jump, slip)) = (tail[0] as usize, events(tail));
            has_jump && axes::jump(jump, step).is_some()
                || step > 0 && axes::slip(slip, step) != axes::slip(slip, step - 1)
        };
        let rows = self.tails.chunks(self.size).enumerate();
        self.due.clear();
        self.due.extend(rows.filter(|(_, tail)| is_due(tail)).map(|(row, _)| row));
    }

    fn apply_due(
        &self,
        worlds: &mut dyn WorldBatch,
        workers: &mut [TaskWorker],
        layout: &BatchLayout,
    ) -> Result<(), RolloutError> {
        let buffers = worlds.buffers();
        let share = self.due.len().div_ceil(workers.len()).max(1);
        let applied: Vec<Event> = workers
            .par_iter_mut()
            .zip(self.due.par_chunks(share))
            .flat_map_iter(|(worker, rows)| {
                let buffers = &buffers;
                rows.iter().map(move |row| self.event(*row, worker, layout, buffers))
            })
            .collect();
        let (mut rows, mut fields) = (Vec::new(), Vec::new());
        for event in applied {
            if let Some((mocap, output)) = event.jumped {
                buffers.mocap[event.row * mocap.len()..][..mocap.len()].copy_from_slice(&mocap);
                buffers.outputs[event.row * output.len()..][..output.len()].copy_from_slice(&output);
            }
            if let Some(values) = event.fields {
                rows.push(event.row);
                fields.extend(values);
            }
        }
        if rows.is_empty() {
            return Ok(());
        }
        worlds.write_fields(&rows, &fields).map_err(|error| engine_error(&error))
    }

    /// Computes the jump and the slip of a row.
    fn event(
        &self,
        row: usize,
        worker: &mut TaskWorker,
        layout: &BatchLayout,
        buffers: &BatchBuffers<'_>,
    ) -> Event {
        let tail = self.tail(row);
        let (_, jump, _) = events(tail);
        let offset = self.jump.zip(axes::jump(jump, tail[0] as usize));
        let jumped = offset.map(|(body, offset)| {
            let mut mocap = buffers.mocap[row * 7 * layout.mocaps..][..7 * layout.mocaps].to_vec();
            for (position, offset) in mocap[7 * body.index()..].iter_mut().zip(offset) {
                *position += offset;
            }
            let mut output = buffers.outputs[row * layout.output_size()..][..layout.output_size()].to_vec();
            if self.reads_poses_to_grip {
                worker.refresh_output(tail, layout, &mocap, &mut output);
            }
            (mocap, output)
        });
        let fields = self.has_slip.then(|| worker.read_fields(tail, &self.fields));
        Event { row, jumped, fields }
    }
}

/// Returns the fields of the model that the constants of the space, and a slip if it has one, change.
fn varying_fields(environment: &TaskEnvironment, has_slip: bool) -> Vec<ModelField> {
    let elements = environment.elements();
    // The fields of a change do not depend on its value.
    let constants = environment.space_parameters().iter().filter_map(|parameter| match parameter {
        Parameter::Constant(constant) => Some(elements.change(*constant, 1.0)),
        _ => None,
    });
    let slip = has_slip.then(|| elements.slip([1.0; 2])).into_iter().flatten();
    ModelField::of(&constants.chain(slip).collect::<Vec<Change>>())
}

/// Returns the push, the jump and the slip of a tail.
fn events(tail: &[f64]) -> (&[f64], &[f64], &[f64]) {
    let (rest, slip) = tail.split_at(tail.len() - SLIP_SIZE);
    let (rest, jump) = rest.split_at(rest.len() - JUMP_SIZE);
    (&rest[rest.len() - PUSH_SIZE..], jump, slip)
}
