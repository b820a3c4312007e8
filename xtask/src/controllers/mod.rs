//! `cargo xtask controllers`: makes every shipped controller, every curve and every table.
//!
//! What there is to train stands in the plan; whether a training is done, in its record, its file and what they would be
//! now. What is missing or out of date is trained by the program, measured, and put in its place; then the tables of
//! README.md and controllers/README.md and the pictures of the curves are made again, of the records and the kept curves
//! alone. A call that is interrupted, or killed, is carried on by the next.

mod aggregate;
mod bars;
mod chart;
mod curve;
mod curves;
mod facts;
mod home;
mod intake;
mod measure;
mod options;
mod paper;
mod plan;
mod program;
mod record;
mod seed_tables;
mod state;
mod summary;
mod tables;
#[cfg(test)]
mod tests;
mod train;
mod workers;

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use anyhow::{Context, Result, bail, ensure};
use serde_json::Value;
use signal_hook::consts::{SIGINT, SIGTERM};

use facts::Wanted;
use home::Home;
use measure::{Bench, conditions};
use options::{Action, Options, USAGE};
use plan::Training;
use program::Program;
use record::Record;
use state::{Standing, State};

/// Does what `arguments` say; without any, all that there is to do.
///
/// # Errors
/// If an argument is wrong, something cannot be built, read or written, or a training failed or was interrupted.
pub fn make(root: &Path, arguments: &[String]) -> Result<()> {
    let options = Options::parse(arguments)?;
    if options.action == Action::Help {
        return help();
    }
    let home = Home::new(root);
    let stop = Arc::new(AtomicBool::new(false));
    for signal in [SIGINT, SIGTERM] {
        signal_hook::flag::register(signal, stop.clone()).context("cannot listen for signals")?;
    }
    let program = match &options.program {
        Some(file) => Program::at(file, &home)?,
        None => Program::built(root, &home)?,
    };
    act(&Bench { home: &home, program: &program, stop: stop.as_ref() }, &options)
}

fn act(bench: &Bench<'_>, options: &Options) -> Result<()> {
    let tasks = bench.program.tasks()?;
    let mut wanted = BTreeMap::new();
    let mut chosen = standings(bench, &tasks, options, &mut wanted)?;
    chosen.retain(|standing| options.chooses(&standing.training));
    let an_expert = tasks.iter().any(|task| options.chooses_expert(&name_of(task)));
    ensure!(an_expert || !chosen.is_empty(), "nothing in the plan is what --only and --seeds ask for");
    if options.action == Action::List {
        list(bench, &chosen);
        return Ok(());
    }
    let lock = home::lock(&bench.home.path("target/controllers/lock"))?;
    ensure!(lock.is_some(), "another `cargo xtask controllers` is at work");
    let done = match &options.action {
        Action::Import(folder) => intake::import(bench, folder, &tasks, &chosen),
        Action::Tables => Ok(()),
        _ => work(bench, &tasks, &chosen, &wanted, options),
    };
    let standings = standings(bench, &tasks, options, &mut wanted)?;
    pages(bench.home, &tasks, &standings).and(done)
}

/// What each task and algorithm of the plan would be trained under now.
type AllWanted = BTreeMap<(String, String), Wanted>;

/// How the whole plan stands, in its order. What is wanted is asked for once.
fn standings(
    bench: &Bench<'_>,
    tasks: &[Value],
    options: &Options,
    wanted: &mut AllWanted,
) -> Result<Vec<Standing>> {
    let names: Vec<String> = tasks.iter().map(name_of).collect();
    let mut found = Vec::new();
    for (group, trainings) in plan::plan(&names).into_iter().enumerate() {
        for training in trainings {
            let pair = (training.task.clone(), training.algorithm.clone());
            if !wanted.contains_key(&pair) {
                wanted.insert(pair.clone(), bench.program.wanted(&training)?);
            }
            let subject = (task_of(tasks, &training)?, &training);
            let adopt = options.adopt && options.chooses(&training);
            let wanted = wanted[&pair].clone();
            let mut standing = state::standing(bench.home, bench.program, subject, wanted, adopt)?;
            standing.group = group;
            found.push(standing);
        }
    }
    Ok(found)
}

/// How long a training took the last time, s.
fn secs(standing: &Standing) -> f64 {
    standing.facts.as_ref().and_then(|facts| facts.number("wall_clock_secs")).unwrap_or(f64::INFINITY)
}

fn name_of(task: &Value) -> String {
    task["name"].as_str().unwrap_or_default().to_string()
}

fn task_of<'a>(tasks: &'a [Value], training: &Training) -> Result<&'a Value> {
    let found = tasks.iter().find(|task| task["name"] == training.task.as_str());
    found.with_context(|| format!("there is no task `{}`", training.task))
}

#[expect(clippy::print_stdout, reason = "it is what was asked for")]
fn help() -> Result<()> {
    println!("{USAGE}");
    Ok(())
}

#[expect(clippy::print_stdout, reason = "the list is what was asked for")]
fn list(bench: &Bench<'_>, chosen: &[Standing]) {
    for standing in chosen {
        tell(standing, bench.home.curve(&standing.training).is_file());
    }
    let done = chosen.iter().filter(|standing| standing.state == State::Done).count();
    println!("{done} of {} done", chosen.len());
}

#[expect(clippy::print_stdout, reason = "the list is what was asked for")]
fn tell(standing: &Standing, has_curve: bool) {
    let adopted = standing.facts.as_ref().is_some_and(facts::Facts::is_adopted);
    let mark = if adopted && standing.state == State::Done { ", adopted" } else { "" };
    let bare = if standing.state == State::Done && !has_curve { ", without a curve" } else { "" };
    println!("{:<28} {}{mark}{bare}", standing.training.name(), standing.state);
}

/// One thing to do.
enum Job<'a> {
    Train(&'a Standing),
    Measure(&'a Standing),
    MeasureExpert { task: &'a Value, task_hash: &'a str },
}

impl Job<'_> {
    fn name(&self) -> String {
        match self {
            Job::Train(standing) | Job::Measure(standing) => standing.training.name(),
            Job::MeasureExpert { task, .. } => format!("{}-expert", name_of(task)),
        }
    }

    fn run(&self, bench: &Bench<'_>, tasks: &[Value]) -> Result<()> {
        match self {
            Job::Train(standing) => train::train(bench, task_of(tasks, &standing.training)?, standing),
            Job::Measure(standing) => {
                intake::measure_again(bench, task_of(tasks, &standing.training)?, standing)
            }
            Job::MeasureExpert { task, task_hash } => intake::measure_expert(bench, task, task_hash),
        }
    }
}

/// Trains and measures what has to be.
fn work(
    bench: &Bench<'_>,
    tasks: &[Value],
    chosen: &[Standing],
    wanted: &AllWanted,
    options: &Options,
) -> Result<()> {
    let measures = options.action == Action::Measure;
    let mut jobs = Vec::new();
    for task in tasks.iter().filter(|task| options.chooses_expert(&name_of(task))) {
        let Some((_, any)) = wanted.iter().find(|((name, _), _)| *name == name_of(task)) else { continue };
        let task_hash = any.task_hash.as_str();
        let record = Record::load(bench.home, &name_of(task), "expert")?;
        let is_done = record.is_some_and(|record| record.is_of(&conditions(task, task_hash)));
        if measures || !is_done {
            jobs.push(Job::MeasureExpert { task, task_hash });
        }
    }
    let mut in_order: Vec<&Standing> = chosen.iter().collect();
    // The longest first, and those of which nothing is known: so that the last does not run alone.
    in_order.sort_by(|a, b| a.group.cmp(&b.group).then(secs(b).total_cmp(&secs(a))));
    for standing in in_order {
        match standing.state {
            State::Unmeasured => jobs.push(Job::Measure(standing)),
            State::Done if measures && bench.home.controller(&standing.training).is_file() => {
                jobs.push(Job::Measure(standing));
            }
            State::Missing(_) | State::Interrupted { .. } if !measures => jobs.push(Job::Train(standing)),
            _ => {}
        }
    }
    eprintln!("{} to do, {} at a time", jobs.len(), options.jobs);
    let (started, count) = (Instant::now(), jobs.len());
    let run = |job: &Job<'_>| {
        let why = match job {
            Job::Train(standing) => standing.state.to_string(),
            _ => "to be measured".to_string(),
        };
        eprintln!("{:>6.0} s  {}: {why}", started.elapsed().as_secs_f64(), job.name());
        job.run(bench, tasks)
    };
    let tell = |job: &Job<'_>, result: &Result<()>| {
        let how = match result {
            Ok(()) => "done".to_string(),
            Err(error) => format!("failed: {error:#}"),
        };
        eprintln!("{:>6.0} s  {}: {how}", started.elapsed().as_secs_f64(), job.name());
    };
    let workers::Outcome { done, failed } = workers::side_by_side(&jobs, options.jobs, bench.stop, run, tell);
    if bench.stop.load(Ordering::Relaxed) {
        bail!("interrupted with {done} of {count} done; the same command goes on");
    }
    ensure!(failed == 0, "{failed} of {count} failed; the others are done");
    Ok(())
}

/// Makes all tables and pictures of what is there.
fn pages(home: &Home, tasks: &[Value], standings: &[Standing]) -> Result<()> {
    let names: Vec<String> = tasks.iter().map(name_of).collect();
    let experts = names.iter().map(|task| Record::load(home, task, "expert")).collect::<Result<Vec<_>>>()?;
    let experts: Vec<Record> = experts.into_iter().flatten().collect();
    let drawn = curves::draw(home, &names)?;
    tables::write(home, &tables::Shown { tasks, standings, experts: &experts }, &drawn)
}
