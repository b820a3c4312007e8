use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use anyhow::{Context, Result, bail, ensure};
use clap::Args;
use mishandle::campaign::{CAMPAIGN_FILE, CampaignRun, campaign_runs, create_campaign, free_campaign_folder};
use mishandle::files::{limits, read_text_bounded};
use mishandle::plan::{EngineSettings, GridRun, Settings, Values, grid};
use mishandle::results::Campaign;
use mishandle::run::{Device, Opening};
use mishandle::store::{RunFile, RunKind};
use mishandle_text::{path_text, plural, shell_path, shell_quote};
use toml::{Table, Value};

use crate::exit_status::ExitStatus;
use crate::flags::{self, OpenRun, Planned};
use crate::interrupt;
use crate::run::first_look::{self, FirstLook};
use crate::run::grid::Ended;
use crate::run::{self, answers, path_kind, question};
use crate::show::progress::Bar;
use crate::show::{campaign, escape, output};

/// Ask what a file says: one question, a grid of questions and hardenings, or metamorphic relations
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  mishandle run plan.toml
  mishandle run campaign.toml --out runs/controllers
  mishandle run campaign.toml -k 'seed=[1, 2, 3]' -k falsify.budget=100
  mishandle run robot.toml --controller ./policy.onnx -k evaluate.episodes=1000
  mishandle run --resume runs/controllers
  mishandle run campaign.toml -k engine.ray=auto      on this machine's Ray cluster

The file is a plan (docs/reference/plans.md), in which keys may have lists of values
(docs/guide/campaigns.md), or a target file: then each of its spaces is evaluated and searched, and
the smallest disturbance is sought. One question has a run file. Otherwise each combination of the
values has a run file in a folder; one of [harden] has a folder there, and beside it the accepted
controller. Exit code 1 means that a violation was found by falsify, margin or risk, that a pair
breaks a metamorphic relation, or that a hardening accepted no controller; 2 also that no simulation
has a verdict, or too few for a conclusion (max-without-verdict).")]
pub struct Arguments {
    /// Plan or target file (TOML)
    #[arg(value_name = "FILE", required_unless_present = "resume")]
    pub file: Option<PathBuf>,
    /// Controller of all runs
    #[arg(long, value_name = "C", conflicts_with = "resume")]
    pub controller: Option<String>,
    /// Run file to create, or folder for the run files of several runs [default: a new one in
    /// runs/]
    #[arg(long, value_name = "PATH")]
    pub out: Option<PathBuf>,
    /// Resume the stopped runs in this folder, or the run of metamorphic relations in this file
    #[arg(long, value_name = "PATH", conflicts_with_all = ["file", "out", "seed"])]
    pub resume: Option<PathBuf>,
    #[command(flatten)]
    pub keys: flags::SettingKeys,
    #[command(flatten)]
    pub run: flags::Run,
    #[command(flatten)]
    pub verbose: flags::Verbose,
}

pub fn run(command: &Arguments, gpu: Option<&Device>) -> Result<ExitStatus> {
    run::set_threads(command.run.threads)?;
    match (&command.resume, &command.file) {
        (Some(folder), _) if folder.is_dir() => {
            let engine = command.keys.settings("run")?.engine;
            let runs = campaign_runs(folder)?;
            let text = read_text_bounded(&folder.join(CAMPAIGN_FILE), limits::PLAN).unwrap_or_default();
            let look = runs.first().map(|run| FirstLook::resumed(&text, &run.plan)).transpose()?.flatten();
            run_all(command, folder, &engine, &runs, gpu, look)
        }
        (Some(path), _) => {
            let found = RunFile::open_unchecked(path)?.header().kind;
            let name = shell_path(path);
            ensure!(
                found == RunKind::Metamorphic,
                "{} is a run of `{1}`; resume it with: mishandle {1} --resume {name}",
                path.display(),
                found.name(),
            );
            let settings = command.keys.settings("run")?;
            ask(command, RunKind::Metamorphic, gpu, || Ok((mishandle::Plan::new("", ""), settings)))
        }
        (None, Some(path)) => run_file(command, path, gpu),
        (None, None) => bail!("there is no plan: name its file"),
    }
}

/// Asks what a file says.
fn run_file(command: &Arguments, path: &Path, gpu: Option<&Device>) -> Result<ExitStatus> {
    path_kind::refuse_others(path, &[path_kind::PLAN, path_kind::TARGET])?;
    let of_file = || path.display().to_string();
    let text = read_text_bounded(path, limits::PLAN).with_context(of_file)?;
    let mut planned = Planned::from(table(path, &text).with_context(of_file)?);
    planned.flag("--controller", "controller", command.controller.clone())?;
    planned.number("--seed", "seed", command.run.seed)?;
    planned.assign(&command.keys.keys, "run", Values::Lists)?;
    let is_of_target = is_target_file(&text);
    let is_edited = planned.is_edited() || is_of_target;
    let mut plan = planned.into_table(Values::Lists)?;
    let settings = Settings::take(&mut plan)?;
    let mut questions = RunKind::ALL.map(|(_, name)| name).into_iter().chain(["harden"]);
    let mut look = None;
    if is_of_target && !questions.any(|question| plan.contains_key(question)) {
        look = Some(FirstLook::of(&mut plan).with_context(of_file)?);
    }
    let runs = grid(&plan).with_context(of_file)?;
    // A list of one value has a folder, too: the name of its run is that value.
    if let [GridRun { name, plan: only }] = &runs[..]
        && only.harden.is_none()
        && name == only.kind().name()
    {
        let mut only = only.clone();
        if let Some(falsify) = &mut only.falsify {
            falsify.isolate_by_default();
        }
        return ask(command, only.kind(), gpu, || Ok((only, settings)));
    }
    let folder = command.out.clone().unwrap_or_else(free_campaign_folder);
    ensure!(
        !folder.exists(),
        "{} exists already; choose another --out, or resume it with --resume",
        folder.display()
    );
    // The folder keeps the comments of a file that nothing edits, and no settings of this start.
    let text = if is_edited { plan.to_string() } else { text };
    let text = if look.is_some() { format!("{}{text}", first_look::MARK) } else { text };
    let runs = create_campaign(&text, &folder).with_context(of_file)?;
    run_all(command, &folder, &settings.engine, &runs, gpu, look)
}

/// Returns whether a text is a target file rather than a plan.
fn is_target_file(text: &str) -> bool {
    path_kind::is_target(&toml::from_str(text).unwrap_or_default())
}

/// Returns the table of a plan file, or a table whose target is the file.
fn table(path: &Path, text: &str) -> Result<Table> {
    if is_target_file(text) {
        let target = ("target".to_string(), Value::String(path_text(path)));
        return Ok(Table::from_iter([target]));
    }
    Ok(mishandle::plan::table(text, Values::Lists)?)
}

/// Asks one question, as its command does.
fn ask(
    command: &Arguments,
    kind: RunKind,
    gpu: Option<&Device>,
    plan: impl FnOnce() -> Result<(mishandle::Plan, Settings)>,
) -> Result<ExitStatus> {
    let file = OpenRun { out: command.out.clone(), resume: command.resume.clone() };
    let asked = question::ask(kind, &command.keys.keys, &file, gpu, plan)?;
    answers::show(asked, command.run.json, command.verbose.verbose)
}

/// Runs or completes the runs of a folder.
fn run_all(
    command: &Arguments,
    folder: &Path,
    engine: &EngineSettings,
    runs: &[CampaignRun],
    gpu: Option<&Device>,
    look: Option<FirstLook>,
) -> Result<ExitStatus> {
    ensure!(
        engine.ray.is_none() || engine.jobs == 1,
        "engine.jobs has no effect on a Ray cluster, which runs all at the same time; leave it out"
    );
    ensure!(
        engine.screening.is_none(),
        "engine.screening has no effect on several runs; measure one of them, and set screening.device for all"
    );
    if engine.ray.is_some() {
        check_ray()?;
    }
    let bar = Bar::new(0, "simulations");
    run::stop_on_signals(&bar)?;
    let opening = Opening { durable: engine.durable, any_build: engine.any_build };
    let status = match &engine.ray {
        Some(address) => simulate_on_ray(folder, address, opening)?,
        None => ExitStatus::Done,
    };
    let mut ended = Ended::default();
    if status == ExitStatus::Done {
        ended = run::grid::run_all(runs, &bar, opening, engine.jobs as usize, gpu)?;
    }
    bar.clear();
    let Ended { finished, stopped } = ended;
    let is_complete = finished.len() + stopped.len() == runs.len();
    let is_first_look = look.is_some();
    let mut found = Campaign { folder: path_text(folder), is_complete, runs: finished };
    if let Some(look) = look.as_ref().filter(|_| is_complete) {
        found.runs.push(look.margin(folder)?);
        found.is_complete = found.runs.iter().all(|run| run.result.is_complete());
    }
    let name = shell_quote(&found.folder);
    if !found.is_complete {
        output::message(&format!(
            "interrupted; {} of {} finished",
            found.runs.len(),
            plural(runs.len() as u64, "run")
        ));
        output::message(&format!("Resume with: mishandle run --resume {name}"));
    }
    if command.run.json {
        output::json(&found)?;
    } else if !found.runs.is_empty() {
        output::line(&look.map_or_else(|| campaign::text(&found), |_| first_look::text(&found)))?;
    }
    if !found.is_complete {
        return Ok(ExitStatus::Interrupted);
    }
    output::message(&format!("Run files: {name}"));
    if is_first_look && first_look::write_pages(folder)? == ExitStatus::Interrupted {
        output::message(&format!("Resume with: mishandle run --resume {name}"));
        return Ok(ExitStatus::Interrupted);
    }
    for (run, why) in &stopped {
        output::message(&format!("error: run {}: {}", escape::name(run), escape::name(why)));
    }
    ensure!(stopped.is_empty(), "{} without a result", plural(stopped.len() as u64, "run"));
    // Exit code 0 would say that the controllers were tested.
    ensure!(
        found.runs.is_empty() || found.runs.iter().any(|run| run.result.has_verdict()),
        "no simulation has a verdict, so nothing was tested; the run files contain the end of each simulation"
    );
    if found.runs.iter().any(|run| run.result.is_violated()) {
        return Ok(ExitStatus::Violated);
    }
    let open = found.runs.iter().filter(|run| run.result.is_inconclusive()).count() as u64;
    ensure!(
        open == 0,
        "{} without a conclusion: too many simulations have no verdict (max-without-verdict), or none asks anything",
        plural(open, "run")
    );
    Ok(ExitStatus::Done)
}

/// Program and module that simulate a campaign on Ray.
const PYTHON: &str = "python3";
const MODULE: &str = "mishandle.cluster";

/// Checks that the Python package and Ray are installed.
fn check_ray() -> Result<()> {
    let found = Command::new(PYTHON)
        .args(["-c", "import ray, mishandle.cluster"])
        .stdin(Stdio::null())
        .output()
        .with_context(|| format!("engine.ray needs {PYTHON}"))?;
    ensure!(
        found.status.success(),
        "engine.ray needs the Python package with Ray: run `{PYTHON} -m pip install '.[ray]'` in a clone of Mishandle ({PYTHON} says: {})",
        String::from_utf8_lossy(&found.stderr).lines().last().unwrap_or("nothing")
    );
    Ok(())
}

/// Simulates the runs of the folder on a Ray cluster. The run files are then complete, so that this
/// program only reads them.
fn simulate_on_ray(folder: &Path, address: &str, opening: Opening) -> Result<ExitStatus> {
    let mut command = Command::new(PYTHON);
    command.args(["-m", MODULE, "--resume"]).arg(folder).args(["--address", address]);
    if opening.durable {
        command.arg("--durable");
    }
    if opening.any_build {
        command.arg("--any-build");
    }
    // Ctrl-C reaches the other program as well, which saves its finished work.
    let status = command.status().with_context(|| format!("cannot start {PYTHON} -m {MODULE}"))?;
    match status.code() {
        Some(0) if !interrupt::requested() => Ok(ExitStatus::Done),
        Some(0) => Ok(ExitStatus::Interrupted),
        Some(code) if code == i32::from(interrupt::EXIT_CODE) => Ok(ExitStatus::Interrupted),
        _ => bail!(
            "{PYTHON} -m {MODULE} failed ({status}); everything recorded is kept: mishandle run --resume {}",
            shell_path(folder)
        ),
    }
}
