//! The run file of a command: created, resumed or read.

use std::path::Path;

use anyhow::{Context, Result, ensure};
use mishandle::plan::EngineSettings;
use mishandle::store::{RunFile, RunKind, RunWriter};
use mishandle::{Plan, ResolvedPlan};
use mishandle_text::plural;

use super::path_kind;
use crate::flags::OpenRun;
use crate::show::{cost, output};

/// Opens a run file of this kind and returns it with its resolved plan: the run to resume, or else
/// a new run with the plan `new_plan`.
pub fn open(
    flags: &OpenRun,
    kind: RunKind,
    engine: &EngineSettings,
    new_plan: Option<Plan>,
) -> Result<(ResolvedPlan, RunWriter)> {
    let sync = |run: &mut RunWriter| if engine.durable { run.set_durable() } else { Ok(()) };
    let Some(path) = &flags.resume else {
        let plan = new_plan.context("there is no plan")?;
        let is_json = flags.out.as_ref().is_some_and(|out| out.extension().is_some_and(|end| end == "json"));
        ensure!(
            !is_json,
            "--out ends with .json, but a run file is SQLite; choose another name, such as run.sqlite"
        );
        let resolved = ResolvedPlan::new(&plan)?;
        let mut run = create(&resolved, flags.out.as_deref())?;
        sync(&mut run)?;
        return Ok((resolved, run));
    };
    let mut run =
        if engine.skip_check { RunWriter::resume_unchecked(path) } else { RunWriter::resume(path) }?;
    let found = run.file().header().kind;
    ensure!(
        found == kind,
        "{} is a run of `{}`, not of `{}`; resume it with: mishandle {} --resume {}",
        path.display(),
        found.name(),
        kind.name(),
        command(found),
        name(run.file())
    );
    sync(&mut run)?;
    let resolved = mishandle::resolve::recorded_plan(run.file().header(), engine.moved())?;
    if engine.any_build {
        report_build_differences(
            "started",
            &mishandle::replay::build_differences(run.file().header(), &resolved),
        );
        mishandle::run::admit_build(&mut run, &resolved)?;
    }
    Ok((resolved, run))
}

/// Creates the run file of a question. Says how many simulations it takes before the probes, and
/// about how long after them.
pub fn create(resolved: &ResolvedPlan, path: Option<&Path>) -> Result<RunWriter> {
    let cost = mishandle::run::cost(resolved)?;
    output::message(&cost::text(&cost));
    let (run, probes) = mishandle::run::create_probed_run(resolved, path)?;
    if let Some(text) = cost::time_text(&cost, &probes, 0) {
        output::message(&text);
    }
    Ok(run)
}

/// Largest number of differences that are reported.
const MAX_DIFFERENCES: usize = 20;

/// Reports differences between the build that made or started a run and the present one.
pub fn report_build_differences(verb: &str, differences: &[String]) {
    for difference in differences.iter().take(MAX_DIFFERENCES) {
        output::message(&format!("warning: another build {verb} the run: {difference}"));
    }
    if differences.len() > MAX_DIFFERENCES {
        output::message(&format!(
            "warning: {} more",
            plural(differences.len() - MAX_DIFFERENCES, "difference")
        ));
    }
}

/// Opens a run file for reading.
pub fn read(path: &Path, skip_check: bool) -> Result<RunFile> {
    path_kind::refuse_others(path, &[path_kind::RUN])?;
    Ok(if skip_check { RunFile::open_unchecked(path) } else { RunFile::open(path) }?)
}

/// Describes the differences between a run file and the replay of a simulation, one per line.
pub fn differences_text(differences: &[String]) -> String {
    format!("the run file differs from its plan or from the replay:\n  {}", differences.join("\n  "))
}

/// Returns the path of a run, quoted for a shell.
pub fn name(run: &RunFile) -> String {
    mishandle_text::shell_quote(&run.path().to_string_lossy())
}

/// Returns the command that asks a question.
fn command(kind: RunKind) -> &'static str {
    if kind == RunKind::Metamorphic { "run" } else { kind.name() }
}

/// Reports the progress of an interrupted run and the command that resumes it.
pub fn report_interruption(kind: RunKind, simulations: u64, name: &str) {
    output::message(&format!("interrupted after {}, stored in {name}", plural(simulations, "simulation")));
    output::message(&format!("Resume with: mishandle {} --resume {name}", command(kind)));
}
