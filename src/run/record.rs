//! Conversion between episodes and stored simulations. No other module does this.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use mishandle_files::NewFolders;
use mishandle_rollout::{
    Axis, AxisKind, AxisValues, Condition, Episode, EpisodeEnd, Holds, Request, Scenario, Seed, Space,
    Verdict,
};
use mishandle_stl::Trace;
use mishandle_store as store;
use mishandle_store::{AxisRecord, IfExists, RunHeader, RunWriter, Simulation, StoreError, TargetRecord};

use crate::build::build;
use crate::error::MishandleError;
use crate::plan::Plan;
use crate::resolve::{ResolvedPlan, controller_name, file_label, is_path};

/// Names of the verdicts that are stored in addition to the robustness. If the search needs
/// the parts of the robustness, they follow. The robustness of each named requirement comes last.
const VERDICTS: [&str; 6] =
    ["success", "strict", "dangerous_steps", "completion_step", "total_reward", "careful"];

/// Start of the names of the verdicts of named requirements.
pub(crate) const REQUIREMENT: &str = "requirement_";

/// Returns the names of all verdicts of a run.
pub(crate) fn verdict_names(resolved: &ResolvedPlan) -> Vec<String> {
    let parts = (1..=resolved.stored_parts).map(|i| format!("part_{i}"));
    let others = resolved.specification.others.iter().map(|(name, _)| format!("{REQUIREMENT}{name}"));
    VERDICTS.map(String::from).into_iter().chain(parts).chain(others).collect()
}

/// Returns the header of a run.
pub(crate) fn header(resolved: &ResolvedPlan) -> RunHeader {
    let ResolvedPlan { plan, target, space, specification, signals, .. } = resolved;
    // Absolute, so that the run can be resumed and replayed from every folder.
    let mut stored = plan.with_absolute_paths();
    if let (true, Ok(path)) = (is_path(&plan.controller), std::path::absolute(&plan.controller)) {
        stored.controller = path.to_string_lossy().into_owned();
    }
    let components = target.components.iter().map(|component| store::ComponentRecord {
        role: component.role.clone(),
        name: component.name.clone(),
        hash: component.hash.clone(),
        file_hash: component.file_hash.clone(),
    });
    let formulas = target
        .formulas
        .iter()
        .filter(|formula| formula.name != "careful" || specification.careful.is_some())
        .map(|formula| store::FormulaRecord { name: formula.name.clone(), text: formula.text.clone() });
    let requirements = specification.others.iter().map(|(name, formula)| store::FormulaRecord {
        name: format!("{REQUIREMENT}{name}"),
        text: formula.to_string(),
    });
    let signals = signals
        .iter()
        .map(|signal| store::SignalRecord { name: signal.name.clone(), unit: signal.unit.clone() });
    RunHeader {
        kind: plan.kind(),
        build: build(),
        versions: target.versions.clone(),
        plan: stored.to_toml(),
        target: TargetRecord {
            kind: target.identity.kind.clone(),
            name: target.identity.name.clone(),
            hash: target.identity.hash.clone(),
            is_deterministic: target.is_deterministic,
        },
        components: components.collect(),
        space: space.name().to_string(),
        formula: specification.requirement.to_string(),
        formulas: formulas.chain(requirements).collect(),
        search: plan.falsify.as_ref().map_or(String::new(), |falsify| falsify.search.clone()),
        seed: plan.seed,
        control_dt: target.control_dt,
        episode_steps: target.episode_steps as u32,
        signals: signals.collect(),
        axes: axis_records(space),
        verdicts: verdict_names(resolved),
        preflight: vec![],
    }
}

/// Returns the axes of a space as a run file describes them.
pub(crate) fn axis_records(space: &Space) -> Vec<AxisRecord> {
    space.axes().iter().map(|each| axis(space, each)).collect()
}

fn axis(space: &Space, axis: &Axis) -> AxisRecord {
    let values = match &axis.values {
        AxisValues::Continuous => "continuous".to_string(),
        AxisValues::Logarithmic => "logarithmic".to_string(),
        AxisValues::Integer => "integer".to_string(),
        AxisValues::Categorical(names) => format!("categorical: {}", names.join(", ")),
    };
    AxisRecord {
        name: axis.name.clone(),
        unit: axis.unit.clone(),
        kind: axis.kind.name().to_string(),
        low: axis.low,
        high: axis.high,
        nominal: axis.nominal,
        values: values + &conditions_text(space, axis),
        meaning: axis.meaning.clone(),
    }
}

/// Text between the values of an axis and its conditions.
const ONLY_IF: &str = "; only if ";

/// Returns the conditions of an axis: the other axes and the numbers of their values.
fn conditions_text(space: &Space, axis: &Axis) -> String {
    let has_axis = |condition: &&Condition| space.axes().iter().any(|axis| axis.name == condition.axis);
    let text = |condition: &Condition| match &condition.holds {
        Holds::OneOf(values) => {
            let values: Vec<String> = values.iter().map(ToString::to_string).collect();
            format!("`{}` in {}", condition.axis, values.join("|"))
        }
        Holds::Except(value) => format!("`{}` not {value}", condition.axis),
    };
    // Others are constant: the space has no axis without an effect.
    let texts: Vec<String> = axis.conditions.iter().filter(has_axis).map(text).collect();
    if texts.is_empty() { String::new() } else { ONLY_IF.to_string() + &texts.join(" and ") }
}

/// Reads what [`conditions_text`] wrote.
fn recorded_conditions(text: &str) -> Vec<Condition> {
    let condition = |text: &str| {
        let (axis, holds) = text.strip_prefix('`')?.split_once("` ")?;
        let (word, values) = holds.split_once(' ')?;
        let values = values.split('|').map(|value| value.parse().ok()).collect::<Option<Vec<f64>>>()?;
        let holds = match (word, values.as_slice()) {
            ("in", values) => Holds::OneOf(values.into()),
            ("not", [value]) => Holds::Except(*value),
            _ => return None,
        };
        // Its axis is in the record, so the nominal value is not needed.
        Some(Condition { axis: axis.to_string(), nominal: 0.0, holds })
    };
    text.split(" and ").filter_map(condition).collect()
}

/// Returns the axis that a run file describes. Its kind matters for sampling and checks only, which
/// a description does not need.
pub fn recorded_axis(record: &AxisRecord) -> Axis {
    let (values, conditions) = record.values.rsplit_once(ONLY_IF).unwrap_or((&record.values, ""));
    let values = match values.split_once(": ") {
        Some(("categorical", names)) => {
            AxisValues::Categorical(names.split(", ").map(str::to_string).collect())
        }
        _ if values == "logarithmic" => AxisValues::Logarithmic,
        _ if values == "integer" => AxisValues::Integer,
        _ => AxisValues::Continuous,
    };
    let bounds = [record.low, record.high];
    let kind = AxisKind::by_name(&record.kind).unwrap_or(AxisKind::Start);
    Axis::new(kind, &record.name, &record.unit, bounds, record.nominal)
        .with_values(values)
        .only_if(recorded_conditions(conditions))
}

/// Creates the run file of a plan at `path`, with its folder. Without a path, chooses the first
/// free name in the folder `runs`.
///
/// # Errors
/// If the file exists already or cannot be written.
pub fn create_run(resolved: &ResolvedPlan, path: Option<&Path>) -> Result<RunWriter, MishandleError> {
    // What a question needs, before there is a file.
    if resolved.plan.risk.is_some() {
        crate::run::check_risk_method(resolved)?;
    }
    if let Some(margin) = &resolved.plan.margin {
        mishandle_falsification::check_margin(margin.budget, &resolved.space)?;
        if margin.each_category {
            mishandle_falsification::each_category(&resolved.space)?;
        }
    }
    let Some(path) = path else {
        // Another process can take the free name first.
        let is_taken = |created: &Result<RunWriter, MishandleError>| {
            matches!(
                created,
                Err(MishandleError::Store(StoreError::Exists { .. } | StoreError::Locked { .. }))
            )
        };
        let mut number = 1;
        let mut created = create(resolved, &free_name(&resolved.plan, number));
        while is_taken(&created) {
            number += 1;
            created = create(resolved, &free_name(&resolved.plan, number));
        }
        return created;
    };
    create(resolved, path)
}

/// Continues the run of a plan at `path`, or begins it.
///
/// # Errors
/// If it is a run of another plan, which stays as it is, or cannot be opened.
pub(crate) fn continue_run(resolved: &ResolvedPlan, path: &Path) -> Result<RunWriter, MishandleError> {
    let run = match path.exists().then(|| RunWriter::resume(path)) {
        // A program was killed while it created the run.
        None | Some(Err(StoreError::Unfinished { .. })) => create_run(resolved, Some(path))?,
        Some(run) => run?,
    };
    crate::run::header::check(run.file().header(), resolved)?;
    Ok(run)
}

/// Creates the run file of a plan at `path`, with its folder.
fn create(resolved: &ResolvedPlan, path: &Path) -> Result<RunWriter, MishandleError> {
    // Removes them again if the run cannot be created.
    let mut folders = NewFolders::default();
    if let Some(folder) = path.parent().filter(|folder| !folder.as_os_str().is_empty()) {
        folders.create(folder).map_err(|source| MishandleError::Write {
            what: "folder",
            path: folder.to_path_buf(),
            source,
        })?;
    }
    let header = RunHeader { preflight: crate::run::preflight(resolved)?, ..header(resolved) };
    Ok(RunWriter::create(path, &header, IfExists::Refuse)?)
}

/// Returns `runs/KIND-TARGET[-CONTROLLER][-SEARCH]-sSEED[-N].sqlite`. The first name has no number.
fn free_name(plan: &Plan, number: u32) -> PathBuf {
    let target = file_label(&plan.target);
    let kind = plan.kind().name();
    let search = plan.falsify.as_ref().map_or("", |falsify| falsify.search.as_str());
    let seed = format!("s{}", plan.seed);
    let parts = [kind, &target, &controller_name(&plan.controller), search, &seed];
    let number = if number == 1 { String::new() } else { number.to_string() };
    let parts = parts.into_iter().chain([number.as_str()]).filter(|part| !part.is_empty());
    Path::new("runs").join(parts.collect::<Vec<_>>().join("-") + ".sqlite")
}

/// Converts an episode of a plan to a stored simulation. Only a
/// counterexample keeps its trace.
pub(crate) fn record(episode: &Episode, resolved: &ResolvedPlan) -> Simulation {
    let columns = (0..episode.trace.names().len()).map(|i| episode.trace.column(i).to_vec()).collect();
    let trace = store::StoredTrace { columns };
    let Episode { request, verdict, .. } = episode;
    let is_falsified = episode.is_violated();
    let parts = (0..resolved.stored_parts).map(|i| verdict.parts.get(i).copied());
    let verdicts = [
        verdict.success,
        verdict.strict,
        verdict.dangerous_steps.map(|steps| steps as f64),
        verdict.completion_step.map(|step| step as f64),
        episode.total_reward.is_finite().then_some(episode.total_reward),
        verdict.careful,
    ];
    // An episode without a verdict has none of them.
    let others = (0..resolved.specification.others.len()).map(|i| verdict.others.get(i).copied().flatten());
    // The value is a lower bound if the simulation stopped because it is above the threshold.
    let is_bound = matches!(episode.end, EpisodeEnd::Stopped { .. })
        && request.stop_threshold.is_some_and(|threshold| verdict.robustness > Some(threshold));
    Simulation {
        trial: request.trial,
        number: request.number,
        seed: request.seed.0,
        unit_point: request.unit_point.clone(),
        scenario: request.scenario.values().to_vec(),
        robustness: verdict.robustness,
        robustness_low: verdict.robustness,
        robustness_high: if is_bound { Some(f64::INFINITY) } else { verdict.robustness },
        stop_threshold: request.stop_threshold,
        end: stored_end(episode.end),
        steps: episode.steps as u32,
        verdicts: verdicts.into_iter().chain(parts).chain(others).collect(),
        reason: episode.reason.clone(),
        trace_digest: Some(episode.trace_digest.unwrap_or_else(|| trace.digest())),
        trace: is_falsified.then_some(trace),
    }
}

fn stored_end(end: EpisodeEnd) -> store::SimulationEnd {
    use store::SimulationEnd as End;
    match end {
        EpisodeEnd::Completed => End::Completed,
        EpisodeEnd::Terminated { step } => End::Terminated { step: step as u32 },
        EpisodeEnd::Stopped { step } => End::Stopped { step: step as u32 },
        EpisodeEnd::Diverged { step } => End::Diverged { step: step as u32 },
        EpisodeEnd::Undefined { step } => End::Undefined { step: step as u32 },
        EpisodeEnd::InvalidAction { step, index } => {
            End::InvalidAction { step: step as u32, index: index as u32 }
        }
        EpisodeEnd::InvalidObservation { step, index } => {
            End::InvalidObservation { step: step as u32, index: index as u32 }
        }
        EpisodeEnd::InvalidReward { step, index } => {
            End::InvalidReward { step: step as u32, index: index as u32 }
        }
        EpisodeEnd::InvalidSignal { step, index } => {
            End::InvalidSignal { step: step as u32, index: index as u32 }
        }
        EpisodeEnd::InvalidScenario => End::InvalidScenario,
        EpisodeEnd::Crashed { step } => End::Crashed { step: step as u32 },
        EpisodeEnd::TimedOut { step } => End::TimedOut { step: step as u32 },
    }
}

pub(crate) fn episode_end(end: store::SimulationEnd) -> EpisodeEnd {
    use store::SimulationEnd as End;
    match end {
        End::Completed => EpisodeEnd::Completed,
        End::Terminated { step } => EpisodeEnd::Terminated { step: step as usize },
        End::Stopped { step } => EpisodeEnd::Stopped { step: step as usize },
        End::Diverged { step } => EpisodeEnd::Diverged { step: step as usize },
        End::Undefined { step } => EpisodeEnd::Undefined { step: step as usize },
        End::InvalidAction { step, index } => {
            EpisodeEnd::InvalidAction { step: step as usize, index: index as usize }
        }
        End::InvalidObservation { step, index } => {
            EpisodeEnd::InvalidObservation { step: step as usize, index: index as usize }
        }
        End::InvalidReward { step, index } => {
            EpisodeEnd::InvalidReward { step: step as usize, index: index as usize }
        }
        End::InvalidSignal { step, index } => {
            EpisodeEnd::InvalidSignal { step: step as usize, index: index as usize }
        }
        End::InvalidScenario => EpisodeEnd::InvalidScenario,
        End::Crashed { step } => EpisodeEnd::Crashed { step: step as usize },
        End::TimedOut { step } => EpisodeEnd::TimedOut { step: step as usize },
    }
}

/// Converts a stored simulation of a plan to an episode, with a trace if the simulation has one.
///
/// # Errors
/// If the episode has too many steps.
pub(crate) fn episode(simulation: &Simulation, resolved: &ResolvedPlan) -> Result<Episode, MishandleError> {
    let target = &resolved.target;
    let episode_steps = target.episode_steps;
    let stored = |name: &str| {
        let index = VERDICTS.iter().position(|verdict| *verdict == name)?;
        simulation.verdicts.get(index).copied().flatten()
    };
    // A sample is taken before the first step, too.
    let samples = episode_steps as f64 + 1.0;
    let count = |name: &'static str, limit: f64, value: Option<f64>| {
        let is_count = |value: &f64| (0.0..=limit).contains(value) && value.fract() == 0.0;
        match value {
            Some(value) if !is_count(&value) => {
                let Simulation { trial, number, .. } = *simulation;
                Err(MishandleError::InvalidCount { name, trial, number, value, limit })
            }
            value => Ok(value.map(|value| value as usize)),
        }
    };
    let dangerous_steps = count("dangerous_steps", samples, stored("dangerous_steps"))?;
    let completion_step = count("completion_step", samples, stored("completion_step"))?;
    let steps = count("steps", episode_steps as f64, Some(simulation.steps.into()))?;
    count("end_step", samples, simulation.end.step().map(f64::from))?;
    let end = episode_end(simulation.end);
    if !target.can_fail && (end.is_failed() || matches!(end, EpisodeEnd::Terminated { .. })) {
        let Simulation { trial, number, end, .. } = *simulation;
        return Err(MishandleError::ImpossibleEnd { trial, number, end });
    }
    if let Some(problem) = contradiction(simulation, episode_steps) {
        let Simulation { trial, number, .. } = *simulation;
        return Err(MishandleError::Contradiction { trial, number, problem });
    }
    let episode = recorded_episode(simulation);
    let further = simulation.verdicts.get(VERDICTS.len()..).unwrap_or_default();
    let (parts, others) = further.split_at(further.len().min(resolved.stored_parts));
    // Either all parts are present or none, because a formula can have no finite value.
    let parts = parts.iter().copied().collect::<Option<Vec<f64>>>().unwrap_or_default();
    let request = Request { needs_parts: resolved.stored_parts > 0, ..episode.request };
    let verdict =
        Verdict { dangerous_steps, completion_step, parts, others: others.to_vec(), ..episode.verdict };
    let trace =
        simulation.trace.as_ref().map_or(episode.trace, |stored| trace(resolved.signal_names(), stored));
    Ok(Episode { request, trace, steps: steps.unwrap_or_default(), verdict, ..episode })
}

/// Returns a recorded trace with the names of its signals.
pub(crate) fn trace(names: Arc<[String]>, stored: &store::StoredTrace) -> Trace {
    let samples = stored.columns.first().map_or(0, Vec::len);
    let mut trace = Trace::with_capacity(names, samples);
    let mut sample = vec![0.0; stored.columns.len()];
    for step in 0..samples {
        sample.iter_mut().zip(&stored.columns).for_each(|(value, column)| *value = column[step]);
        trace.push(&sample);
    }
    trace
}

/// Converts a stored simulation to an episode without a trace and parts, and checks none of
/// its values.
///
/// It needs no target, so it reads runs whose target is not here, such as those of a Python system.
pub fn recorded_episode(simulation: &Simulation) -> Episode {
    let stored = |name: &str| {
        let index = VERDICTS.iter().position(|verdict| *verdict == name)?;
        simulation.verdicts.get(index).copied().flatten()
    };
    let count = |name: &str| stored(name).map(|value| value as usize);
    Episode {
        request: request(simulation, false),
        end: episode_end(simulation.end),
        reason: simulation.reason.clone(),
        steps: simulation.steps as usize,
        verdict: Verdict {
            robustness: simulation.robustness,
            success: stored("success"),
            strict: stored("strict"),
            careful: stored("careful"),
            dangerous_steps: count("dangerous_steps"),
            completion_step: count("completion_step"),
            ..Verdict::default()
        },
        total_reward: stored("total_reward").unwrap_or(f64::NAN),
        trace: Trace::new([].into()),
        trace_digest: simulation.trace_digest,
    }
}

/// Describes how the end of a stored simulation contradicts its other values; `None` if it does
/// not.
fn contradiction(simulation: &Simulation, episode_steps: usize) -> Option<&'static str> {
    use store::SimulationEnd as End;
    let Simulation { end, steps, robustness, robustness_low, robustness_high, .. } = *simulation;
    let has_value = |name: &str| {
        let index = VERDICTS.iter().position(|verdict| *verdict == name);
        index.and_then(|index| simulation.verdicts.get(index).copied().flatten()).is_some()
    };
    let bits = |value: Option<f64>| value.map(f64::to_bits);
    let can_have_verdict = matches!(end, End::Completed | End::Terminated { .. } | End::Stopped { .. });
    let stopped_at = match end {
        End::Terminated { step } | End::Stopped { step } => Some(step),
        _ => None,
    };
    let has_verdict = robustness.is_some() || ["success", "strict", "careful"].into_iter().any(has_value);
    if !can_have_verdict && has_verdict {
        Some("its end allows no verdict, but it has one")
    } else if end == End::Completed && (steps as usize) != episode_steps {
        Some("it completed, but with another number of control steps than an episode")
    } else if stopped_at.is_some_and(|step| step != steps) {
        Some("it ended after another control step than it took")
    } else if matches!(end, End::InvalidAction { step: 0, .. } | End::InvalidReward { step: 0, .. }) {
        Some("its end has control step 0, and control steps count from 1")
    } else if simulation.stop_threshold.is_none()
        && (bits(robustness_low), bits(robustness_high)) != (bits(robustness), bits(robustness))
    {
        Some("no stop rule applied, but the bounds of its robustness differ from the robustness")
    } else {
        None
    }
}

/// Returns the request of a stored simulation.
pub(crate) fn request(simulation: &Simulation, needs_parts: bool) -> Request {
    Request {
        trial: simulation.trial,
        number: simulation.number,
        unit_point: simulation.unit_point.clone(),
        scenario: Scenario::new(simulation.scenario.clone()),
        seed: Seed(simulation.seed),
        needs_parts,
        stop_threshold: simulation.stop_threshold,
    }
}
