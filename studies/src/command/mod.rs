//! The command line: a module for each command.

mod interrupt;
mod reproduce;
mod zoo;

use std::io::Write;
use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::{Context, Result, bail};
use clap::{Parser, Subcommand};

/// Our own studies: the paper's tables, and the shipped controllers
#[derive(Debug, Parser)]
#[command(name = "studies", max_term_width = 100, arg_required_else_help = true)]
#[command(
    after_help = "`studies` stands for `cargo run --release -p mishandle-studies --`. It works in a clone of the
repository: the one that contains the program, or the folder in MISHANDLE_HOME."
)]
pub struct CommandLine {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    Reproduce(reproduce::Arguments),
    Zoo(zoo::Arguments),
}

pub fn run(line: &CommandLine) -> Result<ExitCode> {
    match &line.command {
        Command::Reproduce(arguments) => reproduce::run(&arguments.command),
        Command::Zoo(arguments) => zoo::run(&arguments.command),
    }
}

/// Prints a message to stderr.
pub fn message(text: &str) {
    // If stderr is closed, the error cannot be reported.
    let _ = writeln!(std::io::stderr().lock(), "{text}");
}

/// Prints data to stdout.
fn print(text: &str) -> Result<()> {
    writeln!(std::io::stdout().lock(), "{text}")?;
    Ok(())
}

/// Returns the clone of the repository to work in.
fn repository() -> Result<PathBuf> {
    let root = mishandle::shipped::home().context(
        "expected a clone of the repository around the program; name one in the environment variable MISHANDLE_HOME",
    )?;
    if !root.join("controllers/README.md").is_file() {
        bail!("expected a clone of the repository at {}; set MISHANDLE_HOME to one", root.display());
    }
    Ok(root)
}
