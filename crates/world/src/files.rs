//! The files of a document: MuJoCo opens each one through a provider of ours, and none on the disk.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::ffi::{CStr, CString, c_char, c_int, c_void};
use std::hash::{BuildHasher, RandomState};
use std::sync::{LazyLock, Mutex, PoisonError};

use mujoco_rs::mujoco_c::{mj_mountVFS, mjResource, mjpResourceProvider};
use mujoco_rs::wrappers::MjVfs;

use crate::WorldError;
use crate::model::discard_warning_log;

/// Files that a document refers to, by their paths relative to its folder, or absolute.
pub type Assets = BTreeMap<String, Vec<u8>>;

/// Returns the content of a file that MuJoCo asks for by such a path; `None` refuses it.
pub type Open<'a> = dyn FnMut(&str) -> Option<Vec<u8>> + Send + 'a;

/// The number of folders [`LEVEL`] between [`BASE`] and the document, as MuJoCo sees it: a path
/// through the folders above it differs from an absolute one. No disk has a file there,
/// because the base is a device.
const LEVELS: usize = 32;
const BASE: &str = "/dev/null/";
const LEVEL: &str = "@/";

static FOLDER: LazyLock<String> = LazyLock::new(|| format!("{BASE}{}", LEVEL.repeat(LEVELS)));

/// The name of the document, which no file of a model has.
const DOCUMENT: &str = "@.xml";

/// The entries of the root folder. MuJoCo reads a path from the disk unless a provider is mounted
/// at it or above it, and the root folder itself cannot be such a place.
static ROOTS: LazyLock<Vec<CString>> = LazyLock::new(|| {
    let found = std::fs::read_dir("/").into_iter().flatten().flatten();
    let names = found.map(|entry| entry.file_name().into_encoded_bytes());
    let mut roots: Vec<CString> = names
        .chain([b"dev".to_vec()])
        .filter_map(|name| CString::new([b"/".as_slice(), name.as_slice()].concat()).ok())
        .collect();
    roots.sort_unstable();
    roots.dedup();
    roots
});

/// Random in each process, so that no file can be made to have the stamp of another one.
static STAMPS: LazyLock<[RandomState; 2]> = LazyLock::new(|| [RandomState::new(), RandomState::new()]);

/// Lists the root folder, before the process may no longer open it.
pub(crate) fn prepare() {
    LazyLock::force(&ROOTS);
}

/// MuJoCo's file system with a document and nothing else but what `open` returns.
pub(crate) struct Files<'a> {
    // Dropped first: it refers to the provider, and that to the contents.
    vfs: MjVfs,
    _provider: Box<mjpResourceProvider>,
    _contents: Box<Contents<'a>>,
}

struct Contents<'a> {
    document: &'a [u8],
    /// MuJoCo reads meshes and textures in several threads.
    open: Mutex<&'a mut Open<'a>>,
}

impl<'a> Files<'a> {
    pub(crate) fn new(document: &'a str, open: &'a mut Open<'a>) -> Result<Files<'a>, WorldError> {
        // MuJoCo would read the document up to there.
        if document.contains('\0') {
            return Err(WorldError::Model("the document contains a zero byte".to_string()));
        }
        discard_warning_log();
        let contents = Box::new(Contents { document: document.as_bytes(), open: Mutex::new(open) });
        let provider = Box::new(mjpResourceProvider {
            prefix: std::ptr::null(),
            open: Some(open_resource),
            read: Some(read_resource),
            close: Some(close_resource),
            mount: Some(mount_resource),
            unmount: Some(mount_resource),
            modified: Some(is_modified),
            write: None,
            data: std::ptr::from_ref::<Contents<'a>>(&contents).cast_mut().cast(),
        });
        let mut vfs = MjVfs::new();
        for root in &*ROOTS {
            // SAFETY: the provider and its contents are in boxes that live longer than the file
            // system, and nothing else changes them.
            #[allow(unsafe_code)]
            let code = unsafe { mj_mountVFS(vfs.ffi_mut(), root.as_ptr(), &raw const *provider) };
            if code != 0 {
                let place = root.to_string_lossy();
                return Err(WorldError::Model(format!("MuJoCo cannot mount {place} (code {code})")));
            }
        }
        Ok(Files { vfs, _provider: provider, _contents: contents })
    }

    pub(crate) fn vfs(&self) -> &MjVfs {
        &self.vfs
    }

    /// Returns the path of the document.
    pub(crate) fn document() -> String {
        format!("{}{DOCUMENT}", *FOLDER)
    }

    /// Returns a message of MuJoCo with paths relative to the folder of the document.
    pub(crate) fn shown(message: &str) -> String {
        message.replace(&*FOLDER, "").trim().to_string()
    }
}

/// Returns a path of MuJoCo relative to the folder of the document.
fn relative(path: &str) -> Cow<'_, str> {
    let Some(mut rest) = path.strip_prefix(BASE) else { return path.into() };
    let mut up = LEVELS;
    while let Some(below) = rest.strip_prefix(LEVEL).filter(|_| up > 0) {
        (rest, up) = (below, up - 1);
    }
    if up == 0 { rest.into() } else { format!("{}{rest}", "../".repeat(up)).into() }
}

/// # Safety
/// `resource` is one of MuJoCo whose provider [`Files`] mounted.
#[allow(unsafe_code)]
unsafe extern "C" fn open_resource(resource: *mut mjResource) -> c_int {
    // SAFETY: as above; the name is a terminated text, and MuJoCo shares the resource with no other
    // thread while it is opened.
    let (resource, contents, path) = unsafe {
        let resource = &mut *resource;
        let contents = &*(*resource.provider).data.cast::<Contents<'_>>();
        let path = CStr::from_ptr(resource.name);
        (resource, contents, path)
    };
    let Ok(path) = path.to_str() else { return 0 };
    let name = relative(path);
    let content = if name == DOCUMENT {
        Some(contents.document.to_vec())
    } else {
        contents.open.lock().unwrap_or_else(PoisonError::into_inner)(&name)
    };
    let Some(content) = content else { return 0 };
    // MuJoCo keeps what it made of files, by their paths and stamps.
    let stamp = STAMPS.each_ref().map(|stamp| stamp.hash_one(&content));
    let stamp = format!("{:016x}{:016x}", stamp[0], stamp[1]);
    for (to, from) in resource.timestamp.iter_mut().zip(stamp.bytes().chain([0])) {
        *to = from as c_char;
    }
    resource.data = Box::into_raw(Box::new(content)).cast::<c_void>();
    1
}

/// # Safety
/// As for [`open_resource`], which has opened it.
#[allow(unsafe_code)]
unsafe extern "C" fn read_resource(resource: *mut mjResource, buffer: *mut *const c_void) -> c_int {
    // SAFETY: as above; the content stays until the resource is closed.
    unsafe {
        let content = &*(*resource).data.cast::<Vec<u8>>();
        *buffer = content.as_ptr().cast();
        c_int::try_from(content.len()).unwrap_or(-1)
    }
}

/// # Safety
/// As for [`read_resource`].
#[allow(unsafe_code)]
unsafe extern "C" fn close_resource(resource: *mut mjResource) {
    // SAFETY: as above; the box is from `open_resource`, and is freed once.
    unsafe {
        drop(Box::from_raw((*resource).data.cast::<Vec<u8>>()));
        (*resource).data = std::ptr::null_mut();
    }
}

extern "C" fn mount_resource(_resource: *mut mjResource) -> c_int {
    0
}

/// # Safety
/// As for [`read_resource`]; the stamp is a terminated text.
#[allow(unsafe_code)]
unsafe extern "C" fn is_modified(resource: *const mjResource, stamp: *const c_char) -> c_int {
    // SAFETY: as above; `open_resource` terminates the stamp of the resource.
    unsafe { c_int::from(CStr::from_ptr((*resource).timestamp.as_ptr()) != CStr::from_ptr(stamp)) }
}
