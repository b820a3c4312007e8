//! The folder of a hardening: its plan, the controller before, and the runs of each phase.

use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use mishandle_files::{
    AtomicFolder, NewFolders, limits, read_text_bounded, refuse_link, refuse_links_in, write_atomically,
};
use mishandle_results::{Answer, Hardening, Key, Remedy, Versioned};
use mishandle_store::RunFile;
use mishandle_text::path_text;

use crate::error::{MishandleError, exists, problem};
use crate::plan::Plan;
use crate::resolve::ResolvedPlan;
use crate::run::{Engine, Opening, Probed, Progress, ask, continue_run};

use super::controller_files::ControllerFiles;
use super::{EXTENSION, HardenProgress, HardenUnit, ONNX_EXTENSION, Watch, plan_file};

/// Plan of the hardening.
pub(super) const PLAN: &str = "harden.toml";

/// Result of a finished hardening.
pub(super) const RESULT: &str = "result.json";

/// Folder of the final comparison.
const FINAL: &str = "final";

/// Stem of the name of the controller before.
const BEFORE: &str = "before";

/// Stem of the name of the controller that a round trains.
const CANDIDATE: &str = "controller";

/// Training settings of the controller, or of the plan's file.
const SETTINGS: &str = "settings.toml";

/// The folder of a hardening.
pub(super) struct Folder {
    /// Its path as the user named it, for results.
    pub given: PathBuf,
    /// Its path for the files in it, absolute while phases run: their plans and settings name files
    /// of the folder.
    pub path: PathBuf,
    /// Extension of the files of its controllers.
    extension: &'static str,
    opening: Opening,
}

impl Folder {
    /// Returns the folder at a path, unchecked.
    pub fn at(path: &Path) -> Folder {
        let is_onnx = path.join(BEFORE).with_extension(ONNX_EXTENSION).exists();
        Folder::with_extension(path, if is_onnx { ONNX_EXTENSION } else { EXTENSION })
    }

    fn with_extension(path: &Path, extension: &'static str) -> Folder {
        let [given, path] = [path, path].map(Path::to_path_buf);
        Folder { given, path, extension, opening: Opening::default() }
    }

    /// Creates the folder of a plan with all that the hardening reads: it then depends on no other
    /// file but the files of a trainer. `settings` are for training by this program. The folder
    /// appears when it is complete, so a process that is killed leaves none without a plan.
    ///
    /// # Errors
    /// If it exists, or a file cannot be written.
    pub fn create(
        path: &Path,
        plan: &Plan,
        before: &ControllerFiles,
        settings: Option<&str>,
    ) -> Result<(), MishandleError> {
        if path.exists() {
            return Err(exists(path, Key::OUT));
        }
        let write = MishandleError::write("folder", path);
        // Removes them again if the hardening cannot be created.
        let mut folders = NewFolders::default();
        if let Some(parent) = path.parent().filter(|parent| !parent.as_os_str().is_empty()) {
            folders.create(parent).map_err(write)?;
        }
        let created = AtomicFolder::create_new(path).map_err(write)?;
        let folder = Folder::with_extension(created.path(), before.extension);
        before.write(&folder, &folder.before())?;
        if let Some(settings) = settings {
            folder.write(&folder.settings(), settings.as_bytes())?;
        }
        folder.write(&folder.path.join(PLAN), plan.to_toml().as_bytes())?;
        created.persist().map_err(write)
    }

    /// Opens the folder of a hardening, and reads its plan. The folder may be untrusted.
    ///
    /// # Errors
    /// If it contains no plan, or symbolic links.
    pub fn open(path: &Path) -> Result<(Folder, Plan), MishandleError> {
        let file = plan_file(path);
        let text = refuse_link(&file).and_then(|()| read_text_bounded(&file, limits::PLAN));
        let text = text.map_err(|source| MishandleError::File { path: file, source })?;
        let plan = Plan::from_toml(&text)?;
        refuse_links_in(path).map_err(MishandleError::file(path))?;
        Ok((Folder::at(path), plan))
    }

    /// Opens the folder of a hardening to run its phases.
    ///
    /// # Errors
    /// Those of [`open`](Self::open).
    pub fn resume(path: &Path, opening: Opening) -> Result<(Folder, Plan), MishandleError> {
        let (folder, plan) = Folder::open(path)?;
        let absolute = std::path::absolute(path).map_err(MishandleError::file(&folder.given))?;
        Ok((Folder { path: absolute, opening, ..folder }, plan))
    }

    /// Returns the result of a finished hardening, with the present paths of the folder and of the
    /// accepted controller.
    ///
    /// # Errors
    /// If the file of the result cannot be read.
    pub fn result(&self) -> Result<Option<Hardening>, MishandleError> {
        let path = self.path.join(RESULT);
        if !path.exists() {
            return Ok(None);
        }
        let text = read_text_bounded(&path, limits::RESULT).map_err(MishandleError::file(&path))?;
        let found: Hardening = serde_json::from_str(&text)
            .map_err(|error| {
                let text = format!("{} is not the result of a hardening of this version: {error}", path.display());
                let again = "delete the file and resume the hardening, which makes it again from the recorded simulations";
                problem(text).with(Remedy::Advice(again)).with(Remedy::Another(Key::OUT))
            })?;
        let after = found.after.is_some().then(|| path_text(&self.accepted()));
        Ok(Some(Hardening { folder: path_text(&self.given), after, ..found }))
    }

    /// Writes the result, which finishes the hardening.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn finish(&self, result: &Hardening) -> Result<(), MishandleError> {
        let path = self.path.join(RESULT);
        let json = serde_json::to_vec_pretty(&Versioned::new(result));
        let json = json.map_err(|error| MishandleError::File { path: path.clone(), source: error.into() })?;
        self.write(&path, &json)
    }

    pub fn before(&self) -> PathBuf {
        self.path.join(BEFORE).with_extension(self.extension)
    }

    /// Returns the file of the accepted controller.
    pub fn accepted(&self) -> PathBuf {
        self.given.with_extension(self.extension)
    }

    pub fn settings(&self) -> PathBuf {
        self.path.join(SETTINGS)
    }

    /// Returns the path of a file of a round.
    pub fn of_round(&self, round: u32, name: &str) -> PathBuf {
        self.path.join(format!("round-{round}")).join(name)
    }

    /// Removes a file if it exists.
    ///
    /// # Errors
    /// If it cannot be removed.
    pub fn remove(&self, path: &Path) -> Result<(), MishandleError> {
        match fs::remove_file(path) {
            Err(source) if source.kind() != ErrorKind::NotFound => {
                Err(MishandleError::Write { what: "file", path: path.to_path_buf(), source })
            }
            _ => Ok(()),
        }
    }

    /// Returns the path of a file of the final comparison.
    pub fn of_final(&self, name: &str) -> PathBuf {
        self.path.join(FINAL).join(name)
    }

    /// Returns the path of the controller that a round trains.
    pub fn candidate(&self, round: u32) -> PathBuf {
        self.of_round(round, CANDIDATE).with_extension(self.extension)
    }

    /// Writes a file, with its folder.
    pub fn write(&self, path: &Path, bytes: &[u8]) -> Result<(), MishandleError> {
        let folder = path.parent().unwrap_or(&self.path);
        let write = |what| move |source| MishandleError::Write { what, path: path.to_path_buf(), source };
        fs::create_dir_all(folder).map_err(write("folder"))?;
        write_atomically(path, bytes).map_err(write("file"))
    }

    /// Asks a question, or continues it. Returns `None` if it was interrupted.
    ///
    /// # Errors
    /// If a simulation cannot be run or stored, or the file is of another plan.
    pub fn ask(
        &self,
        plan: &Plan,
        path: &Path,
        phase: &str,
        watch: Watch<'_>,
    ) -> Result<Option<Asked>, MishandleError> {
        let resolved = ResolvedPlan::new(plan)?;
        let mut run = continue_run(&resolved, path, Probed::Requirement)?;
        self.opening.apply(&mut run, &resolved)?;
        let mut watch = |progress: &Progress| {
            watch(&HardenProgress {
                phase: phase.to_string(),
                done: progress.simulations,
                all: progress.max_simulations,
                unit: HardenUnit::Simulations,
            })
        };
        let answer = ask(&resolved, run, Engine::Direct, &mut watch)?;
        let is_complete = answer.is_complete();
        Ok(is_complete.then(|| Asked { answer, path: path.to_path_buf() }))
    }

    /// Returns the run files in the folder, sorted.
    pub fn run_files(&self) -> Result<Vec<PathBuf>, MishandleError> {
        let mut runs = Vec::new();
        list(&self.path, &mut runs).map_err(MishandleError::file(&self.path))?;
        runs.sort();
        Ok(runs)
    }

    /// Returns the number of simulations of all runs in the folder.
    pub fn simulations(&self) -> Result<u64, MishandleError> {
        let mut all = 0;
        for path in self.run_files()? {
            all += RunFile::open(&path)?.counts()?.simulations;
        }
        Ok(all)
    }
}

/// Adds the run files in a folder and its folders.
fn list(folder: &Path, runs: &mut Vec<PathBuf>) -> std::io::Result<()> {
    for entry in fs::read_dir(folder)? {
        let (path, kind) = entry.and_then(|entry| Ok((entry.path(), entry.file_type()?)))?;
        if kind.is_dir() {
            list(&path, runs)?;
        } else if path.extension().is_some_and(|extension| extension == "sqlite") {
            runs.push(path);
        }
    }
    Ok(())
}

/// A question of a hardening, and its answer.
pub(super) struct Asked {
    pub answer: Answer,
    pub path: PathBuf,
}

impl Asked {
    /// Opens its run file.
    pub fn run(&self) -> Result<RunFile, MishandleError> {
        Ok(RunFile::open(&self.path)?)
    }
}
