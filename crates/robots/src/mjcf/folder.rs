//! Reading the files of a model, which may not leave its folder.

use std::path::{Component, Path, PathBuf};

use mishandle_files::{limits, read_bounded};

/// The largest size of all files of a model, bytes.
const TOTAL: u64 = 512 << 20;

/// The largest number of files of a model.
const FILES: usize = 2_000;

/// The folder of a model's main file.
#[derive(Debug)]
pub(crate) struct Folder {
    path: PathBuf,
    canonical: PathBuf,
    allow_outside: bool,
    read: u64,
    /// The files that were read.
    files: Vec<PathBuf>,
    /// Why the first file that was refused was refused.
    refusal: Option<String>,
}

impl Folder {
    /// Returns the folder of a file.
    pub(crate) fn of(file: &Path, allow_outside: bool) -> Result<Folder, String> {
        let path = match file.parent() {
            Some(parent) if !parent.as_os_str().is_empty() => parent.to_path_buf(),
            _ => PathBuf::from("."),
        };
        let canonical = path.canonicalize().map_err(|error| error.to_string())?;
        Ok(Folder { path, canonical, allow_outside, read: 0, files: Vec::new(), refusal: None })
    }

    /// Returns the files that were read, the main file first.
    pub(crate) fn into_files(self) -> Vec<PathBuf> {
        self.files
    }

    /// Returns whether files outside the folder may be read.
    pub(crate) fn allows_outside(&self) -> bool {
        self.allow_outside
    }

    /// Returns where a file `NAME/REST` is if a folder above is called NAME and may be read.
    pub(crate) fn in_ancestor(&self, path: &str) -> Option<String> {
        let (name, rest) = path.split_once('/')?;
        let is_named = |folder: &&Path| folder.file_name().is_some_and(|own| own == name);
        let folder = self.canonical.ancestors().filter(|_| self.allow_outside).find(is_named)?;
        Some(folder.join(rest).to_string_lossy().into_owned())
    }

    /// Returns the content of a file that MuJoCo asks for, relative to the folder. `None` if it
    /// does not exist or is refused: [`refusal`](Self::refusal) says why.
    pub(crate) fn open(&mut self, name: &str) -> Option<Vec<u8>> {
        let content = match self.find(name) {
            Ok(Some(path)) => {
                self.read(&path).map(Some).map_err(|reason| format!("cannot read `{name}`: {reason}"))
            }
            Ok(None) => Ok(None),
            Err(refusal) => Err(refusal),
        };
        content.unwrap_or_else(|refusal| {
            self.refusal.get_or_insert(refusal);
            None
        })
    }

    /// Returns why the first file that was refused was refused.
    pub(crate) fn refusal(&self) -> Option<&str> {
        self.refusal.as_deref()
    }

    /// Reads a file.
    pub(crate) fn read(&mut self, path: &Path) -> Result<Vec<u8>, String> {
        let bytes = read_bounded(path, limits::MODEL).map_err(|error| error.to_string())?;
        self.read += bytes.len() as u64;
        self.files.push(path.to_path_buf());
        if self.read > TOTAL {
            return Err(format!("the files of the model have more than {} MiB in all", TOTAL >> 20));
        }
        if self.files.len() > FILES {
            return Err(format!("the model refers to more than {FILES} files"));
        }
        Ok(bytes)
    }

    /// Returns the path of a file, relative to the folder, without symbolic links; `None` if it
    /// does not exist.
    pub(crate) fn find(&self, name: &str) -> Result<Option<PathBuf>, String> {
        let outside = || {
            Err(format!(
                "`{name}` is outside the folder of the model; if you trust the model, allow files outside it with the \
                 setting `allow_outside`, which is `allow_outside = true` in [model] of a target file"
            ))
        };
        if name.contains(":/") {
            return Err(format!("`{name}` is a link; only files can be read"));
        }
        if !self.allow_outside && leaves(Path::new(name)) {
            return outside();
        }
        let Ok(path) = self.path.join(name).canonicalize() else { return Ok(None) };
        if !self.allow_outside && !path.starts_with(&self.canonical) {
            return outside();
        }
        Ok(Some(path))
    }
}

/// Returns whether a relative path leaves its folder at any point.
fn leaves(path: &Path) -> bool {
    let mut depth = 0_i64;
    path.components().any(|component| {
        match component {
            Component::Normal(_) => depth += 1,
            Component::CurDir => {}
            Component::ParentDir => depth -= 1,
            Component::RootDir | Component::Prefix(_) => return true,
        }
        depth < 0
    })
}
