//! Where shipped controllers and training settings come from: a folder, or the program itself.

use std::borrow::Cow;
use std::fmt;
use std::path::{Path, PathBuf};

use mishandle_controllers::{ControllerError, ControllerFile};
use mishandle_tasks::Definition;

use crate::target::{EXPERT, is_path};
use crate::{MishandleError, task};

/// The files that were in `controllers/` and `experiments/training/` when the program was built, with their content.
static EMBEDDED: &[(&str, &[u8])] = include!(concat!(env!("OUT_DIR"), "/embedded.rs"));

/// Environment variable with the folder to read shipped files from.
const HOME: &str = "MISHANDLE_HOME";

/// The folder that shipped controllers and training settings are read from: `MISHANDLE_HOME` if it is set, otherwise the
/// clone of the repository that contains the program. `None` if there is no such clone: then the files that the program
/// was built with are used.
///
/// The working directory does not count, so the same command gives the same result everywhere.
pub fn home() -> Option<PathBuf> {
    if let Some(home) = chosen_home() {
        return Some(home);
    }
    let program = std::env::current_exe().unwrap_or_default();
    program.ancestors().find(|folder| is_home(folder)).map(PathBuf::from)
}

fn chosen_home() -> Option<PathBuf> {
    std::env::var_os(HOME).filter(|home| !home.is_empty()).map(PathBuf::from)
}

fn is_home(folder: &Path) -> bool {
    folder.join("controllers").is_dir() && folder.join("experiments/training").is_dir()
}

/// Says in words where shipped files are read from.
pub fn home_in_words() -> String {
    home().map_or("built into the program".to_string(), |home| format!("in {}", home.display()))
}

/// A shipped file.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum ShippedFile {
    /// A file of [`home`], or one that the user named.
    Path(PathBuf),
    /// A file that is built into the program.
    Embedded {
        /// Its path in the repository.
        name: &'static str,
        /// Its content.
        bytes: &'static [u8],
    },
}

impl fmt::Display for ShippedFile {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.path().display().fmt(f)
    }
}

impl ShippedFile {
    /// Its path: of an embedded file, the path in the repository.
    pub fn path(&self) -> &Path {
        match self {
            ShippedFile::Path(path) => path,
            ShippedFile::Embedded { name, .. } => Path::new(name),
        }
    }

    /// Reads its content.
    ///
    /// # Errors
    /// If the file cannot be read.
    pub fn bytes(&self) -> Result<Cow<'static, [u8]>, MishandleError> {
        match self {
            ShippedFile::Path(path) => std::fs::read(path)
                .map(Cow::Owned)
                .map_err(|source| MishandleError::File { path: path.clone(), source }),
            ShippedFile::Embedded { bytes, .. } => Ok(Cow::Borrowed(bytes)),
        }
    }

    /// Reads it as a controller.
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

    /// The shipped file with this path in the repository, if it exists.
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

/// The task whose controllers and settings a task takes: of a variant, the task that it varies.
fn base(definition: &Definition) -> &'static str {
    definition.variant_of.unwrap_or(definition.name)
}

/// Path of a task's picture, if the repository is there.
pub fn picture_path(task: &str) -> Option<PathBuf> {
    let path = home()?.join("docs").join("tasks").join(format!("{task}.png"));
    path.is_file().then_some(path)
}

/// Checks that `MISHANDLE_HOME`, if it is set, has the folder `wanted`.
pub(crate) fn check_home(wanted: &'static str) -> Result<(), MishandleError> {
    match chosen_home() {
        Some(path) if !path.join(wanted).is_dir() => Err(MishandleError::Home { path, wanted }),
        _ => Ok(()),
    }
}

/// The shipped controller of that name for a task, if there is one.
pub fn shipped_controller(definition: &Definition, name: &str) -> Option<ShippedFile> {
    ShippedFile::find(&format!("controllers/{}/{name}.safetensors", base(definition)))
}

/// The file of a task's controller: a path, or the name of a shipped one.
pub(crate) fn controller_of(definition: &Definition, name: &str) -> Result<ShippedFile, MishandleError> {
    if is_path(name) {
        return Ok(ShippedFile::Path(name.into()));
    }
    if let Some(file) = shipped_controller(definition, name) {
        return Ok(file);
    }
    check_home("controllers")?;
    Err(MishandleError::Name {
        kind: "controller",
        name: name.to_string(),
        known: shipped_controllers(definition),
    })
}

/// The file of a controller: a path, or `TASK/NAME` for a shipped one.
///
/// # Errors
/// If there is no such file, nor such a shipped controller.
pub fn find_controller(name: &str) -> Result<ShippedFile, MishandleError> {
    let path = Path::new(name);
    let shipped = name.split_once('/').filter(|_| path.extension().is_none() && !path.exists());
    let Some((task_name, name)) = shipped else {
        return if is_path(name) { Ok(ShippedFile::Path(path.into())) } else { Err(no_controller(name)) };
    };
    let definition = task(task_name)?.definition();
    if let Some(file) = shipped_controller(definition, name) {
        return Ok(file);
    }
    check_home("controllers")?;
    if name == EXPERT {
        return Err(MishandleError::Value {
            what: "the controller",
            value: name.to_string(),
            wanted: "one that was trained; the expert is a program of the task's and has no file",
        });
    }
    let known = shipped_controllers(definition).into_iter().filter(|known| known != EXPERT).collect();
    Err(MishandleError::Name { kind: "controller file", name: name.to_string(), known })
}

fn no_controller(name: &str) -> MishandleError {
    let wanted = "a file, as ./FILE, or TASK/NAME for a shipped one, as point-reaching/ppo";
    MishandleError::Value { what: "the controller", value: name.to_string(), wanted }
}

/// What a controller is called: its name, or that of its file without folder and extension.
pub fn controller_name(controller: &str) -> String {
    Path::new(controller).file_stem().unwrap_or_default().to_string_lossy().into_owned()
}

/// The shipped training settings of an algorithm for a task, if there are any.
pub fn shipped_settings(definition: &Definition, algorithm: &str) -> Option<ShippedFile> {
    ShippedFile::find(&format!("experiments/training/{}/{algorithm}.toml", base(definition)))
}

/// Names of the shipped controllers of a task, in alphabetical order; the expert comes last.
pub fn shipped_controllers(definition: &Definition) -> Vec<String> {
    let folder = format!("controllers/{}", base(definition));
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
        // A name with a point would be taken for a path, as that of a training's last controller.
        (path.extension()? == "safetensors" && !name.contains('.')).then_some(name)
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
    fn the_embedded_files_are_those_of_the_repository() {
        let root = Path::new(env!("CARGO_MANIFEST_DIR"));
        assert!(EMBEDDED.is_sorted_by_key(|(name, _)| *name));
        for (name, bytes) in EMBEDDED {
            assert_eq!(std::fs::read(root.join(name)).unwrap(), *bytes, "{name}");
        }
        for task in mishandle_tasks::TASKS.iter().filter(|task| task.definition().variant_of.is_none()) {
            let name = task.definition().name;
            for file in [
                format!("controllers/{name}/ppo.safetensors"),
                format!("experiments/training/{name}/ppo.toml"),
            ] {
                assert!(EMBEDDED.iter().any(|(known, _)| *known == file), "{file}");
            }
        }
    }

    #[test]
    fn an_embedded_controller_is_the_same_as_its_file() {
        let (name, bytes) = EMBEDDED.iter().find(|(name, _)| name.ends_with("/ppo.safetensors")).unwrap();
        let embedded = ShippedFile::Embedded { name, bytes };
        let path = ShippedFile::Path(Path::new(env!("CARGO_MANIFEST_DIR")).join(name));
        assert_eq!(embedded.controller().unwrap().policy.hash(), path.controller().unwrap().policy.hash());
        assert_eq!(embedded.bytes().unwrap(), path.bytes().unwrap());
    }
}
