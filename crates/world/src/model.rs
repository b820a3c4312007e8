use std::ffi::{CStr, CString, c_char};
use std::ptr::null;
use std::sync::{Arc, Once};

use mujoco_rs::prelude::*;

use crate::{World, WorldError};

/// The integration state: positions, velocities, controls, mocap poses, active constraints, and the
/// warm start of the solver, which affects the bits of the next step.
pub(crate) const INTEGRATION: u32 = MjtState::mjSTATE_INTEGRATION as u32;

/// A compiled MJCF document, shared by all threads.
#[derive(Clone, Debug)]
pub struct Model {
    pub(crate) inner: Arc<MjModel>,
    pub(crate) state_size: usize,
    /// The MJCF document.
    pub(crate) document: Arc<str>,
}

impl Model {
    /// Compiles an MJCF document.
    ///
    /// # Errors
    /// If MuJoCo rejects the document, with MuJoCo's message, or an actuator has several controls.
    ///
    /// # Example
    /// ```
    /// let model = mishandle_world::Model::from_xml(mishandle_world::PANDA).unwrap();
    /// assert_eq!(model.qpos_size(), 9); // seven joints of the arm, two of the fingers
    /// ```
    pub fn from_xml(xml: &str) -> Result<Model, WorldError> {
        // MuJoCo reads a C string, which a zero byte would truncate.
        if xml.contains('\0') {
            return Err(WorldError::Model("the document contains a zero byte".to_string()));
        }
        discard_warning_log();
        let inner = MjModel::from_xml_string(xml)
            .map_err(|error| WorldError::Model(full_message(xml).unwrap_or_else(|| error.to_string())))?;
        if inner.nu() != inner.nactuator() || inner.nout() != inner.nactuator() {
            return Err(WorldError::Model(
                "it has an actuator with several controls or forces; only actuators with one of each are supported, so \
                 replace it by one actuator per axis"
                    .into(),
            ));
        }
        let state_size = inner.state_size(INTEGRATION);
        Ok(Model { inner: Arc::new(inner), state_size, document: xml.into() })
    }

    /// Returns the MJCF document from which the model was compiled. Later changes of the model are
    /// not in it.
    pub fn document(&self) -> &str {
        &self.document
    }

    /// Creates a world of this model, for one thread.
    pub fn world(&self) -> World {
        World::new(self.clone())
    }

    /// Returns the length of a state vector.
    pub fn state_size(&self) -> usize {
        self.state_size
    }

    /// Returns the number of generalized positions.
    pub fn qpos_size(&self) -> usize {
        self.inner.nq() as usize
    }

    /// Returns the number of generalized velocities.
    pub fn qvel_size(&self) -> usize {
        self.inner.nv() as usize
    }

    /// Returns the number of actuators.
    pub fn actuators(&self) -> usize {
        self.inner.nu() as usize
    }

    /// Returns the duration of a physics step, s.
    pub fn timestep(&self) -> f64 {
        self.inner.opt().timestep
    }

    /// Returns a copy of this model with another duration of the physics step, s.
    pub fn with_timestep(&self, timestep: f64) -> Model {
        let mut inner = (*self.inner).clone();
        inner.opt_mut().timestep = timestep;
        Model { inner: Arc::new(inner), ..self.clone() }
    }
}

/// Returns MuJoCo's full error message for a document. `mujoco-rs` truncates messages to 100 bytes,
/// often before the line number.
fn full_message(xml: &str) -> Option<String> {
    use mujoco_rs::mujoco_c::{mj_compile, mj_deleteModel, mj_deleteSpec, mj_parseXMLString, mjs_getError};
    let xml = CString::new(xml).ok()?;
    let mut message: [c_char; 1000] = [0; 1000];
    // SAFETY: the text and the buffer outlive the calls. MuJoCo terminates the message with a zero
    // byte within the given length. Both objects are deleted once, after their last use.
    #[allow(unsafe_code)]
    let text = unsafe {
        let (buffer, length) = (message.as_mut_ptr(), message.len() as i32);
        let specification = mj_parseXMLString(xml.as_ptr(), null(), buffer, length);
        if specification.is_null() {
            CStr::from_ptr(buffer).to_string_lossy().into_owned()
        } else {
            let model = mj_compile(specification, null());
            let text = CStr::from_ptr(mjs_getError(specification)).to_string_lossy().into_owned();
            if !model.is_null() {
                mj_deleteModel(model);
            }
            mj_deleteSpec(specification);
            text
        }
    };
    Some(text.trim().to_string()).filter(|text| !text.is_empty())
}

/// Discards MuJoCo's warnings, which it would otherwise write to a file in the working directory.
/// MuJoCo also counts them in its data, where [`World::take_divergence`] reads them.
fn discard_warning_log() {
    extern "C" fn take(_warning: *const c_char) {}
    static ONCE: Once = Once::new();
    // SAFETY: the callback is set once, and no thread runs MuJoCo before the first model is
    // compiled.
    #[allow(unsafe_code)]
    ONCE.call_once(|| unsafe { mujoco_rs::mujoco_c::mju_user_warning = Some(take) });
}
