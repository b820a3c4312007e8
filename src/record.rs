//! Between what ran and what is stored: only here is one turned into the other.

use std::path::{Path, PathBuf};

use mishandle_rollout::{End, Environment, Episode, Seed, Verdict};
use mishandle_store as store;
use mishandle_store::{Existing, RunHeader, RunKind, RunWriter, SimulationRecord};

use crate::subject::is_path;
use crate::{MishandleError, Plan, Subject, build, controller_name};

/// Names of the verdicts that are stored beside the robustness.
const VERDICTS: [&str; 5] = ["success", "strict", "dangerous_steps", "completion_step", "total_reward"];

/// The header of a run of `plan` on `subject`.
fn header(plan: &Plan, subject: &Subject) -> RunHeader {
    // A run is resumed and replayed from anywhere, so a path in it leads there from anywhere.
    let mut stored = plan.clone();
    if let (true, Ok(path)) = (is_path(&plan.controller), std::path::absolute(&plan.controller)) {
        stored.controller = path.to_string_lossy().into_owned();
    }
    let environment = &subject.environment;
    let axes = environment.initial_box().axes().iter().map(|axis| store::Axis {
        name: axis.name.clone(),
        unit: axis.unit.clone(),
        low: axis.low,
        high: axis.high,
    });
    RunHeader {
        kind: if plan.falsify.is_some() { RunKind::Falsify } else { RunKind::Evaluate },
        build: build(),
        plan: stored.to_toml(),
        controller: controller_name(&plan.controller),
        controller_hash: subject.controller_hash.clone(),
        controller_bytes_hash: subject.controller_bytes_hash.clone(),
        task: plan.task.clone(),
        preset: plan.preset.clone(),
        formula: subject.specification.requirement.to_string(),
        search: plan.falsify.as_ref().map_or(String::new(), |falsify| falsify.search.clone()),
        seed: plan.seed,
        control_dt: environment.control_dt(),
        signals: environment.signals().to_vec(),
        axes: axes.collect(),
        verdicts: VERDICTS.map(String::from).to_vec(),
    }
}

/// Creates the run file of `plan` at `path`, or at the first free name in `runs/`.
///
/// # Errors
/// If there is a file already, or none can be written.
pub fn create_run(plan: &Plan, subject: &Subject, path: Option<&Path>) -> Result<RunWriter, MishandleError> {
    let path = match path {
        Some(path) => path.to_path_buf(),
        None => free_path(plan)?,
    };
    Ok(RunWriter::create(path, &header(plan, subject), Existing::Refuse)?)
}

/// `runs/KIND-TASK-CONTROLLER[-SEARCH]-sSEED[-N].sqlite`, with the first N that is free.
fn free_path(plan: &Plan) -> Result<PathBuf, MishandleError> {
    let folder = PathBuf::from("runs");
    std::fs::create_dir_all(&folder)
        .map_err(|source| MishandleError::File { path: folder.clone(), source })?;
    let controller = controller_name(&plan.controller);
    let work = match &plan.falsify {
        Some(falsify) => format!("falsify-{}-{controller}-{}", plan.task, falsify.search),
        None => format!("evaluate-{}-{controller}", plan.task),
    };
    let name = format!("{work}-s{}", plan.seed);
    let candidates = (1..).map(|n: u32| if n == 1 { name.clone() } else { format!("{name}-{n}") });
    let free = candidates.map(|name| folder.join(name + ".sqlite")).find(|path| !path.exists());
    Ok(free.unwrap_or_default())
}

/// Where a simulation stands in its run, and what the search asked for.
pub(crate) struct Place<'a> {
    pub trial: u32,
    pub number: u32,
    pub unit_point: &'a [f64],
}

/// What is stored of an episode; its trace too if it is a counterexample.
pub(crate) fn record(place: &Place<'_>, episode: &Episode) -> SimulationRecord {
    let columns: Vec<Vec<f64>> =
        (0..episode.trace.names().len()).map(|i| episode.trace.column(i).to_vec()).collect();
    let trace = store::Trace { columns };
    let verdict = &episode.verdict;
    let decided = !matches!(episode.end, End::Diverged { .. } | End::Undefined { .. });
    let falsified = verdict.robustness.is_some_and(|rho| rho < 0.0);
    SimulationRecord {
        simulation: store::Simulation {
            trial: place.trial,
            number: place.number,
            seed: episode.seed.0,
            unit_point: place.unit_point.to_vec(),
            initial_configuration: episode.x0.clone(),
            robustness: verdict.robustness,
            end: match episode.end {
                End::Completed => store::End::Horizon,
                End::Stopped { step } => store::End::Stopped { step: step as u32 },
                End::Diverged { step } => store::End::Diverged { step: step as u32 },
                End::Undefined { step } => store::End::Undefined { step: step as u32 },
            },
            steps: episode.steps() as u32,
            verdicts: vec![
                verdict.success,
                verdict.strict,
                decided.then_some(verdict.dangerous_steps as f64),
                verdict.completion_step.map(|step| step as f64),
                episode.total_reward.is_finite().then_some(episode.total_reward),
            ],
            trace_digest: Some(trace.digest()),
        },
        trace: falsified.then_some(trace),
    }
}

/// How a stored simulation ended.
pub(crate) fn end(simulation: &store::Simulation) -> End {
    match simulation.end {
        store::End::Horizon => End::Completed,
        store::End::Stopped { step } => End::Stopped { step: step as usize },
        store::End::Diverged { step } => End::Diverged { step: step as usize },
        store::End::Undefined { step } => End::Undefined { step: step as usize },
    }
}

/// The verdict of a stored simulation.
pub(crate) fn verdict(simulation: &store::Simulation) -> Verdict {
    let stored = |name: &str| {
        let index = VERDICTS.iter().position(|verdict| *verdict == name)?;
        simulation.verdicts.get(index).copied().flatten()
    };
    Verdict {
        robustness: simulation.robustness,
        success: stored("success"),
        strict: stored("strict"),
        dangerous_steps: stored("dangerous_steps").unwrap_or(0.0) as usize,
        completion_step: stored("completion_step").map(|step| step as usize),
    }
}

/// The seed of a stored simulation.
pub(crate) fn seed(simulation: &store::Simulation) -> Seed {
    Seed(simulation.seed)
}
