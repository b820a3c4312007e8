//! The development program `zoo`: maintains the controllers that come with the repository.
//!
//! Data goes to stdout, everything else to stderr. Exit codes: 0 success, 2 error, 130 interrupted.

mod arguments;
mod interrupt;
mod list;
mod reporter;

use std::io::Write;
use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::{Context, Result, bail};
use clap::Parser;
use mishandle_zoo::{LocalRunner, Selection, Zoo, ZooError, ZooFolder};

use arguments::{CommandLine, Jobs, Part, ZooCommand};
use reporter::{Reporter, message};

fn main() -> ExitCode {
    match run(&CommandLine::parse().command) {
        Ok(code) => code,
        Err(error) => {
            message(&format!("error: {error:#}"));
            ExitCode::from(2)
        }
    }
}

fn run(command: &ZooCommand) -> Result<ExitCode> {
    let runner = LocalRunner::new()?;
    let reporter = Reporter::new();
    let zoo = Zoo::new(ZooFolder::new(&repository()?), &runner, &reporter, &interrupt::requested);
    match command {
        ZooCommand::List { part, json } => {
            let zoo = selected(zoo, part);
            let entries = zoo.entries()?;
            if let (true, Some(only)) = (entries.is_empty(), &part.only) {
                bail!(
                    "--only is {only}; an expert is not trained, so the list of training runs does not have it: \
                     `zoo measure --only {only}` measures it"
                );
            }
            print(&if *json { list::json(&zoo, &entries)? } else { list::text(&zoo, &entries) })?;
            Ok(ExitCode::SUCCESS)
        }
        ZooCommand::Train { part, jobs } => finish(with_jobs(selected(zoo, part), jobs)?.train()),
        ZooCommand::Measure { part, jobs, again, json } => {
            let zoo = with_jobs(selected(zoo, part), jobs)?;
            let code = finish(zoo.measure(*again))?;
            if *json && code == ExitCode::SUCCESS {
                print(&list::json(&zoo, &zoo.entries()?)?)?;
            }
            Ok(code)
        }
        ZooCommand::Import { folder, part } => {
            interrupt::listen()?;
            finish(selected(zoo, part).import(folder))
        }
        ZooCommand::Tables => finish(zoo.write_pages()),
    }
}

/// Returns the clone of the repository to work in.
fn repository() -> Result<PathBuf> {
    let root = mishandle::shipped::home().context(
        "expected a clone of the repository around the program; name one in the environment variable MISHANDLE_HOME",
    )?;
    if !root.join("experiments/training").is_dir() || !root.join("controllers/README.md").is_file() {
        bail!("expected a clone of the repository at {}; set MISHANDLE_HOME to one", root.display());
    }
    Ok(root)
}

fn selected<'a>(zoo: Zoo<'a>, part: &Part) -> Zoo<'a> {
    let Part { only, seeds, adopt } = part;
    zoo.with_selection(Selection { only: only.clone(), seeds: seeds.clone() }).with_adoption(*adopt)
}

/// Sets the number of jobs, and makes signals end them after an iteration or a batch.
fn with_jobs<'a>(zoo: Zoo<'a>, jobs: &Jobs) -> Result<Zoo<'a>> {
    interrupt::listen()?;
    let all_cores = || std::thread::available_parallelism().map_or(1, usize::from);
    Ok(zoo.with_workers(jobs.jobs.map_or_else(all_cores, usize::from)))
}

/// Turns an interruption into an exit code.
fn finish(result: Result<(), ZooError>) -> Result<ExitCode> {
    match result {
        Ok(()) => Ok(ExitCode::SUCCESS),
        Err(error @ (ZooError::Interrupted | ZooError::InterruptedWith { .. })) => {
            message(&error.to_string());
            Ok(ExitCode::from(interrupt::EXIT_CODE))
        }
        Err(error) => Err(error.into()),
    }
}

/// Prints data to stdout.
fn print(text: &str) -> Result<()> {
    writeln!(std::io::stdout().lock(), "{text}")?;
    Ok(())
}
