mod junit;

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use anyhow::{Chain, Context, Result, ensure};
use clap::Args;
use mishandle::{Counterexample, Regression, plural};
use serde_json::{Value, json};

use super::{counterexamples, simulate};
use crate::output::{self, number};
use crate::progress::Bar;
use crate::{ExitStatus, args, escape, numbers, run};

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

Each file *.json in the folder is one test. It passes if the scenario satisfies the formula. Exit
code 0 means that all pass, 1 that at least one still fails, 2 that a test could not run.")]
pub struct Arguments {
    /// Folder with files of `mishandle counterexamples export`
    #[arg(value_name = "DIR")]
    pub folder: PathBuf,
    /// Controller: the path of a .safetensors or .onnx file, or the name of a shipped controller
    /// [default: the one of each counterexample]
    #[arg(long, value_name = "C")]
    pub controller: Option<String>,
    /// Number of simulations with other random seeds, which decide the test; without it, the recorded seed does
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = numbers::integer::<u32>(args::REPEATS))]
    pub repeat: Option<u32>,
    /// With --repeat: largest failure rate of a test that passes [default: 0]
    #[arg(long, value_name = "RATE", requires = "repeat", allow_negative_numbers = true)]
    #[arg(value_parser = numbers::number(RATE, is_rate))]
    pub max_failure_rate: Option<f64>,
    /// Write the results to this file as JUnit XML; an existing file is replaced
    #[arg(long, value_name = "FILE")]
    pub junit: Option<PathBuf>,
    /// Number of threads; does not affect the results [default: number of cores]
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = numbers::integer::<usize>(args::THREADS))]
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
    outcome: Outcome,
    time: Duration,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Outcome {
    Passes,
    Fails,
    Error,
}

impl Outcome {
    fn name(self) -> &'static str {
        match self {
            Outcome::Passes => "passes",
            Outcome::Fails => "still fails",
            Outcome::Error => "error",
        }
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
    let repeats = u64::from(command.repeat.unwrap_or(0));
    let bar = Bar::new(files.len() as u64 * (1 + repeats), "simulations");
    let mut tests = Vec::new();
    for (index, path) in files.iter().enumerate() {
        tests.push(test(command, path, &bar, index as u64 * (1 + repeats)));
    }
    bar.clear();
    if let Some(path) = &command.junit {
        let name = command.folder.to_string_lossy();
        output::write_atomically(path, true, junit::report(&name, &tests).as_bytes())?;
    }
    if command.json {
        output::json(document(command, &tests))?;
    } else {
        output::line(&text(&tests))?;
    }
    report_problems(&tests);
    let has = |outcome| tests.iter().any(|test| test.outcome == outcome);
    if has(Outcome::Error) {
        let errors = tests.iter().filter(|test| test.outcome == Outcome::Error).count();
        anyhow::bail!("{} of {} could not run", errors, plural(tests.len(), "test"));
    }
    Ok(if has(Outcome::Fails) { ExitStatus::Violated } else { ExitStatus::Done })
}

/// Returns the files *.json of a folder, sorted by name, except for descriptions of ONNX models (NAME.onnx.json).
fn files(folder: &Path) -> Result<Vec<PathBuf>> {
    let read = || format!("cannot read the folder {}", folder.display());
    let mut files = Vec::new();
    for entry in std::fs::read_dir(folder).with_context(read)? {
        let path = entry.with_context(read)?.path();
        let describes_onnx = path.file_stem().is_some_and(|stem| mishandle::is_onnx(Path::new(stem)));
        if counterexamples::is_file(&path) && !describes_onnx {
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
    let mut recorded = None;
    let result = counterexamples::read(path).and_then(|counterexample| {
        let found = mishandle::regress(
            &counterexample,
            &command.folder,
            command.controller.as_deref(),
            u64::from(command.repeat.unwrap_or(0)),
            |_| {
                done += 1;
                bar.set_position(done);
            },
        );
        recorded = Some(counterexample);
        Ok(found?)
    });
    Test {
        name: file_name(path.file_stem()),
        file: file_name(path.file_name()),
        outcome: outcome(&result, command.max_failure_rate.unwrap_or(0.0)),
        recorded,
        result,
        time: start.elapsed(),
    }
}

/// Returns the outcome: by the failure rate with other seeds, or without repeats by the robustness with the recorded seed.
fn outcome(result: &Result<Regression>, max_failure_rate: f64) -> Outcome {
    let Ok(found) = result else { return Outcome::Error };
    let fails = match &found.repeats {
        None => found.episode.robustness().is_none_or(|rho| rho < 0.0),
        Some(repeats) => match repeats.failure_rate.value {
            Some(rate) => rate > max_failure_rate,
            None => return Outcome::Error,
        },
    };
    if fails { Outcome::Fails } else { Outcome::Passes }
}

/// Describes why a test fails or could not run: the decisive predicate with its values, the failure rate, or the error.
fn reason(test: &Test) -> String {
    let found = match &test.result {
        Ok(found) => found,
        Err(error) => return output::with_causes(Chain::new(error.as_ref())),
    };
    let robustness = found.episode.robustness().unwrap_or(f64::NAN);
    let decisive = found.explained.explanation.diagnosis.predicate.as_ref().map(|predicate| {
        format!(
            "{} at {}: {}",
            predicate.text,
            mishandle::instant(predicate.sample, found.header.control_dt),
            escape::name(&mishandle::compared_values(predicate))
        )
    });
    let rate = found.repeats.as_ref().map(simulate::failure_text);
    let parts = [rate, Some(format!("robustness {robustness:.4}")), decisive];
    parts.into_iter().flatten().collect::<Vec<_>>().join("; ")
}

/// Reports on stderr what is uncertain about the results.
fn report_problems(tests: &[Test]) {
    for test in tests {
        match &test.result {
            Err(_) => output::message(&format!("error: {}: {}", escape::name(&test.file), reason(test))),
            Ok(found) if found.has_other_target == Some(true) => output::message(&format!(
                "warning: {}: the target has changed since the counterexample was recorded, so its scenario may have \
                 another meaning",
                escape::name(&test.file)
            )),
            Ok(_) => {}
        }
    }
}

fn count(tests: &[Test], outcome: Outcome) -> usize {
    tests.iter().filter(|test| test.outcome == outcome).count()
}

fn document(command: &Arguments, tests: &[Test]) -> Value {
    let test = |test: &Test| {
        let found = test.result.as_ref().ok();
        let predicate = found.and_then(|found| found.explained.explanation.diagnosis.predicate.as_ref());
        json!({
            "file": test.file,
            "target": test.recorded.as_ref().map(|recorded| &recorded.target.name),
            "result": test.outcome.name(),
            "recorded_robustness": test.recorded.as_ref().map(|recorded| number(recorded.expected.robustness)),
            "robustness": found.and_then(|found| found.episode.robustness()).map(number),
            "predicate": predicate.map(|predicate| &predicate.text),
            "sample": predicate.map(|predicate| predicate.sample),
            "values": predicate.map(|predicate| predicate.values.map(number)),
            "same_target": found.and_then(|found| found.has_other_target).map(|is_other| !is_other),
            "repeats": found.and_then(|found| found.repeats.as_ref()).map(simulate::repeats_document),
            "reason": if test.outcome == Outcome::Passes { Value::Null } else { json!(reason(test)) },
        })
    };
    json!({
        "folder": command.folder.to_string_lossy(),
        "controller": command.controller,
        "passes": count(tests, Outcome::Passes),
        "fails": count(tests, Outcome::Fails),
        "errors": count(tests, Outcome::Error),
        "tests": tests.iter().map(test).collect::<Vec<_>>(),
    })
}

fn text(tests: &[Test]) -> String {
    let has_repeats =
        tests.iter().any(|test| test.result.as_ref().is_ok_and(|found| found.repeats.is_some()));
    let mut columns = vec!["file", "recorded robustness", "robustness now"];
    columns.extend(has_repeats.then_some("failure rate"));
    columns.push("result");
    let mut rows = vec![columns.into_iter().map(String::from).collect::<Vec<_>>()];
    for test in tests {
        let value = |value: Option<f64>| value.map_or("-".to_string(), |value| format!("{value:.4}"));
        let found = test.result.as_ref().ok();
        let mut row = vec![
            test.file.clone(),
            value(test.recorded.as_ref().map(|recorded| recorded.expected.robustness)),
            value(found.and_then(|found| found.episode.robustness())),
        ];
        if has_repeats {
            let rate = found.and_then(|found| found.repeats.as_ref()?.failure_rate.value);
            row.push(rate.map_or("-".to_string(), |rate| format!("{:.1} %", 100.0 * rate)));
        }
        row.push(test.outcome.name().to_string());
        rows.push(row);
    }
    let failing = tests.iter().filter(|test| test.outcome == Outcome::Fails);
    let reasons: String =
        failing.map(|test| format!("\n{}: {}", escape::name(&test.file), reason(test))).collect();
    let gap = if reasons.is_empty() { "" } else { "\n" };
    format!(
        "{}\n\n{}: {} pass, {} still fail, {}{gap}{reasons}",
        output::table(&rows),
        plural(tests.len(), "counterexample"),
        count(tests, Outcome::Passes),
        count(tests, Outcome::Fails),
        plural(count(tests, Outcome::Error), "error"),
    )
}
