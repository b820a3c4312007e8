//! A formula in words, its traps, and its sub-formulas over traces, as text.

use mishandle::results::{
    ExampleKind, FormulaDescription, FormulaExample, FormulaLane, FormulaTrap, FormulaValues, LaneState,
    RequirementPattern,
};
use mishandle_text::{plural, short, short_number};

use super::{escape, output};

/// Width of a drawing, characters.
const COLUMNS: usize = 60;

/// Largest number of traces that are drawn.
const MAX_DRAWN: usize = 4;

/// Levels of a signal, from its least to its greatest value.
const LEVELS: [char; 8] = ['▁', '▂', '▃', '▄', '▅', '▆', '▇', '█'];

/// Describes a formula. `sentence` is that of its pattern.
pub fn text(found: &FormulaDescription, sentence: Option<&str>, width: usize) -> String {
    let mut facts = Vec::new();
    if let Some(pattern) = &found.pattern {
        facts.push(vec!["pattern".to_string(), pattern.clone()]);
    }
    facts.push(vec!["formula".to_string(), escape::name(&found.formula)]);
    if found.parenthesized != found.formula {
        facts.push(vec!["grouped".to_string(), escape::name(&found.parenthesized)]);
    }
    facts.push(vec!["symbols".to_string(), escape::name(&found.symbols)]);
    let signal = |signal: &mishandle::results::Signal| match signal.unit.as_str() {
        "" => escape::name(&signal.name),
        unit => format!("{} ({})", escape::name(&signal.name), escape::name(unit)),
    };
    let signals: Vec<String> = found.signals.iter().map(signal).collect();
    facts.push(vec![
        "reads".to_string(),
        if signals.is_empty() { "no signal".into() } else { signals.join(", ") },
    ]);
    facts.push(vec!["horizon".to_string(), horizon(found)]);
    let mut parts = vec![output::table_in(&facts, width)];
    if let Some(sentence) = sentence {
        parts.push(output::wrapped(&escape::name(sentence), width));
    }
    if found.words.is_empty() {
        parts.push("The formula is too long to be put into words.".to_string());
    } else {
        let lines: Vec<String> = found.words.iter().map(|line| format!("  {}", escape::name(line))).collect();
        parts.push(format!("In words:\n{}", lines.join("\n")));
    }
    if found.traps.is_empty() {
        parts.push("No known trap.".to_string());
    } else {
        parts.extend(found.traps.iter().map(|found| trap(found, width)));
    }
    let columns = COLUMNS.min(width.saturating_sub(4)).max(20);
    parts.extend(found.examples.iter().take(MAX_DRAWN).map(|found| example(found, columns)));
    if found.examples.len() > MAX_DRAWN {
        parts.push(format!(
            "{} more are not drawn",
            plural((found.examples.len() - MAX_DRAWN) as u64, "trace")
        ));
    }
    parts.join("\n\n")
}

fn horizon(found: &FormulaDescription) -> String {
    let Some(horizon) = &found.horizon else {
        return "up to the end of the trace".to_string();
    };
    let samples = horizon.samples.map(|samples| plural(samples, "sample"));
    let secs = horizon.seconds.map(|secs| format!("{} s", short_number(secs.0)));
    match (samples, secs) {
        (Some(samples), Some(secs)) => format!("{secs} ({samples})"),
        (Some(one), None) | (None, Some(one)) => one,
        (None, None) => "unknown: it needs a sampling period that fits all bounds".to_string(),
    }
}

/// Describes a trap, with its place.
fn trap(trap: &FormulaTrap, width: usize) -> String {
    let place = match (trap.line, trap.column) {
        (Some(1), Some(column)) => format!(" (column {column})"),
        (Some(line), Some(column)) => format!(" (line {line}, column {column})"),
        _ => String::new(),
    };
    let head = format!("{}: {}{place}: {}", trap.severity, trap.name, escape::name(&trap.why));
    let mut lines = vec![output::folded(&head, width)];
    if !trap.formula.is_empty() {
        lines.push(format!(
            "  at       {}",
            short(&escape::name(&trap.formula), width.saturating_sub(11).max(20))
        ));
    }
    if let Some(instead) = &trap.instead {
        let advice = output::wrapped(&escape::name(instead), width.saturating_sub(11).max(20));
        lines.push(format!("  instead  {}", output::indented(&advice, 11)));
    }
    lines.join("\n")
}

/// Draws the sub-formulas over a trace.
pub fn example(found: &FormulaExample, columns: usize) -> String {
    let samples = usize::try_from(found.samples).unwrap_or(usize::MAX).max(1);
    // Each sample has the same number of columns, or each column the same number of samples.
    let columns = if samples <= columns { columns / samples * samples } else { columns };
    let verdict = if found.violated { "violated" } else { "satisfied" };
    let what = match found.kind {
        ExampleKind::Found => format!("A trace that was found for it: {verdict}"),
        ExampleKind::Pattern => format!("A trace of the pattern: {verdict}"),
        ExampleKind::Episode => format!("Nominal episode of {}: {verdict}", escape::name(&found.name)),
        ExampleKind::Log | ExampleKind::Simulation => format!("{}: {verdict}", escape::name(&found.name)),
    };
    let border = if found.robustness.0 == 0.0 { " (its sign is the verdict)" } else { "" };
    let mut lines = vec![format!("{what}, robustness {}{border}", short_number(found.robustness.0))];
    let end = match found.period {
        Some(period) => format!("{} s", short_number((samples - 1) as f64 * period.0)),
        None => format!("sample {}", samples - 1),
    };
    let start = if found.period.is_some() { "0 s" } else { "sample 0" };
    let gap = columns.saturating_sub(start.len() + end.len());
    lines.push(format!("  {start}{}{end}", " ".repeat(gap)));
    for values in found.values.iter().flatten() {
        lines.push(format!("  {}  {}", signal_line(values, samples, columns), signal_label(values)));
    }
    for lane in &found.lanes {
        let indent = "  ".repeat(usize::try_from(lane.depth).unwrap_or(0).min(20));
        let label = short(&escape::name(&lane.formula), 60);
        lines.push(format!("  {}  {indent}{label}", lane_line(lane, samples, columns)));
    }
    lines.push("  █ holds  ░ violated  ▒ both  · not violated, but a window is cut at the end".to_string());
    lines.join("\n")
}

/// Returns the samples of each column, first and last.
fn bins(samples: usize, columns: usize) -> impl Iterator<Item = (usize, usize)> {
    (0..columns).map(move |column| {
        let first = column * samples / columns;
        let last = ((column + 1) * samples).div_ceil(columns).saturating_sub(1);
        (first, last.max(first))
    })
}

fn lane_line(lane: &FormulaLane, samples: usize, columns: usize) -> String {
    let mut spans = lane.spans.iter().peekable();
    let states = bins(samples, columns).map(|(first, last)| {
        while spans.next_if(|span| (span.last as usize) < first).is_some() {}
        let inside = spans.clone().take_while(|span| span.first as usize <= last);
        let states: Vec<LaneState> = inside.map(|span| span.state).collect();
        match (states.contains(&LaneState::Holds), states.contains(&LaneState::Violated)) {
            (true, true) => '▒',
            (true, false) => '█',
            (false, true) => '░',
            (false, false) => '·',
        }
    });
    states.collect()
}

fn extent(values: &FormulaValues) -> (f64, f64) {
    let numbers = values.values.iter().copied().filter(|value| value.is_finite());
    numbers.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), value| (low.min(value), high.max(value)))
}

fn signal_line(values: &FormulaValues, samples: usize, columns: usize) -> String {
    let (low, high) = extent(values);
    let level = |(first, last): (usize, usize)| {
        let inside = values.values.get(first..=last).unwrap_or_default();
        let value = inside.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let share = if high > low { (value - low) / (high - low) } else { 0.0 };
        LEVELS[((share * 7.0).round().max(0.0) as usize).min(7)]
    };
    bins(samples, columns).map(level).collect()
}

fn signal_label(values: &FormulaValues) -> String {
    let (low, high) = extent(values);
    let name = escape::name(&values.signal);
    if high > low {
        format!("{name} from {} to {}", short_number(low), short_number(high))
    } else {
        format!("{name} = {}", short_number(low))
    }
}

/// Lists the patterns.
pub fn patterns(found: &[RequirementPattern]) -> String {
    let paragraph = |pattern: &RequirementPattern| {
        let parameters: Vec<String> = pattern
            .parameters
            .iter()
            .map(|parameter| match &parameter.default {
                Some(default) => {
                    format!("{} ({}, default {default})", parameter.name, parameter.kind)
                }
                None => format!("{} ({})", parameter.name, parameter.kind),
            })
            .collect();
        let summary = output::wrapped(&pattern.summary, 96).replace('\n', "\n  ");
        format!(
            "{}\n  {summary}\n  {}\n  parameters: {}",
            pattern.name,
            pattern.formula,
            parameters.join(", ")
        )
    };
    let mut parts: Vec<String> = found.iter().map(paragraph).collect();
    parts.push(
        "`mishandle formula --pattern NAME` shows a pattern; --parameter NAME=VALUE sets a parameter."
            .to_string(),
    );
    parts.join("\n\n")
}
