use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use mishandle::files::{limits, read_bounded, write_atomically};

use crate::zoo::{Training, ZooError};

/// The paths of the zoo's files inside a clone of the repository.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ZooFolder(PathBuf);

impl ZooFolder {
    /// Returns the zoo in this clone of the repository.
    pub fn new(root: &Path) -> ZooFolder {
        ZooFolder(root.to_path_buf())
    }

    /// Returns a path relative to the root.
    pub fn path(&self, path: &str) -> PathBuf {
        self.0.join(path)
    }

    /// Returns the settings file of a training run.
    pub fn settings(&self, training: &Training) -> PathBuf {
        self.path(&format!("controllers/training/{}/{}.toml", training.task, training.algorithm))
    }

    /// Returns where a finished controller is.
    pub fn controller(&self, training: &Training) -> PathBuf {
        self.path(&format!("controllers/{}/{}.safetensors", training.task, training.algorithm))
    }

    /// Returns the record of a controller.
    pub fn record(&self, task: &str, controller: &str) -> PathBuf {
        self.path(&format!("controllers/figures/{task}/{controller}.json"))
    }

    /// Returns the learning curve that is kept.
    pub fn curve(&self, training: &Training) -> PathBuf {
        self.path(&format!("controllers/curves/{}/{}.csv", training.task, training.algorithm))
    }

    /// Returns the chart of a task's learning curves.
    pub fn chart(&self, task: &str) -> PathBuf {
        self.path(&format!("controllers/curves/{task}.svg"))
    }

    /// Returns a file of a training run in progress.
    pub fn work(&self, training: &Training, ending: &str) -> PathBuf {
        self.work_file(&(training.name() + ending))
    }

    /// Returns a file in the folder of work in progress, which git ignores.
    pub(crate) fn work_file(&self, name: &str) -> PathBuf {
        self.path("target/controllers").join(name)
    }
}

/// Writes a file atomically, and creates its folder.
pub(crate) fn write(path: &Path, bytes: &[u8]) -> Result<(), ZooError> {
    create_parent(path)?;
    write_atomically(path, bytes).map_err(ZooError::file(path))
}

pub(crate) fn create_parent(path: &Path) -> Result<(), ZooError> {
    let folder = path.parent().unwrap_or(Path::new("."));
    fs::create_dir_all(folder).map_err(ZooError::file(folder))
}

pub(crate) fn read(path: &Path) -> Result<Vec<u8>, ZooError> {
    read_bounded(path, limits::CONTROLLER).map_err(ZooError::file(path))
}

/// Removes a file; a missing file is not an error.
pub(crate) fn remove(path: &Path) -> Result<(), ZooError> {
    match fs::remove_file(path) {
        Err(error) if error.kind() != ErrorKind::NotFound => Err(ZooError::file(path)(error)),
        _ => Ok(()),
    }
}
