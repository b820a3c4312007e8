//! The files of a controller: itself, and those that belong to an ONNX model.

use std::path::Path;

use mishandle_files::{limits, read_bounded};

use super::folder::Folder;
use super::{EXTENSION, ONNX_EXTENSION};
use crate::error::MishandleError;
use crate::plan::Plan;
use crate::resolve::{ONNX_SIDES, is_onnx, onnx_side, shipped_file};
use crate::shipped::ShippedFile;

/// The contents of the files of a controller.
pub(super) struct ControllerFiles {
    /// Extension of the controller: the format in which a hardening writes all of its controllers.
    pub extension: &'static str,
    bytes: Vec<u8>,
    /// Those of [`ONNX_SIDES`] that exist.
    sides: [Option<Vec<u8>>; 2],
}

impl ControllerFiles {
    /// Returns those of a network of this program.
    pub fn of_network(bytes: Vec<u8>) -> ControllerFiles {
        ControllerFiles { extension: EXTENSION, bytes, sides: [None, None] }
    }

    /// Reads those of the controller of a plan.
    ///
    /// # Errors
    /// If the name is unknown, is that of an expert, or a file cannot be read.
    pub fn of_plan(plan: &Plan) -> Result<ControllerFiles, MishandleError> {
        match shipped_file(plan)? {
            ShippedFile::Path(path) => ControllerFiles::read(&path),
            embedded => Ok(ControllerFiles {
                extension: if is_onnx(embedded.path()) { ONNX_EXTENSION } else { EXTENSION },
                bytes: embedded.bytes()?.into_owned(),
                sides: [None, None],
            }),
        }
    }

    /// Reads those of a path.
    ///
    /// # Errors
    /// If a file cannot be read.
    pub fn read(path: &Path) -> Result<ControllerFiles, MishandleError> {
        let read = |path: &Path| read_bounded(path, limits::CONTROLLER).map_err(MishandleError::file(path));
        let bytes = read(path)?;
        if !is_onnx(path) {
            return Ok(ControllerFiles::of_network(bytes));
        }
        let mut sides = [None, None];
        for (side, end) in sides.iter_mut().zip(ONNX_SIDES) {
            let path = onnx_side(path, end);
            *side = path.exists().then(|| read(&path)).transpose()?;
        }
        Ok(ControllerFiles { extension: ONNX_EXTENSION, bytes, sides })
    }

    /// Writes them in place of those of another controller.
    ///
    /// # Errors
    /// If a file cannot be written.
    pub fn write(&self, folder: &Folder, path: &Path) -> Result<(), MishandleError> {
        for (side, end) in self.sides.iter().zip(ONNX_SIDES).filter(|_| self.extension == ONNX_EXTENSION) {
            let path = onnx_side(path, end);
            match side {
                Some(bytes) => folder.write(&path, bytes)?,
                None => folder.remove(&path)?,
            }
        }
        folder.write(path, &self.bytes)
    }
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    #[test]
    fn the_weights_of_a_model_go_with_it_and_those_of_another_one_do_not_stay() {
        let home = tempfile::tempdir().unwrap();
        let folder = Folder::at(home.path());
        let path = |name: &str| home.path().join(name);
        for (name, text) in [
            ("a.onnx", "model"),
            ("a.onnx.data", "weights"),
            ("b.onnx", "old"),
            ("b.onnx.json", "old description"),
        ] {
            fs::write(path(name), text).unwrap();
        }
        ControllerFiles::read(&path("a.onnx")).unwrap().write(&folder, &path("b.onnx")).unwrap();
        assert_eq!(fs::read(path("b.onnx")).unwrap(), b"model");
        assert_eq!(fs::read(path("b.onnx.data")).unwrap(), b"weights");
        assert!(!path("b.onnx.json").exists());
    }
}
