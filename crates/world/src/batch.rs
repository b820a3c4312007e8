//! Many worlds of one model that are stepped together, one per row: by [`CpuWorlds`], or by another
//! physics engine.

use crate::rows::Tree;
use crate::{Body, Model, ModelField, Probe, ProbeRecorder, Readings, Rows, Servo, World, WorldError};

/// Facts that a device needs to make a batch.
#[derive(Clone, Debug)]
pub struct BatchSpec {
    /// Model of all worlds. Its constants equal those of its document, except the physics step.
    pub model: Model,
    /// Fields of the model that differ between worlds, each once. Until
    /// [`WorldBatch::write_fields`], a world has those of `model`.
    pub fields: Vec<ModelField>,
    /// Bodies that [`BatchBuffers::forces`] push, each once.
    pub pushed: Vec<Body>,
    /// Number of worlds.
    pub rows: usize,
    /// Number of physics steps per control step.
    pub substeps: usize,
    /// Servos of the first actuators. The inputs of the other actuators are their controls.
    pub servos: Vec<Servo>,
    /// Elements whose forces and motion are measured over the physics steps. Without them, an
    /// output row has no [`Readings`].
    pub probe: Option<Probe>,
}

/// Makes batches of worlds.
pub trait WorldDevice: Send + Sync {
    /// Returns the name of the physics engine.
    fn engine(&self) -> &'static str;

    /// Makes a batch. Every row must be [started](WorldBatch::write_states) before its first step.
    ///
    /// # Errors
    /// If the engine or its device is not available, or it cannot simulate the model.
    fn batch(&self, spec: &BatchSpec) -> Result<Box<dyn WorldBatch>, WorldError>;
}

/// Many worlds of one model that are stepped together.
///
/// All buffers are row-major. Inputs and outputs have the lengths of a [`BatchLayout`].
///
/// The physics may run on another device between [`start_step`](Self::start_step) and
/// [`finish_step`](Self::finish_step). In between, nothing else may be called.
pub trait WorldBatch: Send {
    /// Replaces the states of some rows by state vectors, `[rows, state_size]`. No row may occur
    /// twice.
    ///
    /// # Errors
    /// If the batch fails as a whole.
    fn write_states(&mut self, rows: &[usize], states: &[f64]) -> Result<(), WorldError>;

    /// Replaces the varying fields of the models of some rows, `[rows, Model::fields_size]`. The
    /// values must be those of a [changed](Model::changed) copy of the model. No row may occur
    /// twice. The states do not change.
    ///
    /// # Errors
    /// If the batch fails as a whole.
    fn write_fields(&mut self, rows: &[usize], values: &[f64]) -> Result<(), WorldError>;

    /// Copies the states of all rows into `states`, `[rows, state_size]`.
    ///
    /// # Errors
    /// If the batch fails as a whole.
    fn read_states(&mut self, states: &mut [f64]) -> Result<(), WorldError>;

    /// Returns the buffers.
    fn buffers(&mut self) -> BatchBuffers<'_>;

    /// Begins to advance all rows by the physics steps of one control step under their inputs.
    ///
    /// # Errors
    /// If the batch fails as a whole, for instance because the device is lost.
    fn start_step(&mut self) -> Result<(), WorldError>;

    /// Waits for the end of the step, and updates the outputs.
    ///
    /// # Errors
    /// As [`start_step`](Self::start_step). A failure of one row is its [`RowStatus`].
    fn finish_step(&mut self) -> Result<(), WorldError>;
}

/// Buffers of a batch.
#[derive(Debug)]
pub struct BatchBuffers<'a> {
    /// Targets of the servos, rad or m, then controls of the other actuators, `[rows, actuators]`.
    pub inputs: &'a mut [f64],
    /// Whether each equality constraint is active, `[rows, constraints]`.
    pub active: &'a mut [bool],
    /// Position (m) and quaternion of each mocap body, `[rows, 7 mocap bodies]`.
    pub mocap: &'a mut [f64],
    /// Force on the center of mass of every pushed body in each physics step, N, world axes,
    /// `[rows, substeps, 3]`; empty without pushed bodies.
    pub forces: &'a mut [f64],
    /// State and poses after the control step, its [`Readings`] if there is a probe, and
    /// [`RowStatus`], `[rows, output_size]`.
    pub outputs: Outputs<'a>,
}

/// Output rows in the precision of the engine.
#[derive(Debug)]
pub enum Outputs<'a> {
    /// 32 bits.
    Single(&'a mut [f32]),
    /// 64 bits.
    Double(&'a mut [f64]),
}

impl<'a> Outputs<'a> {
    /// Splits the rows into groups of `length` numbers; the last group may be smaller.
    pub fn chunks_mut(self, length: usize) -> impl Iterator<Item = Outputs<'a>> {
        let (single, double) = match self {
            Outputs::Single(numbers) => (numbers, &mut [][..]),
            Outputs::Double(numbers) => (&mut [][..], numbers),
        };
        single.chunks_mut(length).map(Outputs::Single).chain(double.chunks_mut(length).map(Outputs::Double))
    }

    /// Copies row `row` into `output`.
    pub fn read(&self, row: usize, output: &mut [f64]) {
        let size = output.len();
        match self {
            Outputs::Single(numbers) => {
                output
                    .iter_mut()
                    .zip(&numbers[row * size..][..size])
                    .for_each(|(to, from)| *to = f64::from(*from));
            }
            Outputs::Double(numbers) => output.copy_from_slice(&numbers[row * size..][..size]),
        }
    }

    /// Replaces row `row` by `output`.
    pub fn write(&mut self, row: usize, output: &[f64]) {
        let size = output.len();
        match self {
            Outputs::Single(numbers) => {
                numbers[row * size..][..size]
                    .iter_mut()
                    .zip(output)
                    .for_each(|(to, from)| *to = *from as f32);
            }
            Outputs::Double(numbers) => numbers[row * size..][..size].copy_from_slice(output),
        }
    }
}

/// Status of a row after a control step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RowStatus {
    /// The simulation continues.
    Running,
    /// A number is not finite or exceeds MuJoCo's limit.
    Diverged,
    /// The engine had too little memory for all contacts or constraints of the row, so its numbers
    /// are wrong.
    Overflow,
}

impl RowStatus {
    /// Returns the status from its code in an output row: 0, 1 or 2.
    fn from_code(code: f64) -> RowStatus {
        match code {
            0.0 => RowStatus::Running,
            2.0 => RowStatus::Overflow,
            _ => RowStatus::Diverged,
        }
    }
}

/// Lengths of the parts of an output row: qpos, qvel, body positions and quaternions, site
/// positions and rotations, joint anchors and axes, readings if there is a probe, status.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BatchLayout {
    lengths: [usize; 10],
    /// Number of equality constraints.
    pub constraints: usize,
    /// Number of mocap bodies.
    pub mocaps: usize,
}

impl BatchLayout {
    /// Returns the layout for a model, with or without a probe.
    pub fn new(model: &Model, probe: Option<&Probe>) -> BatchLayout {
        let readings = probe.map_or(0, |_| Readings::SIZE);
        let model = &*model.inner;
        let [nq, nv, bodies, sites, joints] =
            [model.nq(), model.nv(), model.nbody(), model.nsite(), model.njnt()].map(|n| n as usize);
        BatchLayout {
            lengths: [
                nq,
                nv,
                3 * bodies,
                4 * bodies,
                3 * sites,
                9 * sites,
                3 * joints,
                3 * joints,
                readings,
                1,
            ],
            constraints: model.neq() as usize,
            mocaps: model.nmocap() as usize,
        }
    }

    /// Returns the length of an output row.
    pub fn output_size(&self) -> usize {
        self.lengths.iter().sum()
    }

    fn split<'a>(&self, mut output: &'a [f64]) -> [&'a [f64]; 10] {
        self.lengths.map(|length| {
            let (part, rest) = output.split_at(length);
            output = rest;
            part
        })
    }

    /// Returns the view of an output row for tasks. It contains no controls.
    pub fn rows<'a>(&self, model: &'a Model, output: &'a [f64], active: &'a [bool]) -> Rows<'a> {
        let [qpos, qvel, positions, quaternions, site_positions, site_rotations, anchors, axes, ..] =
            self.split(output);
        Rows {
            qpos,
            qvel,
            ctrl: &[],
            active,
            body_positions: positions.as_chunks().0,
            body_quaternions: quaternions.as_chunks().0,
            site_positions: site_positions.as_chunks().0,
            site_rotations: site_rotations.as_chunks().0,
            joint_anchors: anchors.as_chunks().0,
            joint_axes: axes.as_chunks().0,
            tree: Tree::of(model),
        }
    }

    /// Returns the generalized positions and velocities of an output row.
    pub fn state<'a>(&self, output: &'a [f64]) -> (&'a [f64], &'a [f64]) {
        let [qpos, qvel, ..] = self.split(output);
        (qpos, qvel)
    }

    /// Returns the status of an output row.
    pub fn status(&self, output: &[f64]) -> RowStatus {
        output.last().map_or(RowStatus::Diverged, |code| RowStatus::from_code(*code))
    }

    /// Returns the readings of an output row, if there is a probe.
    pub fn readings(&self, output: &[f64]) -> Option<Readings> {
        let [.., readings, _] = self.split(output);
        readings.as_array().map(Readings::read)
    }

    /// Writes readings into an output row, if there is a probe.
    pub fn write_readings(&self, readings: &Readings, output: &mut [f64]) {
        let [.., length, status] = self.lengths;
        let first = self.output_size() - length - status;
        output[first..][..length].copy_from_slice(&readings.numbers()[..length]);
    }

    /// Writes the state and the poses of a world, which must be [refreshed](World::refresh), and the
    /// status of a running row into an output row.
    pub fn write(&self, world: &World, output: &mut [f64]) {
        let rows = world.rows();
        let parts = [
            rows.qpos,
            rows.qvel,
            rows.body_positions.as_flattened(),
            rows.body_quaternions.as_flattened(),
            rows.site_positions.as_flattened(),
            rows.site_rotations.as_flattened(),
            rows.joint_anchors.as_flattened(),
            rows.joint_axes.as_flattened(),
        ];
        let mut rest = output;
        for part in parts {
            let (own, others) = rest.split_at_mut(part.len());
            own.copy_from_slice(part);
            rest = others;
        }
        if let Some(status) = rest.last_mut() {
            *status = 0.0;
        }
    }
}

/// The device that steps worlds with MuJoCo on one thread. It gives the same bits as a [`World`].
#[derive(Clone, Copy, Debug, Default)]
pub struct CpuDevice;

impl WorldDevice for CpuDevice {
    fn engine(&self) -> &'static str {
        "MuJoCo C"
    }

    fn batch(&self, spec: &BatchSpec) -> Result<Box<dyn WorldBatch>, WorldError> {
        Ok(Box::new(CpuWorlds::new(spec.clone())))
    }
}

/// The batch of [`CpuDevice`].
#[derive(Debug)]
pub struct CpuWorlds {
    layout: BatchLayout,
    /// World of each row if their models differ, otherwise one world for all rows.
    worlds: Vec<World>,
    states: Vec<f64>,
    inputs: Vec<f64>,
    active: Vec<bool>,
    mocap: Vec<f64>,
    forces: Vec<f64>,
    outputs: Vec<f64>,
    recorder: Option<ProbeRecorder>,
    spec: BatchSpec,
}

impl CpuWorlds {
    /// Makes a batch.
    pub fn new(spec: BatchSpec) -> CpuWorlds {
        let layout = BatchLayout::new(&spec.model, spec.probe.as_ref());
        let rows = spec.rows;
        let worlds = if spec.fields.is_empty() { 1 } else { rows };
        let forces = if spec.pushed.is_empty() { 0 } else { 3 * spec.substeps };
        CpuWorlds {
            worlds: (0..worlds).map(|_| spec.model.world()).collect(),
            states: vec![0.0; rows * spec.model.state_size()],
            inputs: vec![0.0; rows * spec.model.actuators()],
            active: vec![false; rows * layout.constraints],
            mocap: vec![0.0; rows * 7 * layout.mocaps],
            forces: vec![0.0; rows * forces],
            outputs: vec![0.0; rows * layout.output_size()],
            recorder: spec.probe.clone().map(|probe| ProbeRecorder::new(probe, &spec.model)),
            layout,
            spec,
        }
    }
}

impl WorldBatch for CpuWorlds {
    fn write_states(&mut self, rows: &[usize], states: &[f64]) -> Result<(), WorldError> {
        let size = self.spec.model.state_size();
        for (row, state) in rows.iter().zip(states.chunks(size)) {
            self.states[row * size..][..size].copy_from_slice(state);
        }
        Ok(())
    }

    fn write_fields(&mut self, rows: &[usize], values: &[f64]) -> Result<(), WorldError> {
        let BatchSpec { model, fields, .. } = &self.spec;
        let size = model.fields_size(fields);
        for (index, row) in rows.iter().enumerate() {
            self.worlds[*row] = model.with_fields(fields, &values[index * size..][..size]).world();
        }
        Ok(())
    }

    fn read_states(&mut self, states: &mut [f64]) -> Result<(), WorldError> {
        states.copy_from_slice(&self.states);
        Ok(())
    }

    fn buffers(&mut self) -> BatchBuffers<'_> {
        BatchBuffers {
            inputs: &mut self.inputs,
            active: &mut self.active,
            mocap: &mut self.mocap,
            forces: &mut self.forces,
            outputs: Outputs::Double(&mut self.outputs),
        }
    }

    fn start_step(&mut self) -> Result<(), WorldError> {
        let BatchSpec { model, substeps, servos, pushed, .. } = &self.spec;
        let size = model.state_size();
        let shared = self.worlds.len().saturating_sub(1);
        for (row, output) in self.outputs.chunks_mut(self.layout.output_size()).enumerate() {
            let world = &mut self.worlds[row.min(shared)];
            let state = &mut self.states[row * size..][..size];
            world.set_state(state);
            world.set_active(&self.active[row * self.layout.constraints..][..self.layout.constraints]);
            world.place_all(&self.mocap[row * 7 * self.layout.mocaps..][..7 * self.layout.mocaps]);
            let inputs = &self.inputs[row * model.actuators()..][..model.actuators()];
            let (targets, controls) = inputs.split_at(servos.len());
            world.ctrl_mut()[servos.len()..].copy_from_slice(controls);
            self.recorder.iter_mut().for_each(ProbeRecorder::clear);
            for substep in 0..*substeps {
                let force = self.forces.as_chunks().0.get(row * substeps + substep);
                if let Some(force) = force {
                    pushed.iter().for_each(|body| world.push(*body, *force));
                }
                match &mut self.recorder {
                    Some(recorder) => recorder.step(servos, targets, world),
                    None => world.step_servos(servos, targets),
                }
            }
            let has_diverged = world.take_divergence();
            world.read_state(state);
            world.refresh();
            self.layout.write(world, output);
            if let Some(recorder) = &self.recorder {
                self.layout.write_readings(recorder.readings(), output);
            }
            if let (Some(status), true) = (output.last_mut(), has_diverged) {
                *status = 1.0;
            }
        }
        Ok(())
    }

    fn finish_step(&mut self) -> Result<(), WorldError> {
        Ok(())
    }
}
