//! Compiling documents whose files are in memory.

use std::ffi::{CStr, CString, c_char};

use mujoco_rs::error::MjEditError;
use mujoco_rs::mujoco_c::{mj_deleteSpec, mj_parseXML};
use mujoco_rs::prelude::*;

use crate::WorldError;
use crate::files::{Assets, Files, Open};

/// The largest document that MuJoCo writes, bytes.
const SAVED: usize = 256 << 20;

/// The largest arena that is kept if the document states none, bytes. MuJoCo then derives one from
/// the deprecated `njmax` and `nconmax`, whose squares are in it, and touches a small part of it.
pub(crate) const ARENA_LIMIT: u64 = 1 << 30;

/// Parts of a compiled model beside its physics.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Visuals {
    /// All geoms, materials and textures, for pictures.
    Keep,
    /// No geoms that do not collide, as with MuJoCo's `discardvisual`: copies of the model are
    /// small without their meshes. They are kept where the inertia of a body follows from them.
    Discard,
}

/// Compiles a document, whose files `open` returns.
pub(crate) fn compile(xml: &str, visuals: Visuals, open: &mut Open<'_>) -> Result<MjModel, WorldError> {
    let mut attempt = |visuals| {
        let mut open = |name: &str| open(name);
        let files = Files::new(xml, &mut open)?;
        let mut spec = parsed(&files)?;
        if visuals == Visuals::Discard {
            spec.compiler_mut().set_discardvisual(true);
        }
        let states_arena = spec.ffi().memory >= 0;
        let mut model = spec.compile_with_vfs(files.vfs()).map_err(edit_error)?;
        if !states_arena && model.ffi().narena as u64 > ARENA_LIMIT {
            set_arena(&mut model, ARENA_LIMIT);
        }
        Ok(model)
    };
    match visuals {
        Visuals::Keep => attempt(visuals),
        Visuals::Discard => attempt(visuals).or_else(|_: WorldError| attempt(Visuals::Keep)),
    }
}

/// Sets the size of the memory that each `mjData` of the model will have for contacts, bytes.
pub(crate) fn set_arena(model: &mut MjModel, bytes: u64) {
    // SAFETY: no data of the model exist, because they would share it.
    #[allow(unsafe_code)]
    unsafe {
        model.ffi_mut().narena = bytes as _;
    }
}

/// Checks that MuJoCo can parse a document, which opens the documents that it includes or attaches.
pub(crate) fn parse(xml: &str, open: &mut Open<'_>) -> Result<(), WorldError> {
    parsed(&Files::new(xml, &mut |name| open(name))?).map(drop)
}

/// Returns the MJCF document that MuJoCo writes for a URDF document, so that it can be edited.
/// MuJoCo rounds numbers to about six digits there.
///
/// # Errors
/// If MuJoCo rejects the document.
pub fn mjcf_of_urdf(xml: &str, assets: &Assets) -> Result<String, WorldError> {
    mjcf_of(xml, &mut |name| assets.get(name).cloned())
}

pub(crate) fn mjcf_of(xml: &str, open: &mut Open<'_>) -> Result<String, WorldError> {
    let mut open = |name: &str| open(name);
    let files = Files::new(xml, &mut open)?;
    let mut spec = parsed(&files)?;
    spec.compile_with_vfs(files.vfs()).map_err(edit_error)?;
    let mut size = 1 << 20;
    loop {
        match spec.save_xml_string(size) {
            Err(MjEditError::XmlBufferTooSmall { required_size }) if size < SAVED => {
                size = (2 * size).max(required_size + 1);
            }
            saved => return saved.map(|text| text.trim().to_string()).map_err(edit_error),
        }
    }
}

/// Returns an MJCF document with more elements at its end, where they take precedence.
///
/// # Example
/// ```
/// let document = "<mujoco><size/></mujoco> <!-- not this </mujoco> -->";
/// let longer = mishandle_world::with_elements(document, "<option/>");
/// assert_eq!(longer, "<mujoco><size/><option/></mujoco> <!-- not this </mujoco> -->");
/// ```
pub fn with_elements(document: &str, elements: &str) -> String {
    const END: &str = "</mujoco";
    let mut start = 0;
    while let Some(end) = document[start..].find(END).map(|end| start + end) {
        match document[start..end].find("<!--").map(|comment| start + comment) {
            None => return format!("{}{elements}{}", &document[..end], &document[end..]),
            Some(comment) => match document[comment..].find("-->") {
                Some(length) => start = comment + length,
                None => break,
            },
        }
    }
    document.to_string()
}

fn parsed(files: &Files<'_>) -> Result<MjSpec, WorldError> {
    // `mujoco-rs` truncates messages to 100 bytes, often before the line number.
    MjSpec::from_xml_vfs(Files::document(), files.vfs()).map_err(|error| match error {
        MjEditError::ParseFailed(_) => rejected(&parse_message(files)),
        error => edit_error(error),
    })
}

fn edit_error(error: MjEditError) -> WorldError {
    match error {
        MjEditError::ParseFailed(message)
        | MjEditError::CompileFailed(message)
        | MjEditError::SaveFailed(message) => rejected(&message),
        other => rejected(&other.to_string()),
    }
}

/// Returns the error for a message of MuJoCo.
fn rejected(message: &str) -> WorldError {
    let message = Files::shown(message);
    let is_plugin = message.contains("plugin");
    let rule =
        if is_plugin { "; plugins run code and are not loaded; remove them from the model" } else { "" };
    WorldError::Model(format!("{message}{rule}"))
}

/// Returns MuJoCo's message about a document that it cannot parse.
fn parse_message(files: &Files<'_>) -> String {
    let path = CString::new(Files::document()).unwrap_or_default();
    let mut message: [c_char; 1000] = [0; 1000];
    let buffer = message.as_mut_ptr();
    let length = message.len() as i32;
    // SAFETY: path, files and buffer outlive the call. MuJoCo terminates the message with a zero
    // byte within the given length. What it returns is deleted once.
    #[allow(unsafe_code)]
    unsafe {
        let parsed = mj_parseXML(path.as_ptr(), files.vfs().ffi(), buffer, length);
        if !parsed.is_null() {
            mj_deleteSpec(parsed);
        }
        CStr::from_ptr(buffer).to_string_lossy().into_owned()
    }
}
