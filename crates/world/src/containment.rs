//! Models of others: tried in a child process before this process compiles them.
//!
//! MuJoCo ends the process at a fatal error, and a document can make it crash, compile without end
//! or take all memory. A child process with limits compiles the document, makes its data and takes
//! a few steps. It can open no file: it asks for each one, and this process decides. What ends the
//! child is an error here.

mod child;
mod message;
mod parent;

use std::ffi::OsString;
use std::sync::{Arc, OnceLock};

use crate::compile::{ARENA_LIMIT, Visuals, parse, set_arena};
use crate::files::Open;
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
    /// It is parsed: what it includes is opened.
    Parse,
    /// It is compiled for pictures and for physics, and simulated: all its files are opened.
    Read,
    /// It is compiled and simulated.
    Simulate(Visuals),
    /// It is converted from URDF to MJCF.
    Convert,
}

/// The smallest arena, bytes. A document can ask for one in which no step has space; MuJoCo ends
/// the process then. The system provides memory only for the used part.
const ARENA: u64 = 16 << 20;

impl Model {
    /// Compiles a document of others, which refers to these files, after a child process has
    /// compiled and simulated it: see [`set_child_program`]. The arena of the model has at least 16
    /// MiB; one that MuJoCo derives from `njmax` and `nconmax` has at most 1 GiB.
    ///
    /// # Errors
    /// If MuJoCo rejects the document, the child process is ended by a fatal error, a crash or a
    /// limit, or the model is too large.
    pub fn from_untrusted(xml: &str, assets: &Assets, visuals: Visuals) -> Result<Model, WorldError> {
        parent::try_in_child(PROGRAM.get(), Task::Simulate(visuals), xml, assets)?;
        compiled(xml, visuals, &mut |name| assets.get(name).cloned())
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

/// Files of a document of others that are opened.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Opened {
    /// Files that MuJoCo opens to parse it: documents that it includes or attaches.
    Included,
    /// Files that MuJoCo opens to compile it.
    All,
}

/// Returns the files that MuJoCo opens for a document of others, by the paths that it has for them,
/// which are relative to the folder of the document, or absolute. MuJoCo runs in a child process,
/// which compiles and simulates the model if all files are opened; `open` decides about each file
/// and returns its content, or `None`.
///
/// # Errors
/// As for [`Model::from_untrusted`].
pub fn files_of_untrusted(xml: &str, which: Opened, open: &mut Open<'_>) -> Result<Assets, WorldError> {
    let mut assets = Assets::new();
    let mut kept = |name: &str| {
        if let Some(known) = assets.get(name) {
            return Some(known.clone());
        }
        let content = open(name)?;
        assets.insert(name.to_string(), content.clone());
        Some(content)
    };
    let task = if which == Opened::All { Task::Read } else { Task::Parse };
    match PROGRAM.get() {
        Some(program) => parent::converse(program, task, xml, &mut kept)?,
        None if which == Opened::All => compiled(xml, Visuals::Keep, &mut kept).map(drop)?,
        None => parse(xml, &mut kept)?,
    }
    if which == Opened::All {
        parent::remember(xml, &assets);
    }
    Ok(assets)
}

/// Compiles a document, checks the sizes of the model and enlarges its arena.
fn compiled(xml: &str, visuals: Visuals, open: &mut Open<'_>) -> Result<Model, WorldError> {
    let mut model = Model::compiled(xml, visuals, open)?;
    let inner = model.inner.ffi();
    let limits = [
        ("generalized positions", inner.nq, 10_000),
        ("degrees of freedom", inner.nv, 10_000),
        ("actuators", inner.nu, 2_000),
        ("bodies", inner.nbody, 20_000),
        ("geoms", inner.ngeom, 50_000),
        ("plugins, which run code", inner.nplugin, 0),
        ("MiB of memory for contacts (`<size memory>`)", inner.narena >> 20, (ARENA_LIMIT >> 20) as _),
    ];
    for (what, found, limit) in limits {
        if found > limit {
            return Err(WorldError::Model(format!("it has {found} {what}; at most {limit} are supported")));
        }
    }
    let arena = (inner.narena as u64).max(ARENA);
    if let Some(inner) = Arc::get_mut(&mut model.inner) {
        set_arena(inner, arena);
    }
    Ok(model)
}
