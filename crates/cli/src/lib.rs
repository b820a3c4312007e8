//! The command line of Mishandle.
//!
//! Results go to stdout, messages to stderr. Exit codes: 0 success, 1 falsified or violated, 2 error, 130 interrupted.

mod args;
mod commands;
mod corners;
mod escape;
mod formula_error;
mod interrupt;
mod live_curve;
mod numbers;
mod output;
mod progress;
mod risk_text;
mod run;
mod screened_text;
mod train_reporter;
mod training_time;
mod video;

use std::ffi::OsString;
use std::process::ExitCode;

use clap::Parser;
use mishandle::tasks::Task;

use args::{Command, CommandLine};

/// Exit code after the reader of stdout closed the pipe: 128 plus the number of the signal SIGPIPE.
const BROKEN_PIPE: u8 = 141;

/// Name of the program.
const PROGRAM: &str = "mishandle";

/// Runs the program with the arguments of the process.
pub fn main() -> ExitCode {
    main_with_tasks(&[])
}

/// Runs the program with the arguments of the process and with your own tasks in addition to the benchmark's.
///
/// If the definition of a task is invalid, the program prints the error and returns exit code 2.
pub fn main_with_tasks(tasks: &[&'static dyn Task]) -> ExitCode {
    match tasks.iter().try_for_each(|task| mishandle::tasks::add(*task)) {
        Ok(()) => run_with(std::env::args_os()),
        Err(error) => {
            output::report_error(&error.into());
            ExitCode::from(2)
        }
    }
}

/// Runs the program with the given arguments. The first one is the name of the program.
pub fn run_with(arguments: impl IntoIterator<Item = OsString>) -> ExitCode {
    ExitCode::from(exit_code_of(arguments))
}

/// As [`run_with`], but returns the exit code as a number.
pub fn exit_code_of(arguments: impl IntoIterator<Item = OsString>) -> u8 {
    interrupt::report_file_size_limits();
    let words: Vec<OsString> = arguments.into_iter().collect();
    let arguments = match CommandLine::try_parse_from(&words) {
        Ok(arguments) => arguments,
        Err(error) => {
            output::usage(&error, &words);
            return error.exit_code() as u8;
        }
    };
    let status = match &arguments.command {
        Command::Tasks(command) => commands::tasks::run(command),
        Command::Targets(command) => commands::targets::run(command),
        Command::Searches(command) => commands::searches::run(command),
        Command::Monitor(command) => commands::monitor::run(command),
        Command::Train(command) => commands::train::run(command),
        Command::Controller(command) => commands::controller::run(command),
        Command::Curve(command) => commands::curve::run(command),
        Command::Evaluate(command) => commands::evaluate::run(command),
        Command::Falsify(command) => commands::falsify::run(command),
        Command::Campaign(command) => commands::campaign::run(command),
        Command::Reproduce(command) => commands::reproduce::run(command),
        Command::Compare(command) => commands::compare::run(command),
        Command::Margin(command) => commands::margin::run(command),
        Command::Risk(command) => commands::risk::run(command),
        Command::Simulate(command) => commands::simulate::run(command),
        Command::Runs(command) => commands::runs::run(command),
        Command::Export(command) => commands::export::run(command),
        Command::Replay(command) => commands::replay::run(command),
        Command::Explain(command) => commands::explain::run(command),
        Command::Counterexamples(command) => commands::counterexamples::run(command),
        Command::Regress(command) => commands::regress::run(command),
        Command::Render(command) => commands::render::run(command),
        Command::Report(command) => commands::report::run(command),
        Command::Completions(command) => commands::completions::run(command),
        Command::Man(command) => commands::man::run(command),
    };
    match status {
        Ok(ExitStatus::Done) => 0,
        Ok(ExitStatus::Violated) => 1,
        Ok(ExitStatus::Interrupted) => interrupt::EXIT_CODE,
        // As programs that the signal ends: 0 would hide a violation.
        Err(error) if output::is_broken_pipe(&error) => BROKEN_PIPE,
        Err(error) => {
            output::report_error(&error);
            2
        }
    }
}

/// Result of a command that ended without an error.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum ExitStatus {
    /// The command finished, and no formula was violated.
    Done,
    /// The command found a counterexample or a violated formula.
    Violated,
    /// A signal interrupted the command, which has saved its finished work.
    Interrupted,
}
