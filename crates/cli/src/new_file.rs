//! A file that is there whole, or not at all.

use std::fs::Permissions;
use std::io::Write;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use tempfile::{Builder, NamedTempFile};

/// A file under another name, until it is whole; dropped before, it is gone.
pub struct NewFile {
    part: NamedTempFile,
    path: PathBuf,
    force: bool,
}

impl NewFile {
    /// Begins the file that will be at `path`; one that is there already is only written over by `force`.
    pub fn create(path: &Path, force: bool) -> Result<NewFile> {
        if path.exists() && !force {
            bail!("{} exists already; give another --out, or --force to write over it", path.display());
        }
        let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
        if !folder.is_dir() {
            bail!("cannot write {}: there is no folder {}", path.display(), folder.display());
        }
        let part = Builder::new()
            .prefix(".mishandle-")
            .suffix(".part")
            .permissions(Permissions::from_mode(0o666)) // less what the user's umask takes away
            .tempfile_in(folder)
            // What the system says, without the name that is only for now.
            .map_err(|error| std::io::Error::from(error.kind()))
            .with_context(|| format!("cannot write {}", path.display()))?;
        Ok(NewFile { part, path: path.to_path_buf(), force })
    }

    /// Where it is as yet.
    pub fn part(&self) -> &Path {
        self.part.path()
    }

    /// Writes all of it.
    pub fn fill(mut self, bytes: &[u8]) -> Result<()> {
        self.part.write_all(bytes).with_context(|| self.path.display().to_string())?;
        self.finish()
    }

    /// Gives it its name, now that it is whole.
    pub fn finish(self) -> Result<()> {
        let done =
            if self.force { self.part.persist(&self.path) } else { self.part.persist_noclobber(&self.path) };
        done.map(drop).map_err(|error| error.error).with_context(|| self.path.display().to_string())
    }
}
