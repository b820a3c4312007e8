use std::io::Write;

use anyhow::Result;
use clap::CommandFactory;

use crate::args::{self, Arguments};
use crate::{ExitStatus, PROGRAM};

pub fn run(command: &args::Completions) -> Result<ExitStatus> {
    // Written to memory first, because `generate` panics on a write error such as a closed pipe.
    let mut script = Vec::new();
    clap_complete::generate(command.shell, &mut Arguments::command(), PROGRAM, &mut script);
    std::io::stdout().lock().write_all(&script)?;
    Ok(ExitStatus::Done)
}
