//! The command line of Mishandle.
//!
//! Words go to stderr, data to stdout. Exit codes: 0 done, 1 falsified or violated, 2 an error, 130 interrupted.

mod args;
mod commands;
mod count;
mod interrupt;
mod live_curve;
mod output;
mod progress;
mod run;
mod train_watch;
mod training_time;
mod video;

use std::ffi::OsString;
use std::process::ExitCode;

use clap::Parser;
use mishandle::tasks::Task;

use args::{Arguments, Command};

/// Name of the program.
const PROGRAM: &str = "mishandle";

/// Runs the program on the arguments of the process.
///
pub fn main() -> ExitCode {
    main_with_tasks(&[])
}

/// Runs the program on the arguments of the process, with tasks of your own beside the benchmark's.
///
/// A task with a mistake in its definition ends the program before any command, with exit code 2.
pub fn main_with_tasks(tasks: &[&'static dyn Task]) -> ExitCode {
    match tasks.iter().try_for_each(|task| mishandle::tasks::add(*task)) {
        Ok(()) => run_with(std::env::args_os()),
        Err(error) => {
            output::report_error(&error.into());
            ExitCode::from(2)
        }
    }
}

/// Runs the program on these arguments, the first of which is its own name.
pub fn run_with(arguments: impl IntoIterator<Item = OsString>) -> ExitCode {
    let arguments = match Arguments::try_parse_from(arguments) {
        Ok(arguments) => arguments,
        Err(error) => {
            // Help goes to stdout, whose reader may be gone.
            let _ = error.print();
            return ExitCode::from(error.exit_code() as u8);
        }
    };
    let outcome = match &arguments.command {
        Command::Tasks(command) => commands::tasks::run(command),
        Command::Targets(command) => commands::targets::run(command),
        Command::Searches(command) => commands::searches::run(command),
        Command::Monitor(command) => commands::monitor::run(command),
        Command::Train(command) => commands::train::run(command),
        Command::Controller(command) => commands::controller::run(command),
        Command::Curve(command) => commands::curve::run(command),
        Command::Evaluate(command) => commands::evaluate::run(command),
        Command::Falsify(command) => commands::falsify::run(command),
        Command::Replay(command) => commands::replay::run(command),
        Command::Render(command) => commands::render::run(command),
        Command::Zoo(command) => commands::zoo::run(command),
        Command::Completions(command) => commands::completions::run(command),
        Command::Man(command) => commands::man::run(command),
    };
    match outcome {
        Ok(ExitStatus::Done) => ExitCode::SUCCESS,
        Ok(ExitStatus::Violated) => ExitCode::from(1),
        Ok(ExitStatus::Interrupted) => ExitCode::from(interrupt::EXIT_CODE),
        Err(error) if output::is_broken_pipe(&error) => ExitCode::SUCCESS,
        Err(error) => {
            output::report_error(&error);
            ExitCode::from(2)
        }
    }
}

/// How a command that did its work ends.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum ExitStatus {
    /// Nothing was violated.
    Done,
    /// A counterexample was found, or a formula is violated.
    Violated,
    /// It was asked to end before it was done, and has saved what it had.
    Interrupted,
}
