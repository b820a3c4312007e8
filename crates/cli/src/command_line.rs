//! The command line of the program: its commands and its help.

use std::ffi::OsString;
use std::sync::LazyLock;

use clap::Parser;

use crate::commands::Command;
use crate::show::{escape, output};

/// Version, and the paths of MuJoCo's library and of the shipped files, for questions about an installation.
static LONG_VERSION: LazyLock<String> = LazyLock::new(|| {
    let library = std::fs::read_to_string("/proc/self/maps").unwrap_or_default();
    let library = library.lines().find(|line| line.contains("libmujoco.so"));
    let library = library.and_then(|line| line.find('/').map(|start| &line[start..]));
    format!(
        "{}\nMuJoCo {}: {}\nshipped controllers and settings: {}",
        mishandle::build::VERSION_AND_COMMIT,
        mishandle::world::mujoco_version(),
        library.unwrap_or("linked statically"),
        mishandle::shipped::home_description()
    )
});

/// Train, evaluate and falsify robot controllers
#[derive(Debug, Parser)]
#[command(name = "mishandle", version = mishandle::build::VERSION_AND_COMMIT, long_version = LONG_VERSION.as_str())]
#[command(arg_required_else_help = true, max_term_width = 100)]
#[command(after_help = "Examples:
  mishandle tasks
  mishandle evaluate ball-balancing --controller ppo --episodes 1000
  mishandle falsify ball-balancing --controller ppo --formula strict --trials 5

Results go to stdout, messages to stderr. Exit codes: 0 success, 1 falsified or violated, 2 error,
130 interrupted (finished work is saved).")]
pub struct CommandLine {
    #[command(subcommand)]
    pub command: Command,
}

/// Prints help, or an error in the arguments of the program.
pub fn usage(error: &clap::Error, arguments: &[OsString]) {
    // The parser colors its errors, which quote arguments, so the arguments are escaped instead of the error.
    let escaped = arguments.iter().map(|argument| escape::name(&argument.to_string_lossy()));
    match CommandLine::try_parse_from(escaped) {
        // Help goes to stdout, which can be a closed pipe.
        Err(escaped) => drop(escaped.print()),
        // An argument was not UTF-8.
        Ok(_) => output::message(error.render().to_string().trim_end()),
    }
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory;

    use super::*;

    /// Width at which clap wraps help.
    const WIDTH: usize = 100;

    fn check(command: &clap::Command) {
        let text = command.get_after_help().map(ToString::to_string).unwrap_or_default();
        for line in text.lines() {
            assert!(line.chars().count() <= WIDTH, "help of {} wraps the line: {line}", command.get_name());
        }
        command.get_subcommands().for_each(check);
    }

    #[test]
    fn no_help_text_with_line_breaks_of_its_own_is_wrapped_again() {
        check(&CommandLine::command());
    }
}
