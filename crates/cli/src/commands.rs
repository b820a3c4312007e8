//! One file per command.

mod bisect;
mod check;
mod compare;
mod completions;
mod controller;
mod counterexamples;
mod evaluate;
mod evidence;
mod explain;
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
mod runs;
mod simulate;
mod train;
mod view;

use anyhow::Result;
use clap::Subcommand;
use mishandle::run::Device;

use crate::exit_status::ExitStatus;

pub use bisect::ask as ask_bisection;
pub use regress::junit;

/// The commands by what a person wants to do, in the order of the help. `help` is the parser's own.
pub const GROUPS: [(&str, &[&str]); 6] = [
    ("Find failures", &["falsify", "margin", "run"]),
    ("Measure", &["evaluate", "check", "risk", "compare", "bisect"]),
    ("Understand", &["explain", "simulate", "replay", "render", "view", "report", "monitor", "formula"]),
    ("Keep", &["runs", "counterexamples", "regress", "evidence", "export"]),
    ("Train", &["record", "train", "harden", "guard", "controller"]),
    ("Set up", &["list", "init", "completions", "man", "help"]),
];

/// The commands, in the order of [`GROUPS`].
#[derive(Debug, Subcommand)]
pub enum Command {
    Falsify(falsify::Arguments),
    Margin(margin::Arguments),
    Run(run::Arguments),
    Evaluate(evaluate::Arguments),
    Check(check::Arguments),
    Risk(risk::Arguments),
    Compare(compare::Arguments),
    Bisect(bisect::Arguments),
    Explain(explain::Arguments),
    Simulate(simulate::Arguments),
    Replay(replay::Arguments),
    Render(render::Arguments),
    View(view::Arguments),
    Report(report::Arguments),
    Monitor(monitor::Arguments),
    Formula(formula::Arguments),
    Runs(runs::Arguments),
    Counterexamples(counterexamples::Arguments),
    Regress(regress::Arguments),
    Evidence(evidence::Arguments),
    Export(export::Arguments),
    Record(record::Arguments),
    Train(train::Arguments),
    Harden(harden::Arguments),
    Guard(guard::Arguments),
    Controller(controller::Arguments),
    List(list::Arguments),
    Init(init::Arguments),
    Completions(completions::Arguments),
    Man(man::Arguments),
}

/// Runs a command. `gpu` is the device `gpu` of this process, `program` returns the declaration of
/// the whole program.
pub fn run(command: &Command, gpu: Option<&Device>, program: fn() -> clap::Command) -> Result<ExitStatus> {
    match command {
        Command::Falsify(arguments) => falsify::run(arguments, gpu),
        Command::Margin(arguments) => margin::run(arguments),
        Command::Run(arguments) => run::run(arguments, gpu),
        Command::Evaluate(arguments) => evaluate::run(arguments, gpu),
        Command::Check(arguments) => check::run(arguments),
        Command::Risk(arguments) => risk::run(arguments, gpu),
        Command::Compare(arguments) => compare::run(arguments),
        Command::Bisect(arguments) => bisect::run(arguments),
        Command::Explain(arguments) => explain::run(arguments),
        Command::Simulate(arguments) => simulate::run(arguments),
        Command::Replay(arguments) => replay::run(arguments),
        Command::Render(arguments) => render::run(arguments),
        Command::View(arguments) => view::run(arguments),
        Command::Report(arguments) => report::run(arguments),
        Command::Monitor(arguments) => monitor::run(arguments),
        Command::Formula(arguments) => formula::run(arguments),
        Command::Runs(arguments) => runs::run(arguments),
        Command::Counterexamples(arguments) => counterexamples::run(arguments),
        Command::Regress(arguments) => regress::run(arguments),
        Command::Evidence(arguments) => evidence::run(arguments),
        Command::Export(arguments) => export::run(arguments),
        Command::Record(arguments) => record::run(arguments),
        Command::Train(arguments) => train::run(arguments, gpu),
        Command::Harden(arguments) => harden::run(arguments, gpu),
        Command::Guard(arguments) => guard::run(arguments),
        Command::Controller(arguments) => controller::run(arguments),
        Command::List(arguments) => list::run(arguments),
        Command::Init(arguments) => init::run(arguments),
        Command::Completions(arguments) => completions::run(arguments, program),
        Command::Man(arguments) => man::run(arguments, program),
    }
}
