//! The backend `gpu`: worlds that MuJoCo Warp steps, through the Python module `mishandle.gpu`.

use std::collections::HashMap;
use std::sync::Arc;

use mishandle::world::{Backend, BatchBuffers, BatchSpec, WorldBatch, WorldError};
use numpy::{PyArray1, PyArrayMethods};
use pyo3::prelude::*;

/// Makes batches of `mishandle.gpu.WarpBatch`.
struct WarpBackend;

/// Makes the backend `gpu` available to the commands of this process.
pub fn install() {
    mishandle::install_gpu_backend(Arc::new(WarpBackend));
}

/// Address and number of elements of a buffer that a Python object owns.
#[derive(Clone, Copy)]
struct Buffer {
    address: usize,
    length: usize,
}

/// A batch that a Python object steps. The object owns the buffers and never moves them.
struct WarpWorlds {
    object: Py<PyAny>,
    targets: Buffer,
    active: Buffer,
    mocap: Buffer,
    outputs: Buffer,
}

fn failed(py: Python<'_>, error: &PyErr) -> WorldError {
    WorldError::Backend(format!("GPU: {}", error.value(py)))
}

impl Backend for WarpBackend {
    fn engine(&self) -> &'static str {
        "MuJoCo Warp"
    }

    fn batch(&self, spec: &BatchSpec) -> Result<Box<dyn WorldBatch>, WorldError> {
        Python::attach(|py| make(py, spec).map_err(|error| failed(py, &error)))
            .map(|worlds| Box::new(worlds) as Box<dyn WorldBatch>)
    }
}

fn make(py: Python<'_>, spec: &BatchSpec) -> PyResult<WarpWorlds> {
    let qpos: Vec<usize> = spec.servos.iter().map(|servo| servo.qpos).collect();
    let lead: Vec<f64> = spec.servos.iter().map(|servo| servo.max_lead).collect();
    let pushed: [usize; 0] = [];
    let arguments =
        (spec.model.document(), spec.model.timestep(), spec.rows, spec.substeps, qpos, lead, pushed.to_vec());
    let object = py.import("mishandle.gpu")?.getattr("WarpBatch")?.call1(arguments)?;
    let buffers: HashMap<String, (usize, usize)> = object.call_method0("buffers")?.extract()?;
    let buffer = |name: &str, expected: usize| match buffers.get(name) {
        Some((address, length)) if *length == expected && (*length == 0 || *address != 0) => {
            Ok(Buffer { address: *address, length: *length })
        }
        found => Err(pyo3::exceptions::PyRuntimeError::new_err(format!(
            "buffer {name}: expected {expected} elements, found {found:?}"
        ))),
    };
    let layout = mishandle::world::BatchLayout::new(&spec.model);
    Ok(WarpWorlds {
        targets: buffer("targets", spec.rows * spec.servos.len())?,
        active: buffer("active", spec.rows * layout.constraints)?,
        mocap: buffer("mocap", spec.rows * 7 * layout.mocaps)?,
        outputs: buffer("outputs", spec.rows * layout.output_size())?,
        object: object.unbind(),
    })
}

/// Returns a buffer as a slice.
///
/// # Safety
/// The buffer must hold `length` values of `T`, be aligned, outlive `'a`, and have no other reader or writer.
#[allow(unsafe_code)]
unsafe fn slice<'a, T>(buffer: Buffer) -> &'a mut [T] {
    if buffer.length == 0 {
        return &mut [];
    }
    // SAFETY: by the contract of this function.
    unsafe { std::slice::from_raw_parts_mut(buffer.address as *mut T, buffer.length) }
}

impl WorldBatch for WarpWorlds {
    fn write_states(&mut self, rows: &[usize], states: &[f64]) -> Result<(), WorldError> {
        if rows.is_empty() {
            return Ok(());
        }
        Python::attach(|py| {
            let indices: Vec<i32> = rows.iter().map(|row| *row as i32).collect();
            let arguments = (PyArray1::from_vec(py, indices), PyArray1::from_slice(py, states));
            self.object.call_method1(py, "write_states", arguments).map_err(|error| failed(py, &error))
        })?;
        Ok(())
    }

    fn read_states(&mut self, states: &mut [f64]) -> Result<(), WorldError> {
        Python::attach(|py| {
            let array = self.object.call_method0(py, "read_states")?;
            let found = array.bind(py).cast::<PyArray1<f64>>()?.try_readonly()?;
            let found = found.as_slice()?;
            if found.len() != states.len() {
                let problem = format!("expected {} numbers of states, found {}", states.len(), found.len());
                return Err(pyo3::exceptions::PyRuntimeError::new_err(problem));
            }
            states.copy_from_slice(found);
            Ok(())
        })
        .map_err(|error: PyErr| Python::attach(|py| failed(py, &error)))
    }

    fn buffers(&mut self) -> BatchBuffers<'_> {
        // SAFETY: the object lives as long as `self`; its buffers have these types and lengths (`make` checked the lengths) and are
        // used by Python only in `step` and `write_states`, which borrow `self` exclusively. `active` holds what this side writes,
        // 0 or 1, and starts as zeros.
        #[allow(unsafe_code)]
        unsafe {
            BatchBuffers {
                targets: slice(self.targets),
                active: slice(self.active),
                mocap: slice(self.mocap),
                outputs: slice(self.outputs),
            }
        }
    }

    fn step(&mut self) -> Result<(), WorldError> {
        Python::attach(|py| self.object.call_method0(py, "step").map_err(|error| failed(py, &error)))?;
        Ok(())
    }
}
