//! Maintains the controllers that come with the repository.

mod arguments;
mod list;
mod reporter;

use std::process::ExitCode;

use anyhow::{Result, bail};
use mishandle_studies::zoo::{LocalRunner, Selection, Zoo, ZooError, ZooFolder};

use super::{interrupt, message, print, repository};
pub use arguments::Arguments;
use arguments::{Jobs, Part, ZooCommand};
use reporter::Reporter;

pub fn run(command: &ZooCommand) -> Result<ExitCode> {
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
                     `studies zoo measure --only {only}` measures it"
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

fn selected<'a>(zoo: Zoo<'a>, part: &Part) -> Zoo<'a> {
    let Part { only, adopt } = part;
    zoo.with_selection(Selection { only: only.clone() }).with_adoption(*adopt)
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
