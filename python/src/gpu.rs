//! The device `gpu`: worlds that MuJoCo Warp steps, through the Python module
//! `mishandle.gpu.batches`, and networks, through `mishandle.gpu.networks`.

use std::collections::HashMap;
use std::sync::Arc;

use mishandle::network::{Activation, DeviceBuffers, DeviceNetwork, Mlp, NetworkDevice, NetworkError};
use mishandle::run::Device;
use mishandle::world::{
    BatchBuffers, BatchLayout, BatchSpec, Outputs, Part, Probe, ProbedJoint, Servo, WorldBatch, WorldDevice,
    WorldError,
};
use numpy::{PyArray1, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict};

/// Makes batches of `mishandle.gpu.batches.WarpBatch`.
struct WarpWorldDevice;

/// Returns the device `gpu` of this process.
pub fn device() -> Device {
    Device { worlds: Arc::new(WarpWorldDevice), networks: Some(Arc::new(WarpDevice)) }
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
    inputs: Buffer,
    active: Buffer,
    mocap: Buffer,
    forces: Buffer,
    outputs: Buffer,
}

fn failed(py: Python<'_>, error: &PyErr) -> WorldError {
    WorldError::Device(error.value(py).to_string())
}

/// Returns the buffers of a Python object by name.
fn buffers(object: &Bound<'_, PyAny>) -> PyResult<impl Fn(&str, usize) -> PyResult<Buffer> + use<>> {
    let buffers: HashMap<String, (usize, usize)> = object.call_method0("buffers")?.extract()?;
    Ok(move |name: &str, expected: usize| match buffers.get(name) {
        Some((address, length)) if *length == expected && (*length == 0 || *address != 0) => {
            Ok(Buffer { address: *address, length: *length })
        }
        found => Err(pyo3::exceptions::PyRuntimeError::new_err(format!(
            "buffer {name}: expected {expected} elements, found {found:?}"
        ))),
    })
}

impl WorldDevice for WarpWorldDevice {
    fn engine(&self) -> &'static str {
        "MuJoCo Warp"
    }

    fn batch(&self, spec: &BatchSpec) -> Result<Box<dyn WorldBatch>, WorldError> {
        Python::attach(|py| make(py, spec).map_err(|error| failed(py, &error)))
            .map(|worlds| Box::new(worlds) as Box<dyn WorldBatch>)
    }
}

fn make(py: Python<'_>, spec: &BatchSpec) -> PyResult<WarpWorlds> {
    // The columns of `servos.COLUMNS`.
    let servos: Vec<[f64; 4]> = spec
        .servos
        .iter()
        .map(|servo| {
            let Servo { qpos, dof, max_velocity, max_effort } = *servo;
            [qpos as f64, dof as f64, max_velocity, max_effort]
        })
        .collect();
    let pushed: Vec<usize> = spec.pushed.iter().map(|body| body.index()).collect();
    let fields: Vec<&str> = spec.fields.iter().map(|field| field.name()).collect();
    let forces = if pushed.is_empty() { 0 } else { 3 * spec.rows * spec.substeps };
    let model = PyBytes::new(py, &spec.model.binary());
    let timestep = spec.model.timestep();
    let arguments = (model, timestep, spec.rows, spec.substeps, servos, pushed, fields);
    let keywords = PyDict::new(py);
    if let Some(probe) = &spec.probe {
        keywords.set_item("probe", make_probe(py, probe)?)?;
    }
    let object =
        py.import("mishandle.gpu.batches")?.getattr("WarpBatch")?.call(arguments, Some(&keywords))?;
    let buffer = buffers(&object)?;
    let layout = BatchLayout::new(&spec.model, spec.probe.as_ref());
    Ok(WarpWorlds {
        inputs: buffer("inputs", spec.rows * spec.model.actuators())?,
        active: buffer("active", spec.rows * layout.constraints)?,
        mocap: buffer("mocap", spec.rows * 7 * layout.mocaps)?,
        forces: buffer("forces", forces)?,
        outputs: buffer("outputs", spec.rows * layout.output_size())?,
        object: object.unbind(),
    })
}

/// Returns a probe with the keys of `probe.KEYS`.
fn make_probe<'py>(py: Python<'py>, probe: &Probe) -> PyResult<Bound<'py, PyDict>> {
    let Probe { parts, weld, joints, hand, tool, .. } = probe;
    let indices = |parts: &[Part]| parts.iter().map(|part| *part as usize).collect::<Vec<_>>();
    let pairs = [false, true].map(|holds| probe.pairs(holds).map(u32::from));
    // The columns of `probe.COLUMNS`.
    let joints: Vec<[f64; 8]> = joints
        .iter()
        .map(|probed| {
            let ProbedJoint { joint, actuator, max_velocity, max_acceleration, max_torque } = *probed;
            let [qpos, dof, servo] = [joint.qpos, joint.dof, actuator.index()].map(|index| index as f64);
            [qpos, dof, servo, joint.low, joint.high, max_velocity, max_acceleration, max_torque]
        })
        .collect();
    let made = PyDict::new(py);
    made.set_item("geoms", indices(parts.geoms()))?;
    made.set_item("flexes", indices(parts.flexes()))?;
    made.set_item("pairs", pairs)?;
    made.set_item("weld", weld.map_or(-1, |weld| weld.index() as i64))?;
    made.set_item("body", hand.index())?;
    made.set_item("site", tool.index())?;
    made.set_item("joints", joints)?;
    Ok(made)
}

/// Returns a buffer as a slice.
///
/// # Safety
/// The buffer must hold `length` values of `T`, be aligned, outlive `'a`, and have no other reader
/// or writer.
#[allow(unsafe_code)]
unsafe fn slice<'a, T>(buffer: Buffer) -> &'a mut [T] {
    if buffer.length == 0 {
        return &mut [];
    }
    // SAFETY: by the contract of this function.
    unsafe { std::slice::from_raw_parts_mut(buffer.address as *mut T, buffer.length) }
}

impl WarpWorlds {
    fn call(&mut self, method: &str) -> Result<(), WorldError> {
        Python::attach(|py| match self.object.call_method0(py, method) {
            Ok(_) => Ok(()),
            Err(error) => Err(failed(py, &error)),
        })
    }

    /// Calls a method with indices of rows and numbers for each of them.
    fn write(&mut self, method: &str, rows: &[usize], values: &[f64]) -> Result<(), WorldError> {
        if rows.is_empty() {
            return Ok(());
        }
        Python::attach(|py| {
            let indices: Vec<i32> = rows.iter().map(|row| *row as i32).collect();
            let arguments = (PyArray1::from_vec(py, indices), PyArray1::from_slice(py, values));
            self.object.call_method1(py, method, arguments).map_err(|error| failed(py, &error))
        })?;
        Ok(())
    }
}

impl WorldBatch for WarpWorlds {
    fn write_states(&mut self, rows: &[usize], states: &[f64]) -> Result<(), WorldError> {
        self.write("write_states", rows, states)
    }

    fn write_fields(&mut self, rows: &[usize], values: &[f64]) -> Result<(), WorldError> {
        self.write("write_fields", rows, values)
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
        // SAFETY: the object lives as long as `self`; its buffers have these types and lengths
        // (`make` checked the lengths) and are used by Python and the GPU only from `start_step` to
        // `finish_step` and in `write_states` and `write_fields`, which borrow `self` exclusively.
        // `active` holds what this side writes, 0 or 1, and starts as zeros.
        #[allow(unsafe_code)]
        unsafe {
            BatchBuffers {
                inputs: slice(self.inputs),
                active: slice(self.active),
                mocap: slice(self.mocap),
                forces: slice(self.forces),
                outputs: Outputs::Single(slice(self.outputs)),
            }
        }
    }

    fn start_step(&mut self) -> Result<(), WorldError> {
        self.call("start_step")
    }

    fn finish_step(&mut self) -> Result<(), WorldError> {
        self.call("finish_step")
    }
}

/// Makes networks of `mishandle.gpu.networks.WarpNetwork`.
struct WarpDevice;

/// A network that a Python object computes. The object owns the buffers and never moves them.
struct WarpNetwork {
    object: Py<PyAny>,
    parameters: Buffer,
    inputs: Buffer,
    outputs: Buffer,
    output_gradient: Buffer,
    parameter_gradient: Buffer,
}

fn network_failed(py: Python<'_>, error: &PyErr) -> NetworkError {
    NetworkError::Device { reason: format!("GPU: {}", error.value(py)) }
}

impl NetworkDevice for WarpDevice {
    fn network(&self, network: &Mlp<f32>, rows: usize) -> Result<Box<dyn DeviceNetwork>, NetworkError> {
        if network.output_activation() != Activation::Identity || network.has_layer_norm() {
            let reason = "GPU: networks with layer normalization or an activation of the output layer";
            return Err(NetworkError::Device { reason: format!("{reason} are not supported") });
        }
        Python::attach(|py| make_network(py, network, rows).map_err(|error| network_failed(py, &error)))
            .map(|network| Box::new(network) as Box<dyn DeviceNetwork>)
    }
}

fn make_network(py: Python<'_>, network: &Mlp<f32>, rows: usize) -> PyResult<WarpNetwork> {
    let arguments = (network.sizes().to_vec(), network.hidden_activation().to_string(), rows);
    let object = py.import("mishandle.gpu.networks")?.getattr("WarpNetwork")?.call1(arguments)?;
    let buffer = buffers(&object)?;
    Ok(WarpNetwork {
        parameters: buffer("parameters", network.parameter_count())?,
        inputs: buffer("inputs", rows * network.input_size())?,
        outputs: buffer("outputs", rows * network.output_size())?,
        output_gradient: buffer("output_gradient", rows * network.output_size())?,
        parameter_gradient: buffer("parameter_gradient", network.parameter_count())?,
        object: object.unbind(),
    })
}

impl WarpNetwork {
    fn call(&mut self, method: &str) -> Result<(), NetworkError> {
        Python::attach(|py| match self.object.call_method0(py, method) {
            Ok(_) => Ok(()),
            Err(error) => Err(network_failed(py, &error)),
        })
    }
}

impl DeviceNetwork for WarpNetwork {
    fn buffers(&mut self) -> DeviceBuffers<'_> {
        // SAFETY: the object lives as long as `self`; its buffers hold 32-bit floats, have these
        // lengths (`make_network` checked them), and are used by Python only in `forward` and
        // `backward`, which borrow `self` exclusively.
        #[allow(unsafe_code)]
        unsafe {
            DeviceBuffers {
                parameters: slice(self.parameters),
                inputs: slice(self.inputs),
                outputs: slice(self.outputs),
                output_gradient: slice(self.output_gradient),
                parameter_gradient: slice(self.parameter_gradient),
            }
        }
    }

    fn forward(&mut self) -> Result<(), NetworkError> {
        self.call("forward")
    }

    fn backward(&mut self) -> Result<(), NetworkError> {
        self.call("backward")
    }
}
