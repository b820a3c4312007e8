//! The command line of Mishandle.
//!
//! Results go to stdout, messages to stderr. Exit codes: 0 success, 1 falsified or violated, 2
//! error, 130 interrupted.

mod command_line;
mod commands;
mod exit_status;
mod flags;
mod interrupt;
mod run;
mod show;
pub mod words;

use std::ffi::OsString;
use std::process::ExitCode;

use mishandle::run::Device;
use mishandle::tasks::Task;
use mishandle::world::{CHILD_WORD, run_child, set_child_program};

pub use commands::junit;
pub use flags::reads_key;
pub use run::check_reports::write as write_check_reports;
pub use show::answer::below as answer_text;
pub use show::bisection::{command as bisection_command, text as bisection_text};
pub use show::check::text as check_text;
pub use show::cost::{text as cost_text, time_text};
pub use show::formula::text as formula_text;
pub use show::mining::text as mining_text;
pub use show::verdict::python_text as verdict_text;

use command_line::CommandLine;
use exit_status::ExitStatus;
use show::output;

/// Exit code after the reader of stdout closed the pipe: 128 plus the number of the signal SIGPIPE.
const BROKEN_PIPE: u8 = 141;

/// Runs the program with the arguments of the process.
pub fn main() -> ExitCode {
    main_with_tasks(&[])
}

/// Runs the program with the arguments of the process and with your own tasks in addition to the
/// benchmark's.
///
/// If the definition of a task is invalid, the program prints the error and returns exit code 2.
pub fn main_with_tasks(tasks: &[&'static dyn Task]) -> ExitCode {
    if let Ok(program) = std::env::current_exe() {
        set_child_program(vec![program.into(), CHILD_WORD.into()]);
    }
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
    ExitCode::from(exit_code_of(arguments, None))
}

/// As [`run_with`], but returns the exit code as a number. `gpu` is the device `gpu` of this
/// process, if it has one.
pub fn exit_code_of(arguments: impl IntoIterator<Item = OsString>, gpu: Option<&Device>) -> u8 {
    interrupt::report_file_size_limits();
    let words: Vec<OsString> = arguments.into_iter().collect();
    if words.get(1).is_some_and(|word| word == CHILD_WORD) {
        return run_child();
    }
    let arguments = match CommandLine::parse_words(words.clone()) {
        Ok(arguments) => arguments,
        Err(error) => {
            command_line::usage(&error, &words);
            return error.exit_code() as u8;
        }
    };
    match commands::run(&arguments.command, gpu, command_line::declaration) {
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
