//! Code shared by `evaluate` and `falsify`: plan, run file and messages.

use std::collections::BTreeMap;
use std::ops::ControlFlow;
use std::path::Path;

use anyhow::{Context, Result, bail, ensure};
use mishandle::evaluation::Corners;
use mishandle::files::{limits, read_text_bounded};
use mishandle::plan::AxisSetting;
use mishandle::rollout::{Axis, AxisKind, AxisValues, EpisodeEnd, Signal};
use mishandle::stl::Trace;
use mishandle::store::{
    self, AxisRecord, RunFile, RunHeader, RunKind, RunWriter, Simulation, StoredTrace, TraceColumn,
};
use mishandle::{Plan, ResolvedPlan};
use mishandle_text::{decimal, plural};
use serde_json::{Value, json};

use crate::progress::Bar;
use crate::{args, escape, interrupt, output};

/// Sets the size of rayon's global thread pool.
pub fn set_threads(threads: Option<usize>) -> Result<()> {
    if let Some(threads) = threads {
        rayon::ThreadPoolBuilder::new().num_threads(threads).build_global()?;
    }
    Ok(())
}

/// Returns the plan that the flags describe: the plan of `--plan` or a new plan, with the values of the flags.
pub fn plan(subject: &args::Subject, run: &args::Run) -> Result<Plan> {
    let mut plan = match (&subject.plan, &subject.target) {
        (Some(path), _) => {
            let text = read_text_bounded(path, limits::PLAN).with_context(|| path.display().to_string())?;
            Plan::from_toml(&text).with_context(|| path.display().to_string())?
        }
        (None, Some(target)) => Plan::new(target, ""),
        (None, None) => bail!("there is no target: name one, or give --plan FILE"),
    };
    let edit = |field: &mut String, flag: &Option<String>| {
        if let Some(value) = flag {
            field.clone_from(value);
        }
    };
    edit(&mut plan.target, &subject.target);
    edit(&mut plan.space, &subject.space);
    edit(&mut plan.controller, &subject.controller);
    edit(&mut plan.preset, &subject.preset);
    plan.axes.extend(settings(subject)?);
    plan.action_noise = subject.action_noise.unwrap_or(plan.action_noise);
    plan.observation_noise = subject.observation_noise.unwrap_or(plan.observation_noise);
    plan.stochastic |= subject.stochastic;
    plan.seed = run.seed.unwrap_or(plan.seed);
    ensure!(!plan.target.is_empty(), "there is no target: name one in the plan or as an argument");
    Ok(plan)
}

/// Returns the settings of axes, each of which may be given once.
fn settings(subject: &args::Subject) -> Result<BTreeMap<String, AxisSetting>> {
    let mut settings = BTreeMap::new();
    for (name, setting) in subject.axis.iter().chain(&subject.set) {
        let earlier = settings.insert(name.clone(), setting.clone());
        ensure!(earlier.is_none(), "the axis {name} is set twice by --axis and --set");
    }
    Ok(settings)
}

/// Opens a run file of this kind and returns it with its resolved plan: the run to resume, or else a new run with the plan
/// `new_plan`. `controller` is the new path of the controller of a resumed run.
pub fn open(
    flags: &args::OpenRun,
    kind: RunKind,
    controller: Option<&str>,
    new_plan: impl FnOnce() -> Result<Plan>,
) -> Result<(ResolvedPlan, RunWriter)> {
    let sync = |run: &mut RunWriter| if flags.durable { run.set_durable() } else { Ok(()) };
    let Some(path) = &flags.resume else {
        let is_json = flags.out.as_ref().is_some_and(|out| out.extension().is_some_and(|end| end == "json"));
        ensure!(
            !is_json,
            "--out ends with .json, but a run file is SQLite; choose another name, such as run.sqlite"
        );
        let resolved = ResolvedPlan::new(&new_plan()?)?;
        let mut run = mishandle::run::create_run(&resolved, flags.out.as_deref())?;
        sync(&mut run)?;
        return Ok((resolved, run));
    };
    let mut run = if flags.skip_check { RunWriter::resume_unchecked(path) } else { RunWriter::resume(path) }?;
    let found = run.file().header().kind;
    ensure!(
        found == kind,
        "{} is a run of `{}`, not of `{}`; resume it with: mishandle {} --resume {}",
        path.display(),
        found.name(),
        kind.name(),
        found.name(),
        name(run.file())
    );
    sync(&mut run)?;
    let resolved = mishandle::resolve::recorded_plan(run.file().header(), controller)?;
    report_build_differences(
        "started",
        &mishandle::replay::build_differences(run.file().header(), &resolved),
    );
    Ok((resolved, run))
}

/// Largest number of differences that are reported.
const MAX_DIFFERENCES: usize = 20;

/// Reports differences between the build that made or started a run and the present one.
pub fn report_build_differences(verb: &str, differences: &[String]) {
    for difference in differences.iter().take(MAX_DIFFERENCES) {
        output::message(&format!("warning: another build {verb} the run: {difference}"));
    }
    if differences.len() > MAX_DIFFERENCES {
        output::message(&format!(
            "warning: {} more",
            plural(differences.len() - MAX_DIFFERENCES, "difference")
        ));
    }
}

/// Opens a run file for reading.
pub fn read(path: &Path, skip_check: bool) -> Result<RunFile> {
    Ok(if skip_check { RunFile::open_unchecked(path) } else { RunFile::open(path) }?)
}

/// Describes the differences between a run file and the replay of a simulation, one per line.
pub fn differences_text(differences: &[String]) -> String {
    format!("the run file differs from its plan or from the replay:\n  {}", differences.join("\n  "))
}

/// Returns a one-line description of target and settings.
pub fn heading(resolved: &ResolvedPlan) -> String {
    let ResolvedPlan { plan, space, .. } = resolved;
    let mut text = plan.target.clone();
    if !plan.controller.is_empty() {
        text.push_str(&format!(
            ", controller {}, task preset {}",
            escape::name(&plan.controller),
            plan.preset
        ));
    }
    if plan.space != "starts" {
        text.push_str(&format!(", space {} ({})", plan.space, axes(space.free_dimension())));
    }
    for axis in space.axes().iter().filter(|axis| plan.axes.contains_key(&axis.name)) {
        text.push_str(&match axis.is_fixed() {
            true => format!(", {}", axis_text(axis, Some(axis.low))),
            false => {
                let unit = if axis.unit.is_empty() { String::new() } else { format!(" {}", axis.unit) };
                format!(", {} from {} to {}{unit}", axis.name, axis.low, axis.high)
            }
        });
    }
    if plan.action_noise > 0.0 {
        text.push_str(&format!(", action noise {}", plan.action_noise));
    }
    if plan.observation_noise > 0.0 {
        text.push_str(&format!(", observation noise {}", plan.observation_noise));
    }
    if plan.stochastic {
        text.push_str(", sampled actions");
    }
    text
}

/// Formats a number of axes.
pub fn axes(count: usize) -> String {
    if count == 1 { "1 axis".to_string() } else { format!("{count} axes") }
}

/// Returns the keys that the JSON documents of `evaluate` and `falsify` share.
pub fn document(resolved: &ResolvedPlan, path: &str) -> Value {
    let ResolvedPlan { plan, target, space, .. } = resolved;
    let controller = target.components.first();
    json!({
        "run": path,
        "target": plan.target,
        "task": plan.target,
        "target_kind": target.identity.kind,
        "target_hash": target.identity.hash,
        "preset": controller.is_some().then_some(&plan.preset),
        "controller": controller.map(|controller| &controller.name),
        "controller_hash": controller.map(|controller| &controller.hash),
        "stochastic": plan.stochastic,
        "action_noise": plan.action_noise,
        "observation_noise": plan.observation_noise,
        "seed": plan.seed.to_string(),
        "space": plan.space,
        "axes": space.axes().iter().map(|axis| &axis.name).collect::<Vec<_>>(),
    })
}

/// Returns a scenario as JSON: value by axis name.
pub fn scenario(axes: &[Axis], values: &[Option<f64>]) -> Value {
    let entries = axes.iter().zip(values).map(|(axis, value)| (axis.name.clone(), json!(value)));
    Value::Object(entries.collect())
}

/// Number of values in the summary of a scenario.
const SUMMARY_VALUES: usize = 4;

/// Formats a scenario for a table: all its values if they are few, otherwise the values farthest from nominal.
pub fn scenario_summary(axes: &[Axis], values: &[Option<f64>]) -> String {
    format_scenario(axes, values, SUMMARY_VALUES)
}

/// Formats all values of a scenario.
pub fn scenario_text(axes: &[Axis], values: &[Option<f64>]) -> String {
    format_scenario(axes, values, usize::MAX)
}

fn format_scenario(axes: &[Axis], values: &[Option<f64>], max_values: usize) -> String {
    let mut shown: Vec<(usize, &Axis, f64)> = (0..)
        .zip(axes.iter().zip(values))
        .filter_map(|(index, (axis, value))| Some((index, axis, (*value)?)))
        .collect();
    // ", and 1 more" would be as long as the value itself.
    let omitted = if shown.len() > max_values.saturating_add(1) { shown.len() - max_values } else { 0 };
    if omitted > 0 {
        let distance = |(_, axis, value): &(usize, &Axis, f64)| {
            (axis.unit_coordinate(*value) - axis.unit_coordinate(axis.nominal.unwrap_or_default())).abs()
        };
        shown.sort_by(|a, b| distance(b).total_cmp(&distance(a)));
        shown.truncate(max_values);
        shown.sort_by_key(|(index, ..)| *index);
    }
    let value = |(_, axis, value): &(usize, &Axis, f64)| axis_text(axis, Some(*value));
    let values: Vec<String> = shown.iter().map(value).collect();
    let rest = if omitted > 0 { format!(", and {omitted} more") } else { String::new() };
    values.join(", ") + &rest
}

/// Formats the first values of a recorded scenario.
pub fn recorded_scenario_text(axes: &[AxisRecord], values: &[Option<f64>], max_values: usize) -> String {
    let named = axes.iter().zip(values).take(max_values);
    let values: Vec<String> =
        named.map(|(axis, value)| axis_text(&mishandle::run::recorded_axis(axis), *value)).collect();
    let omitted = axes.len().saturating_sub(max_values);
    let rest = if omitted > 0 { format!(", and {omitted} more") } else { String::new() };
    values.join(", ") + &rest
}

fn axis_text(axis: &Axis, value: Option<f64>) -> String {
    axis_value(&escape::name(&axis.name), &value_text(axis, value), &escape::name(&axis.unit))
}

/// Formats a value of an axis: the name of a category, an integer, or a number with four decimals.
pub fn value_text(axis: &Axis, value: Option<f64>) -> String {
    match (value, &axis.values) {
        (None, _) => "random".to_string(),
        (Some(value), AxisValues::Categorical(names)) => {
            let name = names.get((value - axis.low) as usize);
            name.map_or(value.to_string(), |name| escape::name(name))
        }
        (Some(value), _) if axis.levels().is_some() && value.abs() < 1e9 => value.to_string(),
        (Some(value), _) => decimal(value, 4),
    }
}

/// Formats the value of an axis with its unit: `gap = 1.5 m`, `delay = 1 control step`.
pub fn axis_value(name: &str, value: &str, unit: &str) -> String {
    // Other units are symbols: `s` is seconds.
    let unit = if value == "1" && unit.ends_with("steps") { unit.trim_end_matches('s') } else { unit };
    format!("{name} = {value} {unit}").trim_end().to_string()
}

/// Reasons why a simulation has no verdict.
pub const DIVERGED: &str = "diverged";
pub const INVALID: &str = "ended in a value that is not finite";

/// Reason of failed simulations.
pub const FAILED: &str = "did not start, crashed or took too long";
pub const UNDECIDED: &str = "left the formula undecided";

/// Formats the numbers of simulations without a verdict, by reason. Returns `None` if there are none.
pub fn without_verdict(diverged: u64, invalid: u64, failed: u64, undecided: u64) -> Option<String> {
    let counts = [(diverged, DIVERGED), (invalid, INVALID), (failed, FAILED), (undecided, UNDECIDED)];
    let shown: Vec<String> = counts
        .iter()
        .filter(|(count, _)| *count > 0)
        .map(|(count, reason)| format!("{} {reason}", plural(*count, "simulation")))
        .collect();
    (!shown.is_empty()).then(|| shown.join(", "))
}

/// Returns a paragraph about the screened simulations without a verdict; empty if all have one.
pub fn without_gpu_verdict(simulations: u64, overflows: u64) -> String {
    if simulations == 0 {
        return String::new();
    }
    let simulations = plural(simulations, "simulation");
    format!(
        "\n\n{simulations} without a verdict on the GPU, {overflows} of them for lack of memory for contacts or constraints"
    )
}

/// Returns `corner` or `center` for a simulation at the corners of the initial box, which an evaluation runs in a trial of its
/// own.
pub fn box_point(header: &RunHeader, trial: u32, scenario: &[Option<f64>]) -> Option<&'static str> {
    if header.kind != RunKind::Evaluate || trial != Corners::TRIAL {
        return None;
    }
    let is_between = |(axis, value): (&AxisRecord, &Option<f64>)| {
        let is_numeric = !axis.values.starts_with("categorical");
        let margin = 1e-6 * (axis.high - axis.low);
        let inner = axis.low + margin..axis.high - margin;
        axis.kind == AxisKind::Start.name() && is_numeric && value.is_some_and(|value| inner.contains(&value))
    };
    let is_center = header.axes.iter().zip(scenario).any(is_between);
    Some(if is_center { "center" } else { "corner" })
}

/// Describes a recorded simulation by its numbers: `trial 2 (corner), simulation 5`.
pub fn simulation_text(header: &RunHeader, recorded: &Simulation) -> String {
    let Simulation { trial, number, scenario, .. } = recorded;
    let point = box_point(header, *trial, scenario).map_or(String::new(), |point| format!(" ({point})"));
    format!("trial {trial}{point}, simulation {number}")
}

/// Describes the end of an episode without a verdict. Signals have their names.
pub fn end_text(end: EpisodeEnd, signals: &[Signal]) -> String {
    match end {
        EpisodeEnd::InvalidSignal { step, index } => {
            let name = signals.get(index).map_or("unknown", |signal| signal.name.as_str());
            format!("the signal `{name}` is not finite at sample {step}")
        }
        EpisodeEnd::InvalidAction { step, index } => {
            format!(
                "the controller returned an action that is not finite in control step {step} (index {index})"
            )
        }
        EpisodeEnd::InvalidObservation { step, index } => {
            format!("the observation is not finite at sample {step} (index {index})")
        }
        EpisodeEnd::InvalidReward { step, index } => {
            format!("the reward is not finite in control step {step} (term {index})")
        }
        EpisodeEnd::Undefined { step } => {
            format!("the formula has no finite value at sample {step}, so the simulation is undecided")
        }
        EpisodeEnd::Diverged { step } => format!("the physics diverged in control step {step}"),
        EpisodeEnd::Stopped { step } => format!("the monitor stopped it after control step {step}"),
        EpisodeEnd::Terminated { step } => format!("the target ended it after control step {step}"),
        EpisodeEnd::InvalidScenario => "the target cannot start from the scenario".to_string(),
        EpisodeEnd::Crashed { step } => format!("the target or its controller failed in control step {step}"),
        EpisodeEnd::TimedOut { step } => format!("it took longer than its time limit in control step {step}"),
        EpisodeEnd::Completed => "it completed".to_string(),
    }
}

/// Returns the path of a run, quoted for a shell.
pub fn name(run: &RunFile) -> String {
    mishandle_text::shell_quote(&run.path().to_string_lossy())
}

/// Reports the progress of an interrupted run and the command that resumes it.
pub fn report_interruption(kind: RunKind, simulations: u64, name: &str) {
    output::message(&format!("interrupted after {}, stored in {name}", plural(simulations, "simulation")));
    output::message(&format!("Resume with: mishandle {} --resume {name}", kind.name()));
}

/// Reports an interrupted command that writes no run file: what is kept, and what is lost.
pub fn report_loss(simulations: u64, kept_and_lost: &str) {
    output::message(&format!("interrupted after {}: {kept_and_lost}", plural(simulations, "simulation")));
}

/// Makes signals end the run after the current batch. The first signal prints a message immediately.
pub fn stop_on_signals(bar: &Bar) -> Result<()> {
    let (announced, cleared) = (bar.line(), bar.line());
    let announce = move || {
        announced.suspend(|| {
            output::message("finishing the running simulations; press Ctrl-C again to stop immediately");
        });
    };
    interrupt::listen(announce, move || cleared.finish_and_clear())
}

/// Returns whether to continue after a batch.
pub fn control_flow() -> ControlFlow<()> {
    if interrupt::requested() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
}

/// Writes a trace as CSV, with `more` columns after the signals.
pub fn write_trace(path: &Path, header: &RunHeader, trace: &Trace, more: &[TraceColumn]) -> Result<()> {
    let columns = (0..trace.names().len()).map(|i| trace.column(i).to_vec()).collect();
    let stored = StoredTrace { columns };
    output::write_new(path, |out| Ok(store::export_trace_csv(header, &stored, more, out)?))?;
    output::message(&format!("wrote the trace to {}", path.display()));
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_unit_of_counted_things_is_singular_after_1() {
        assert_eq!(axis_value("delay", "1", "control steps"), "delay = 1 control step");
        assert_eq!(axis_value("delay", "2", "control steps"), "delay = 2 control steps");
        assert_eq!(axis_value("time", "1", "s"), "time = 1 s");
        assert_eq!(axis_value("scale", "1", ""), "scale = 1");
    }
}
