//! The explanation of a simulation, as text and as JSON.

use mishandle::stl::{DecisivePredicate, Formula};
use mishandle::store::RunHeader;
use mishandle::{ExplainedSimulation, Explanation, decimal, instant};
use serde_json::{Value, json};

use super::output::{self, number};
use super::{escape, scenario};

/// Numbers of evenly spaced samples in the table of signals, up to the decisive one and behind it.
const ROWS_BEFORE: usize = 8;

const ROWS_AFTER: usize = 3;

/// Largest number of signals in the table of signals.
const SIGNAL_COLUMNS: usize = 4;

/// Returns the explanation as JSON. Samples count from 0, times are in seconds.
pub fn document(header: &RunHeader, explained: &ExplainedSimulation) -> Value {
    let ExplainedSimulation { recorded, explanation, .. } = explained;
    let Explanation { diagnosis, history, decided, conjuncts, .. } = explanation;
    let time = |sample: usize| sample as f64 * header.control_dt;
    let named = header.axes.iter().zip(&recorded.scenario);
    let window = |window: Option<(usize, usize)>| window.map(|(first, last)| [first, last]);
    json!({
        "target": header.target.name,
        "trial": recorded.trial,
        "simulation": recorded.number,
        "scenario": named.map(|(axis, value)| (axis.name.clone(), json!(value))).collect::<Value>(),
        "seed": recorded.seed.to_string(),
        "formula": header.formula,
        "robustness": number(diagnosis.robustness()),
        "decided": decided.map(|sample| json!({ "sample": sample, "time": time(sample) })),
        "predicate": diagnosis.predicate.as_ref().map(|predicate| json!({
            "formula": predicate.text,
            "sample": predicate.sample,
            "time": time(predicate.sample),
            "comparison": predicate.comparison,
            "sides": predicate.sides,
            "values": predicate.values.map(number),
            "robustness": number(predicate.robustness),
            "negated": predicate.is_negated,
        })),
        "window": history.as_ref().map(|history| json!({
            "samples": [history.window.0, history.window.1],
            "violated": history.violated,
            "first_violated": history.first_and_last.map(|(first, _)| first),
            "last_violated": history.first_and_last.map(|(_, last)| last),
        })),
        "path": diagnosis.path.iter().map(|found| json!({
            "formula": found.text,
            "operator": found.operator,
            "sample": found.sample,
            "time": time(found.sample),
            "window": window(found.window),
            "robustness": number(found.robustness),
        })).collect::<Vec<_>>(),
        "conjuncts": conjuncts.iter().map(|conjunct| json!({
            "formula": conjunct.text,
            "robustness": number(conjunct.robustness),
            "decided": conjunct.decided.map(|sample| json!({ "sample": sample, "time": time(sample) })),
        })).collect::<Vec<_>>(),
    })
}

/// Returns the explanation as text, which starts with the scenario.
pub fn text(header: &RunHeader, explained: &ExplainedSimulation) -> String {
    let ExplainedSimulation { recorded, explanation, .. } = explained;
    let Explanation { diagnosis, conjuncts, .. } = explanation;
    let scenario = scenario::recorded_text(&header.axes, &recorded.scenario, usize::MAX);
    let verdict = match diagnosis.robustness() {
        rho if rho < 0.0 => "violated",
        rho if rho > 0.0 => "satisfied",
        _ => "on the border between satisfied and violated",
    };
    let mut parts = vec![format!(
        "{}, seed {}\nformula {}\n{verdict}: robustness {}",
        scenario,
        recorded.seed,
        escape::name(&header.formula),
        decimal(diagnosis.robustness(), 4),
    )];
    let sentences: Vec<String> =
        explanation.sentences(header.control_dt).iter().map(|sentence| escape::name(sentence)).collect();
    if !sentences.is_empty() {
        parts.push(sentences.join("\n"));
    }
    parts.push(output::table(&path_table(header, explained)));
    if conjuncts.len() > 1 {
        let columns = ["conjunct on its own", "robustness", "decided at"];
        let mut rows = vec![columns.map(String::from).to_vec()];
        rows.extend(conjuncts.iter().map(|conjunct| {
            let decided = conjunct.decided.map(|sample| instant(sample, header.control_dt));
            vec![
                escape::name(&conjunct.text),
                decimal(conjunct.robustness, 4),
                decided.unwrap_or("-".to_string()),
            ]
        }));
        parts.push(output::table(&rows));
    }
    parts.extend(
        diagnosis
            .predicate
            .as_ref()
            .map(|predicate| output::table(&signal_table(header, explained, predicate))),
    );
    parts.join("\n\n")
}

/// Returns the table of the chain from the formula to the predicate.
fn path_table(header: &RunHeader, explained: &ExplainedSimulation) -> Vec<Vec<String>> {
    let columns = ["decisive sub-formula", "at", "window", "robustness"];
    let mut rows = vec![columns.map(String::from).to_vec()];
    let path = &explained.explanation.diagnosis.path;
    let is_and = |index: usize| path[index].operator == Some("and");
    // Of a chain of `and`, only the first is shown: the others are parts of its text.
    let shown = (0..path.len()).filter(|index| *index == 0 || !is_and(*index) || !is_and(index - 1));
    rows.extend(shown.map(|index| &path[index]).map(|found| {
        let window = found.window.map_or("-".to_string(), |(first, last)| format!("{first} to {last}"));
        vec![
            escape::name(&found.text),
            instant(found.sample, header.control_dt),
            window,
            decimal(found.robustness, 4),
        ]
    }));
    rows
}

/// Returns the table of the formula's signals up to the decisive sample, at the first violation, and at the end.
fn signal_table(
    header: &RunHeader,
    explained: &ExplainedSimulation,
    predicate: &DecisivePredicate,
) -> Vec<Vec<String>> {
    let ExplainedSimulation { trace, explanation, .. } = explained;
    let of = |text: &str| {
        Formula::parse(text).map(|formula| formula.signals().into_iter().map(str::to_string).collect())
    };
    let decisive: Vec<String> = of(&predicate.text).unwrap_or_default();
    let others: Vec<String> = of(&header.formula).unwrap_or_default();
    let others = others.into_iter().filter(|name| !decisive.contains(name));
    let names: Vec<String> = decisive.iter().cloned().chain(others).take(SIGNAL_COLUMNS).collect();
    let unit = |name: &str| {
        let signal = header.signals.iter().find(|signal| signal.name == name);
        signal.map_or("", |signal| signal.unit.as_str())
    };
    let mut rows = vec![vec!["at".to_string()]];
    rows[0].extend(
        names.iter().map(|name| format!("{} {}", escape::name(name), unit(name)).trim_end().to_string()),
    );
    for sample in shown_samples(predicate.sample, explanation.decided, trace.len()) {
        let mut row = vec![instant(sample, header.control_dt)];
        row.extend(names.iter().map(|name| {
            trace.signal(name).and_then(|values| values.get(sample)).map_or(String::new(), |x| decimal(*x, 4))
        }));
        rows.push(row);
    }
    rows
}

/// Returns the samples of the table: evenly spaced up to the decisive one and from there to the end, and the instant that decides
/// the formula.
fn shown_samples(decisive: usize, decided: Option<usize>, len: usize) -> Vec<usize> {
    let last = len.saturating_sub(1);
    let before = (0..ROWS_BEFORE).map(|i| decisive * i / (ROWS_BEFORE - 1));
    let after = (1..=ROWS_AFTER).map(|i| decisive + last.saturating_sub(decisive) * i / ROWS_AFTER);
    let mut samples: Vec<usize> = before.chain(after).chain(decided).collect();
    samples.sort_unstable();
    samples.dedup();
    samples
}
