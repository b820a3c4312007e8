//! Campaigns: grids of plans in a folder, with a run file or a hardening for each.

use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use mishandle_files::{AtomicFolder, NewFolders, limits, read_text_bounded, refuse_link, write_atomically};
use mishandle_results::Hardening;
use mishandle_store::{RunFile, RunKind, RunWriter, StoreError};

use crate::error::MishandleError;
use crate::harden::{self, CheckedHardening, Watch, check_plan};
use crate::plan::{GridRun, Plan, read_grid};
use crate::resolve::{ResolvedPlan, described_target, is_path, is_target_file, recorded_plan};
use crate::run::{Device, Opening, create_run, shares_arm};
use crate::shipped::{EXPERT, Generation};

/// File of a campaign's folder that contains the campaign.
const CAMPAIGN_FILE: &str = "campaign.toml";

/// Why a file does not belong to a run.
const OTHER_PLAN: &str =
    "its plan is not that of the campaign file, which was changed, or the file was replaced";

/// Extension of the empty file that stands in the place of a run file while the controller of the
/// run is not trained.
const UNTRAINED: &str = "untrained";

/// Name for the temporary folder in which a run is made that is added to a campaign.
const ADDED: &str = "added";

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
            MishandleError::OtherSettings { .. } => self.differs(OTHER_PLAN),
            error => error,
        })?;
        harden::resume(&self.path, opening, gpu, watch)
    }

    fn differs(&self, problem: &str) -> MishandleError {
        MishandleError::CampaignMismatch {
            path: self.path.clone(),
            name: self.name.clone(),
            problem: problem.to_string(),
        }
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
    let folder = match planned.folder.is_empty() {
        true => recorded.folder.clone(),
        false => same_file(true, &recorded.folder, &planned.folder),
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
    create(text, folder, |_, _| false)
}

/// Creates the folder of a campaign as [`create_campaign`] does, but leaves out the runs whose
/// controller has the name of a [generation](Generation) that lacks it. [`untrained_runs`] returns
/// them, and [`add_trained_runs`] adds them later.
///
/// # Errors
/// Those of [`create_campaign`]; if no controller is trained.
pub fn create_trained_campaign(text: &str, folder: &Path) -> Result<Vec<CampaignRun>, MishandleError> {
    create(text, folder, is_untrained)
}

/// Returns whether a run cannot be resolved because its controller is not trained.
fn is_untrained(run: &GridRun, error: &MishandleError) -> bool {
    let lacks_controller = matches!(error, MishandleError::UnknownName { kind: "controller", .. });
    lacks_controller && Generation::of(&run.plan.controller).is_some()
}

/// Creates the folder of a campaign without the runs that `is_left_out` accepts with their error.
fn create(
    text: &str,
    folder: &Path,
    is_left_out: impl Fn(&GridRun, &MishandleError) -> bool,
) -> Result<Vec<CampaignRun>, MishandleError> {
    let (mut runs, mut untrained, mut reason) = (Vec::new(), Vec::new(), None);
    for run in read_grid(text)? {
        match check(&run) {
            Ok(()) => runs.push(run),
            Err(error) if is_left_out(&run, &error) => {
                reason.get_or_insert_with(|| of_run(&run, error));
                untrained.push(run);
            }
            Err(error) => return Err(of_run(&run, error)),
        }
    }
    if let Some(reason) = reason.filter(|_| runs.is_empty()) {
        return Err(reason);
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
        create_in(run, created.path(), folder)?;
    }
    for run in &untrained {
        write_atomically(&untrained_path(created.path(), &run.name), &[]).map_err(write)?;
    }
    write_atomically(&created.path().join(CAMPAIGN_FILE), text.as_bytes()).map_err(write)?;
    created.persist().map_err(write)?;
    Ok(runs.into_iter().map(|run| CampaignRun::new(folder, run)).collect())
}

/// Returns the runs of the campaign in a folder, in the order of its file, without the
/// [untrained](untrained_runs) ones.
///
/// # Errors
/// If the folder contains no campaign, its file cannot be read, or a run file is missing or a
/// symbolic link.
pub fn campaign_runs(folder: &Path) -> Result<Vec<CampaignRun>, MishandleError> {
    let mut runs = Vec::new();
    for run in planned_runs(folder)? {
        let run = CampaignRun::new(folder, run);
        match run.path.try_exists() {
            Ok(true) => {
                refuse_link(&run.path).map_err(|error| run.differs(&error.to_string()))?;
                runs.push(run);
            }
            _ if untrained_path(folder, &run.name).is_file() => {}
            _ => return Err(MishandleError::NoCampaign { path: folder.to_path_buf(), file: run.path }),
        }
    }
    Ok(runs)
}

/// Returns the runs that [`create_trained_campaign`] left out, in the order of the campaign file.
///
/// # Errors
/// If the folder contains no campaign, or its file cannot be read.
pub fn untrained_runs(folder: &Path) -> Result<Vec<GridRun>, MishandleError> {
    let mut runs = planned_runs(folder)?;
    runs.retain(|run| {
        !run_path(folder, &run.name, &run.plan).exists() && untrained_path(folder, &run.name).is_file()
    });
    Ok(runs)
}

/// Returns a plan as its run file would have it: without a space, it has the first one of its
/// target. Its controller need not exist.
///
/// # Errors
/// If the target is unknown.
pub fn with_space(plan: &Plan) -> Result<Plan, MishandleError> {
    let mut plan = plan.clone();
    if plan.space.is_empty() {
        let target = described_target(&Plan { controller: EXPERT.to_string(), ..plan.clone() })?;
        plan.space = target.spaces.first().map_or_else(String::new, |space| space.name().to_string());
    }
    Ok(plan)
}

/// Adds the run files of the untrained runs whose controllers are trained by now.
///
/// # Errors
/// If the folder contains no campaign, a plan is invalid for another reason, or a file cannot be
/// written.
pub fn add_trained_runs(folder: &Path) -> Result<(), MishandleError> {
    for run in planned_runs(folder)? {
        let marker = untrained_path(folder, &run.name);
        let path = run_path(folder, &run.name, &run.plan);
        let write = |source| MishandleError::Write { what: "run", path: path.clone(), source };
        if !marker.is_file() {
            continue;
        }
        if path.exists() {
            // An earlier call was killed before it removed the marker.
            std::fs::remove_file(&marker).map_err(write)?;
            continue;
        }
        match check(&run) {
            Ok(()) => {
                // A kill leaves no part of the run under its name.
                let parts = AtomicFolder::create_new(&folder.join(ADDED)).map_err(write)?;
                create_in(&run, parts.path(), folder)?;
                let made = run_path(parts.path(), &run.name, &run.plan);
                std::fs::rename(made, &path).map_err(write)?;
                std::fs::remove_file(&marker).map_err(write)?;
            }
            Err(error) if is_untrained(&run, &error) => {}
            Err(error) => return Err(of_run(&run, error)),
        }
    }
    Ok(())
}

/// Returns the runs of the campaign file in a folder.
fn planned_runs(folder: &Path) -> Result<Vec<GridRun>, MishandleError> {
    let path = folder.join(CAMPAIGN_FILE);
    let text = refuse_link(&path).and_then(|()| read_text_bounded(&path, limits::PLAN));
    let text = text.map_err(|error| match error.kind() {
        ErrorKind::NotFound => MishandleError::NoCampaign { path: folder.to_path_buf(), file: path.clone() },
        _ => MishandleError::File { path: path.clone(), source: error },
    })?;
    read_grid(&text)
}

/// Returns the first folder `runs/campaign-N` that does not exist.
pub fn free_campaign_folder() -> PathBuf {
    let candidates = (1..).map(|number: u32| PathBuf::from("runs").join(format!("campaign-{number}")));
    candidates.into_iter().find(|path| !path.exists()).unwrap_or_default()
}

/// Checks the plan of a run.
fn check(run: &GridRun) -> Result<(), MishandleError> {
    if run.plan.compare.is_some() {
        let (what, value) = ("the table [compare] of a campaign", "given".to_string());
        let expected = "left out, because each run of a campaign ends by its own rule; ask mishandle compare";
        return Err(MishandleError::InvalidValue { what, value, expected });
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
    MishandleError::CampaignRun { name: run.name.clone(), source: Box::new(error) }
}

/// Returns the path of a run: its file, or the folder of its hardening. The accepted controller is
/// beside that.
fn run_path(folder: &Path, name: &str, plan: &Plan) -> PathBuf {
    let extension = if plan.harden.is_some() { harden::FOLDER_EXTENSION } else { "sqlite" };
    folder.join(format!("{name}.{extension}"))
}

fn untrained_path(folder: &Path, name: &str) -> PathBuf {
    folder.join(format!("{name}.{UNTRAINED}"))
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

    #[test]
    fn only_a_name_of_a_generation_is_untrained() {
        let left_out = |controller: &str| {
            let [run] =
                &read_grid(&format!("target = 'ball-balancing'\ncontroller = '{controller}'\n[evaluate]\n"))
                    .unwrap()[..]
            else {
                panic!("one run")
            };
            let unknown =
                |kind| MishandleError::UnknownName { kind, name: controller.to_string(), known: Vec::new() };
            assert!(!is_untrained(run, &unknown("space")));
            is_untrained(run, &unknown("controller"))
        };
        assert!(left_out("ppo-2") && left_out("ddpg"));
        assert!(!left_out("ppo-9") && !left_out("poo-2") && !left_out("expert"));
    }
}
