mod junit;

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use anyhow::{Chain, Context, Result, anyhow, ensure};
use clap::Args;
use mishandle::counterexample::{Counterexample, Regression};
use mishandle::results::{self, BaselineTest, Number, RegressionTest, Repeats};
use mishandle_text::{decimal, plural};

use crate::exit_status::ExitStatus;
use crate::flags::{self, numbers};
use crate::run::{self, counterexample};
use crate::show::progress::Bar;
use crate::show::{escape, output, regression, repeats};

/// Failure rates.
const RATE: &str = "a number from 0 to 1, such as 0.05";

fn is_rate(rate: f64) -> bool {
    (0.0..=1.0).contains(&rate)
}

/// Simulate a folder of counterexamples with another controller, and report which still fail
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  mishandle regress failures --controller my_controller.safetensors
  mishandle regress failures --controller ppo --junit report.xml
  mishandle regress failures --controller ppo --repeat 100 --max-failure-rate 0.05
  mishandle regress failures --controller new.safetensors --baseline old.safetensors

Each file *.json in the folder is one test. It passes if the scenario satisfies the formula. Exit
code 0 means that all pass, 1 that at least one still fails, 2 that a test could not run. With
--baseline, 1 means that at least one fails that passes with the baseline.")]
pub struct Arguments {
    /// Folder with files of `mishandle counterexamples export`
    #[arg(value_name = "DIR")]
    pub folder: PathBuf,
    /// Controller: the path of a .safetensors or .onnx file, or the name of a shipped controller
    /// [default: the one of each counterexample]
    #[arg(long, value_name = "C")]
    pub controller: Option<String>,
    /// Controller to compare with, simulated like the one of --controller: only a test that fails although it passes with the
    /// baseline counts as a failure
    #[arg(long, value_name = "C")]
    pub baseline: Option<String>,
    /// Number of simulations with other random seeds, which decide the test; without it, the recorded seed does
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = numbers::integer::<u32>(flags::REPEATS))]
    pub repeat: Option<u32>,
    /// With --repeat: largest failure rate of a test that passes [default: 0]
    #[arg(long, value_name = "RATE", requires = "repeat", allow_negative_numbers = true)]
    #[arg(value_parser = numbers::number(RATE, is_rate))]
    pub max_failure_rate: Option<f64>,
    /// Write the results to this file as JUnit XML; an existing file is replaced
    #[arg(long, value_name = "FILE")]
    pub junit: Option<PathBuf>,
    /// Number of threads; does not affect the results [default: number of cores]
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = numbers::integer::<usize>(flags::THREADS))]
    pub threads: Option<usize>,
    /// Print one JSON document to stdout
    #[arg(long)]
    pub json: bool,
}

/// A counterexample of the folder and what became of it.
struct Test {
    /// Name of the file without extension.
    name: String,
    file: String,
    /// `None` if the file could not be read.
    recorded: Option<Counterexample>,
    result: Result<Regression>,
    /// The same test with the baseline; `None` without one.
    baseline: Option<Result<Regression>>,
    outcome: Outcome,
    time: Duration,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Outcome {
    Passes,
    /// It passes, and fails with the baseline.
    Fixed,
    Fails,
    /// It fails, and passes with the baseline.
    NewFailure,
    Error,
}

impl Outcome {
    fn name(self) -> &'static str {
        match self {
            Outcome::Passes => "passes",
            Outcome::Fixed => "fixed",
            Outcome::Fails => "still fails",
            Outcome::NewFailure => "new failure",
            Outcome::Error => "error",
        }
    }

    /// Returns the outcome of a test that does or does not fail, now and with the baseline.
    fn new(fails: bool, fails_with_baseline: Option<bool>) -> Outcome {
        match (fails, fails_with_baseline) {
            (false, Some(true)) => Outcome::Fixed,
            (false, _) => Outcome::Passes,
            (true, Some(false)) => Outcome::NewFailure,
            (true, _) => Outcome::Fails,
        }
    }

    /// Returns whether the outcome is a failure of the suite, which the exit code and JUnit report.
    fn is_failure(self, has_baseline: bool) -> bool {
        self == Outcome::NewFailure || (self == Outcome::Fails && !has_baseline)
    }
}

pub fn run(command: &Arguments) -> Result<ExitStatus> {
    run::set_threads(command.threads)?;
    let files = files(&command.folder)?;
    ensure!(
        !files.is_empty(),
        "there is no counterexample (*.json) in {}; write some with `mishandle counterexamples export`",
        command.folder.display()
    );
    if let Some(path) = &command.junit {
        let controllers = [&command.controller, &command.baseline].into_iter().flatten().map(Path::new);
        output::refuse_inputs(path, "--junit", files.iter().map(PathBuf::as_path).chain(controllers))?;
    }
    let repeats = u64::from(command.repeat.unwrap_or(0));
    let simulations = (1 + repeats) * if command.baseline.is_some() { 2 } else { 1 };
    let bar = Bar::new(files.len() as u64 * simulations, "simulations");
    run::stop_on_signals(&bar)?;
    let mut tests = Vec::new();
    for (index, path) in files.iter().enumerate() {
        let done = test(command, path, &bar, index as u64 * simulations);
        // A test that was interrupted has no result.
        if run::control_flow().is_break() {
            break;
        }
        tests.push(done);
    }
    bar.clear();
    let is_complete = tests.len() == files.len();
    if let (Some(path), true) = (&command.junit, is_complete) {
        let name = command.folder.to_string_lossy();
        output::write_atomically(path, true, junit::report(&name, &tests).as_bytes())?;
    }
    let found = result(command, &tests, is_complete);
    if command.json {
        output::json(&found)?;
    } else {
        output::line(&regression::text(&found))?;
    }
    regression::report_problems(&found);
    if !is_complete {
        let junit = if command.junit.is_some() { "; the JUnit file is not written" } else { "" };
        output::message(&format!(
            "interrupted: the results of {} of {} are printed, the others are lost{junit}",
            tests.len(),
            plural(files.len(), "counterexample")
        ));
        return Ok(ExitStatus::Interrupted);
    }
    let errors = count(&tests, &[Outcome::Error]);
    ensure!(errors == 0, "{errors} of {} could not run", plural(tests.len(), "test"));
    let fails = tests.iter().any(|test| test.outcome.is_failure(command.baseline.is_some()));
    Ok(if fails { ExitStatus::Violated } else { ExitStatus::Done })
}

/// Returns the files *.json of a folder, sorted by name, except for descriptions of ONNX models (NAME.onnx.json).
fn files(folder: &Path) -> Result<Vec<PathBuf>> {
    let read = || format!("cannot read the folder {}", folder.display());
    let mut files = Vec::new();
    for entry in std::fs::read_dir(folder).with_context(read)? {
        let path = entry.with_context(read)?.path();
        let describes_onnx =
            path.file_stem().is_some_and(|stem| mishandle::resolve::is_onnx(Path::new(stem)));
        if flags::is_file(&path) && !describes_onnx {
            files.push(path);
        }
    }
    files.sort();
    Ok(files)
}

/// Simulates a counterexample. `done` is the number of simulations before it, for the progress bar.
fn test(command: &Arguments, path: &Path, bar: &Bar, mut done: u64) -> Test {
    let start = Instant::now();
    let file_name = |name: Option<&std::ffi::OsStr>| name.unwrap_or_default().to_string_lossy().into_owned();
    let recorded = counterexample::read(path);
    let mut simulated = |controller: Option<&str>| -> Result<Regression> {
        let counterexample =
            recorded.as_ref().map_err(|error| anyhow!(output::with_causes(error.chain())))?;
        let repeats = u64::from(command.repeat.unwrap_or(0));
        let found =
            mishandle::counterexample::regress(counterexample, &command.folder, controller, repeats, |_| {
                done += 1;
                bar.set_position(done);
                run::control_flow()
            });
        Ok(found?)
    };
    let result = simulated(command.controller.as_deref());
    let baseline = command.baseline.as_deref().map(|controller| simulated(Some(controller)));
    let max_failure_rate = command.max_failure_rate.unwrap_or(0.0);
    let outcome = match (&result, &baseline) {
        (Ok(found), None) => fails(found, max_failure_rate).map(|fails| Outcome::new(fails, None)),
        (Ok(found), Some(Ok(other))) => fails(found, max_failure_rate)
            .zip(fails(other, max_failure_rate))
            .map(|(now, before)| Outcome::new(now, Some(before))),
        _ => None,
    };
    Test {
        name: file_name(path.file_stem()),
        file: file_name(path.file_name()),
        outcome: outcome.unwrap_or(Outcome::Error),
        recorded: recorded.ok(),
        result,
        baseline,
        time: start.elapsed(),
    }
}

/// Returns whether a test fails: by the failure rate with other seeds, or without repeats by the robustness with the recorded seed.
/// `None` if a simulation has no verdict, because a rate of the others would say nothing about it.
fn fails(found: &Regression, max_failure_rate: f64) -> Option<bool> {
    match &found.repeats {
        None => found.episode.robustness().map(|rho| rho < 0.0),
        Some(repeats) if repeats.failure_rate.n < repeats.simulations => None,
        Some(repeats) => repeats.failure_rate.value.map(|rate| rate > max_failure_rate),
    }
}

/// Describes why a test fails or could not run: the decisive predicate with its values, the failure rate, or the error.
fn reason(test: &Test) -> String {
    let of_baseline =
        test.baseline.as_ref().and_then(problem).map(|problem| format!("with the baseline: {problem}"));
    if let Some(problem) = problem(&test.result).or(of_baseline) {
        return problem;
    }
    let Ok(found) = &test.result else { return String::new() };
    let robustness = found.episode.robustness().unwrap_or(f64::NAN);
    let decisive = found.explained.explanation.diagnosis.predicate.as_ref().map(|predicate| {
        format!(
            "{} at {}: {}",
            predicate.text,
            mishandle_text::instant(predicate.sample, found.header.control_dt),
            escape::name(&mishandle::inspect::compared_values(predicate))
        )
    });
    let rate = found.repeats.as_ref().map(repeats::failure_text);
    let parts = [rate, Some(format!("robustness {}", decimal(robustness, 4))), decisive];
    parts.into_iter().flatten().collect::<Vec<_>>().join("; ")
}

/// Describes why simulations give no outcome; `None` if they do.
fn problem(result: &Result<Regression>) -> Option<String> {
    match result {
        Err(error) => Some(output::with_causes(Chain::new(error.as_ref()))),
        Ok(Regression { repeats: Some(Repeats { simulations, failure_rate, .. }), .. })
            if failure_rate.n < *simulations =>
        {
            Some(format!(
                "{} of {} without a verdict",
                simulations - failure_rate.n,
                plural(*simulations, "repeat")
            ))
        }
        Ok(_) => None,
    }
}

fn count(tests: &[Test], outcomes: &[Outcome]) -> usize {
    tests.iter().filter(|test| outcomes.contains(&test.outcome)).count()
}

/// Outcomes of tests that pass and that fail.
const PASSES: [Outcome; 2] = [Outcome::Passes, Outcome::Fixed];
const FAILS: [Outcome; 2] = [Outcome::Fails, Outcome::NewFailure];

fn result(command: &Arguments, tests: &[Test], is_complete: bool) -> results::Regression {
    let robustness = |found: &Regression| -> Option<Number> { found.episode.robustness().map(Into::into) };
    let test = |test: &Test| {
        let found = test.result.as_ref().ok();
        let predicate = found.and_then(|found| found.explained.explanation.diagnosis.predicate.as_ref());
        let recorded = test.recorded.as_ref();
        RegressionTest {
            file: test.file.clone(),
            target: recorded.map(|recorded| recorded.target.name.clone()),
            result: test.outcome.name().to_string(),
            recorded_robustness: recorded.map(|recorded| recorded.expected.robustness.into()),
            robustness: found.and_then(robustness),
            predicate: predicate.map(|predicate| predicate.text.clone()),
            sample: predicate.map(|predicate| predicate.sample as u64),
            values: predicate.map(|predicate| predicate.values.map(Into::into)),
            same_target: found.and_then(|found| found.has_other_target).map(|is_other| !is_other),
            repeats: found.and_then(|found| found.repeats.clone()),
            reason: (!PASSES.contains(&test.outcome)).then(|| reason(test)),
            baseline: test.baseline.as_ref().map(|baseline| {
                let found = baseline.as_ref().ok();
                BaselineTest {
                    robustness: found.and_then(robustness),
                    repeats: found.and_then(|found| found.repeats.clone()),
                }
            }),
        }
    };
    let number = |outcomes: &[Outcome]| count(tests, outcomes) as u64;
    let with_baseline = |outcome| command.baseline.as_ref().map(|_| number(&[outcome]));
    results::Regression {
        folder: command.folder.to_string_lossy().into_owned(),
        controller: command.controller.clone(),
        baseline: command.baseline.clone(),
        passes: number(&PASSES),
        fails: number(&FAILS),
        errors: number(&[Outcome::Error]),
        new_failures: with_baseline(Outcome::NewFailure),
        fixed: with_baseline(Outcome::Fixed),
        is_complete,
        tests: tests.iter().map(test).collect(),
    }
}
