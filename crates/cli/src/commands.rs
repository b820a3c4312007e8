//! One file per command.

mod check;
mod compare;
mod completions;
mod controller;
mod demo;
mod evaluate;
mod evidence;
mod export;
mod falsify;
mod formula;
mod guard;
mod harden;
mod init;
mod list;
mod man;
mod margin;
mod monitor;
mod record;
mod regress;
mod render;
mod replay;
mod report;
mod risk;
mod run;
mod show;
mod simulate;
mod train;

use anyhow::Result;
use clap::{FromArgMatches, Subcommand};
use mishandle::run::Device;

use crate::exit_status::ExitStatus;

pub use regress::junit;

/// The commands by what a person wants to do, in the order of the help.
pub const GROUPS: [(&str, &[&str]); 6] = [
    ("Ask", &["evaluate", "falsify", "margin", "risk", "check", "run"]),
    ("See", &["show", "simulate", "replay", "render", "report", "compare"]),
    ("Keep", &["regress", "evidence", "export"]),
    ("Improve", &["train", "harden", "guard", "record", "controller"]),
    ("Formulas and logs", &["formula", "monitor"]),
    ("Set up", &["list", "init", "demo"]),
];

/// The commands, in the order of [`GROUPS`].
#[derive(Debug, Subcommand)]
pub enum Command {
    Evaluate(evaluate::Arguments),
    Falsify(falsify::Arguments),
    Margin(margin::Arguments),
    Risk(risk::Arguments),
    Check(check::Arguments),
    Run(run::Arguments),
    Show(show::Arguments),
    Simulate(simulate::Arguments),
    Replay(replay::Arguments),
    Render(render::Arguments),
    Report(report::Arguments),
    Compare(compare::Arguments),
    Regress(regress::Arguments),
    Evidence(evidence::Arguments),
    Export(export::Arguments),
    Train(train::Arguments),
    Harden(harden::Arguments),
    Guard(guard::Arguments),
    Record(record::Arguments),
    Controller(controller::Arguments),
    Formula(formula::Arguments),
    Monitor(monitor::Arguments),
    List(list::Arguments),
    Init(init::Arguments),
    Demo(demo::Arguments),
    Completions(completions::Arguments),
    Man(man::Arguments),
}

/// Runs a command. `gpu` is the device `gpu` of this process, `program` returns the declaration of
/// the whole program.
pub fn run(command: &Command, gpu: Option<&Device>, program: fn() -> clap::Command) -> Result<ExitStatus> {
    match command {
        Command::Evaluate(arguments) => evaluate::run(arguments, gpu),
        Command::Falsify(arguments) => falsify::run(arguments, gpu),
        Command::Margin(arguments) => margin::run(arguments),
        Command::Risk(arguments) => risk::run(arguments, gpu),
        Command::Check(arguments) => check::run(arguments),
        Command::Run(arguments) => run::run(arguments, gpu),
        Command::Show(arguments) => show::run(arguments),
        Command::Simulate(arguments) => simulate::run(arguments),
        Command::Replay(arguments) => replay::run(arguments),
        Command::Render(arguments) => render::run(arguments),
        Command::Report(arguments) => report::run(arguments),
        Command::Compare(arguments) => compare::run(arguments),
        Command::Regress(arguments) => regress::run(arguments),
        Command::Evidence(arguments) => evidence::run(arguments),
        Command::Export(arguments) => export::run(arguments),
        Command::Train(arguments) => train::run(arguments, gpu),
        Command::Harden(arguments) => harden::run(arguments, gpu),
        Command::Guard(arguments) => guard::run(arguments),
        Command::Record(arguments) => record::run(arguments),
        Command::Controller(arguments) => controller::run(arguments),
        Command::Formula(arguments) => formula::run(arguments),
        Command::Monitor(arguments) => monitor::run(arguments),
        Command::List(arguments) => list::run(arguments),
        Command::Init(arguments) => init::run(arguments),
        Command::Demo(arguments) => demo::run(arguments, |words| run_words(words, gpu, program)),
        Command::Completions(arguments) => completions::run(arguments, program),
        Command::Man(arguments) => man::run(arguments, program),
    }
}

/// Runs a command by its words, as if they were typed.
fn run_words(words: &[&str], gpu: Option<&Device>, program: fn() -> clap::Command) -> Result<ExitStatus> {
    let matches = program().try_get_matches_from([&["mishandle"], words].concat())?;
    run(&Command::from_arg_matches(&matches)?, gpu, program)
}
