//! Shipped controllers and training settings: from a folder, or from the program itself.

use std::borrow::Cow;
use std::fmt;
use std::path::{Path, PathBuf};

use mishandle_controllers::{ControllerError, ControllerFile};
use mishandle_files::{limits, read_bounded};
use mishandle_tasks::Definition;

use crate::error::{MishandleError, problem};

/// The shipped controllers and settings at build time: path and content, sorted by path.
static EMBEDDED: &[(&str, &[u8])] = include!(concat!(env!("OUT_DIR"), "/embedded.rs"));

/// Folder of the shipped controllers.
pub(crate) const CONTROLLERS: &str = "controllers";

/// Folder of the shipped training settings.
pub(crate) const SETTINGS: &str = "controllers/training";

/// Extensions of the shipped controllers: our own files, and ONNX models.
pub(crate) const EXTENSIONS: [&str; 2] = ["safetensors", "onnx"];

/// Name of a task's expert, a controller without a file.
pub(crate) const EXPERT: &str = "expert";

/// Environment variable that names the folder of the shipped files.
const HOME: &str = "MISHANDLE_HOME";

/// Returns the folder of the shipped controllers and training settings.
///
/// It is `MISHANDLE_HOME` if that is set, otherwise the clone of the repository whose folder
/// `target` contains the program. `None` means that the program uses the files that it was built
/// with.
///
/// The folder does not depend on the working directory, so a command gives the same result in every
/// folder. Folders beside or above an installed program do not count: anyone may have put them
/// there.
pub fn home() -> Option<PathBuf> {
    if let Some(home) = home_from_environment() {
        return Some(home);
    }
    let program = std::env::current_exe().unwrap_or_default();
    clone_of(&program)
}

/// Returns the clone of the repository in which a program was built.
fn clone_of(program: &Path) -> Option<PathBuf> {
    let is_clone = |folder: &&Path| program.starts_with(folder.join("target")) && is_home(folder);
    program.ancestors().find(is_clone).map(PathBuf::from)
}

fn home_from_environment() -> Option<PathBuf> {
    std::env::var_os(HOME).filter(|home| !home.is_empty()).map(PathBuf::from)
}

fn is_home(folder: &Path) -> bool {
    folder.join(SETTINGS).is_dir()
}

/// Describes the source of the shipped files, for messages: `in FOLDER` or
/// `built into the program`.
pub fn home_description() -> String {
    home().map_or("built into the program".to_string(), |home| format!("in {}", home.display()))
}

/// Describes the source of the shipped controllers: `in FOLDER/controllers` or
/// `built into the program`.
pub(crate) fn controllers_description() -> String {
    let folder = home().map(|home| home.join(CONTROLLERS));
    folder.map_or("built into the program".to_string(), |folder| format!("in {}", folder.display()))
}

/// A shipped file.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum ShippedFile {
    /// A file in [`home`], or a file named by the user.
    Path(PathBuf),
    /// A file that is built into the program.
    Embedded {
        /// Path in the repository.
        name: &'static str,
        /// Content of the file.
        bytes: &'static [u8],
    },
}

impl fmt::Display for ShippedFile {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.path().display().fmt(f)
    }
}

impl ShippedFile {
    /// Returns the path. An embedded file has its path in the repository.
    pub fn path(&self) -> &Path {
        match self {
            ShippedFile::Path(path) => path,
            ShippedFile::Embedded { name, .. } => Path::new(name),
        }
    }

    /// Reads the content of the file, which must be a regular file of at most
    /// [`limits::CONTROLLER`] bytes.
    ///
    /// # Errors
    /// If the file cannot be read.
    pub fn bytes(&self) -> Result<Cow<'static, [u8]>, MishandleError> {
        match self {
            ShippedFile::Path(path) => {
                read_bounded(path, limits::CONTROLLER).map(Cow::Owned).map_err(MishandleError::file(path))
            }
            ShippedFile::Embedded { bytes, .. } => Ok(Cow::Borrowed(bytes)),
        }
    }

    /// Loads the file as a controller.
    ///
    /// # Errors
    /// If the file cannot be read or is not a controller.
    pub fn controller(&self) -> Result<ControllerFile, MishandleError> {
        match self {
            ShippedFile::Path(path) => Ok(ControllerFile::load(path)?),
            ShippedFile::Embedded { name, bytes } => Ok(ControllerFile::from_bytes(bytes)
                .map_err(|problem| ControllerError::File { problem, path: PathBuf::from(name) })?),
        }
    }

    /// Returns the shipped file with this path in the repository, if it exists.
    fn find(name: &str) -> Option<ShippedFile> {
        match home() {
            Some(home) => Some(home.join(name)).filter(|path| path.is_file()).map(ShippedFile::Path),
            None => {
                let (name, bytes) = EMBEDDED.iter().find(|(known, _)| *known == name)?;
                Some(ShippedFile::Embedded { name, bytes })
            }
        }
    }
}

/// Returns the name of the task whose controllers and settings apply: the base task of a variant,
/// otherwise the task itself.
fn base(definition: &Definition) -> &'static str {
    definition.variant_of.unwrap_or(definition.name)
}

/// Returns the path of a task's picture, if [`home`] contains it.
pub fn picture_path(task: &str) -> Option<PathBuf> {
    let path = home()?.join(mishandle_tasks::folder(task)).join("picture.png");
    path.is_file().then_some(path)
}

/// Checks that `MISHANDLE_HOME`, if it is set, contains the folder `folder`.
pub(crate) fn check_home(folder: &'static str) -> Result<(), MishandleError> {
    match home_from_environment() {
        Some(path) if !path.join(folder).is_dir() => {
            Err(problem(format!("MISHANDLE_HOME is `{}`, which has no folder `{folder}`", path.display())))
        }
        _ => Ok(()),
    }
}

/// Returns the shipped controller with the name `name` for a task, if it exists.
pub fn shipped_controller(definition: &Definition, name: &str) -> Option<ShippedFile> {
    let find =
        |extension| ShippedFile::find(&format!("{CONTROLLERS}/{}/{name}.{extension}", base(definition)));
    EXTENSIONS.into_iter().find_map(find)
}

/// Returns the shipped training settings of an algorithm for a task on a device (`cpu` or `gpu`),
/// if they exist.
pub fn shipped_settings(definition: &Definition, algorithm: &str, device: &str) -> Option<ShippedFile> {
    let suffix = if device == "cpu" { String::new() } else { format!("-{device}") };
    ShippedFile::find(&format!("{SETTINGS}/{}/{algorithm}{suffix}.toml", base(definition)))
}

/// Returns the names of a task's shipped controllers in alphabetical order, then `expert`.
pub fn shipped_controllers(definition: &Definition) -> Vec<String> {
    let folder = format!("{CONTROLLERS}/{}", base(definition));
    let paths: Vec<PathBuf> = match home() {
        Some(home) => {
            let entries = std::fs::read_dir(home.join(folder)).into_iter().flatten();
            entries.filter_map(|entry| Some(entry.ok()?.path())).collect()
        }
        None => EMBEDDED
            .iter()
            .map(|(name, _)| PathBuf::from(name))
            .filter(|path| path.parent() == Some(Path::new(&folder)))
            .collect(),
    };
    let name = |path: PathBuf| {
        let name = path.file_stem()?.to_str()?.to_string();
        // A name with a dot is a path, such as the last controller of a training run.
        let known = EXTENSIONS.iter().any(|known| path.extension().is_some_and(|found| found == *known));
        (known && !name.contains('.')).then_some(name)
    };
    let mut names: Vec<String> = paths.into_iter().filter_map(name).collect();
    names.sort();
    names.push(EXPERT.to_string());
    names
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_embedded_files_equal_the_files_of_the_repository() {
        let root = Path::new(env!("CARGO_MANIFEST_DIR"));
        assert!(EMBEDDED.is_sorted_by_key(|(name, _)| *name));
        for (name, bytes) in EMBEDDED {
            assert_eq!(std::fs::read(root.join(name)).unwrap(), *bytes, "{name}");
        }
        for task in mishandle_tasks::TASKS.iter().filter(|task| task.definition().variant_of.is_none()) {
            let name = task.definition().name;
            for file in [
                format!("controllers/{name}/ppo.safetensors"),
                format!("controllers/training/{name}/ppo.toml"),
            ] {
                assert!(EMBEDDED.iter().any(|(known, _)| *known == file), "{file}");
            }
        }
    }

    #[test]
    fn only_a_program_in_the_folder_target_of_a_clone_uses_the_files_of_the_clone() {
        let folder = tempfile::tempdir().unwrap();
        let home = folder.path();
        std::fs::create_dir_all(home.join(SETTINGS)).unwrap();
        assert_eq!(clone_of(&home.join("target/release/mishandle")).as_deref(), Some(home));
        // Installed into a folder in which someone has put a folder with this name.
        for program in
            ["mishandle", "bin/mishandle", ".cargo/bin/mishandle", "other/target/release/mishandle"]
        {
            assert_eq!(clone_of(&home.join(program)), None, "{program}");
        }
    }

    #[test]
    fn an_embedded_controller_equals_its_file() {
        let (name, bytes) = EMBEDDED.iter().find(|(name, _)| name.ends_with("/ppo.safetensors")).unwrap();
        let embedded = ShippedFile::Embedded { name, bytes };
        let path = ShippedFile::Path(Path::new(env!("CARGO_MANIFEST_DIR")).join(name));
        assert_eq!(embedded.controller().unwrap().policy.hash(), path.controller().unwrap().policy.hash());
        assert_eq!(embedded.bytes().unwrap(), path.bytes().unwrap());
    }
}
