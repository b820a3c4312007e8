//! What evaluate and falsify share: from flags to a plan, and where its run is stored.

use std::ops::ControlFlow;
use std::path::Path;

use anyhow::{Context, Result, bail, ensure};
use mishandle::rollout::Axis;
use mishandle::store::{RunFile, RunWriter};
use mishandle::{Plan, ResolvedPlan};
use serde_json::{Value, json};

use crate::progress::Bar;
use crate::{args, interrupt, output};

/// More threads than any machine has cores for.
const MAX_THREADS: usize = 1024;

/// Makes a rayon pool of the wanted size the one that everything runs in.
pub fn set_threads(threads: Option<usize>) -> Result<()> {
    if let Some(threads) = threads {
        ensure!(
            (1..=MAX_THREADS).contains(&threads),
            "--threads is {threads}; it has to be from 1 to {MAX_THREADS}"
        );
        rayon::ThreadPoolBuilder::new().num_threads(threads).build_global()?;
    }
    Ok(())
}

/// The plan that the flags describe: one from a file or a run, or a new one, edited.
pub fn plan(subject: &args::Subject, run: &args::Run) -> Result<Plan> {
    let mut plan = match (&subject.plan, &subject.target) {
        (Some(path), _) => {
            let text = std::fs::read_to_string(path).with_context(|| path.display().to_string())?;
            Plan::from_toml(&text).with_context(|| path.display().to_string())?
        }
        (None, Some(target)) => Plan::new(target, ""),
        (None, None) => bail!("expected a target or a --plan"),
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
    plan.action_noise = subject.action_noise.unwrap_or(plan.action_noise);
    plan.observation_noise = subject.observation_noise.unwrap_or(plan.observation_noise);
    plan.stochastic |= subject.stochastic;
    plan.seed = run.seed.unwrap_or(plan.seed);
    ensure!(!plan.target.is_empty(), "neither the plan nor an argument names a target");
    Ok(plan)
}

/// A resolved plan and its open run file: of a stopped run, whose controller may have moved, or of a new one that the
/// flags describe.
pub fn open(
    resume: Option<&Path>,
    controller: Option<&str>,
    out: Option<&Path>,
    new_plan: impl FnOnce() -> Result<Plan>,
) -> Result<(ResolvedPlan, RunWriter)> {
    let Some(path) = resume else {
        let resolved = ResolvedPlan::new(&new_plan()?)?;
        let run = mishandle::create_run(&resolved, out)?;
        return Ok((resolved, run));
    };
    let run = RunWriter::resume(path)?;
    let resolved = mishandle::recorded_plan(run.file().header(), controller)?;
    for difference in mishandle::other_build(run.file().header(), &resolved) {
        output::say(&format!("warning: the run was begun by another build: {difference}"));
    }
    Ok((resolved, run))
}

/// What is tested and how, in a line, for a heading.
pub fn heading(resolved: &ResolvedPlan) -> String {
    let ResolvedPlan { plan, space, .. } = resolved;
    let mut text = plan.target.clone();
    if !plan.controller.is_empty() {
        text.push_str(&format!(", controller {}, task preset {}", plan.controller, plan.preset));
    }
    if plan.space != "starts" {
        text.push_str(&format!(", space {} ({})", plan.space, axes(space.dimension())));
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

/// A number of axes in words.
pub fn axes(count: usize) -> String {
    if count == 1 { "1 axis".to_string() } else { format!("{count} axes") }
}

/// A number of simulations in words.
pub fn simulations(count: u64) -> String {
    if count == 1 { "1 simulation".to_string() } else { format!("{count} simulations") }
}

/// The keys that the documents of `evaluate` and `falsify` share.
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

/// A scenario by axis name.
pub fn scenario(axes: &[Axis], values: &[Option<f64>]) -> Value {
    let entries = axes.iter().zip(values).map(|(axis, value)| (axis.name.clone(), json!(value)));
    Value::Object(entries.collect())
}

/// Values of a scenario that a table shows.
const SHOWN_AXES: usize = 4;

/// A scenario for a table: all of a small one, of a large one the values that are farthest from nominal.
pub fn at(axes: &[Axis], values: &[Option<f64>]) -> String {
    shown(axes, values, SHOWN_AXES)
}

/// A whole scenario for people.
pub fn whole(axes: &[Axis], values: &[Option<f64>]) -> String {
    shown(axes, values, usize::MAX)
}

fn shown(axes: &[Axis], values: &[Option<f64>], most: usize) -> String {
    let mut set: Vec<(usize, &Axis, f64)> = (0..)
        .zip(axes.iter().zip(values))
        .filter_map(|(place, (axis, value))| Some((place, axis, (*value)?)))
        .collect();
    // To leave out one value saves no room.
    let left_out = if set.len() > most.saturating_add(1) { set.len() - most } else { 0 };
    if left_out > 0 {
        let distance = |(_, axis, value): &(usize, &Axis, f64)| {
            (axis.unit_coordinate(*value) - axis.unit_coordinate(axis.nominal.unwrap_or_default())).abs()
        };
        set.sort_by(|a, b| distance(b).total_cmp(&distance(a)));
        set.truncate(most);
        set.sort_by_key(|(place, ..)| *place);
    }
    let value = |(_, axis, value): &(usize, &Axis, f64)| match axis.levels() {
        Some(_) => format!("{} = {value} {}", axis.name, axis.unit),
        None => format!("{} = {value:.4} {}", axis.name, axis.unit),
    };
    let values: Vec<String> = set.iter().map(|pair| value(pair).trim_end().to_string()).collect();
    let rest = if left_out > 0 { format!(", and {left_out} more") } else { String::new() };
    values.join(", ") + &rest
}

/// Where a run is, as a person would type it.
pub fn name(run: &RunFile) -> String {
    mishandle::shell_word(&run.path().to_string_lossy())
}

/// Says how far an interrupted run came, and how it goes on.
pub fn say_interrupted(command: &str, simulations: u64, name: &str) {
    output::say(&format!("interrupted after {simulations} simulations; every one is in {name}"));
    output::say(&format!("Carry on: mishandle {command} --resume {name}"));
}

/// Has signals end the run after a batch, and says so below the bar as soon as one comes.
pub fn end_on_signals(bar: &Bar) -> Result<()> {
    let (shown, cleared) = (bar.line(), bar.line());
    let announce = move || {
        shown.suspend(|| {
            output::say("finishing the simulations that have begun; Ctrl-C again ends at once");
        });
    };
    interrupt::listen(announce, move || cleared.finish_and_clear())
}

/// Whether to go on after a batch.
pub fn flow() -> ControlFlow<()> {
    if interrupt::asked() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
}
