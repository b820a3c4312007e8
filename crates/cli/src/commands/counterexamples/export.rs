use std::io::Write;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail, ensure};
use clap::Args;
use mishandle::Plan;
use mishandle::counterexample::{Chosen, Counterexample, Minimization};
use mishandle::files::NewFolders;
use mishandle::store::RunFile;
use mishandle_text::plural;

use crate::exit_status::ExitStatus;
use crate::flags::{self, numbers};
use crate::run;
use crate::show::progress::Bar;
use crate::show::{escape, exports, output};

#[derive(Debug, Args)]
#[command(after_help = "Examples:
  mishandle counterexamples export runs/RUN.sqlite --out failure.json
  mishandle counterexamples export runs/RUN.sqlite --mode 2 --minimize --out failure.json
  mishandle counterexamples export runs/RUN.sqlite --trial 2 --simulation 17 --out failure.json
  mishandle counterexamples export runs/RUN.sqlite --all --out failures

--minimize moves the scenario toward the nominal one while it still fails: as few axes as possible
off nominal, with offsets that cannot shrink by 1 % of the width of an axis. The random seed stays.
docs/guide/counterexamples.md describes the file.")]
pub struct Arguments {
    /// Run file
    #[arg(value_name = "RUN")]
    pub file: PathBuf,
    /// File to create; with --all a folder for one file per mode
    #[arg(long, value_name = "FILE|DIR")]
    pub out: PathBuf,
    /// Failure mode, from 1, whose representative is exported [default: 1]
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = numbers::integer::<u32>(flags::NUMBERS))]
    #[arg(conflicts_with_all = ["all", "trial", "simulation"])]
    pub mode: Option<u32>,
    /// Export the representatives of all failure modes
    #[arg(long, conflicts_with_all = ["trial", "simulation"])]
    pub all: bool,
    /// Number of the trial, from 1, of the exported simulation
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = numbers::integer::<u32>(flags::NUMBERS))]
    #[arg(requires = "simulation")]
    pub trial: Option<u32>,
    /// Number of the exported simulation within its trial, from 1
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = numbers::integer::<u32>(flags::NUMBERS))]
    pub simulation: Option<u32>,
    /// Move the scenario toward the nominal one while it still fails
    #[arg(long)]
    pub minimize: bool,
    /// Largest number of simulations that minimize a counterexample [default: 300]
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = numbers::integer::<u64>(Plan::BUDGET))]
    #[arg(requires = "minimize")]
    pub budget: Option<u64>,
    /// Overwrite existing files
    #[arg(long)]
    pub force: bool,
    /// Number of threads; does not affect the result [default: number of cores]
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = numbers::integer::<usize>(flags::THREADS))]
    pub threads: Option<usize>,
    /// Print one JSON document to stdout
    #[arg(long)]
    pub json: bool,
    #[command(flatten)]
    pub keys: flags::SettingKeys,
}

pub fn run(command: &Arguments) -> Result<ExitStatus> {
    run::set_threads(command.threads)?;
    ensure!(
        command.all || flags::is_file(&command.out),
        "--out is {}; it must end with .json, by which `replay` recognizes a counterexample",
        command.out.display()
    );
    let engine = command.keys.settings("counterexamples")?.engine;
    let file = run::read(&command.file, engine.skip_check)?;
    let chosen = choose(command, &file)?;
    // The files of a target are copied; they must be those of the run.
    let has_files = mishandle::resolve::has_files(&Plan::from_toml(&file.header().plan)?.target);
    let resolved = if command.minimize || has_files || engine.target.is_some() {
        Some(mishandle::resolve::recorded_plan(file.header(), engine.moved())?)
    } else {
        None
    };
    if let Some(resolved) = &resolved {
        run::report_build_differences("made", &mishandle::replay::build_differences(file.header(), resolved));
    }
    // Before the simulations of --minimize.
    let inputs = [Some(command.file.as_path()), engine.controller.as_deref().map(Path::new)];
    for Chosen { path, .. } in &chosen {
        output::refuse_inputs(path, "--out", inputs.into_iter().flatten())?;
        ensure!(
            command.force || path.symlink_metadata().is_err(),
            "{} exists already; choose another --out, or overwrite it with --force",
            path.display()
        );
    }
    let bar = Bar::new(0, "simulations");
    if command.minimize {
        run::stop_on_signals(&bar)?;
    }
    let budget = command.budget.unwrap_or(Minimization::BUDGET);
    bar.set_length(budget);
    let minimized = resolved.as_ref().filter(|_| command.minimize);
    let minimization = minimized.map(|resolved| Minimization { resolved, budget });
    let found = mishandle::counterexample::export(&file, chosen, minimization, |done| {
        bar.set_position(done);
        run::control_flow()
    })?;
    bar.clear();
    if found.is_interrupted && command.all {
        run::report_loss(
            found.simulations,
            "no file is written, because a part of a suite would look complete",
        );
        return Ok(ExitStatus::Interrupted);
    }
    let folder = if command.all { Some(command.out.as_path()) } else { command.out.parent() };
    let copied = match &resolved {
        Some(resolved) => mishandle::portable::copy_target(&resolved.plan, folder.unwrap_or(Path::new("")))?,
        None => Vec::new(),
    };
    write_all(command, &found.files)?;
    if command.json {
        output::json(&found.result)?;
    } else {
        output::line(&exports::text(&found.result))?;
    }
    for path in &copied {
        output::message(&format!("wrote {}, a file of the target", escape::name(&path.to_string_lossy())));
    }
    // Otherwise the controller is among these files.
    let first = found.files.first().filter(|_| !has_files);
    let controller = first.map(|(_, counterexample)| &counterexample.plan.controller);
    if let Some(name) = controller.and_then(|controller| controller.strip_prefix("./")) {
        output::message(&format!(
            "the controller is not shipped: copy {} to the folder of the counterexamples, or give --controller FILE",
            escape::name(name)
        ));
    }
    // The only counterexample; a suite is not written then.
    if found.is_interrupted {
        run::report_loss(
            found.simulations,
            "the scenario so far is written, which fails, but can be nearer to nominal",
        );
        return Ok(ExitStatus::Interrupted);
    }
    Ok(ExitStatus::Done)
}

/// Writes the files when all are known: an interruption never leaves a part of a suite, which would
/// look complete.
fn write_all(command: &Arguments, files: &[(PathBuf, Counterexample)]) -> Result<()> {
    // Removes them again if nothing is written.
    let mut folders = NewFolders::default();
    let folder = if command.all { Some(command.out.as_path()) } else { command.out.parent() };
    if let Some(folder) = folder.filter(|folder| !folder.as_os_str().is_empty()) {
        folders.create(folder).with_context(|| format!("cannot create the folder {}", folder.display()))?;
    }
    let mut complete = Vec::new();
    for (path, counterexample) in files {
        let mut file = output::create(path, command.force)?;
        file.write_all(counterexample.to_json().as_bytes())
            .with_context(|| format!("cannot write {}", path.display()))?;
        complete.push((path, file));
    }
    for (path, file) in complete {
        file.persist().with_context(|| format!("cannot write {}", path.display()))?;
    }
    Ok(())
}

/// Returns the counterexamples that the flags select.
fn choose(command: &Arguments, file: &RunFile) -> Result<Vec<Chosen>> {
    if let Some(simulation) = command.simulation {
        let path = command.out.clone();
        return Ok(vec![Chosen { path, mode: None, trial: command.trial.unwrap_or(1), simulation }]);
    }
    let folder = if command.all { command.out.as_path() } else { Path::new("") };
    let mut chosen = mishandle::counterexample::representatives(file, folder)?;
    if chosen.is_empty() {
        bail!("{} has no counterexample with a recorded trace", command.file.display());
    }
    if command.all {
        return Ok(chosen);
    }
    let mode = command.mode.map_or(1, |mode| mode as usize);
    if mode > chosen.len() {
        bail!(
            "there is no failure mode {mode}; {} has {}",
            command.file.display(),
            plural(chosen.len(), "failure mode")
        );
    }
    Ok(vec![Chosen { path: command.out.clone(), ..chosen.swap_remove(mode - 1) }])
}
