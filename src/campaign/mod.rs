//! Campaigns: grids of plans in a folder, with a run file or a hardening for each.

use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use mishandle_files::{AtomicFolder, NewFolders, limits, read_text_bounded, refuse_link, write_atomically};
use mishandle_results::{Command, Hardening, Remedy};
use mishandle_store::{RunFile, RunKind, RunWriter, StoreError};

use crate::error::{Compared, MishandleError, RunError, invalid, problem};
use crate::harden::{self, CheckedHardening, Watch, check_plan};
use crate::plan::{GridRun, Plan, read_grid};
use crate::resolve::{ResolvedPlan, is_path, is_target_file, recorded_plan};
use crate::run::{Device, Opening, create_run, shares_arm};

/// File of a campaign's folder that contains the campaign.
pub const CAMPAIGN_FILE: &str = "campaign.toml";

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
    /// If the run file cannot be opened, or has another plan than the campaign file.
    pub fn resume(&self, opening: Opening) -> Result<(RunWriter, ResolvedPlan), MishandleError> {
        let mut run = RunWriter::resume(&self.path)?;
        let header = run.file().header();
        if !is_same_plan(&Plan::from_toml(&header.plan)?, &self.plan) {
            return Err(self.differs(OTHER_PLAN));
        }
        let resolved = recorded_plan(header, None)?;
        let first = resolved.target.spaces.first().map_or("", |space| space.name());
        if self.plan.space.is_empty() && resolved.plan.space != first {
            return Err(self.differs(OTHER_PLAN));
        }
        opening.apply(&mut run, &resolved)?;
        Ok((run, resolved))
    }

    /// Returns the run of the campaign whose control arm is that of this run: it is simulated once.
    /// `resolved` is the plan of this run, and `runs` are those of the campaign.
    ///
    /// A run that cannot be read, or is written at the moment, has none.
    pub fn known_arm(&self, resolved: &ResolvedPlan, runs: &[CampaignRun]) -> Option<RunFile> {
        if resolved.plan.kind() != RunKind::Evaluate {
            return None;
        }
        let others = runs.iter().filter(|other| other.path != self.path && !other.is_hardening());
        let open = |other: &CampaignRun| RunFile::open_unchecked(&other.path).ok();
        others.filter_map(open).find(|other| shares_arm(resolved, other).unwrap_or(false))
    }

    /// Starts or continues the hardening of the run, or reads a finished one. Returns `None` if it
    /// was interrupted.
    ///
    /// # Errors
    /// If the folder has another plan than the campaign file, or as for [`harden`](harden::harden).
    pub fn harden(
        &self,
        opening: Opening,
        gpu: Option<&Device>,
        watch: Watch<'_>,
    ) -> Result<Option<Hardening>, MishandleError> {
        check_plan(&self.path, &self.plan).map_err(|error| match error {
            MishandleError::Run(RunError::Differs { whose: Compared::Settings, .. }) => {
                self.differs(OTHER_PLAN)
            }
            error => error,
        })?;
        harden::resume(&self.path, opening, gpu, watch)
    }

    fn differs(&self, difference: &str) -> MishandleError {
        problem(format!("{} does not belong to the run `{}`: {difference}", self.path.display(), self.name))
    }
}

/// Returns whether a recorded plan is a plan of the campaign file. The record has the absolute
/// paths of a controller and a target file, and the name of the space.
fn is_same_plan(recorded: &Plan, planned: &Plan) -> bool {
    let same_file = |is_file: bool, recorded: &String, planned: &String| {
        let is_same = is_file && Path::new(recorded).file_name() == Path::new(planned).file_name();
        if is_same { recorded.clone() } else { planned.clone() }
    };
    let controller = same_file(is_path(&planned.controller), &recorded.controller, &planned.controller);
    let target = same_file(is_target_file(&planned.target), &recorded.target, &planned.target);
    // Without a name, it is the first space of the target.
    let space = if planned.space.is_empty() { &recorded.space } else { &planned.space }.clone();
    let folder = if planned.folder.is_empty() {
        recorded.folder.clone()
    } else {
        same_file(true, &recorded.folder, &planned.folder)
    };
    *recorded == Plan { controller, target, folder, space, ..planned.clone() }
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
        check(run).map_err(|error| of_run(run, error))?;
    }
    let write = MishandleError::write("folder", folder);
    // Removes them again if the campaign cannot be created.
    let mut folders = NewFolders::default();
    if let Some(parent) = folder.parent().filter(|parent| !parent.as_os_str().is_empty()) {
        folders.create(parent).map_err(write)?;
    }
    // Thousands of runs take a while: a process that is killed meanwhile must not leave a folder
    // that cannot be resumed.
    let created = AtomicFolder::create_new(folder).map_err(write)?;
    for run in &runs {
        create_in(run, created.path(), folder)?;
    }
    write_atomically(&created.path().join(CAMPAIGN_FILE), text.as_bytes()).map_err(write)?;
    created.persist().map_err(write)?;
    Ok(runs.into_iter().map(|run| CampaignRun::new(folder, run)).collect())
}

/// Returns the runs of the campaign in a folder, in the order of its file.
///
/// # Errors
/// If the folder contains no campaign, its file cannot be read, or a run file is missing or a
/// symbolic link.
pub fn campaign_runs(folder: &Path) -> Result<Vec<CampaignRun>, MishandleError> {
    let run = |run| {
        let run = CampaignRun::new(folder, run);
        match run.path.try_exists() {
            Ok(true) => refuse_link(&run.path).map_err(|error| run.differs(&error.to_string())).map(|()| run),
            _ => Err(no_campaign(folder, &run.path)),
        }
    };
    planned_runs(folder)?.into_iter().map(run).collect()
}

/// Returns the runs of the campaign file in a folder.
fn planned_runs(folder: &Path) -> Result<Vec<GridRun>, MishandleError> {
    let path = folder.join(CAMPAIGN_FILE);
    let text = refuse_link(&path).and_then(|()| read_text_bounded(&path, limits::PLAN));
    let text = text.map_err(|error| match error.kind() {
        ErrorKind::NotFound => no_campaign(folder, &path),
        _ => MishandleError::File { path: path.clone(), source: error },
    })?;
    read_grid(&text)
}

fn no_campaign(folder: &Path, missing: &Path) -> MishandleError {
    let (folder, missing) = (folder.display(), missing.display());
    problem(format!("{folder} is not the folder of a campaign: there is no file {missing}"))
}

/// Returns the first folder `runs/campaign-N` that does not exist.
pub fn free_campaign_folder() -> PathBuf {
    let candidates = (1..).map(|number: u32| PathBuf::from("runs").join(format!("campaign-{number}")));
    candidates.into_iter().find(|path| !path.exists()).unwrap_or_default()
}

/// Checks the plan of a run.
fn check(run: &GridRun) -> Result<(), MishandleError> {
    if run.plan.compare.is_some() {
        let what = "the table [compare] of a campaign";
        let value = "given".to_string();
        let expected = "left out, because each run of a campaign ends by its own rule";
        return Err(invalid(what, value, expected).with(Remedy::Run(Command::Compare(None))));
    }
    match run.plan.harden {
        Some(_) => CheckedHardening::new(&run.plan).map(drop),
        None => ResolvedPlan::new(&run.plan).map(drop),
    }
}

/// Creates the run file or hardening of a run in the folder `parts`, which becomes `folder`.
fn create_in(run: &GridRun, parts: &Path, folder: &Path) -> Result<(), MishandleError> {
    let path = run_path(parts, &run.name, &run.plan);
    let created = if run.plan.harden.is_some() {
        CheckedHardening::new(&run.plan).map_err(|error| of_run(run, error))?.create(&path)
    } else {
        let resolved = ResolvedPlan::new(&run.plan).map_err(|error| of_run(run, error))?;
        create_run(&resolved, Some(&path)).and_then(|file| Ok(file.close()?))
    };
    created.map_err(|error| match error {
        // Its message is about recorded simulations, and there are none.
        MishandleError::Store(StoreError::DiskFull { .. }) => {
            let source = ErrorKind::StorageFull.into();
            MishandleError::Write { what: "folder", path: folder.to_path_buf(), source }
        }
        error => error,
    })
}

fn of_run(run: &GridRun, error: MishandleError) -> MishandleError {
    error.of(format!("run `{}` of the campaign", run.name))
}

/// Returns the path of a run: its file, or the folder of its hardening. The accepted controller is
/// beside that.
fn run_path(folder: &Path, name: &str, plan: &Plan) -> PathBuf {
    let extension = if plan.harden.is_some() { harden::FOLDER_EXTENSION } else { "sqlite" };
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
