//! One file per command.

mod campaign;
mod compare;
mod completions;
mod controller;
mod counterexamples;
mod curve;
mod evaluate;
mod explain;
mod export;
mod falsify;
mod man;
mod margin;
mod monitor;
mod regress;
mod render;
mod replay;
mod report;
mod reproduce;
mod risk;
mod runs;
mod searches;
mod simulate;
mod targets;
mod tasks;
mod train;

use anyhow::Result;
use clap::Subcommand;
use mishandle::run::Device;

use crate::exit_status::ExitStatus;

#[derive(Debug, Subcommand)]
pub enum Command {
    Tasks(tasks::Arguments),
    Targets(targets::Arguments),
    Searches(searches::Arguments),
    Monitor(monitor::Arguments),
    Train(train::Arguments),
    Controller(controller::Arguments),
    Curve(curve::Arguments),
    Evaluate(evaluate::Arguments),
    Falsify(falsify::Arguments),
    Campaign(campaign::Arguments),
    Reproduce(reproduce::Arguments),
    Compare(compare::Arguments),
    Margin(margin::Arguments),
    Risk(risk::Arguments),
    Simulate(simulate::Arguments),
    Runs(runs::Arguments),
    Export(export::Arguments),
    Replay(replay::Arguments),
    Explain(explain::Arguments),
    Counterexamples(counterexamples::Arguments),
    Regress(regress::Arguments),
    Render(render::Arguments),
    Report(report::Arguments),
    Completions(completions::Arguments),
    Man(man::Arguments),
}

/// Runs a command. `gpu` is the device `gpu` of this process, `program` returns the declaration of the whole program.
pub fn run(command: &Command, gpu: Option<&Device>, program: fn() -> clap::Command) -> Result<ExitStatus> {
    match command {
        Command::Tasks(arguments) => tasks::run(arguments),
        Command::Targets(arguments) => targets::run(arguments),
        Command::Searches(arguments) => searches::run(arguments),
        Command::Monitor(arguments) => monitor::run(arguments),
        Command::Train(arguments) => train::run(arguments, gpu),
        Command::Controller(arguments) => controller::run(arguments),
        Command::Curve(arguments) => curve::run(arguments),
        Command::Evaluate(arguments) => evaluate::run(arguments, gpu),
        Command::Falsify(arguments) => falsify::run(arguments, gpu),
        Command::Campaign(arguments) => campaign::run(arguments, gpu),
        Command::Reproduce(arguments) => reproduce::run(arguments),
        Command::Compare(arguments) => compare::run(arguments),
        Command::Margin(arguments) => margin::run(arguments),
        Command::Risk(arguments) => risk::run(arguments, gpu),
        Command::Simulate(arguments) => simulate::run(arguments),
        Command::Runs(arguments) => runs::run(arguments),
        Command::Export(arguments) => export::run(arguments),
        Command::Replay(arguments) => replay::run(arguments),
        Command::Explain(arguments) => explain::run(arguments),
        Command::Counterexamples(arguments) => counterexamples::run(arguments),
        Command::Regress(arguments) => regress::run(arguments),
        Command::Render(arguments) => render::run(arguments),
        Command::Report(arguments) => report::run(arguments),
        Command::Completions(arguments) => completions::run(arguments, program),
        Command::Man(arguments) => man::run(arguments, program),
    }
}
