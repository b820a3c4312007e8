//! Compares a recorded simulation with its replay.

use std::fmt::Debug;

use mishandle_store::Simulation;

/// Lists all differences between a recorded simulation and its replay. `recorded_names` and `names` are the names of
/// their verdicts.
pub(super) fn differences(
    recorded: &Simulation,
    recorded_names: &[String],
    again: &Simulation,
    names: &[String],
) -> Vec<String> {
    let mut parts = vec![
        part("end", &recorded.end, &again.end),
        part("number of control steps", &recorded.steps, &again.steps),
        part("robustness", &recorded.robustness, &again.robustness),
        part("lower bound of the robustness", &recorded.robustness_low, &again.robustness_low),
        part("upper bound of the robustness", &recorded.robustness_high, &again.robustness_high),
        part("stop threshold", &recorded.stop_threshold, &again.stop_threshold),
    ];
    for (name, value) in recorded_names.iter().zip(&recorded.verdicts) {
        // A verdict that this program does not compute is a difference of the headers.
        let position = names.iter().position(|known| known == name);
        if let Some(now) = position.and_then(|position| again.verdicts.get(position)) {
            parts.push(part(&format!("verdict `{name}`"), value, now));
        }
    }
    let digest = |simulation: &Simulation| simulation.trace_digest.map(|digest| format!("{digest:032x}"));
    parts.push(part("digest of the trace", &digest(recorded), &digest(again)));
    let is_stored = |simulation: &Simulation| simulation.trace.is_some();
    parts.push(part("whether the trace is stored", &is_stored(recorded), &is_stored(again)));
    parts.into_iter().flatten().collect()
}

/// Describes a difference. The text of a float has all digits and the sign of a zero.
fn part(what: &str, recorded: &impl Debug, again: &impl Debug) -> Option<String> {
    let (recorded, again) = (format!("{recorded:?}"), format!("{again:?}"));
    (recorded != again).then(|| format!("{what}: recorded {recorded}, replayed {again}"))
}
