use std::ffi::c_char;
use std::sync::{Arc, Once};

use mujoco_rs::prelude::*;

use crate::compile::{Visuals, compile};
use crate::{Assets, Open, World, WorldError};

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
    /// Compiles an MJCF document that refers to no files.
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
        Model::from_xml_with_assets(xml, &Assets::new())
    }

    /// Compiles an MJCF or URDF document that refers to these files by their names. No file is read
    /// from the disk.
    ///
    /// # Errors
    /// As for [`from_xml`](Self::from_xml), or if the document refers to another file.
    pub fn from_xml_with_assets(xml: &str, assets: &Assets) -> Result<Model, WorldError> {
        Model::compiled(xml, Visuals::Keep, &mut |name| assets.get(name).cloned())
    }

    /// Compiles a document, whose files `open` returns.
    pub(crate) fn compiled(xml: &str, visuals: Visuals, open: &mut Open<'_>) -> Result<Model, WorldError> {
        let inner = compile(xml, visuals, open)?;
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

    /// Returns the compiled model in MuJoCo's binary format (MJB), for another program with the
    /// same version of MuJoCo.
    pub fn binary(&self) -> Vec<u8> {
        let mut bytes = vec![0; self.inner.size()];
        // The buffer has the size of the model, which is the only reason for an error.
        self.inner.save_to_buffer(&mut bytes).map_or_else(|_| Vec::new(), |()| bytes)
    }

    /// Returns whether the integrator is implicit in velocities.
    pub fn is_implicit(&self) -> bool {
        let implicit = [MjtIntegrator::mjINT_IMPLICIT, MjtIntegrator::mjINT_IMPLICITFAST];
        implicit.map(|integrator| integrator as i32).contains(&self.inner.opt().integrator)
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

/// Discards MuJoCo's warnings, which it would otherwise write to a file in the working directory.
/// MuJoCo also counts them in its data, where [`World::take_divergence`] reads them.
pub(crate) fn discard_warning_log() {
    extern "C" fn take(_warning: *const c_char) {}
    static ONCE: Once = Once::new();
    // SAFETY: the callback is set once, and no thread runs MuJoCo before the first model is
    // compiled.
    #[allow(unsafe_code)]
    ONCE.call_once(|| unsafe { mujoco_rs::mujoco_c::mju_user_warning = Some(take) });
}
