use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use crate::mjcf::compose::Composed;
use crate::mjcf::edit::{Edit, apply};
use crate::mjcf::folder::Folder;
use crate::mjcf::tree::{name, parse};
use crate::mjcf::{MjcfError, assets, urdf};

/// A model as text, with the files that it refers to.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Source {
    /// MJCF without includes, or URDF.
    pub document: String,
    /// The files, by the names that the document has for them.
    pub assets: BTreeMap<String, Vec<u8>>,
}

impl Source {
    /// Reads a model with its includes and assets. With `allow_outside`, they may be outside the
    /// folder of the file.
    ///
    /// # Errors
    /// If a file cannot be read, is not UTF-8 or XML, is too large, or is outside the folder, or if
    /// the model has plugins or attached models.
    ///
    /// # Example
    /// ```
    /// use mishandle_robots::mjcf::Source;
    /// # let folder = tempfile::tempdir()?;
    /// let path = folder.path().join("robot.xml");
    /// std::fs::write(&path, "<mujoco><include file='arm.xml'/></mujoco>")?;
    /// std::fs::write(folder.path().join("arm.xml"), "<mujoco><worldbody/></mujoco>")?;
    /// assert_eq!(Source::read(&path, false)?.document, "<mujoco><worldbody/></mujoco>");
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn read(path: &Path, allow_outside: bool) -> Result<Source, MjcfError> {
        Ok(Source::read_with_files(path, allow_outside)?.0)
    }

    /// Reads a model as [`read`](Self::read) does, and returns the paths of its files as well, the
    /// main file first.
    ///
    /// # Errors
    /// The errors of [`read`](Self::read).
    pub fn read_with_files(path: &Path, allow_outside: bool) -> Result<(Source, Vec<PathBuf>), MjcfError> {
        let file = path.display().to_string();
        let error = |message: String| MjcfError::new(&file, None, message);
        let mut folder = Folder::of(path, allow_outside).map_err(error)?;
        let bytes = folder.read(path).map_err(error)?;
        let text = String::from_utf8(bytes).map_err(|_| error("the file is not UTF-8 text".to_string()))?;
        let root = name(parse(&text, &file)?.root_element()).to_string();
        let source = match root.as_str() {
            "mujoco" => assets::collect(&Composed::new(path, text, &mut folder)?, &mut folder),
            "robot" => urdf::collect(&file, &text, &mut folder),
            _ => Err(error(format!(
                "the root element is `{root}`; a model has `mujoco` (MJCF) or `robot` (URDF)"
            ))),
        }?;
        Ok((source, folder.into_files()))
    }

    /// Makes these edits, one after the other.
    ///
    /// # Errors
    /// If an edit matches nothing or is not valid, or the document is URDF.
    pub fn edit(mut self, edits: &[Edit]) -> Result<Source, MjcfError> {
        if !edits.is_empty() && self.is_urdf() {
            return Err(MjcfError::edit("only MJCF can be edited; convert the URDF to MJCF before"));
        }
        for edit in edits {
            self.document = apply(edit, &self)?;
        }
        Ok(self)
    }

    /// Returns whether the document is URDF.
    pub fn is_urdf(&self) -> bool {
        parse(&self.document, "").is_ok_and(|document| name(document.root_element()) == "robot")
    }
}
