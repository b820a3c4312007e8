use anyhow::Result;
use clap::{Args, Subcommand};
use mishandle::results::ProtocolCheck;

use crate::exit_status::ExitStatus;
use crate::show::{escape, output};

/// Check the protocol of simulators that are programs
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  mishandle protocol check 'python3 my_simulator.py'
  mishandle protocol check './my_simulator --fast' --json")]
pub struct Arguments {
    #[command(subcommand)]
    pub command: ProtocolCommand,
}

#[derive(Debug, Subcommand)]
pub enum ProtocolCommand {
    /// Talk to a simulator as a test suite: description, bounds of the axes, determinism, seeds,
    /// order of the questions, output and end. Exit code 1 if it breaks a rule
    #[command(after_help = "Examples:
  mishandle protocol check 'python3 my_simulator.py'
  mishandle protocol check './my_simulator --fast' --json")]
    Check(Check),
}

#[derive(Debug, Args)]
pub struct Check {
    /// Command of the simulator
    #[arg(value_name = "COMMAND")]
    pub program: String,
    /// Print one JSON document to stdout
    #[arg(long)]
    pub json: bool,
}

pub fn run(command: &Arguments) -> Result<ExitStatus> {
    let ProtocolCommand::Check(command) = &command.command;
    let found = mishandle::resolve::check_protocol(&command.program)?;
    if command.json {
        output::json(&found)?;
    } else {
        output::line(&text(&found))?;
    }
    Ok(if found.passed { ExitStatus::Done } else { ExitStatus::Violated })
}

/// Returns a line for each check, and the times.
fn text(found: &ProtocolCheck) -> String {
    let mut rows = vec![["check", "result", "finding"].map(String::from).to_vec()];
    rows.extend(found.checks.iter().map(|check| {
        let result = if check.passed { "pass" } else { "FAIL" };
        // The standard error of a program has line breaks, which a table has not.
        let finding = escape::text(&check.finding).replace(['\n', '\t'], " ");
        vec![check.check.clone(), result.to_string(), finding]
    }));
    let time = |what: &str, seconds: Option<f64>| {
        let seconds = seconds?;
        let text = if seconds < 1.0 { format!("{:.3} ms", 1e3 * seconds) } else { format!("{seconds:.1} s") };
        Some(format!("{what} {text}"))
    };
    let times = [
        time("start", found.start_seconds),
        time("one simulation", found.simulation_seconds),
        time("one control step", found.step_seconds),
    ];
    let times: Vec<String> = times.into_iter().flatten().collect();
    let times = if times.is_empty() { String::new() } else { format!("\n\ntime: {}", times.join(", ")) };
    format!("{}{times}", output::table_in(&rows, output::width()))
}
