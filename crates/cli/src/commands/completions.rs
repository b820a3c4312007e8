use std::io::Write;

use anyhow::Result;
use clap::{Args, CommandFactory};

use crate::args::CommandLine;
use crate::{ExitStatus, PROGRAM};

/// Print a shell script that completes commands and flags
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  mishandle completions bash > ~/.local/share/bash-completion/completions/mishandle
  mishandle completions zsh > ~/.zfunc/_mishandle
  mishandle completions fish > ~/.config/fish/completions/mishandle.fish")]
pub struct Arguments {
    /// Name of the shell
    pub shell: clap_complete::Shell,
}

pub fn run(command: &Arguments) -> Result<ExitStatus> {
    // Written to memory first, because `generate` panics on a write error such as a closed pipe.
    let mut script = Vec::new();
    clap_complete::generate(command.shell, &mut CommandLine::command(), PROGRAM, &mut script);
    std::io::stdout().lock().write_all(&script)?;
    Ok(ExitStatus::Done)
}
