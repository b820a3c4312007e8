//! The list of targets, and the description of one.

use mishandle::Plan;
use mishandle::rollout::{Axis, AxisValues, Space, Target};

use crate::show::{output, scenario};

/// Most characters of the names of axes on the line of a space.
const AXES_SHOWN: usize = 40;

/// Returns all targets with their summaries.
pub fn list() -> String {
    let tasks = mishandle::tasks::tasks();
    let tasks =
        tasks.iter().map(|task| [task.definition().name.to_string(), task.definition().summary.to_string()]);
    let toys =
        mishandle::toys::TOYS.iter().map(|toy| [format!("toy/{}", toy.name()), toy.summary().to_string()]);
    let entry = |[name, summary]: [String; 2]| {
        let summary = output::wrapped(&summary, 74).replace('\n', "\n    ");
        format!("{name}\n    {summary}")
    };
    let problems = mishandle::arch::PROBLEMS;
    let problems =
        problems.iter().map(|problem| [format!("arch/{}", problem.name()), problem.summary().to_string()]);
    tasks.chain(toys).chain(problems).map(entry).collect::<Vec<_>>().join("\n")
}

/// Returns the description of a target. Without `all`, a space is a line with the names of its
/// axes.
pub fn page(target: &Target, plan: &Plan, all: bool) -> String {
    let is_task = !plan.controller.is_empty();
    let preset = if is_task { format!(", task preset {}", plan.preset) } else { String::new() };
    let mut sections = vec![format!("{} ({}){preset}", target.identity.name, target.identity.kind)];
    let formulas = target.formulas.iter().map(|formula| vec![formula.name.clone(), formula.text.clone()]);
    sections.push(format!(
        "Formulas (the first is the default requirement)\n{}",
        rows(&formulas.collect::<Vec<_>>())
    ));
    let signals = target.signals.iter().map(|signal| match signal.unit.as_str() {
        "" => signal.name.clone(),
        unit => format!("{} ({unit})", signal.name),
    });
    let signals = output::wrapped(&signals.collect::<Vec<_>>().join(", "), output::width().saturating_sub(2))
        .replace('\n', "\n  ");
    sections.push(format!("Signals\n  {signals}"));
    if !all {
        let spaces: Vec<Vec<String>> = families(target.spaces.iter()).into_iter().map(line).collect();
        sections.push(format!("Spaces and their axes\n{}", rows(&spaces)));
    }
    for space in target.spaces.iter().filter(|_| all) {
        sections.push(format!(
            "Space {} ({})\n{}",
            space.name(),
            scenario::axes(space.dimension()),
            axes(space)
        ));
    }
    if let [first, .., last] = target.spaces.as_slice() {
        let example = format!("{}+{}", first.name(), last.name());
        let is_left_out = |space: &&Space| {
            space.axes().iter().any(|axis| target.axes.iter().all(|known| known.name != axis.name))
        };
        let left_out = families(target.spaces.iter().filter(is_left_out));
        let left_out: Vec<String> = left_out.into_iter().map(|family| family.name).collect();
        let but = if left_out.is_empty() {
            String::new()
        } else {
            format!(" but those of {}, which change images only", left_out.join(", "))
        };
        let all =
            format!("Spaces can be joined, such as --space {example}. The space `all` has every axis{but}.");
        sections.push(if left_out.is_empty() { all } else { output::wrapped(&all, 80) });
    }
    if target.axes.iter().any(|axis| axis.name.starts_with("draw_")) {
        sections.push("The axes `draw_*` exist only with --action-noise above 0.".to_string());
    }
    sections.join("\n\n")
}

/// Returns rows as an indented table.
fn rows(rows: &[Vec<String>]) -> String {
    let table = output::table_in(rows, output::width().saturating_sub(2));
    table.lines().map(|line| format!("  {line}")).collect::<Vec<_>>().join("\n")
}

/// Spaces of one factor: the same axes with other bounds.
struct Family<'a> {
    name: String,
    last: &'a Space,
}

/// Returns the families of spaces, whose names end with the numbers of their severities.
fn families<'a>(spaces: impl Iterator<Item = &'a Space>) -> Vec<Family<'a>> {
    let stem = |space: &Space| {
        let (stem, number) = space.name().rsplit_once('-')?;
        number.parse::<u32>().ok().map(|_| stem.to_string())
    };
    let mut found: Vec<Family<'a>> = Vec::new();
    for space in spaces {
        match found.last_mut().filter(|family| stem(space).is_some() && stem(family.last) == stem(space)) {
            Some(family) => {
                let first = family.name.split(' ').next().unwrap_or_default();
                *family = Family { name: format!("{first} to {}", space.name()), last: space };
            }
            None => found.push(Family { name: space.name().to_string(), last: space }),
        }
    }
    found
}

/// Returns the name of a family of spaces, and the names of its first axes on one line.
fn line(family: Family<'_>) -> Vec<String> {
    let names: Vec<&str> = family.last.axes().iter().map(|axis| axis.name.as_str()).collect();
    let names = names.join(", ");
    let shown: String = names.chars().take(AXES_SHOWN).collect();
    let more = if shown == names { "" } else { " ..." };
    vec![family.name, format!("{shown}{more}")]
}

fn axes(space: &Space) -> String {
    let mut rows = vec![["axis", "kind", "from", "to", "nominal", "sets"].map(String::from).to_vec()];
    rows.extend(space.axes().iter().map(|axis| {
        vec![
            axis.name.clone(),
            axis.kind.to_string(),
            short(axis.low),
            short(axis.high),
            axis.nominal.map_or("random".to_string(), short),
            sets(axis),
        ]
    }));
    let table = output::table_in(&rows, output::width().saturating_sub(2));
    table.lines().map(|line| format!("  {line}")).collect::<Vec<_>>().join("\n")
}

/// Describes what an axis sets, with its unit and the kind of its values if they are not
/// continuous.
fn sets(axis: &Axis) -> String {
    let values = match &axis.values {
        AxisValues::Continuous => None,
        AxisValues::Logarithmic => Some("logarithmic".to_string()),
        AxisValues::Integer => Some("integers".to_string()),
        AxisValues::Categorical(names) => Some(names.join(", ")),
    };
    let unit = Some(axis.unit.clone()).filter(|unit| !unit.is_empty());
    let more: Vec<String> = unit.into_iter().chain(values).collect();
    let more = if more.is_empty() { String::new() } else { format!("({})", more.join(", ")) };
    let parts = [axis.meaning.as_str(), &more];
    parts.into_iter().filter(|part| !part.is_empty()).collect::<Vec<_>>().join(" ")
}

/// Formats a number with at most nine decimals, which hides rounding errors.
fn short(value: f64) -> String {
    const SCALE: f64 = 1e9;
    ((value * SCALE).round() / SCALE).to_string()
}
