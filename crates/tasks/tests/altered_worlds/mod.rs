//! Worlds of the CPU that answer some calls in another way.

use mishandle_world::{BatchBuffers, BatchSpec, CpuDevice, WorldBatch, WorldDevice, WorldError};

/// Calls that may be answered in another way. Each receives the worlds of the CPU.
pub trait Alteration: Clone + Send + Sync + 'static {
    fn write_states(
        &mut self,
        worlds: &mut dyn WorldBatch,
        rows: &[usize],
        states: &[f64],
    ) -> Result<(), WorldError> {
        worlds.write_states(rows, states)
    }

    fn write_fields(
        &mut self,
        worlds: &mut dyn WorldBatch,
        rows: &[usize],
        values: &[f64],
    ) -> Result<(), WorldError> {
        worlds.write_fields(rows, values)
    }

    fn start_step(&mut self, worlds: &mut dyn WorldBatch) -> Result<(), WorldError> {
        worlds.start_step()
    }

    fn finish_step(&mut self, worlds: &mut dyn WorldBatch) -> Result<(), WorldError> {
        worlds.finish_step()
    }
}

/// A device whose batches start with a copy of an alteration.
pub struct AlteredDevice<A>(pub A);

impl<A: Alteration> WorldDevice for AlteredDevice<A> {
    fn engine(&self) -> &'static str {
        "altered"
    }

    fn batch(&self, spec: &BatchSpec) -> Result<Box<dyn WorldBatch>, WorldError> {
        Ok(Box::new(AlteredWorlds(CpuDevice.batch(spec)?, self.0.clone())))
    }
}

pub struct AlteredWorlds<A>(pub Box<dyn WorldBatch>, pub A);

impl<A: Alteration> WorldBatch for AlteredWorlds<A> {
    fn write_states(&mut self, rows: &[usize], states: &[f64]) -> Result<(), WorldError> {
        self.1.write_states(&mut *self.0, rows, states)
    }

    fn write_fields(&mut self, rows: &[usize], values: &[f64]) -> Result<(), WorldError> {
        self.1.write_fields(&mut *self.0, rows, values)
    }

    fn read_states(&mut self, states: &mut [f64]) -> Result<(), WorldError> {
        self.0.read_states(states)
    }

    fn buffers(&mut self) -> BatchBuffers<'_> {
        self.0.buffers()
    }

    fn start_step(&mut self) -> Result<(), WorldError> {
        self.1.start_step(&mut *self.0)
    }

    fn finish_step(&mut self) -> Result<(), WorldError> {
        self.1.finish_step(&mut *self.0)
    }
}
