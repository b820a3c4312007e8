//! The development program `studies`: makes the paper's tables and maintains the controllers that
//! come with the repository.
//!
//! Data goes to stdout, everything else to stderr. Exit codes: 0 success, 2 error, 130 interrupted.

mod command;

use std::process::ExitCode;

use clap::Parser;
use mishandle_cli::words::{Shell, described, remedies};

use command::{CommandLine, message};

fn main() -> ExitCode {
    match command::run(&CommandLine::parse()) {
        Ok(code) => code,
        Err(error) => {
            let text = format!("{error:#}");
            message(&format!("error: {}", described(&text, &remedies(error.chain()), &Shell)));
            ExitCode::from(2)
        }
    }
}
