use std::collections::BTreeSet;
use std::path::PathBuf;

use anyhow::{Result, ensure};
use clap::Args;
use mishandle::Plan;
use mishandle::check::{CheckProgress, CheckSubject, Requirements, check};
use mishandle::resolve::command_target;
use mishandle::results::{Check, CheckVerdict};
use mishandle_text::{plural, shell_path, shell_quote};

use crate::exit_status::ExitStatus;
use crate::flags::{self, numbers};
use crate::run::{self, check_reports, control_flow, logs};
use crate::show::progress::Bar;
use crate::show::{self, cost, escape, output};
use crate::words::shell_command;

/// Check all requirements of a file on a target, for one or several controllers: a matrix with
/// verdicts and evidence
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  mishandle check point-reaching --controller ppo --requirements requirements.toml --out checked
  mishandle check point-reaching --controller ppo --against sac --requirements requirements.toml \\
    --episodes 1000 --budget 1000 --out checked

All requirements share the simulations of random scenarios. Then a search tries to violate each
requirement that they do not violate. A requirement with max-failure-rate has no search: random
scenarios decide whether the rate is below or above it.

The folder contains the requirements, the run files, a counterexample for each violation,
check.json, junit.xml, report.md and report.html. The same command continues an interrupted check,
and `mishandle evidence FOLDER` packs all of it for others.

Exit code 0 means that no requirement is violated, 1 that at least one of the severity of -k
check.fail-on (default: error) or above is, 2 that none is and one of them could not be checked or
asks nothing: it holds whatever the controller does; or that no requirement at all was tested.
docs/guide/check.md describes the file.")]
pub struct Arguments {
    #[command(flatten)]
    pub subject: flags::Subject,
    /// Command of a simulator that is a program, such as 'python3 my_simulator.py', instead of a
    /// target: it answers questions as lines of JSON (docs/reference/simulator_protocol.md)
    #[arg(long, value_name = "COMMAND", conflicts_with = "target")]
    pub command: Option<String>,
    /// TOML file with [[requirement]] tables (docs/guide/check.md)
    #[arg(long, value_name = "FILE")]
    pub requirements: PathBuf,
    /// Folder of the runs, the counterexamples and the reports
    #[arg(long, value_name = "FOLDER")]
    pub out: PathBuf,
    /// Further controller: a column of the matrix; repeat the flag for several
    #[arg(long, value_name = "C")]
    pub against: Vec<String>,
    /// Number of random scenarios [default: that of the requirement, or 100]
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = numbers::integer::<u64>(Plan::EPISODES))]
    pub episodes: Option<u64>,
    /// Largest number of simulations of a search [default: that of the requirement, or 300]
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = numbers::integer::<u32>(Plan::BUDGET))]
    pub budget: Option<u32>,
    /// Search algorithm, a name of `mishandle list searches` [default: portfolio]
    #[arg(long, value_name = "S")]
    pub search: Option<String>,
    #[command(flatten)]
    pub run: flags::Run,
    #[command(flatten)]
    pub verbose: flags::Verbose,
}

pub fn run(command: &Arguments) -> Result<ExitStatus> {
    run::set_threads(command.run.threads)?;
    let path = command.requirements.as_path();
    let out = command.out.as_path();
    let (file, text) = logs::requirement_file(path)?;
    let mut planned = flags::planned("check", &command.subject, &command.run)?;
    planned.flag("--command", "target", command.command.as_deref().map(command_target))?;
    planned.number("--episodes", "check.episodes", command.episodes)?;
    planned.number("--budget", "check.budget", command.budget)?;
    planned.flag("--search", "check.search", command.search.clone())?;
    let (first, settings) = planned.plan()?;
    ensure!(first.requirements.is_empty(), "the plan has requirements: write them into {}", path.display());
    let subject = |plan: Plan| CheckSubject { plan, target: None };
    let further =
        command.against.iter().map(|name| subject(Plan { controller: name.clone(), ..first.clone() }));
    let subjects: Vec<CheckSubject> = std::iter::once(subject(first.clone())).chain(further).collect();
    let names: BTreeSet<&str> = subjects.iter().map(|subject| subject.plan.controller.as_str()).collect();
    ensure!(names.len() == subjects.len(), "a controller is given twice");
    let requirements = Requirements { file: &file, path, text: &text, words: shell_command };
    let bar = Bar::new(0, "simulations");
    run::stop_on_signals(&bar)?;
    let found = check(&subjects, &requirements, &settings.check, out, &mut |progress: &CheckProgress| {
        match progress.largest {
            Some(largest) => output::message(&cost::check_text(&largest)),
            None => {
                bar.set_part(&progress.phase, progress.all);
                bar.set_position(progress.done);
            }
        }
        control_flow()
    });
    let Some(found) = found? else {
        bar.clear();
        output::message("Interrupted. The same command continues the check.");
        return Ok(ExitStatus::Interrupted);
    };
    bar.set_note("pictures".to_string());
    let page = check_reports::write(&found, out, &mut || control_flow().is_break());
    bar.clear();
    let page = page?;
    if command.run.json {
        output::json(&found)?;
    } else {
        show::check::print(&found, command.verbose.verbose)?;
    }
    output::message(&format!("Page: {}", shell_path(&page)));
    status(&found)
}

/// Returns the exit code.
fn status(found: &Check) -> Result<ExitStatus> {
    let open: Vec<_> = found.cells.iter().filter(|cell| found.is_open(cell)).collect();
    for cell in &open {
        let title = show::check::title(found, cell);
        output::message(&format!("error: {}: {}", escape::name(&title), escape::name(&cell.evidence)));
    }
    let hint = if !found.allows_inapplicable
        && open.iter().any(|cell| cell.verdict == CheckVerdict::NotApplicable)
    {
        format!(
            "; `mishandle list {}` lists the signals, and -k check.allow-inapplicable=true accepts requirements \
             whose signals the target lacks",
            shell_quote(&found.target)
        )
    } else {
        String::new()
    };
    if found.exit_code() == 1 {
        return Ok(ExitStatus::Violated);
    }
    ensure!(open.is_empty(), "no conclusion about {}{hint}", plural(open.len() as u64, "requirement"));
    Ok(ExitStatus::Done)
}
