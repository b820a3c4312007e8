//! The traces that a question about a formula is about: logs, or the nominal episode of a target.

use mishandle::results::ExampleKind;
use std::collections::BTreeMap;
use std::io::Read;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result, ensure};
use mishandle::plan::FalsifyPlan;
use mishandle::resolve::Moved;
use mishandle::rollout::{Seed, Target};
use mishandle::stl::{Clock, Formula, Monitor, TimeUnit, Trace};
use mishandle::store::RunKind;
use mishandle::{Plan, ResolvedPlan};
use mishandle_logs::{Evaluation, NamedSamples, OpenLog, Options, Source};
use mishandle_requirements::Context;
use mishandle_text::plural;

use super::logs;
use crate::show::output;
use crate::show::progress::Bar;

/// A trace, and how the bounds of a formula count its samples.
pub struct Drawn {
    pub kind: ExampleKind,
    pub name: String,
    pub trace: Trace,
    pub clock: Clock,
    /// The time of the first sample in seconds.
    pub start: f64,
}

/// Returns a plan that resolves to the target. A task requires a controller, and it has axes for
/// the action noise only if there is action noise.
pub fn described_plan(name: &str, preset: Option<&str>) -> Plan {
    let is_task = mishandle::tasks::task(name).is_some();
    let mut plan = Plan { is_typed: true, ..Plan::new(name, if is_task { "expert" } else { "" }) };
    plan.action_noise = if is_task { 1.0 } else { 0.0 };
    plan.preset = preset.map_or(plan.preset, String::from);
    plan
}

/// Returns the text of a formula of the target with this name.
pub fn named_formula<'a>(target: &'a Target, name: &str) -> Option<&'a str> {
    target.formulas.iter().find(|formula| formula.name == name).map(|formula| formula.text.as_str())
}

/// Returns what is known about the traces of a target.
pub fn of_target(target: &Target) -> Context {
    let signals = target.signals.iter().chain(&target.signals_on_request);
    Context {
        period: Some(target.control_dt),
        units: signals.map(|signal| (signal.name.clone(), signal.unit.clone())).collect(),
        samples: Some(target.episode_steps + 1),
        ..Context::default()
    }
}

/// Checks that the target has the signals of a formula.
pub fn check_signals(target: &Target, formula: &Formula) -> Result<()> {
    let signals = target.signals.iter().chain(&target.signals_on_request);
    let names: Vec<String> = signals.map(|signal| signal.name.clone()).collect();
    Ok(formula.check_names(&names)?)
}

/// Simulates the nominal scenario of a target.
pub fn nominal_episode(plan: &Plan, formula: &str) -> Result<Trace> {
    let falsify = FalsifyPlan { formula: Some(formula.to_string()), ..FalsifyPlan::default() };
    let plan = Plan { action_noise: 0.0, falsify: Some(falsify), ..plan.clone() }.only(RunKind::Falsify);
    let resolved = ResolvedPlan::new(&plan)?;
    let episodes = mishandle::inspect::simulate(&resolved, &resolved.space.nominal(), [Seed(0)])?;
    let simulated = episodes.into_iter().next().context("the target has no episode")?;
    Ok(simulated.episode.trace)
}

/// Reads the samples of logs that a formula reads.
pub fn of_logs(
    sources: &[Vec<Source>],
    options: &Options,
    formula: &Formula,
    evaluation: Evaluation,
) -> Result<Vec<Drawn>> {
    let mut found = Vec::new();
    for (name, source) in logs::names(sources).into_iter().zip(sources) {
        let shown = || format!("trace {name}");
        let runs = OpenLog::open(source, options).and_then(|log| log.samples_of_runs([formula], options));
        for NamedSamples { name, samples } in NamedSamples::of_runs(&name, runs.with_context(shown)?) {
            let (trace, clock, start) = samples.evenly(formula, &evaluation).with_context(shown)?;
            found.push(Drawn { kind: ExampleKind::Log, name, trace: trace.clone(), clock, start });
        }
    }
    Ok(found)
}

/// Returns whether the file is a database of SQLite, as run files are.
pub fn is_run(path: &Path) -> bool {
    let mut start = [0; 16];
    let read = std::fs::File::open(path).and_then(|mut file| file.read_exact(&mut start));
    path.is_file() && read.is_ok() && start == *b"SQLite format 3\0"
}

/// Returns the traces of at most `limit` random simulations of each run, which are simulated again.
/// Without their target, only recorded ones are returned. `None` if a signal ended this.
pub fn of_runs(paths: &[PathBuf], limit: u64, unit: Option<TimeUnit>) -> Result<Option<Vec<Drawn>>> {
    if paths.is_empty() {
        return Ok(Some(Vec::new()));
    }
    let bar = Bar::new(0, "simulations");
    super::stop_on_signals(&bar)?;
    let mut drawn = Vec::new();
    for path in paths {
        let file = super::read(path, false)?;
        let moved = Moved { controller: None, target: None };
        let resolved = match mishandle::resolve::recorded_plan(file.header(), moved) {
            Ok(resolved) => Some(resolved),
            Err(error) => {
                output::message(&format!("only recorded counterexamples are read: {error}"));
                None
            }
        };
        let mut count = 0;
        let found = mishandle::inspect::random_traces(&file, resolved.as_ref(), limit, |done, total| {
            bar.set_length(total);
            bar.set_position(done);
            count = done;
            super::control_flow()
        })?;
        let Some(found) = found else {
            bar.clear();
            super::report_loss(count, "nothing is kept");
            return Ok(None);
        };
        let left_out = plural(found.left_out, "simulation");
        let why = "corners, the center and points that a search chose are not a random sample";
        ensure!(
            !found.traces.is_empty() || found.left_out == 0,
            "{} has no random simulation ({left_out}; {why}): mine from a run of evaluate, or of falsify with random scenarios",
            path.display()
        );
        ensure!(!found.traces.is_empty(), "{} has no simulation with a trace", path.display());
        if found.left_out > 0 {
            output::message(&format!("{}: {left_out} left out: {why}", path.display()));
        }
        let period = file.header().control_dt;
        let clock = unit.map_or(Clock::steps(period), |unit| Clock::rtamt(period, unit));
        drawn.extend(found.traces.into_iter().map(|((trial, number), trace)| {
            let name = format!("{}, trial {trial}, simulation {number}", path.display());
            Drawn { kind: ExampleKind::Simulation, name, trace, clock, start: 0.0 }
        }));
    }
    bar.clear();
    Ok(Some(drawn))
}

/// Refuses parameters with the name of a column of a log, which the formula could mean.
pub fn refuse_signals(sources: &[Vec<Source>], options: &Options, parameters: &[&str]) -> Result<()> {
    for (name, source) in logs::names(sources).into_iter().zip(sources) {
        // Stdin is read once; its columns beside the signals of the formula are not seen.
        if source.iter().any(|source| source.path.as_os_str() == "-") {
            continue;
        }
        let log = OpenLog::open(source, options).with_context(|| format!("trace {name}"))?;
        if let Some(parameter) =
            parameters.iter().find(|parameter| log.names().iter().any(|known| known == *parameter))
        {
            anyhow::bail!(
                "the parameter `{parameter}` is also a signal of {name}; choose another name for the parameter"
            );
        }
    }
    Ok(())
}

/// Adds what logs show to what is known about the traces of a formula.
pub fn with_logs(context: Context, drawn: &[Drawn]) -> Context {
    let periods: Vec<f64> = drawn.iter().filter_map(|drawn| drawn.clock.period_secs()).collect();
    Context {
        period: periods.first().copied().or(context.period),
        samples: drawn.iter().map(|drawn| drawn.trace.len()).min().or(context.samples),
        traces: drawn.iter().map(|drawn| (drawn.name.clone(), drawn.trace.clone())).collect(),
        ..context
    }
}

/// Returns whether a formula can be evaluated with this clock.
pub fn fits(formula: &Formula, drawn: &Drawn) -> Result<()> {
    Monitor::new(formula, drawn.trace.names(), drawn.clock)?;
    Ok(())
}

/// Returns the unit declarations of a file of requirements and the texts of its formulas.
pub fn of_file(path: &Path) -> Result<(Vec<logs::Unparsed>, BTreeMap<String, String>)> {
    let found = logs::requirements(path, None)?;
    let units = found.first().map(|first| first.units.clone()).unwrap_or_default();
    Ok((found, units))
}
