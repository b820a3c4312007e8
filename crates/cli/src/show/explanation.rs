//! Explanations of simulations and logs, as text.

use mishandle::results::{AxesAtNominal, AxisFacts, Decision, Explanation, LogExplanation, SignalTable};
use mishandle::stl::is_violated;
use mishandle_text::{decimal, instant, plural};

use super::{escape, log_verdicts, output, reasons, scenario, subject, verdict};

/// Returns the explanation, which starts with the scenario.
pub fn text(found: &Explanation) -> String {
    let scenario = scenario::first_text(&found.space_axes, &found.scenario, usize::MAX);
    let verdict = if is_violated(found.robustness.0) { "violated" } else { "satisfied" };
    let mut parts = vec![format!(
        "{}, seed {}{}\nformula {}\n{verdict}: robustness {}{}",
        scenario,
        found.seed.0,
        subject::guard_line(found.guard.as_ref()),
        escape::name(&found.formula),
        decimal(found.robustness.0, 4),
        reasons::of_one(found.reason.as_deref()),
    )];
    parts.extend(decision(&found.decision, &|sample| instant(sample as usize, found.control_dt)));
    parts.extend(found.axes_at_nominal.iter().flat_map(|axes| axes_at_nominal(axes, &found.space_axes)));
    parts.join("\n\n")
}

/// Returns what the failure is with each axis alone at nominal: sentences, then a table.
fn axes_at_nominal(found: &AxesAtNominal, facts: &[AxisFacts]) -> Vec<String> {
    let mut sentences = Vec::new();
    if !found.axes.is_empty() {
        let removing = found.axes.iter().filter(|axis| axis.violated == Some(false));
        let removing: Vec<String> = removing.map(|axis| escape::label(&axis.axis)).collect();
        let removing = if removing.is_empty() { "none".to_string() } else { removing.join(", ") };
        sentences.push(format!(
            "Simulated again with the same seed and one axis at nominal ({}). Axes that remove the failure alone: {removing}.",
            plural(found.axes.len() as u64, "simulation")
        ));
    }
    if found.left_out > 0 {
        let axes = scenario::axes(found.left_out as usize);
        sentences.push(format!("Left out because of `report.axes`: {axes} nearer to nominal."));
    }
    if let Some(reason) = &found.reason {
        sentences.push(format!("Not simulated again with one axis at nominal: {}.", escape::name(reason)));
    }
    let mut parts = vec![sentences.join("\n")];
    if !found.axes.is_empty() {
        let columns = ["axis at nominal", "nominal", "failure has", "robustness", "verdict"];
        let mut rows = vec![columns.map(String::from).to_vec()];
        rows.extend(found.axes.iter().map(|axis| {
            let fact = facts.iter().find(|fact| fact.name == axis.axis);
            let unit = fact.map_or("", |fact| &fact.unit);
            let value =
                |value| fact.map_or(decimal(value, 4), |fact| scenario::value_text(fact, Some(value)));
            let verdict =
                axis.violated.map_or("-", |violated| if violated { "violated" } else { "satisfied" });
            vec![
                with_unit(&axis.axis, unit),
                value(axis.nominal),
                value(axis.value),
                axis.robustness.map_or("-".to_string(), |robustness| decimal(robustness.0, 4)),
                verdict.to_string(),
            ]
        }));
        parts.push(output::table(&rows));
    }
    parts
}

/// Returns the explanation of a verdict on a log. `start` is the time of the first sample, s.
pub fn log_text(found: &LogExplanation, start: f64) -> String {
    let mut parts = vec![verdict::text(&mishandle::verdict::log(&found.verdict))];
    let at = |sample: u64| log_verdicts::instant(sample as usize, start + sample as f64 * found.period);
    parts.extend(decision(&found.decision, &at));
    parts.join("\n\n")
}

/// Returns the sentences and tables about what decides a formula.
fn decision(found: &Decision, at: &dyn Fn(u64) -> String) -> Vec<String> {
    let mut parts = Vec::new();
    let sentences: Vec<String> = found.sentences.iter().map(|sentence| escape::name(sentence)).collect();
    if !sentences.is_empty() {
        parts.push(sentences.join("\n"));
    }
    parts.push(output::table(&path_table(found, at)));
    if found.conjuncts.len() > 1 {
        let columns = ["conjunct on its own", "robustness", "decided at"];
        let mut rows = vec![columns.map(String::from).to_vec()];
        rows.extend(found.conjuncts.iter().map(|conjunct| {
            vec![
                escape::name(&conjunct.formula),
                decimal(conjunct.robustness.0, 4),
                conjunct.decided.map_or("-".to_string(), |decided| at(decided.sample)),
            ]
        }));
        parts.push(output::table(&rows));
    }
    parts.extend(found.signals.as_ref().map(|signals| output::table(&signal_table(signals, at))));
    parts
}

/// Returns the table of the chain from the formula to the predicate.
fn path_table(found: &Decision, at: &dyn Fn(u64) -> String) -> Vec<Vec<String>> {
    let columns = ["decisive sub-formula", "at", "window", "robustness"];
    let mut rows = vec![columns.map(String::from).to_vec()];
    let path = &found.path;
    let is_and = |index: usize| path[index].operator.as_deref() == Some("and");
    // Of a chain of `and`, only the first is shown: the others are parts of its text.
    let shown = (0..path.len()).filter(|index| *index == 0 || !is_and(*index) || !is_and(index - 1));
    rows.extend(shown.map(|index| &path[index]).map(|step| {
        let window = step.window.map_or("-".to_string(), |[first, last]| format!("{first} to {last}"));
        vec![escape::name(&step.formula), at(step.at.sample), window, decimal(step.robustness.0, 4)]
    }));
    rows
}

fn with_unit(name: &str, unit: &str) -> String {
    format!("{} {}", escape::label(name), escape::label(unit)).trim_end().to_string()
}

/// Returns the table of the formula's signals.
fn signal_table(signals: &SignalTable, at: &dyn Fn(u64) -> String) -> Vec<Vec<String>> {
    let columns = signals.columns.iter().map(|signal| with_unit(&signal.name, &signal.unit));
    let mut rows = vec![std::iter::once("at".to_string()).chain(columns).collect::<Vec<_>>()];
    rows.extend(signals.rows.iter().map(|row| {
        let values = row.values.iter().map(|value| value.map_or(String::new(), |x| decimal(x.0, 4)));
        std::iter::once(at(row.sample)).chain(values).collect()
    }));
    rows
}
