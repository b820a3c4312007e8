mod add;
mod first_bad;
mod junit_xml;

use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Context, Result, bail, ensure};
use clap::Args;
use mishandle::counterexample::{Suite, Tested};
use mishandle::plan::{RegressSettings, Settings, Values};
use mishandle_text::plural;

use crate::exit_status::ExitStatus;
use crate::flags::{self, Planned, numbers};
use crate::run;
use crate::show::progress::Bar;
use crate::show::{escape, output, regression};

pub use junit_xml::report as junit;

/// Default folder of counterexamples.
const FOLDER: &str = "regressions";

/// Who has the question of a plan.
const QUESTION: &str = "only --first-bad with --rate asks";

/// Success rates.
const RATE: &str = "a number between 0 and 1, such as 0.95";

/// Test a folder of counterexamples with another controller, add to it, or find the first bad one
/// of several controllers
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  mishandle regress --add runs/RUN.sqlite                  keep the nearest failure in regressions
  mishandle regress failures --add runs/RUN.sqlite -k regress.all=true -k regress.minimize=true
  mishandle regress --add runs/RUN.sqlite -k regress.mode=2 --out failure.json
  mishandle regress --add runs/RUN.sqlite -k regress.trial=2 -k regress.simulation=17
  mishandle regress failures --controller my_controller.safetensors
  mishandle regress failures --controller ppo --junit report.xml
  mishandle regress failures --controller ppo --repeat 100 -k regress.max-failure-rate=0.05
  mishandle regress failures --controller new.safetensors --baseline old.safetensors
  mishandle regress failures --first-bad checkpoints
  mishandle regress --first-bad checkpoints --rate 0.95 -k target=point-reaching

Each file *.json in the folder is one test. It passes if the scenario satisfies the formula. Exit
code 0 means that all pass, 1 that at least one still fails, 2 that a test could not run, or that
none fails and one has no verdict. With --baseline, 1 means that at least one fails that passes with
the baseline.

--add writes the representative of a failure mode, or of each one, as such a file. regress.minimize
moves the scenario toward the nominal one while it still fails in its mode: as few axes as possible
off nominal, with offsets that cannot shrink by 1 % of the width of an axis. The random seed stays.
docs/guide/counterexamples.md describes the file.

--first-bad orders the controllers of a folder by name, with numbers by value. With --rate, it gives
all of them the same scenarios and seeds, and ends as soon as an interval that holds at any time is
on one side of the rate. What was simulated is kept in the folder of --out: the same command
continues, and `mishandle report` writes a page about the folder. Exit code 0 means that the first
bad one was found, 1 that it was not: the first one does not pass, the last one does not fail, or
those between are undecided.")]
pub struct Arguments {
    /// Folder of counterexamples, or with --first-bad also one file [default: regressions]
    #[arg(value_name = "FOLDER")]
    pub folder: Option<PathBuf>,
    /// Controller: the path of a .safetensors or .onnx file, or the name of a shipped controller
    /// [default: the one of each counterexample]
    #[arg(long, value_name = "C", conflicts_with = "other")]
    pub controller: Option<String>,
    /// Controller to compare with, simulated like the one of --controller: only a test that fails
    /// although it passes with the baseline counts as a failure
    #[arg(long, value_name = "C", conflicts_with = "other")]
    pub baseline: Option<String>,
    /// Number of simulations with other random seeds, which decide the test; without it, the
    /// recorded seed does
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = numbers::integer::<u32>(flags::REPEATS))]
    #[arg(conflicts_with = "other")]
    pub repeat: Option<u32>,
    /// Write the results to this file as JUnit XML; an existing file is replaced
    #[arg(long, value_name = "FILE", conflicts_with = "other")]
    pub junit: Option<PathBuf>,
    /// Write counterexamples of this run into FOLDER
    #[arg(long, value_name = "RUN", group = "other")]
    pub add: Option<PathBuf>,
    /// Find the first controller of this folder (*.safetensors, *.onnx), the oldest first, that
    /// violates a counterexample or, with --rate, falls below a success rate
    #[arg(long, value_name = "DIR", group = "other")]
    pub first_bad: Option<PathBuf>,
    /// With --first-bad: lowest success rate of a controller that passes
    #[arg(long, value_name = "RATE", requires = "first_bad", allow_negative_numbers = true)]
    #[arg(value_parser = numbers::number(RATE, |rate| 0.0 < rate && rate < 1.0))]
    pub rate: Option<f64>,
    /// With --add: file for one counterexample (.json); with --first-bad: folder of the result and
    /// of finished tests [default: runs/bisect]
    #[arg(long, value_name = "PATH", requires = "other")]
    pub out: Option<PathBuf>,
    /// With --add: overwrite existing files
    #[arg(long, requires = "add")]
    pub force: bool,
    /// With --rate: random seed, from 0 to 2^64 - 1 [default: 0, or the seed of the plan]
    #[arg(long, value_name = "N", requires = "first_bad", allow_negative_numbers = true)]
    #[arg(value_parser = numbers::integer::<u64>(flags::SEEDS))]
    pub seed: Option<u64>,
    /// Number of threads; does not affect the results [default: number of cores]
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = numbers::integer::<usize>(flags::THREADS))]
    pub threads: Option<usize>,
    /// Print one JSON document to stdout
    #[arg(long)]
    pub json: bool,
    #[command(flatten)]
    pub keys: flags::Keys,
}

impl Arguments {
    /// Returns the plan, with the values of flags and keys.
    fn planned(&self) -> Result<Planned> {
        let mut planned = Planned::new(&self.keys)?;
        planned.number("--repeat", "regress.repeat", self.repeat)?;
        planned.flag("--rate", "regress.rate", self.rate)?;
        planned.number("--seed", "seed", self.seed)?;
        planned.assign(&self.keys.keys, "regress", Values::One)?;
        Ok(planned)
    }

    /// Returns the settings, where no question is asked.
    fn settings(&self) -> Result<Settings> {
        self.planned()?.settings(QUESTION)
    }

    fn folder(&self) -> &Path {
        self.folder.as_deref().unwrap_or(Path::new(FOLDER))
    }
}

/// Keys of the table `[regress]` that a test, `--add` and `--first-bad` read.
const OF_TEST: &[&str] = &["repeat", "max-failure-rate"];
const OF_ADD: &[&str] = &["mode", "all", "trial", "simulation", "minimize", "budget"];
const OF_FIRST_BAD: &[&str] = &["rate", "every"];

pub fn run(command: &Arguments) -> Result<ExitStatus> {
    run::set_threads(command.threads)?;
    let read = match (&command.add, &command.first_bad) {
        (Some(_), _) => OF_ADD,
        (None, Some(_)) => OF_FIRST_BAD,
        (None, None) => OF_TEST,
    };
    let planned = command.planned()?;
    if let Some(key) = planned.stated_in("regress").find(|key| !read.contains(key)) {
        let read: Vec<String> = read.iter().map(|key| format!("regress.{key}")).collect();
        bail!("regress.{key} has no effect here; leave it out. These have: {}", read.join(", "));
    }
    match (&command.add, &command.first_bad) {
        (Some(run), _) => add::run(command, run),
        (None, Some(controllers)) => first_bad::run(command, controllers),
        (None, None) => test(command),
    }
}

/// Simulates the counterexamples of the folder.
fn test(command: &Arguments) -> Result<ExitStatus> {
    let RegressSettings { repeat, max_failure_rate, .. } = command.settings()?.regress;
    let folder = command.folder();
    let suite = Suite {
        folder,
        tested: Tested::Controllers {
            controller: command.controller.as_deref(),
            baseline: command.baseline.as_deref(),
        },
        repeats: u64::from(repeat.unwrap_or(0)),
        max_failure_rate,
    };
    let read = || format!("cannot read the folder {}", folder.display());
    let files = suite.files().with_context(read)?;
    ensure!(
        !files.is_empty(),
        "there is no counterexample (*.json) in {}; add some with `mishandle regress --add RUN`",
        folder.display()
    );
    if let Some(path) = &command.junit {
        let controllers = [&command.controller, &command.baseline].into_iter().flatten().map(Path::new);
        output::refuse_inputs(path, "--junit", files.iter().map(PathBuf::as_path).chain(controllers))?;
    }
    let simulations = files.len() as u64 * suite.simulations();
    output::message(&format!("at most {}", plural(simulations, "simulation")));
    let bar = Bar::new(simulations, "simulations");
    run::stop_on_signals(&bar)?;
    let mut tests = Vec::new();
    let mut times = Vec::new();
    for (index, path) in files.iter().enumerate() {
        let start = Instant::now();
        let mut done = index as u64 * suite.simulations();
        let test = suite.test(path, |_| {
            done += 1;
            bar.set_position(done);
            run::control_flow()
        });
        // A test that was interrupted has no result.
        if run::control_flow().is_break() {
            break;
        }
        tests.push(test);
        times.push(start.elapsed());
    }
    bar.clear();
    let is_complete = tests.len() == files.len();
    let found = suite.result(tests, is_complete);
    if let (Some(path), true) = (&command.junit, is_complete) {
        output::write_atomically(path, true, junit(&found, &times).as_bytes())?;
    }
    if command.json {
        output::json(&found)?;
    } else {
        output::line(&regression::text(&found))?;
    }
    regression::report_problems(&found);
    if !is_complete {
        let unwritten = if command.junit.is_some() { "; the file of --junit is not written" } else { "" };
        output::message(&format!(
            "interrupted: the results of {} of {} are printed, the others are lost{unwritten}",
            found.tests.len(),
            plural(files.len(), "counterexample")
        ));
        return Ok(ExitStatus::Interrupted);
    }
    let errors = found.errors;
    ensure!(errors == 0, "{errors} of {} could not run", plural(found.tests.len(), "test"));
    // With a baseline, a test that fails with both controllers is not a failure of the new one.
    if found.new_failures.unwrap_or(found.fails) > 0 {
        return Ok(ExitStatus::Violated);
    }
    // A counterexample without a verdict is not fixed.
    let undecided = found.without_verdict;
    ensure!(undecided == 0, "{undecided} of {} without a verdict", plural(found.tests.len(), "test"));
    if let Some(reason) = found.asks_nothing() {
        bail!("no conclusion: the tests ask nothing: {}", escape::name(reason));
    }
    Ok(ExitStatus::Done)
}
