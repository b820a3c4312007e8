//! Models of others: tried in a child process before this process compiles them.
//!
//! MuJoCo ends the process at a fatal error, and a document can make it crash, compile without end
//! or take all memory. A child process with limits compiles the document, makes its data and takes
//! a few steps. What ends the child is an error here.

mod child;
mod message;
mod parent;

use std::ffi::OsString;
use std::sync::{Arc, OnceLock};

use crate::{Assets, Model, WorldError, mjcf_of_urdf};

pub use child::run_child;

/// The word with which a program starts itself as the child: its `main` calls [`run_child`] then.
pub const CHILD_WORD: &str = "__try_model";

static PROGRAM: OnceLock<Vec<OsString>> = OnceLock::new();

/// Sets the program that runs as the child, with its arguments. It must call [`run_child`] and do
/// nothing else. The first call counts.
///
/// Without a program, [`Model::from_untrusted`] compiles in this process only: a hostile model can
/// end it.
pub fn set_child_program(words: Vec<OsString>) {
    // A later call, for instance by a library in the same process, has the same purpose.
    let _ = PROGRAM.set(words);
}

/// Use of a document.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
enum Task {
    /// It is compiled and simulated.
    Simulate,
    /// It is converted from URDF to MJCF.
    Convert,
}

/// The smallest arena, bytes. A document can ask for one in which no step has space; MuJoCo ends
/// the process then. The system provides memory only for the used part.
const ARENA: u64 = 16 << 20;

impl Model {
    /// Compiles a document of others, as [`from_xml_with_assets`](Self::from_xml_with_assets) does,
    /// after a child process has compiled and simulated it: see [`set_child_program`]. The arena of
    /// the model has at least 16 MiB.
    ///
    /// # Errors
    /// If MuJoCo rejects the document, the child process is ended by a fatal error, a crash or a
    /// limit, or the model is too large.
    pub fn from_untrusted(xml: &str, assets: Arc<Assets>) -> Result<Model, WorldError> {
        parent::try_in_child(PROGRAM.get(), Task::Simulate, xml, &assets)?;
        compiled(xml, assets)
    }
}

/// Converts a URDF document of others, as [`mjcf_of_urdf`] does, after a child process has done it.
///
/// # Errors
/// As for [`Model::from_untrusted`].
pub fn mjcf_of_untrusted_urdf(xml: &str, assets: &Assets) -> Result<String, WorldError> {
    parent::try_in_child(PROGRAM.get(), Task::Convert, xml, assets)?;
    mjcf_of_urdf(xml, assets)
}

/// Compiles a document, checks the sizes of the model and enlarges its arena.
fn compiled(xml: &str, assets: Arc<Assets>) -> Result<Model, WorldError> {
    let mut model = Model::from_xml_with_assets(xml, assets)?;
    let inner = model.inner.ffi();
    let limits = [
        ("generalized positions", inner.nq, 10_000),
        ("degrees of freedom", inner.nv, 10_000),
        ("actuators", inner.nu, 2_000),
        ("bodies", inner.nbody, 20_000),
        ("geoms", inner.ngeom, 50_000),
        ("MiB of memory for contacts (`<size memory>`)", inner.narena >> 20, 1_024),
    ];
    for (what, found, limit) in limits {
        if found > limit {
            return Err(WorldError::Model(format!("it has {found} {what}; at most {limit} are supported")));
        }
    }
    if let Some(inner) = Arc::get_mut(&mut model.inner) {
        // SAFETY: the field is the size of the memory that each `mjData` of the model will have,
        // and no data of the model exist.
        #[allow(unsafe_code)]
        unsafe {
            let inner = inner.ffi_mut();
            inner.narena = inner.narena.max(ARENA as _);
        }
    }
    Ok(model)
}
