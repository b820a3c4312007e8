use std::io::Write;

use anyhow::Result;
use clap::Args;

use crate::exit_status::ExitStatus;

/// Print a shell script that completes commands and flags
#[derive(Debug, Args)]
#[command(hide = true)]
#[command(after_help = "Examples:
  mishandle completions bash > ~/.local/share/bash-completion/completions/mishandle
  mishandle completions zsh > ~/.zfunc/_mishandle
  mishandle completions fish > ~/.config/fish/completions/mishandle.fish")]
pub struct Arguments {
    /// Name of the shell
    pub shell: clap_complete::Shell,
}

pub fn run(command: &Arguments, program: fn() -> clap::Command) -> Result<ExitStatus> {
    // Written to memory first, because `generate` panics on a write error such as a closed pipe.
    let mut script = Vec::new();
    let mut program = program();
    let name = program.get_name().to_string();
    clap_complete::generate(command.shell, &mut program, name, &mut script);
    std::io::stdout().lock().write_all(&script)?;
    Ok(ExitStatus::Done)
}
