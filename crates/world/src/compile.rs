//! Compiling documents whose files are in memory.

use std::collections::BTreeMap;
use std::ffi::{CStr, CString, c_char};

use mujoco_rs::mujoco_c::{
    mj_compile, mj_deleteModel, mj_deleteSpec, mj_parseXML, mj_saveXMLString, mjSpec, mjs_getError,
};
use mujoco_rs::prelude::*;
use mujoco_rs::wrappers::MjVfs;

use crate::WorldError;

/// Files that a document refers to, by the names that it has for them.
pub type Assets = BTreeMap<String, Vec<u8>>;

/// The folder of the document in MuJoCo's virtual file system. MuJoCo looks for a file on the disk
/// if it is not in there. No disk has a file in this folder, because it is a device.
const FOLDER: &str = "/dev/null/";

const DOCUMENT: &str = "model.xml";

/// The largest document that MuJoCo writes, bytes.
const SAVED: usize = 256 << 20;

/// Compiles a document.
pub(crate) fn compile(xml: &str, assets: &Assets) -> Result<MjModel, WorldError> {
    let vfs = files(xml, assets)?;
    MjModel::from_xml_vfs(format!("{FOLDER}{DOCUMENT}"), &vfs).map_err(|error| {
        let message =
            Specification::parse(&vfs).map_or_else(|message| message, |parsed| parsed.compile(&vfs));
        WorldError::Model(if message.is_empty() { error.to_string() } else { message })
    })
}

/// Returns the MJCF document that MuJoCo writes for a URDF document, so that it can be edited.
/// MuJoCo rounds numbers to about six digits there.
///
/// # Errors
/// If MuJoCo rejects the document.
pub fn mjcf_of_urdf(xml: &str, assets: &Assets) -> Result<String, WorldError> {
    let vfs = files(xml, assets)?;
    let parsed = Specification::parse(&vfs).map_err(WorldError::Model)?;
    let message = parsed.compile(&vfs);
    if !message.is_empty() {
        return Err(WorldError::Model(message));
    }
    parsed.save().map_err(WorldError::Model)
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

/// Returns the file system of a document and its files.
fn files(xml: &str, assets: &Assets) -> Result<MjVfs, WorldError> {
    // MuJoCo reads C strings, which a zero byte would truncate.
    if xml.contains('\0') {
        return Err(WorldError::Model("the document contains a zero byte".to_string()));
    }
    if let Some(path) = outside(xml) {
        let message = format!("the document refers to `{path}`, which is outside its folder");
        return Err(WorldError::Model(message));
    }
    let mut vfs = MjVfs::new();
    let document = (DOCUMENT, xml.as_bytes());
    let assets = assets.iter().map(|(name, bytes)| (name.as_str(), bytes.as_slice()));
    for (name, bytes) in assets.chain([document]) {
        let added = if name.contains('\0') {
            Err("its name contains a zero byte".to_string())
        } else {
            vfs.add_from_buffer(format!("{FOLDER}{name}"), bytes).map_err(|error| error.to_string())
        };
        added.map_err(|error| WorldError::Model(format!("cannot use the file `{name}`: {error}")))?;
    }
    Ok(vfs)
}

/// Returns the value of an attribute that refers to a file or folder outside that of the document.
fn outside(xml: &str) -> Option<&str> {
    let mut rest = xml;
    while let Some(at) = rest.find('=') {
        let before = rest[..at].trim_end();
        let after = rest[at + 1..].trim_start();
        rest = &rest[at + 1..];
        let key = before.rsplit(|letter: char| letter.is_whitespace()).next().unwrap_or_default();
        if !key.starts_with("file") && !key.ends_with("dir") {
            continue;
        }
        let Some(quote) = after.chars().next().filter(|quote| matches!(quote, '"' | '\'')) else {
            continue;
        };
        let value = after[1..].split(quote).next().unwrap_or_default();
        let path = value.strip_prefix("package://").unwrap_or(value);
        let leaves = path.split(['/', '\\']).any(|part| part == "..");
        // `&` begins the code of a letter.
        if leaves || path.starts_with(['/', '\\']) || path.contains(['&', ':']) {
            return Some(value);
        }
    }
    None
}

/// A parsed document.
struct Specification(*mut mjSpec);

impl Specification {
    fn parse(vfs: &MjVfs) -> Result<Specification, String> {
        let path = CString::new(format!("{FOLDER}{DOCUMENT}")).unwrap_or_default();
        let mut message: [c_char; 1000] = [0; 1000];
        let buffer = message.as_mut_ptr();
        let length = message.len() as i32;
        // SAFETY: path, files and buffer outlive the call. MuJoCo terminates the message with a
        // zero byte within the given length.
        #[allow(unsafe_code)]
        unsafe {
            let parsed = mj_parseXML(path.as_ptr(), vfs.ffi(), buffer, length);
            if parsed.is_null() { Err(text(buffer)) } else { Ok(Specification(parsed)) }
        }
    }

    /// Compiles it and returns MuJoCo's full error message, empty without an error. `mujoco-rs`
    /// truncates messages to 100 bytes, often before the line number.
    fn compile(&self, vfs: &MjVfs) -> String {
        // SAFETY: the specification is valid until it is dropped, and the model is deleted once.
        #[allow(unsafe_code)]
        unsafe {
            let model = mj_compile(self.0, vfs.ffi());
            if model.is_null() {
                return text(mjs_getError(self.0));
            }
            mj_deleteModel(model);
            String::new()
        }
    }

    /// Returns the document that MuJoCo writes.
    fn save(&self) -> Result<String, String> {
        let mut message: [c_char; 1000] = [0; 1000];
        let mut size = 1 << 20;
        loop {
            let mut saved: Vec<c_char> = vec![0; size];
            // SAFETY: both buffers have the given lengths, and MuJoCo terminates what it writes.
            #[allow(unsafe_code)]
            let (code, written, reason) = unsafe {
                let out = saved.as_mut_ptr();
                let error = message.as_mut_ptr();
                let code = mj_saveXMLString(self.0, out, size as i32, error, message.len() as i32);
                (code, text(out), text(error))
            };
            match code {
                0 => return Ok(written),
                // The length that is needed.
                needed if needed > 0 && size < SAVED => size = (2 * size).max(needed as usize + 1),
                _ => return Err(reason),
            }
        }
    }
}

impl Drop for Specification {
    #[allow(unsafe_code)]
    fn drop(&mut self) {
        // SAFETY: it is deleted once, after its last use.
        unsafe { mj_deleteSpec(self.0) }
    }
}

/// Returns the text of a C string without spaces around it.
///
/// # Safety
/// The string must be terminated and valid during the call.
#[allow(unsafe_code)]
unsafe fn text(string: *const c_char) -> String {
    // SAFETY: the caller guarantees it.
    unsafe { CStr::from_ptr(string) }.to_string_lossy().trim().to_string()
}
