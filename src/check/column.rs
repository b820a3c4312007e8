//! The runs of a check for one controller, and what they say.

use std::collections::BTreeSet;
use std::path::Path;

use mishandle_results as results;
use mishandle_results::{Answer, CheckRun, CheckRunKind, EndCounts};
use mishandle_store::{BuildRecord, RunFile};
use mishandle_text::path_text;

use super::checker::Checker;
use super::folder::run_file;
use super::row::{self, Row};
use super::{CheckProgress, Watch};
use crate::error::MishandleError;
use crate::resolve::ResolvedPlan;
use crate::run::{Engine, Probed, Progress, ask, continue_run, idle_axes, of_folder};

/// The runs and the cells of one controller.
pub(super) struct Column {
    pub runs: Vec<CheckRun>,
    pub cells: Vec<results::CheckCell>,
    /// How the simulations of the runs ended: see [`row::add`].
    pub ends: EndCounts,
    /// The programs that made the runs.
    pub programs: BTreeSet<String>,
}

impl Checker<'_> {
    /// Runs what is missing. Returns `None` if it was interrupted.
    pub(super) fn run(&self, watch: Watch<'_>) -> Result<Option<Column>, MishandleError> {
        let mut rows: Vec<Row> =
            self.asked.iter().map(|asked| Row::new(&asked.written.name, self.stated(asked))).collect();
        let mut runs = Vec::new();
        let mut ends = EndCounts::default();
        let mut programs = BTreeSet::new();
        for resolved in &self.random {
            let path = run_file(self.folder, &self.label, "random", &resolved.plan.space);
            let done = self.ask(resolved, &path, Probed::All, "random scenarios", watch)?;
            let Some((answer, run)) = done else {
                return Ok(None);
            };
            ends.add_all(row::add(&mut rows, answer.requirements(), &run, true)?);
            programs.insert(program(&run.header().build));
            runs.push(check_run(&run, CheckRunKind::Random, None)?);
        }
        for (index, asked) in self.asked.iter().enumerate() {
            let Some(resolved) = &asked.search else { continue };
            // A violation is known already, also from the search for another one.
            if rows[index].violated() > 0 {
                continue;
            }
            let name = &asked.written.name;
            let path = run_file(self.folder, &self.label, "search", name);
            let done =
                self.ask(resolved, &path, Probed::Requirement, &format!("search for {name}"), watch)?;
            let Some((answer, run)) = done else {
                return Ok(None);
            };
            ends.add_all(row::add(&mut rows, answer.requirements(), &run, false)?);
            programs.insert(program(&run.header().build));
            runs.push(check_run(&run, CheckRunKind::Search, Some(name.clone()))?);
        }
        let cells: Result<Vec<_>, MishandleError> =
            self.asked.iter().zip(&rows).map(|(asked, row)| self.cell(asked, row)).collect();
        Ok(Some(Column { runs, cells: cells?, ends, programs }))
    }

    /// Asks the question of a plan, or continues its run. Returns `None` if it was interrupted.
    fn ask(
        &self,
        resolved: &ResolvedPlan,
        path: &Path,
        probed: Probed,
        what: &str,
        watch: Watch<'_>,
    ) -> Result<Option<(Answer, RunFile)>, MishandleError> {
        let run = continue_run(resolved, path, probed)?;
        let phase = format!("{}: {what}", self.label);
        let mut watch = |progress: &Progress| {
            let Progress { simulations: done, max_simulations: all, .. } = *progress;
            watch(&CheckProgress { phase: phase.clone(), done, all, largest: None })
        };
        let answer = ask(resolved, run, Engine::Direct, &mut watch).map_err(of_folder)?;
        if !answer.is_complete() {
            return Ok(None);
        }
        Ok(Some((answer, RunFile::open_unchecked(path)?)))
    }
}

/// Returns version and commit of a program, as it prints them.
pub(super) fn program(build: &BuildRecord) -> String {
    format!("{} ({})", build.program_version, build.git_commit)
}

/// Describes a run.
fn check_run(
    run: &RunFile,
    kind: CheckRunKind,
    requirement: Option<String>,
) -> Result<CheckRun, MishandleError> {
    Ok(CheckRun {
        run: path_text(run.path()),
        kind,
        space: run.header().space.clone(),
        requirement,
        simulations: run.counts()?.simulations,
        digest: format!("{:032x}", run.content_digest()?),
        idle_axes: idle_axes(run)?,
    })
}
