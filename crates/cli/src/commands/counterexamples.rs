mod export;

use std::path::{Path, PathBuf};

use anyhow::Result;
use clap::{Args, Subcommand};
use mishandle::results::Counterexamples;

use crate::exit_status::ExitStatus;
use crate::show::{escape, modes, output};
use crate::{flags, run};

/// List the failure modes of a run, or export counterexamples as files of a regression suite
#[derive(Debug, Args)]
#[command(args_conflicts_with_subcommands = true, subcommand_negates_reqs = true)]
#[command(after_help = "Examples:
  mishandle counterexamples runs/RUN.sqlite
  mishandle counterexamples export runs/RUN.sqlite --out failure.json --minimize
  mishandle counterexamples export runs/RUN.sqlite --all --out failures

A failure mode is a group of failures with the same decisive predicate, similar scenarios and
similar times. Its representative is the failure nearest to the nominal scenario.")]
pub struct Arguments {
    #[command(subcommand)]
    pub command: Option<CounterexamplesCommand>,
    /// Run file
    #[arg(value_name = "RUN", required = true)]
    pub file: Option<PathBuf>,
    /// Print one JSON document to stdout
    #[arg(long)]
    pub json: bool,
    #[command(flatten)]
    pub keys: flags::SettingKeys,
}

#[derive(Debug, Subcommand)]
pub enum CounterexamplesCommand {
    /// Write counterexamples as JSON files, which `replay`, `explain` and `regress` run
    Export(export::Arguments),
}

pub fn run(command: &Arguments) -> Result<ExitStatus> {
    if let Some(CounterexamplesCommand::Export(command)) = &command.command {
        return export::run(command);
    }
    let path = command.file.as_deref().unwrap_or(Path::new(""));
    let file = run::read(path, command.keys.settings("counterexamples")?.engine.skip_check)?;
    let found = mishandle::inspect::counterexamples_result(&file, &mishandle::inspect::failure_modes(&file)?);
    if command.json {
        output::json(&found)?;
        return Ok(ExitStatus::Done);
    }
    output::line(&text(&found))?;
    if !found.modes.is_empty() {
        output::message(&format!(
            "Export one with: mishandle counterexamples export {} --mode 1 --out FILE.json",
            run::name(&file)
        ));
    }
    Ok(ExitStatus::Done)
}

fn text(found: &Counterexamples) -> String {
    let modes = modes::Modes {
        modes: found.modes.iter().collect(),
        failures: found.failures,
        not_grouped: found.not_grouped,
        axes: &found.space_axes,
        control_dt: found.control_dt,
    };
    let target = escape::name(&found.target);
    let formula = escape::name(&found.formula);
    format!("{target}\nformula {formula}\n{}", modes.text())
}
