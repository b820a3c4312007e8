use std::io::Write;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail, ensure};
use clap::Args;
use mishandle::evaluation::RepeatReport;
use mishandle::files::NewFolders;
use mishandle::rollout::{Scenario, Seed, Space};
use mishandle::store::RunFile;
use mishandle::{
    AxisValue, Counterexample, Minimized, MinimizedFrom, Plan, ResolvedPlan, axes_off_nominal, decimal,
    is_close, minimize, plural,
};
use serde_json::{Value, json};

use super::is_file;
use crate::commands::simulate;
use crate::output::{self, number};
use crate::progress::Bar;
use crate::{ExitStatus, args, escape, numbers, run};

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
    /// Run file of `mishandle evaluate` or `mishandle falsify`
    #[arg(value_name = "RUN")]
    pub file: PathBuf,
    /// File to create; with --all a folder for one file per mode
    #[arg(long, value_name = "FILE|DIR")]
    pub out: PathBuf,
    /// Failure mode, from 1, whose representative is exported [default: 1]
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = numbers::integer::<u32>(args::NUMBERS))]
    #[arg(conflicts_with_all = ["all", "trial", "simulation"])]
    pub mode: Option<u32>,
    /// Export the representatives of all failure modes
    #[arg(long, conflicts_with_all = ["trial", "simulation"])]
    pub all: bool,
    /// Number of the trial, from 1, of the exported simulation
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = numbers::integer::<u32>(args::NUMBERS))]
    #[arg(requires = "simulation")]
    pub trial: Option<u32>,
    /// Number of the exported simulation within its trial, from 1
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = numbers::integer::<u32>(args::NUMBERS))]
    pub simulation: Option<u32>,
    /// Move the scenario toward the nominal one while it still fails
    #[arg(long)]
    pub minimize: bool,
    /// Largest number of simulations that minimize a counterexample [default: 300]
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = numbers::integer::<u64>(Plan::BUDGET))]
    #[arg(requires = "minimize")]
    pub budget: Option<u64>,
    /// With --minimize: new path of the run's controller, if the file was moved
    #[arg(long, value_name = "C", requires = "minimize")]
    pub controller: Option<String>,
    /// Overwrite existing files
    #[arg(long)]
    pub force: bool,
    /// Do not check the whole run file before reading it; a record is still checked when it is read
    #[arg(long)]
    pub skip_check: bool,
    /// Number of threads; does not affect the result [default: number of cores]
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = numbers::integer::<usize>(args::THREADS))]
    pub threads: Option<usize>,
    /// Print one JSON document to stdout
    #[arg(long)]
    pub json: bool,
}

/// Default number of simulations of a minimization.
const BUDGET: u64 = 300;

/// Number of simulations with other seeds of a minimized scenario whose target depends on the seed.
const REPEATS: u64 = 100;

/// A counterexample to write.
struct Chosen {
    path: PathBuf,
    mode: Option<usize>,
    trial: u32,
    simulation: u32,
}

/// A minimized counterexample and its space.
struct Shrunk {
    minimized: Minimized,
    space: Space,
    /// Whether the decisive predicate is the recorded one.
    has_same_predicate: bool,
    repeats: Option<RepeatReport>,
    /// Whether a signal ended it early.
    is_interrupted: bool,
}

impl Shrunk {
    /// Returns the number of simulations.
    fn simulations(&self) -> u64 {
        self.minimized.simulations + self.repeats.as_ref().map_or(0, |repeats| repeats.simulations)
    }

    /// Returns the minimized scenario; `None` if its failure depends on the seed.
    fn scenario(&self) -> Option<&Scenario> {
        self.repeats.is_none().then_some(&self.minimized.episode.request.scenario)
    }
}

/// A written file.
struct Written {
    path: PathBuf,
    scenario: Option<Scenario>,
    controller: String,
}

impl Written {
    /// Returns whether the file has the same minimized scenario, up to the resolution of minimizations.
    fn is_same(&self, scenario: Option<&Scenario>, resolved: Option<&ResolvedPlan>) -> bool {
        match (&self.scenario, scenario, resolved) {
            (Some(own), Some(other), Some(resolved)) => is_close(&resolved.space, own, other),
            _ => false,
        }
    }
}

pub fn run(command: &Arguments) -> Result<ExitStatus> {
    run::set_threads(command.threads)?;
    ensure!(
        command.all || is_file(&command.out),
        "--out is {}; it must end with .json, by which `replay` recognizes a counterexample",
        command.out.display()
    );
    let file = run::read(&command.file, command.skip_check)?;
    let chosen = choose(command, &file)?;
    let resolved = match command.minimize {
        true => Some(mishandle::recorded_plan(file.header(), command.controller.as_deref())?),
        false => None,
    };
    if let Some(resolved) = &resolved {
        run::report_build_differences("made", &mishandle::build_differences(file.header(), resolved));
    }
    // Before the simulations of --minimize.
    let inputs = [Some(command.file.as_path()), command.controller.as_deref().map(Path::new)];
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
    let mut simulations = 0;
    let mut written: Vec<Written> = Vec::new();
    let mut files: Vec<(PathBuf, String)> = Vec::new();
    let mut texts = Vec::new();
    let mut documents = Vec::new();
    for Chosen { path, mode, trial, simulation } in chosen {
        let mut counterexample = Counterexample::from_run(&file, trial, simulation)?;
        let shrunk = match &resolved {
            Some(resolved) => Some(shrink(command, resolved, &bar, &mut counterexample)?),
            None => None,
        };
        simulations += shrunk.as_ref().map_or(0, Shrunk::simulations);
        let is_interrupted = shrunk.as_ref().is_some_and(|shrunk| shrunk.is_interrupted);
        if is_interrupted && command.all {
            run::report_loss(
                simulations,
                "no file is written, because a part of a suite would look complete",
            );
            return Ok(ExitStatus::Interrupted);
        }
        // Several modes can have the same minimized scenario.
        let scenario = shrunk.as_ref().and_then(Shrunk::scenario);
        let same_as = written.iter().find(|other| other.is_same(scenario, resolved.as_ref()));
        let same_as = same_as.map(|other| other.path.clone());
        if same_as.is_none() {
            files.push((path.clone(), counterexample.to_json()));
        }
        if command.json {
            documents.push(document(&path, same_as.as_deref(), mode, &counterexample, shrunk.as_ref()));
        } else {
            texts.push(text(&path, same_as.as_deref(), mode, &counterexample, shrunk.as_ref()));
        }
        if same_as.is_none() {
            written.push(Written {
                path,
                scenario: scenario.cloned(),
                controller: counterexample.plan.controller,
            });
        }
    }
    bar.clear();
    write_all(command, &files)?;
    if !command.json {
        output::line(&texts.join("\n"))?;
    }
    if let Some(name) = written.first().and_then(|written| written.controller.strip_prefix("./")) {
        output::message(&format!(
            "the controller is not shipped: copy {} to the folder of the counterexamples, or give --controller FILE",
            escape::name(name)
        ));
    }
    if command.json {
        output::json(json!({ "run": command.file.to_string_lossy(), "files": documents }))?;
    }
    // The only counterexample; a suite is not written then.
    if run::control_flow().is_break() {
        run::report_loss(
            simulations,
            "the scenario so far is written, which fails, but can be nearer to nominal",
        );
        return Ok(ExitStatus::Interrupted);
    }
    Ok(ExitStatus::Done)
}

/// Writes the files when all are known: an interruption never leaves a part of a suite, which would look complete.
fn write_all(command: &Arguments, files: &[(PathBuf, String)]) -> Result<()> {
    // Removes them again if nothing is written.
    let mut folders = NewFolders::default();
    let folder = if command.all { Some(command.out.as_path()) } else { command.out.parent() };
    if let Some(folder) = folder.filter(|folder| !folder.as_os_str().is_empty()) {
        folders.create(folder).with_context(|| format!("cannot create the folder {}", folder.display()))?;
    }
    let mut complete = Vec::new();
    for (path, text) in files {
        let mut file = output::create(path, command.force)?;
        file.write_all(text.as_bytes()).with_context(|| format!("cannot write {}", path.display()))?;
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
    let modes = mishandle::failure_modes(file)?.modes;
    if modes.is_empty() {
        bail!("{} has no counterexample with a recorded trace", command.file.display());
    }
    let chosen = |index: usize, path: PathBuf| {
        let failure = modes[index].representative();
        Chosen { path, mode: Some(index + 1), trial: failure.trial, simulation: failure.number }
    };
    if command.all {
        let stem = command.file.file_stem().unwrap_or_default().to_string_lossy();
        let path = |index: usize| command.out.join(format!("{stem}-mode-{}.json", index + 1));
        return Ok((0..modes.len()).map(|index| chosen(index, path(index))).collect());
    }
    let mode = command.mode.map_or(1, |mode| mode as usize);
    if mode > modes.len() {
        bail!(
            "there is no failure mode {mode}; {} has {}",
            command.file.display(),
            plural(modes.len(), "failure mode")
        );
    }
    Ok(vec![chosen(mode - 1, command.out.clone())])
}

/// Minimizes a counterexample, and measures how often its scenario fails with other seeds.
fn shrink(
    command: &Arguments,
    resolved: &ResolvedPlan,
    bar: &Bar,
    counterexample: &mut Counterexample,
) -> Result<Shrunk> {
    let budget = command.budget.unwrap_or(BUDGET);
    let mut system = resolved.system()?;
    let request = counterexample.request(&resolved.space)?;
    bar.set_length(budget);
    let minimized = minimize(&mut *system, &request, budget, |done| {
        bar.set_position(done);
        run::control_flow()
    })?;
    let scenario = &minimized.episode.request.scenario;
    let repeats = match mishandle::depends_on_seed(resolved, scenario) {
        true if run::control_flow().is_continue() => {
            let seeds = mishandle::repeat_seeds(Seed(counterexample.seed), REPEATS);
            Some(mishandle::repeat(&mut *system, scenario, seeds, |_| run::control_flow())?)
        }
        _ => None,
    };
    let origin = MinimizedFrom {
        scenario: request.scenario.values().to_vec(),
        robustness: counterexample.expected.robustness,
        simulations: minimized.simulations,
        is_complete: minimized.is_complete,
    };
    let predicate = |known: &Counterexample| known.decisive.as_ref().map(|known| known.predicate.clone());
    let recorded = predicate(counterexample);
    *counterexample = Counterexample::from_episode(resolved, &minimized.episode)?;
    counterexample.minimized_from = Some(origin);
    let has_same_predicate = predicate(counterexample) == recorded;
    let is_interrupted = run::control_flow().is_break();
    Ok(Shrunk { minimized, space: resolved.space.clone(), has_same_predicate, repeats, is_interrupted })
}

fn document(
    path: &Path,
    same_as: Option<&Path>,
    mode: Option<usize>,
    known: &Counterexample,
    shrunk: Option<&Shrunk>,
) -> Value {
    let scenario = known.scenario.iter().map(|axis| (axis.axis.clone(), json!(axis.value)));
    json!({
        "file": same_as.is_none().then(|| path.to_string_lossy()),
        "same_as": same_as.map(Path::to_string_lossy),
        "mode": mode,
        "trial": known.trial,
        "simulation": known.simulation,
        "seed": known.seed.to_string(),
        "scenario": scenario.collect::<Value>(),
        "robustness": number(known.expected.robustness),
        "predicate": known.decisive.as_ref().map(|decisive| &decisive.predicate),
        "minimized": shrunk.map(|Shrunk { minimized, space, has_same_predicate, repeats, .. }| json!({
            "scenario": run::scenario(space.axes(), minimized.original.request.scenario.values()),
            "robustness": minimized.original.robustness().map(number),
            "axes_off_nominal": [
                axes_off_nominal(space, &minimized.original.request.scenario),
                axes_off_nominal(space, &minimized.episode.request.scenario),
            ],
            "simulations": minimized.simulations,
            "complete": minimized.is_complete,
            "fewest_axes": minimized.has_fewest_axes,
            "same_predicate": has_same_predicate,
            "repeats": repeats.as_ref().map(simulate::repeats_document),
        })),
    })
}

fn text(
    path: &Path,
    same_as: Option<&Path>,
    mode: Option<usize>,
    known: &Counterexample,
    shrunk: Option<&Shrunk>,
) -> String {
    let mode = mode.map_or(String::new(), |mode| format!("mode {mode}, "));
    let found = format!("{mode}trial {}, simulation {}", known.trial, known.simulation);
    let name = |path: &Path| escape::name(&path.to_string_lossy());
    if let Some(same) = same_as {
        return format!("{found}: not written, its minimized scenario is within 1 % of {}", name(same));
    }
    let mut lines = vec![format!("{}: {found}", name(path))];
    let Some(Shrunk { minimized, space, has_same_predicate, repeats, is_interrupted }) = shrunk else {
        let values = scenario_text(known);
        lines.push(format!("  {values}: robustness {}", decimal(known.expected.robustness, 4)));
        return lines.join("\n");
    };
    let off = |scenario: &Scenario| run::axes(axes_off_nominal(space, scenario));
    let recorded = &minimized.original.request.scenario;
    lines.push(format!(
        "  recorded   {}: robustness {}, {} off nominal",
        run::scenario_summary(space.axes(), recorded.values()),
        decimal(minimized.original.robustness().unwrap_or(f64::NAN), 4),
        off(recorded),
    ));
    lines.push(format!(
        "  minimized  {}: robustness {}, {} off nominal",
        scenario_text(known),
        decimal(known.expected.robustness, 4),
        off(&minimized.episode.request.scenario),
    ));
    lines.push(format!("  {}", result_text(minimized, *is_interrupted)));
    if let (false, Some(decisive)) = (has_same_predicate, &known.decisive) {
        lines.push(format!("  its decisive predicate is another one: {}", escape::name(&decisive.predicate)));
    }
    if let Some(repeats) = repeats {
        lines.push(format!("  with other seeds it {}", simulate::failure_text(repeats)));
    }
    lines.join("\n")
}

/// Formats the values that are not nominal.
fn scenario_text(known: &Counterexample) -> String {
    let is_off = |axis: &&AxisValue| axis.value != axis.nominal;
    let value = |axis: &AxisValue| {
        let value = axis.value.map_or("random".to_string(), |value| match value.fract() == 0.0 {
            true if value.abs() < 1e9 => value.to_string(),
            _ => decimal(value, 4),
        });
        run::axis_value(&escape::name(&axis.axis), &value, &escape::name(&axis.unit))
    };
    let values: Vec<String> = known.scenario.iter().filter(is_off).map(value).collect();
    match (values.len(), known.scenario.len() - values.len()) {
        (0, _) => "the nominal scenario".to_string(),
        (_, 0) => values.join(", "),
        (_, 1) => format!("{}, the other axis nominal", values.join(", ")),
        (_, others) => format!("{}, the other {others} axes nominal", values.join(", ")),
    }
}

/// Describes how far a minimization came.
fn result_text(minimized: &Minimized, is_interrupted: bool) -> String {
    let simulations = plural(minimized.simulations, "simulation");
    let axes = match minimized.has_fewest_axes {
        true => "no smaller set of axes fails at the recorded values",
        false => "no single axis can go to nominal; smaller sets were not all tried",
    };
    match minimized.is_complete {
        true => format!("{simulations}: {axes}; no axis can move by 1 % of its width toward nominal"),
        false if is_interrupted => format!("{simulations}: interrupted before the end of the minimization"),
        false => format!("{simulations}: the budget ended before the minimization; give a larger --budget"),
    }
}
