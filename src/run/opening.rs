//! Creates run files, and opens them for writing.

use std::path::{Path, PathBuf};

use mishandle_files::NewFolders;
use mishandle_store::{IfExists, RunHeader, RunWriter, StoreError};

use crate::error::MishandleError;
use crate::plan::Plan;
use crate::resolve::{ResolvedPlan, controller_name, file_label};
use crate::run::header::header;
use crate::run::{Probed, Probes};
use crate::run::{admit_build, same_plan, unfinished};

/// How run files are opened for writing.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Opening {
    /// Whether each batch is synced to the disk.
    pub durable: bool,
    /// Whether this build may continue a run that another one started.
    pub any_build: bool,
}

impl Opening {
    /// Prepares a run file for the rows of its plan.
    ///
    /// # Errors
    /// If the file cannot be read or written.
    pub fn apply(self, run: &mut RunWriter, resolved: &ResolvedPlan) -> Result<(), MishandleError> {
        if self.durable {
            run.set_durable()?;
        }
        // A complete run gets no rows.
        if self.any_build && unfinished(run.file())?.is_some() {
            admit_build(run, resolved)?;
        }
        Ok(())
    }
}

/// Creates the run file of a plan at `path`, with its folder. Without a path, chooses the first
/// free name in the folder `runs`.
///
/// # Errors
/// If the file exists already or cannot be written.
pub fn create_run(resolved: &ResolvedPlan, path: Option<&Path>) -> Result<RunWriter, MishandleError> {
    Ok(create_probed_run(resolved, path)?.0)
}

/// Creates the run file of a plan as [`create_run`] does. Returns also what its probes cost.
///
/// # Errors
/// The errors of [`create_run`].
pub fn create_probed_run(
    resolved: &ResolvedPlan,
    path: Option<&Path>,
) -> Result<(RunWriter, Probes), MishandleError> {
    check_question(resolved)?;
    let create = |path: &Path| create(resolved, path, Probed::All);
    let Some(path) = path else {
        // Another process can take the free name first.
        let is_taken = |created: &Result<(RunWriter, Probes), MishandleError>| {
            matches!(
                created,
                Err(MishandleError::Store(StoreError::Exists { .. } | StoreError::Locked { .. }))
            )
        };
        let mut number = 1;
        let mut created = create(&free_name(&resolved.plan, number));
        while is_taken(&created) {
            number += 1;
            created = create(&free_name(&resolved.plan, number));
        }
        return created;
    };
    create(path)
}

/// Checks what a question needs, before there is a file.
fn check_question(resolved: &ResolvedPlan) -> Result<(), MishandleError> {
    if resolved.plan.risk.is_some() {
        crate::run::check_risk_method(resolved)?;
    }
    if let Some(margin) = &resolved.plan.margin {
        mishandle_falsification::check_margin(margin.budget, &resolved.space)?;
        if margin.each_category {
            mishandle_falsification::each_category(&resolved.space)?;
        }
    }
    Ok(())
}

/// Continues the run of a plan at `path`, or begins it with its probes.
///
/// # Errors
/// If it is a run of another plan, which is not changed, or cannot be opened.
pub(crate) fn continue_run(
    resolved: &ResolvedPlan,
    path: &Path,
    probed: Probed,
) -> Result<RunWriter, MishandleError> {
    let run = match path.exists().then(|| RunWriter::resume(path)) {
        // A program was killed while it created the run.
        None | Some(Err(StoreError::Unfinished { .. })) => {
            check_question(resolved)?;
            create(resolved, path, probed)?.0
        }
        Some(run) => run?,
    };
    same_plan::check(run.file().header(), resolved)?;
    Ok(run)
}

/// Creates the run file of a plan at `path`, with its folder.
fn create(
    resolved: &ResolvedPlan,
    path: &Path,
    probed: Probed,
) -> Result<(RunWriter, Probes), MishandleError> {
    // Removes them again if the run cannot be created.
    let mut folders = NewFolders::default();
    if let Some(folder) = path.parent().filter(|folder| !folder.as_os_str().is_empty()) {
        folders.create(folder).map_err(MishandleError::write("folder", folder))?;
    }
    let (preflight, probes) = crate::run::preflight(resolved, probed)?;
    let header = RunHeader { preflight, ..header(resolved) };
    Ok((RunWriter::create(path, &header, IfExists::Refuse)?, probes))
}

/// Returns `runs/KIND-TARGET[-CONTROLLER][-SEARCH]-sSEED[-N].sqlite`. The first name has no number.
fn free_name(plan: &Plan, number: u32) -> PathBuf {
    let target = file_label(&plan.target);
    let kind = plan.kind().name();
    let search = plan.falsify.as_ref().map_or("", |falsify| falsify.search.as_str());
    let seed = format!("s{}", plan.seed);
    let parts = [kind, &target, &controller_name(&plan.controller), search, &seed];
    let number = if number == 1 { String::new() } else { number.to_string() };
    let parts = parts.into_iter().chain([number.as_str()]).filter(|part| !part.is_empty());
    Path::new("runs").join(parts.collect::<Vec<_>>().join("-") + ".sqlite")
}
