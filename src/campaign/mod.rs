//! Campaigns: grids of plans in a folder, with a run file or a hardening for each.

use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use mishandle_files::{AtomicFolder, NewFolders, limits, read_text_bounded, write_atomically};
use mishandle_results::Hardening;
use mishandle_store::{RunWriter, StoreError};

use crate::error::MishandleError;
use crate::harden::{self, Prepared, Watch, check_plan};
use crate::plan::{GridRun, Plan, read_grid};
use crate::resolve::{ResolvedPlan, is_path, recorded_plan};
use crate::run::{Device, Opening, create_run};

/// File of a campaign's folder that contains the campaign.
const CAMPAIGN_FILE: &str = "campaign.toml";

/// Why a file does not belong to a run.
const OTHER_PLAN: &str =
    "its plan is not that of the campaign file, which was changed, or the file was replaced";

/// A run of a campaign.
#[derive(Clone, Debug, PartialEq)]
pub struct CampaignRun {
    /// Name: its values of the keys that have lists.
    pub name: String,
    /// Path of its run file, or of the folder of its hardening.
    pub path: PathBuf,
    /// Its plan in the campaign file.
    pub plan: Plan,
}

impl CampaignRun {
    fn new(folder: &Path, GridRun { name, plan }: GridRun) -> CampaignRun {
        CampaignRun { path: run_path(folder, &name, &plan), name, plan }
    }

    /// Returns whether the run is a hardening: it has a folder instead of a run file.
    pub fn is_hardening(&self) -> bool {
        self.plan.harden.is_some()
    }

    /// Opens the run file for writing and resolves its plan.
    ///
    /// # Errors
    /// If the run file is a symbolic link, cannot be opened, or has another plan than the campaign
    /// file.
    pub fn resume(&self, opening: Opening) -> Result<(RunWriter, ResolvedPlan), MishandleError> {
        self.check_link(&self.path)?;
        let mut run = RunWriter::resume(&self.path)?;
        let header = run.file().header();
        if !is_same_plan(&Plan::from_toml(&header.plan)?, &self.plan) {
            return Err(self.differs(OTHER_PLAN));
        }
        let resolved = recorded_plan(header, None)?;
        opening.apply(&mut run, &resolved)?;
        Ok((run, resolved))
    }

    /// Starts or continues the hardening of the run, or reads a finished one. Returns `None` if it
    /// was interrupted.
    ///
    /// # Errors
    /// If the folder or its plan is a symbolic link, or has another plan than the campaign file, or
    /// as for [`harden`](harden::harden).
    pub fn harden(
        &self,
        opening: Opening,
        gpu: Option<&Device>,
        watch: Watch<'_>,
    ) -> Result<Option<Hardening>, MishandleError> {
        self.check_link(&self.path)?;
        self.check_link(&harden::plan_file(&self.path))?;
        check_plan(&self.path, &self.plan).map_err(|error| match error {
            MishandleError::OtherSettings { .. } => self.differs(OTHER_PLAN),
            error => error,
        })?;
        harden::resume(&self.path, opening, gpu, watch)
    }

    /// Checks that a file of the run is not a symbolic link: the folder may be untrusted, and the
    /// link may point to a file of the user.
    fn check_link(&self, path: &Path) -> Result<(), MishandleError> {
        if path.is_symlink() { Err(self.differs("it is a symbolic link")) } else { Ok(()) }
    }

    fn differs(&self, problem: &str) -> MishandleError {
        MishandleError::CampaignMismatch {
            path: self.path.clone(),
            name: self.name.clone(),
            problem: problem.to_string(),
        }
    }
}

/// Returns whether a recorded plan is a plan of the campaign file. The record has the absolute path
/// of a controller.
fn is_same_plan(recorded: &Plan, planned: &Plan) -> bool {
    let is_same_file = is_path(&planned.controller)
        && Path::new(&recorded.controller).file_name() == Path::new(&planned.controller).file_name();
    let controller = if is_same_file { recorded.controller.clone() } else { planned.controller.clone() };
    *recorded == Plan { controller, ..planned.clone() }
}

/// Creates the folder of a campaign, with a run file or the folder of a hardening for each run.
/// `text` is the campaign file: see [`read_grid`].
///
/// No run file contains a simulation yet. All plans are resolved before the folder is created, and
/// the folder appears when it is complete.
///
/// # Errors
/// If the text or one of its plans is invalid, the folder exists, or a file cannot be written.
pub fn create_campaign(text: &str, folder: &Path) -> Result<Vec<CampaignRun>, MishandleError> {
    let runs = read_grid(text)?;
    for run in &runs {
        create(run, None)?;
    }
    let write = |source| MishandleError::Write { what: "folder", path: folder.to_path_buf(), source };
    // Removes them again if the campaign cannot be created.
    let mut folders = NewFolders::default();
    if let Some(parent) = folder.parent().filter(|parent| !parent.as_os_str().is_empty()) {
        folders.create(parent).map_err(write)?;
    }
    // Thousands of runs take a while: a process that is killed meanwhile must not leave a folder
    // that cannot be resumed.
    let created = AtomicFolder::create_new(folder).map_err(write)?;
    for run in &runs {
        create(run, Some(created.path())).map_err(|error| match error {
            // Its message is about recorded simulations, and there are none.
            MishandleError::Store(StoreError::DiskFull { .. }) => write(ErrorKind::StorageFull.into()),
            error => error,
        })?;
    }
    write_atomically(&created.path().join(CAMPAIGN_FILE), text.as_bytes()).map_err(write)?;
    created.persist().map_err(write)?;
    Ok(runs.into_iter().map(|run| CampaignRun::new(folder, run)).collect())
}

/// Returns the runs of the campaign in a folder, in the order of its file.
///
/// # Errors
/// If the folder contains no campaign, its file cannot be read, or a run file is missing.
pub fn campaign_runs(folder: &Path) -> Result<Vec<CampaignRun>, MishandleError> {
    let path = folder.join(CAMPAIGN_FILE);
    let text = no_link(&path).and_then(|()| read_text_bounded(&path, limits::PLAN));
    let text = text.map_err(|error| match error.kind() {
        ErrorKind::NotFound => MishandleError::NoCampaign { path: folder.to_path_buf(), file: path.clone() },
        _ => MishandleError::File { path: path.clone(), source: error },
    })?;
    let runs = read_grid(&text)?.into_iter().map(|run| {
        let run = CampaignRun::new(folder, run);
        match run.path.try_exists() {
            Ok(true) => Ok(run),
            _ => Err(MishandleError::NoCampaign { path: folder.to_path_buf(), file: run.path }),
        }
    });
    runs.collect()
}

/// Checks that the file of a campaign is not a symbolic link. An untrusted folder could have one to
/// any file, whose first line would be printed as a wrong plan.
fn no_link(path: &Path) -> std::io::Result<()> {
    if path.symlink_metadata()?.is_symlink() {
        let message = "expected a regular file, but it is a symbolic link; copy the file into the folder of the campaign";
        return Err(std::io::Error::new(ErrorKind::InvalidInput, message));
    }
    Ok(())
}

/// Returns the first folder `runs/campaign-N` that does not exist.
pub fn free_campaign_folder() -> PathBuf {
    let candidates = (1..).map(|number: u32| PathBuf::from("runs").join(format!("campaign-{number}")));
    candidates.into_iter().find(|path| !path.exists()).unwrap_or_default()
}

/// Checks the plan of a run, and creates its run file or hardening in `folder`.
fn create(run: &GridRun, folder: Option<&Path>) -> Result<(), MishandleError> {
    let of_run = |source| MishandleError::CampaignRun { name: run.name.clone(), source: Box::new(source) };
    let path = folder.map(|folder| run_path(folder, &run.name, &run.plan));
    if run.plan.harden.is_some() {
        let prepared = Prepared::new(&run.plan).map_err(of_run)?;
        return path.map_or(Ok(()), |path| prepared.create(&path));
    }
    let resolved = ResolvedPlan::new(&run.plan).map_err(of_run)?;
    path.map_or(Ok(()), |path| Ok(create_run(&resolved, Some(&path))?.close()?))
}

/// Returns the path of a run: its file, or the folder of its hardening. The accepted controller is
/// beside that.
fn run_path(folder: &Path, name: &str, plan: &Plan) -> PathBuf {
    let extension = if plan.harden.is_some() { "harden" } else { "sqlite" };
    folder.join(format!("{name}.{extension}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_campaign_that_cannot_be_created_leaves_no_folder() {
        let home = tempfile::tempdir().unwrap();
        let text = "target = \"toy/sphere-2d\"\nseed = [1, 2]\n[evaluate]\nepisodes = 3\n";
        let folder = home.path().join("new/campaign");
        let runs = create_campaign(text, &folder).unwrap();
        assert_eq!(runs, campaign_runs(&folder).unwrap());
        let entries = |folder: &Path| std::fs::read_dir(folder).unwrap().count();
        assert_eq!((entries(&folder), entries(&home.path().join("new"))), (3, 1));
        // The folder exists already.
        assert!(create_campaign(text, &folder).is_err());
        assert_eq!(entries(&home.path().join("new")), 1);
        // A file has the name of the folder around it.
        std::fs::write(home.path().join("file"), "").unwrap();
        assert!(create_campaign(text, &home.path().join("file/campaign")).is_err());
        assert_eq!(entries(home.path()), 2);
    }
}
