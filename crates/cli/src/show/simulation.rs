//! Recorded simulations: their numbers, how they ended, and their traces.

use std::path::Path;

use anyhow::Result;
use mishandle::evaluation::Corners;
use mishandle::plural;
use mishandle::rollout::{AxisKind, EpisodeEnd, Signal};
use mishandle::stl::Trace;
use mishandle::store::{self, AxisRecord, RunHeader, RunKind, Simulation, StoredTrace, TraceColumn};

use super::output;

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
pub fn text(header: &RunHeader, recorded: &Simulation) -> String {
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

/// Writes a trace as CSV, with `more` columns after the signals.
pub fn write_trace(path: &Path, header: &RunHeader, trace: &Trace, more: &[TraceColumn]) -> Result<()> {
    let columns = (0..trace.names().len()).map(|i| trace.column(i).to_vec()).collect();
    let stored = StoredTrace { columns };
    output::write_new(path, |out| Ok(store::export_trace_csv(header, &stored, more, out)?))?;
    output::message(&format!("wrote the trace to {}", path.display()));
    Ok(())
}
