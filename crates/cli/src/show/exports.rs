//! Exported counterexamples, as text.

use mishandle::falsification::physics_text;
use mishandle::results::{AxisFacts, ExportedCounterexample, Exports, Minimized};
use mishandle_text::{decimal, plural};

use super::{escape, physics, scenario};

/// Returns a paragraph for each file.
pub fn text(found: &Exports) -> String {
    let texts: Vec<String> = found.files.iter().map(|file| file_text(&found.space_axes, file)).collect();
    texts.join("\n")
}

fn file_text(axes: &[AxisFacts], file: &ExportedCounterexample) -> String {
    let mode = file.mode.map_or(String::new(), |mode| format!("mode {mode}, "));
    let found = format!("{mode}trial {}, simulation {}", file.trial, file.simulation);
    if let Some(same) = &file.same_as {
        return format!(
            "{found}: not written, its minimized scenario is within 1 % of {}",
            escape::name(same)
        );
    }
    let refused = file.physics.as_ref().filter(|check| check.depends_on_solver);
    if let Some(check) = refused {
        return format!("{found}: not written, it {}", physics_text(check));
    }
    let values = off_nominal_text(axes, file);
    let robustness = decimal(file.robustness.0, 4);
    let mut lines = vec![format!("{}: {found}", escape::name(file.file.as_deref().unwrap_or_default()))];
    let physics = file.physics.as_ref().map(|check| format!("  {}", physics::text(check)));
    let Some(minimized) = &file.minimized else {
        lines.push(format!("  {values}: robustness {robustness}"));
        lines.extend(physics);
        return lines.join("\n");
    };
    let [recorded_off, minimized_off] =
        minimized.axes_off_nominal.map(|count| scenario::axes(count as usize));
    lines.push(format!(
        "  recorded   {}: robustness {}, {recorded_off} off nominal",
        scenario::summary(axes, &minimized.scenario),
        decimal(minimized.robustness.map_or(f64::NAN, |rho| rho.0), 4),
    ));
    lines.push(format!("  minimized  {values}: robustness {robustness}, {minimized_off} off nominal"));
    lines.push(format!("  {}", result_text(minimized)));
    lines.extend(physics);
    if let Some(repeats) = &minimized.repeats {
        lines.push(format!("  with other seeds it {}", mishandle::run::failure_text(repeats)));
    }
    lines.join("\n")
}

/// Formats the values that are not nominal.
fn off_nominal_text(axes: &[AxisFacts], file: &ExportedCounterexample) -> String {
    let is_off = |(axis, value): &(&AxisFacts, &Option<f64>)| **value != axis.nominal;
    let off = axes.iter().zip(file.scenario.values()).filter(is_off);
    let values: Vec<String> = off.map(|(axis, value)| scenario::axis_text(axis, *value)).collect();
    match (values.len(), file.scenario.0.len() - values.len()) {
        (0, _) => format!("the nominal scenario ({})", scenario::summary(axes, &file.scenario)),
        (_, 0) => values.join(", "),
        (_, 1) => format!("{}, the other axis nominal", values.join(", ")),
        (_, others) => format!("{}, the other {others} axes nominal", values.join(", ")),
    }
}

/// Describes how far a minimization came.
fn result_text(minimized: &Minimized) -> String {
    let simulations = plural(minimized.simulations, "simulation");
    if minimized.went_back {
        return format!(
            "{simulations}: it went back toward the recorded scenario: nearer failures depend on the solver"
        );
    }
    let axes = if minimized.fewest_axes {
        "no smaller set of axes fails at the recorded values"
    } else {
        "no single axis can go to nominal; smaller sets were not all tried"
    };
    if minimized.complete {
        format!("{simulations}: {axes}; no axis can move by 1 % of its width toward nominal")
    } else if minimized.interrupted {
        format!("{simulations}: interrupted before the end of the minimization")
    } else {
        format!("{simulations}: the budget ended before the minimization; raise regress.budget")
    }
}
