use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail, ensure};
use clap::Args;
use mishandle::files::AtomicFile;
use mishandle::store::{self, RunFile};
use mishandle::tasks::compose_with_start;
use mishandle_text::plural;

use crate::exit_status::ExitStatus;
use crate::show::output;
use crate::{flags, run};

/// Export the simulations of a run as CSV or Parquet, or the scene of a task as MJCF
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  mishandle export runs/RUN.sqlite --out simulations.csv
  mishandle export runs/RUN.sqlite --out simulations.parquet
  mishandle export ball-balancing --out scene.xml        the scene, to load into MuJoCo

One row per simulation: trial, number, seed, robustness, end, scenario, verdicts.
docs/reference/run_file.md describes the columns. `mishandle replay RUN --trace FILE` exports the
trace of one simulation.")]
pub struct Arguments {
    /// Run file, or name of a task
    #[arg(value_name = "RUN|TASK")]
    pub file: PathBuf,
    /// File to create: .csv or .parquet of a run; .xml of a task: its scene as MJCF, with the
    /// initial state as keyframe `start`, without the control of servos and gripper
    #[arg(long, value_name = "FILE")]
    pub out: PathBuf,
    /// Overwrite an existing file
    #[arg(long)]
    pub force: bool,
    #[command(flatten)]
    pub keys: flags::SettingKeys,
}

/// Writes all simulations of a run.
type Writer = fn(&RunFile, &mut AtomicFile) -> store::Result<()>;

pub fn run(command: &Arguments) -> Result<ExitStatus> {
    if !command.file.exists()
        && let Some(task) = command.file.to_str().and_then(mishandle::tasks::task)
    {
        let is_xml = command.out.extension().is_some_and(|end| end == "xml");
        ensure!(is_xml, "--out is {}; the scene of a task must end in .xml", command.out.display());
        let scene = compose_with_start(task)?;
        output::write_atomically(&command.out, command.force, scene.as_bytes())?;
        output::message(&format!("wrote {}", command.out.display()));
        return Ok(ExitStatus::Done);
    }
    let write = writer(&command.out)?;
    output::refuse_inputs(&command.out, "--out", [command.file.as_path()])?;
    let file = run::read(&command.file, command.keys.settings("export")?.engine.skip_check)?;
    let mut out = output::create(&command.out, command.force)?;
    let failed = || format!("cannot write {}", command.out.display());
    write(&file, &mut out).with_context(failed)?;
    out.persist().with_context(failed)?;
    let simulations = file.counts()?.simulations;
    output::message(&format!("wrote {} to {}", plural(simulations, "simulation"), command.out.display()));
    Ok(ExitStatus::Done)
}

/// Returns the writer for the extension of a file.
fn writer(out: &Path) -> Result<Writer> {
    match out.extension().and_then(|extension| extension.to_str()) {
        Some("csv") => Ok(store::export_csv),
        Some("parquet") => Ok(store::export_parquet),
        _ => bail!("--out is {}; it must end in .csv or .parquet", out.display()),
    }
}
