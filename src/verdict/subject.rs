//! The subject of a question, as text.

use mishandle_results::{AxisFacts, Choice, Key, Subject};
use mishandle_text::number_text;

use super::axes::{axis_range, axis_text, shown};

/// Returns what was tested, and under which conditions: `ball-balancing with ppo (space delay)`.
pub fn tested(subject: &Subject) -> String {
    let controller = subject.controller_given.as_ref().map(|given| format!(" with {}", file_name(given)));
    let guard = subject.guard.as_ref().map(|guard| format!(" and {}", guard.words()));
    let conditions = conditions(subject);
    let conditions =
        if conditions.is_empty() { String::new() } else { format!(" ({})", conditions.join(", ")) };
    format!(
        "{}{}{}{conditions}",
        file_name(&subject.target),
        controller.unwrap_or_default(),
        guard.unwrap_or_default()
    )
}

/// Returns the space, the ranges that the plan sets, and the noise.
fn conditions(subject: &Subject) -> Vec<String> {
    let mut found = Vec::new();
    if !subject.space.is_empty() {
        found.push(format!("space {}", shown(&subject.space)));
    }
    found.extend(
        subject.preset.iter().filter(|preset| *preset != "paper").map(|p| format!("preset {}", shown(p))),
    );
    let set = subject.space_axes.iter().filter(|axis| subject.set_axes.contains(&axis.name));
    found.extend(set.map(range_text));
    if subject.action_noise > 0.0 {
        found.push(format!("action noise {}", subject.action_noise));
    }
    if subject.observation_noise > 0.0 {
        found.push(format!("observation noise {}", subject.observation_noise));
    }
    if subject.stochastic {
        found.push("sampled actions".to_string());
    }
    found
}

/// Formats the range of an axis: `gap from 1 to 2 m`.
fn range_text(axis: &AxisFacts) -> String {
    if axis.is_fixed() {
        return axis_text(axis, Some(axis.low));
    }
    let [low, high] = [axis.low, axis.high].map(number_text);
    axis_range(&axis.name, [low, high], &axis.unit)
}

/// Largest number of axes that are named.
const NAMED: usize = 4;

/// Returns what the scenarios of a space vary: `2 axes: ball_x, ball_y`.
pub(super) fn varied(subject: &Subject) -> String {
    let free: Vec<&AxisFacts> = subject.space_axes.iter().filter(|axis| !axis.is_fixed()).collect();
    let named: Vec<String> = free.iter().take(NAMED).map(|axis| range_text(axis)).collect();
    let more = free.len().saturating_sub(NAMED);
    let more = if more > 0 { format!(" and {more} more") } else { String::new() };
    match free.len() {
        0 => "nothing but the seed".to_string(),
        1 => format!("1 axis: {}", named.join(", ")),
        count => format!("{count} axes: {}{more}", named.join(", ")),
    }
}

/// Returns the last part of a path; another name stays. A very long one is cut.
pub(super) fn file_name(path: &str) -> String {
    let is_path = std::path::Path::new(path).extension().is_some();
    shown(if is_path { path.rsplit('/').next().unwrap_or(path) } else { path })
}

/// Returns the settings with which the question was asked, as a command needs them.
pub(super) fn settings(subject: &Subject) -> Vec<(Key, Choice)> {
    let text = |text: &String| Choice::Text(text.clone());
    let mut found: Vec<(Key, Choice)> =
        subject.controller_given.iter().map(|given| (Key::CONTROLLER, text(given))).collect();
    // The first space is the default.
    let default = subject.offered.as_ref().and_then(|offered| offered.spaces.first());
    if !subject.space.is_empty() && default != Some(&subject.space) {
        found.push((Key::SPACE, text(&subject.space)));
    }
    for axis in subject.space_axes.iter().filter(|axis| subject.set_axes.contains(&axis.name)) {
        let range = Choice::Range([axis.low, axis.high]);
        found.push((Key::AXES, Choice::Of(axis.name.clone(), Box::new(range))));
    }
    if subject.action_noise > 0.0 {
        found.push((Key::ACTION_NOISE, Choice::Number(subject.action_noise)));
    }
    found
}
