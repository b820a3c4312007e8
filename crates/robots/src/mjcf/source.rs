use std::borrow::Cow;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use mishandle_world::{Opened, WorldError, files_of_untrusted};

use crate::mjcf::edit::{Edit, apply};
use crate::mjcf::folder::Folder;
use crate::mjcf::tree::{lenient, root};
use crate::mjcf::{MjcfError, urdf};

/// A model as text, with the files that it refers to.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Source {
    /// MJCF or URDF.
    pub document: String,
    /// The files that MuJoCo opens, by their paths relative to the folder of the document, or
    /// absolute.
    pub assets: BTreeMap<String, Vec<u8>>,
}

impl Source {
    /// Reads a model with the files that MuJoCo opens to compile it. With `allow_outside`, they may
    /// be outside the folder of the file.
    ///
    /// # Errors
    /// If a file cannot be read, is too large, or is outside the folder, or if MuJoCo rejects the
    /// model.
    ///
    /// # Example
    /// ```
    /// use mishandle_robots::mjcf::Source;
    /// # let folder = tempfile::tempdir()?;
    /// let path = folder.path().join("robot.xml");
    /// std::fs::write(&path, "<mujoco><include file='arm.xml'/></mujoco>")?;
    /// std::fs::write(folder.path().join("arm.xml"), "<mujoco><worldbody/></mujoco>")?;
    /// let source = Source::read(&path, false)?;
    /// assert_eq!(source.document, "<mujoco><include file='arm.xml'/></mujoco>");
    /// assert_eq!(source.assets["arm.xml"], b"<mujoco><worldbody/></mujoco>");
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn read(path: &Path, allow_outside: bool) -> Result<Source, MjcfError> {
        let (mut source, mut files) = Source::main(path, allow_outside)?;
        source.open(Opened::All, &mut files).map_err(|error| files.error(&error))?;
        Ok(source)
    }

    /// Reads the main file of a model, and the meshes of URDF.
    pub(crate) fn main(path: &Path, allow_outside: bool) -> Result<(Source, ModelFiles), MjcfError> {
        let file = path.display().to_string();
        let error = |message: String| MjcfError::new(&file, None, message);
        let mut folder = Folder::of(path, allow_outside).map_err(error)?;
        let document = decoded(&folder.read(path).map_err(error)?).into_owned();
        let source = if root(&lenient(&document)).eq_ignore_ascii_case("robot") {
            urdf::collect(&file, &document, &mut folder)?
        } else {
            Source { document, assets: BTreeMap::new() }
        };
        Ok((source, ModelFiles { main: file, folder }))
    }

    /// Adds the files that MuJoCo opens, except for URDF, whose meshes are known by other names.
    pub(crate) fn open(&mut self, which: Opened, files: &mut ModelFiles) -> Result<(), WorldError> {
        if self.is_urdf() {
            return Ok(());
        }
        let known = &self.assets;
        let mut open = |name: &str| known.get(name).cloned().or_else(|| files.folder.open(name));
        let assets = files_of_untrusted(&self.document, which, &mut open)?;
        self.assets.extend(assets);
        Ok(())
    }

    /// Makes these edits, one after the other. Only documents that MuJoCo has opened for this one,
    /// and that it includes, are edited beside it.
    ///
    /// # Errors
    /// If an edit matches nothing or is not valid, or the document is URDF.
    pub fn edit(mut self, edits: &[Edit]) -> Result<Source, MjcfError> {
        if !edits.is_empty() && self.is_urdf() {
            return Err(MjcfError::edit("only MJCF can be edited; convert the URDF to MJCF before"));
        }
        for edit in edits {
            apply(edit, &mut self)?;
        }
        Ok(self)
    }

    /// Returns whether the document is URDF.
    pub fn is_urdf(&self) -> bool {
        root(&lenient(&self.document)).eq_ignore_ascii_case("robot")
    }
}

/// The files of a model on the disk.
#[derive(Debug)]
pub(crate) struct ModelFiles {
    main: String,
    folder: Folder,
}

impl ModelFiles {
    /// Returns the error of reading the model.
    pub(crate) fn error(&self, error: &WorldError) -> MjcfError {
        MjcfError::new(&self.main, None, self.message(error))
    }

    /// Returns why the model cannot be used: the refusal of a file that MuJoCo could not open, or
    /// what MuJoCo says.
    pub(crate) fn message(&self, error: &WorldError) -> String {
        let message = error.to_string();
        let Some((_, unopened)) = message.split_once("opening file '") else { return message };
        // MuJoCo itself refuses some paths before it asks for them.
        let of_path = || self.folder.find(unopened.split('\'').next().unwrap_or_default()).err();
        self.folder.refusal().map(str::to_string).or_else(of_path).unwrap_or(message)
    }

    /// Returns the files that were read, the main file first.
    pub(crate) fn into_files(self) -> Vec<PathBuf> {
        self.folder.into_files()
    }
}

/// Returns the text of a file: UTF-8 or, if it is none, Latin-1. MuJoCo reads bytes.
pub(crate) fn decoded(bytes: &[u8]) -> Cow<'_, str> {
    match std::str::from_utf8(bytes) {
        Ok(text) => text.into(),
        Err(_) => bytes.iter().map(|byte| char::from(*byte)).collect::<String>().into(),
    }
}
