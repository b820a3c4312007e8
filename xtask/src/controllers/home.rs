//! Where the files of a training are.

use std::fs::{File, OpenOptions, TryLockError};
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};

use super::plan::Training;

/// A folder with training settings, controllers and pages: the repository, or what `MISHANDLE_HOME` says.
#[derive(Clone, Debug)]
pub struct Home(PathBuf);

impl Home {
    pub fn new(root: &Path) -> Home {
        Home(std::env::var_os("MISHANDLE_HOME").map_or_else(|| root.to_path_buf(), PathBuf::from))
    }

    #[cfg(test)]
    pub fn at(folder: &Path) -> Home {
        Home(folder.to_path_buf())
    }

    pub fn folder(&self) -> &Path {
        &self.0
    }

    /// A file or folder by its path from here.
    pub fn path(&self, path: &str) -> PathBuf {
        self.0.join(path)
    }

    pub fn settings(&self, training: &Training) -> PathBuf {
        self.path(&format!("experiments/training/{}/{}.toml", training.task, training.algorithm))
    }

    /// Where a finished controller is: among the shipped ones, or where it was trained, since further seeds are measured
    /// and not shipped.
    pub fn controller(&self, training: &Training) -> PathBuf {
        match training.is_shipped() {
            true => self.path(&format!("controllers/{}/{}.safetensors", training.task, training.algorithm)),
            false => self.work(training, ".safetensors"),
        }
    }

    /// The record of what was measured of a controller.
    pub fn record(&self, task: &str, controller: &str) -> PathBuf {
        self.path(&format!("controllers/figures/{task}/{controller}.json"))
    }

    /// The learning curve that is kept.
    pub fn curve(&self, training: &Training) -> PathBuf {
        let Training { task, algorithm, seed } = training;
        self.path(&format!("controllers/curves/{task}/{algorithm}-s{seed}.csv"))
    }

    /// A file of a training that is under way.
    pub fn work(&self, training: &Training, ending: &str) -> PathBuf {
        self.path("target/controllers").join(training.name() + ending)
    }
}

/// Takes the lock in a file, which the system lets go of when this process ends; nothing if another process has it.
///
/// # Errors
/// If there can be no such file.
pub fn lock(path: &Path) -> Result<Option<File>> {
    if let Some(folder) = path.parent() {
        std::fs::create_dir_all(folder).with_context(|| folder.display().to_string())?;
    }
    let told = || path.display().to_string();
    let file = OpenOptions::new().write(true).create(true).truncate(false).open(path).with_context(told)?;
    match file.try_lock() {
        Ok(()) => Ok(Some(file)),
        Err(TryLockError::WouldBlock) => Ok(None),
        Err(TryLockError::Error(error)) => Err(error).with_context(told),
    }
}

/// Writes a file, and its folder if it is not there; whole or not at all.
///
/// # Errors
/// If it cannot be written.
pub fn write(path: &Path, bytes: &[u8]) -> Result<()> {
    let folder = path.parent().context("a file without a folder")?;
    let mut new = path.as_os_str().to_owned();
    new.push(".new");
    std::fs::create_dir_all(folder)
        .and_then(|()| std::fs::write(&new, bytes))
        .and_then(|()| std::fs::rename(&new, path))
        .with_context(|| format!("cannot write {}", path.display()))
}
