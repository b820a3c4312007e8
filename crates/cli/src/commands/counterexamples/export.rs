use std::io::Write;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail, ensure};
use clap::Args;
use mishandle::counterexample::{Counterexample, MinimizedFrom};
use mishandle::falsification::{
    Minimized, Repeated, axes_off_nominal, is_close, minimize, repeat, repeat_seeds,
};
use mishandle::files::NewFolders;
use mishandle::resolve::named_scenario;
use mishandle::results::{self, ExportedCounterexample, Exports, Repeats};
use mishandle::rollout::{Scenario, Seed, Space};
use mishandle::store::RunFile;
use mishandle::{Plan, ResolvedPlan};
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
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = numbers::integer::<usize>(flags::THREADS))]
    pub threads: Option<usize>,
    /// Print one JSON document to stdout
    #[arg(long)]
    pub json: bool,
}

/// Default number of simulations of a minimization.
const BUDGET: u64 = 300;

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
    repeats: Option<Repeats>,
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
        command.all || flags::is_file(&command.out),
        "--out is {}; it must end with .json, by which `replay` recognizes a counterexample",
        command.out.display()
    );
    let file = run::read(&command.file, command.skip_check)?;
    let chosen = choose(command, &file)?;
    let resolved = match command.minimize {
        true => Some(mishandle::resolve::recorded_plan(file.header(), command.controller.as_deref())?),
        false => None,
    };
    if let Some(resolved) = &resolved {
        run::report_build_differences("made", &mishandle::replay::build_differences(file.header(), resolved));
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
    let mut exported = Vec::new();
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
        exported.push(result(&path, same_as.as_deref(), mode, &counterexample, shrunk.as_ref()));
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
    let found = Exports {
        run: command.file.to_string_lossy().into_owned(),
        files: exported,
        space_axes: mishandle::run::recorded_axes(&file.header().axes),
    };
    match command.json {
        true => output::json(&found)?,
        false => output::line(&exports::text(&found))?,
    }
    if let Some(name) = written.first().and_then(|written| written.controller.strip_prefix("./")) {
        output::message(&format!(
            "the controller is not shipped: copy {} to the folder of the counterexamples, or give --controller FILE",
            escape::name(name)
        ));
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
    let modes = mishandle::inspect::failure_modes(file)?.modes;
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
    let repeats = match mishandle::resolve::depends_on_seed(resolved, scenario) {
        true if run::control_flow().is_continue() => {
            let seeds = repeat_seeds(Seed(counterexample.seed), Repeated::Counterexample.simulations());
            Some(repeat(&mut *system, scenario, seeds, |_| run::control_flow())?)
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

fn result(
    path: &Path,
    same_as: Option<&Path>,
    mode: Option<usize>,
    known: &Counterexample,
    shrunk: Option<&Shrunk>,
) -> ExportedCounterexample {
    let text = |path: &Path| path.to_string_lossy().into_owned();
    ExportedCounterexample {
        file: same_as.is_none().then(|| text(path)),
        same_as: same_as.map(text),
        mode: mode.map(|mode| mode as u64),
        trial: known.trial,
        simulation: known.simulation,
        seed: results::Seed(known.seed),
        scenario: known.scenario.iter().map(|axis| (axis.axis.clone(), axis.value)).collect(),
        robustness: known.expected.robustness.into(),
        predicate: known.decisive.as_ref().map(|decisive| decisive.predicate.clone()),
        minimized: shrunk.map(minimized_result),
    }
}

fn minimized_result(shrunk: &Shrunk) -> results::Minimized {
    let Shrunk { minimized, space, has_same_predicate, repeats, is_interrupted } = shrunk;
    let recorded = &minimized.original.request.scenario;
    let off = |scenario: &Scenario| axes_off_nominal(space, scenario) as u64;
    results::Minimized {
        scenario: named_scenario(space.axes(), recorded.values()),
        robustness: minimized.original.robustness().map(Into::into),
        axes_off_nominal: [off(recorded), off(&minimized.episode.request.scenario)],
        simulations: minimized.simulations,
        complete: minimized.is_complete,
        interrupted: *is_interrupted,
        fewest_axes: minimized.has_fewest_axes,
        same_predicate: *has_same_predicate,
        repeats: repeats.clone(),
    }
}
