//! Target and settings of a question.

use mishandle::results::{GuardFacts, Subject};
use mishandle_text::number_text;

use super::escape;
use super::scenario::{axes, axis_text};

/// Returns a one-line description of target and settings.
pub fn heading(subject: &Subject) -> String {
    let mut text = escape::label(&subject.target);
    if let (Some(controller), Some(preset)) = (&subject.controller_given, &subject.preset) {
        text.push_str(&format!(", controller {}, task preset {preset}", escape::label(controller)));
    }
    if let Some(guard) = &subject.guard {
        text.push_str(&format!(", {}", escape::name(&guard.words())));
    }
    if subject.space != "starts" {
        let free = subject.space_axes.iter().filter(|axis| !axis.is_fixed()).count();
        text.push_str(&format!(", space {} ({})", escape::label(&subject.space), axes(free)));
    }
    for axis in subject.space_axes.iter().filter(|axis| subject.set_axes.contains(&axis.name)) {
        text.push_str(&if axis.is_fixed() {
            format!(", {}", axis_text(axis, Some(axis.low)))
        } else {
            let [low, high] = [axis.low, axis.high].map(number_text);
            let [name, unit] = [&axis.name, &axis.unit].map(|text| escape::label(text));
            format!(", {name} from {low} to {high} {unit}").trim_end().to_string()
        });
    }
    if subject.action_noise > 0.0 {
        text.push_str(&format!(", action noise {}", subject.action_noise));
    }
    if subject.observation_noise > 0.0 {
        text.push_str(&format!(", observation noise {}", subject.observation_noise));
    }
    if subject.stochastic {
        text.push_str(", sampled actions");
    }
    text
}

/// Returns a line that describes the guard; empty without one.
pub fn guard_line(guard: Option<&GuardFacts>) -> String {
    guard.map_or(String::new(), |guard| format!("\n{}", escape::name(&guard.sentence())))
}
