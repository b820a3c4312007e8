mod junit_xml;

use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Context, Result, ensure};
use clap::Args;
use mishandle::counterexample::{Suite, Tested};
use mishandle_text::plural;

use crate::exit_status::ExitStatus;
use crate::flags::{self, numbers};
use crate::run;
use crate::show::progress::Bar;
use crate::show::{output, regression};

pub use junit_xml::report as junit;

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
    /// Controller to compare with, simulated like the one of --controller: only a test that fails
    /// although it passes with the baseline counts as a failure
    #[arg(long, value_name = "C")]
    pub baseline: Option<String>,
    /// Number of simulations with other random seeds, which decide the test; without it, the
    /// recorded seed does
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

pub fn run(command: &Arguments) -> Result<ExitStatus> {
    run::set_threads(command.threads)?;
    let suite = Suite {
        folder: &command.folder,
        tested: Tested::Controllers {
            controller: command.controller.as_deref(),
            baseline: command.baseline.as_deref(),
        },
        repeats: u64::from(command.repeat.unwrap_or(0)),
        max_failure_rate: command.max_failure_rate.unwrap_or(0.0),
    };
    let read = || format!("cannot read the folder {}", command.folder.display());
    let files = suite.files().with_context(read)?;
    ensure!(
        !files.is_empty(),
        "there is no counterexample (*.json) in {}; write some with `mishandle counterexamples export`",
        command.folder.display()
    );
    if let Some(path) = &command.junit {
        let controllers = [&command.controller, &command.baseline].into_iter().flatten().map(Path::new);
        output::refuse_inputs(path, "--junit", files.iter().map(PathBuf::as_path).chain(controllers))?;
    }
    let bar = Bar::new(files.len() as u64 * suite.simulations(), "simulations");
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
    let fails = found.new_failures.unwrap_or(found.fails) > 0;
    Ok(if fails { ExitStatus::Violated } else { ExitStatus::Done })
}
