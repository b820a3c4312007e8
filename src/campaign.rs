use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use mishandle_files::{AtomicFile, limits, read_text_bounded};
use mishandle_store::RunWriter;

use crate::target::is_path;
use crate::{GridRun, MishandleError, Plan, ResolvedPlan, create_run, read_grid, recorded_plan};

/// File of a campaign's folder that contains the campaign. It is written last, so a folder with it is complete.
const CAMPAIGN_FILE: &str = "campaign.toml";

/// A run of a campaign.
#[derive(Clone, Debug, PartialEq)]
pub struct CampaignRun {
    /// Name: its values of the keys that have lists.
    pub name: String,
    /// Path of its run file.
    pub path: PathBuf,
    /// Its plan in the campaign file.
    pub plan: Plan,
}

impl CampaignRun {
    /// Opens the run file for writing and resolves its plan.
    ///
    /// # Errors
    /// If the run file is a symbolic link, cannot be opened, or has another plan than the campaign file.
    pub fn resume(&self) -> Result<(RunWriter, ResolvedPlan), MishandleError> {
        let differs = |problem: &str| MishandleError::CampaignMismatch {
            path: self.path.clone(),
            name: self.name.clone(),
            problem: problem.to_string(),
        };
        // The folder may come from a stranger, and the link may point to a run file of the user.
        if self.path.is_symlink() {
            return Err(differs("it is a symbolic link"));
        }
        let run = RunWriter::resume(&self.path)?;
        let header = run.file().header();
        if !is_same_plan(&Plan::from_toml(&header.plan)?, &self.plan) {
            return Err(differs(
                "its plan is not that of the campaign file, which was changed, or the run file was replaced",
            ));
        }
        let resolved = recorded_plan(header, None)?;
        Ok((run, resolved))
    }
}

/// Returns whether a recorded plan is a plan of the campaign file. The record has the absolute path of a controller.
fn is_same_plan(recorded: &Plan, planned: &Plan) -> bool {
    let is_same_file = is_path(&planned.controller)
        && Path::new(&recorded.controller).file_name() == Path::new(&planned.controller).file_name();
    let controller = if is_same_file { recorded.controller.clone() } else { planned.controller.clone() };
    *recorded == Plan { controller, ..planned.clone() }
}

/// Creates the folder of a campaign, with a run file for each run. `text` is the campaign file: see [`read_grid`].
///
/// No run file contains a simulation yet. All plans are resolved before the folder is created.
///
/// # Errors
/// If the text or one of its plans is invalid, the folder exists, or a file cannot be written.
pub fn create_campaign(text: &str, folder: &Path) -> Result<Vec<CampaignRun>, MishandleError> {
    let runs = read_grid(text)?;
    for run in &runs {
        resolve(run)?;
    }
    let write = |source| MishandleError::Write { what: "folder", path: folder.to_path_buf(), source };
    if let Some(parent) = folder.parent() {
        std::fs::create_dir_all(parent).map_err(write)?;
    }
    std::fs::create_dir(folder).map_err(write)?;
    let mut created = Vec::new();
    for run in &runs {
        let path = run_path(folder, &run.name);
        create_run(&resolve(run)?, Some(&path))?.close()?;
        created.push(CampaignRun { name: run.name.clone(), path, plan: run.plan.clone() });
    }
    let path = folder.join(CAMPAIGN_FILE);
    let write = |source| MishandleError::Write { what: "campaign", path: path.clone(), source };
    let mut file = AtomicFile::create_new(&path).map_err(write)?;
    std::io::Write::write_all(&mut file, text.as_bytes()).and_then(|()| file.persist()).map_err(write)?;
    Ok(created)
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
    let runs = read_grid(&text)?.into_iter().map(|GridRun { name, plan }| {
        let path = run_path(folder, &name);
        match path.try_exists() {
            Ok(true) => Ok(CampaignRun { name, path, plan }),
            _ => Err(MishandleError::NoCampaign { path: folder.to_path_buf(), file: path }),
        }
    });
    runs.collect()
}

/// Checks that the file of a campaign is no symbolic link. A folder of a stranger could have one to any file, whose first line
/// would be printed as a wrong plan.
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

fn resolve(run: &GridRun) -> Result<ResolvedPlan, MishandleError> {
    ResolvedPlan::new(&run.plan)
        .map_err(|source| MishandleError::CampaignRun { name: run.name.clone(), source: Box::new(source) })
}

fn run_path(folder: &Path, name: &str) -> PathBuf {
    folder.join(format!("{name}.sqlite"))
}
