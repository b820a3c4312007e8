use anyhow::Result;
use clap::Args;
use mishandle::results::LogExplanations;

use crate::exit_status::ExitStatus;
use crate::flags;
use crate::run::log_question;
use crate::show::{explanation, output};

/// Explain the verdicts of formulas on logs: when, where and by which predicate
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  mishandle explain --log rig.csv --formula 'always(force <= 2)'

docs/guide/logs.md describes logs.")]
pub struct Arguments {
    /// Print one JSON document to stdout
    #[arg(long)]
    pub json: bool,
    #[command(flatten)]
    pub logs: flags::Logs,
}

/// Explains the verdicts of formulas on logs, worst first.
pub fn run(command: &Arguments) -> Result<ExitStatus> {
    let sources = log_question::sources(&command.logs.question, &command.logs.paths)?;
    let mut found = Vec::new();
    let without = log_question::ask(&command.logs.question, &sources, |asked| {
        found.push(asked.explanation()?);
        Ok(())
    })?;
    mishandle_logs::worst_first(&mut found, |(explained, _)| &explained.verdict);
    let fails = found.iter().any(|(explained, _)| explained.verdict.fails());
    if command.json {
        let explanations = found.into_iter().map(|(explained, _)| explained).collect();
        output::json(&LogExplanations { explanations })?;
    } else {
        let texts: Vec<String> =
            found.iter().map(|(explained, start)| explanation::log_text(explained, *start)).collect();
        output::line(&texts.join("\n\n\n"))?;
    }
    log_question::check_all(without, sources.len())?;
    Ok(if fails { ExitStatus::Violated } else { ExitStatus::Done })
}
