//! Compares a recorded simulation with its replay.

use mishandle_store::Simulation;

/// Lists all differences between a recorded simulation and its replay. `recorded_names` and `names`
/// are the names of their verdicts.
pub(super) fn differences(
    recorded: &Simulation,
    recorded_names: &[String],
    again: &Simulation,
    names: &[String],
) -> Vec<String> {
    let steps = |simulation: &Simulation| simulation.steps.to_string();
    let mut parts = vec![
        part("end", &end(recorded), &end(again)),
        part("number of control steps", &steps(recorded), &steps(again)),
        part("robustness", &number(recorded.robustness), &number(again.robustness)),
        part(
            "lower bound of the robustness",
            &number(recorded.robustness_low),
            &number(again.robustness_low),
        ),
        part(
            "upper bound of the robustness",
            &number(recorded.robustness_high),
            &number(again.robustness_high),
        ),
        part("stop threshold", &number(recorded.stop_threshold), &number(again.stop_threshold)),
    ];
    for (name, value) in recorded_names.iter().zip(&recorded.verdicts) {
        // A verdict that this program does not compute is a difference of the headers.
        let position = names.iter().position(|known| known == name);
        if let Some(now) = position.and_then(|position| again.verdicts.get(position)) {
            parts.push(part(&format!("verdict `{name}`"), &number(*value), &number(*now)));
        }
    }
    let digest = |simulation: &Simulation| {
        simulation.trace_digest.map_or_else(|| NONE.to_string(), |digest| format!("{digest:032x}"))
    };
    parts.push(part("digest of the trace", &digest(recorded), &digest(again)));
    let is_stored = |simulation: &Simulation| simulation.trace.is_some().to_string();
    parts.push(part("whether the trace is stored", &is_stored(recorded), &is_stored(again)));
    parts.into_iter().flatten().collect()
}

/// Text of a value that is absent.
const NONE: &str = "none";

/// Returns a number with all its digits and the sign of a zero.
fn number(value: Option<f64>) -> String {
    value.map_or_else(|| NONE.to_string(), |value| format!("{value:?}"))
}

/// Returns the end of a simulation with all its facts.
fn end(simulation: &Simulation) -> String {
    let fact = |what, value: Option<u32>| value.map(|value| format!(", {what} {value}")).unwrap_or_default();
    let end = simulation.end;
    end.name().to_string() + &fact("step", end.step()) + &fact("index", end.index())
}

/// Describes a difference of two texts.
fn part(what: &str, recorded: &str, again: &str) -> Option<String> {
    (recorded != again).then(|| format!("{what}: recorded {recorded}, replayed {again}"))
}
