mod tune;

use anyhow::Result;
use clap::{Args, Subcommand};

use crate::exit_status::ExitStatus;

/// Choose the threshold of a guard from data, and measure what the guard is worth
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  mishandle guard tune ball-balancing --controller ppo --guard guard.toml --space starts+delay \\
    --out tuned

Every question about a target takes a guard: mishandle evaluate TARGET --guard tuned/guard.toml")]
pub struct Arguments {
    #[command(subcommand)]
    pub command: GuardCommand,
}

#[derive(Debug, Subcommand)]
pub enum GuardCommand {
    /// Choose the threshold of a guard on training scenarios, and measure it on held-out ones
    Tune(Box<tune::Arguments>),
}

pub fn run(command: &Arguments) -> Result<ExitStatus> {
    let GuardCommand::Tune(command) = &command.command;
    tune::run(command)
}
