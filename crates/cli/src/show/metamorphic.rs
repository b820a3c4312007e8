//! Relations between pairs of scenarios, as text.

use mishandle::results::{
    AxisFacts, BrokenPair, Metamorphic, MetamorphicRelation, Named, PairCase, SmallestChange,
};
use mishandle_text::{decimal, plural};

use super::{answer, escape, output, scenario};

/// Largest number of broken pairs in the table of a relation.
const MAX_PAIRS: usize = 5;

/// Returns a table of the relations of runs with these names, and for each broken relation the
/// worst pairs and the smallest change.
pub fn text(runs: &[(&str, &Metamorphic)]) -> String {
    let relations =
        || runs.iter().flat_map(|(run, found)| found.relations.iter().map(move |own| (*run, *found, own)));
    let header = [
        "run",
        "relation",
        "change",
        "holds",
        "pairs",
        "broken",
        "rate",
        "95 % interval",
        "no verdict",
        "out of bounds",
    ];
    let row = |(run, _, relation): (&str, &Metamorphic, &MetamorphicRelation)| {
        let [rate, low, high] = {
            let estimate = &relation.broken_rate;
            [estimate.value, estimate.low, estimate.high].map(|share| share.map_or("-".to_string(), percent))
        };
        vec![
            run.to_string(),
            escape::label(&relation.name),
            changes(&relation.change),
            relation.holds.clone(),
            relation.pairs.to_string(),
            relation.broken.to_string(),
            rate,
            format!("[{low}, {high}]"),
            relation.without_verdict.to_string(),
            relation.out_of_bounds.to_string(),
        ]
    };
    let header = header.map(String::from).to_vec();
    let rows: Vec<Vec<String>> = std::iter::once(header).chain(relations().map(row)).collect();
    let mut text = String::new();
    for (run, found) in runs {
        let nothing = found.asks_nothing.as_ref().filter(|_| !found.is_broken());
        let undecided = answer::without_verdict(&found.without_verdict, "their pairs do not count");
        let open = found.open_relation().map_or(String::new(), |why| escape::name(&why) + "\n");
        for line in [answer::asks_nothing(nothing), undecided, open].iter().filter(|line| !line.is_empty()) {
            text.push_str(&format!("{run}: {line}"));
        }
    }
    text.push_str(&output::table(&rows));
    for (run, found, relation) in relations().filter(|(.., relation)| relation.broken > 0) {
        text.push_str(&format!("\n\n{run}, {}", details(found, relation)));
    }
    let is_concluded =
        runs.iter().all(|(_, found)| found.asks_nothing.is_none() && found.open_relation().is_none());
    let is_kept = |relation: &MetamorphicRelation| relation.broken == 0 && relation.broken_rate.n > 0;
    if is_concluded && relations().all(|(.., relation)| is_kept(relation)) {
        let is_decided = relations().all(|(.., relation)| relation.without_verdict == 0);
        text.push_str(if is_decided {
            "\n\nno pair breaks a relation; that is evidence, not a proof"
        } else {
            "\n\nno pair with two verdicts breaks a relation, which says nothing about the others"
        });
    }
    text
}

/// Formats changes of axes.
fn changes(change: &Named<String>) -> String {
    let text = |(axis, change): &(String, String)| {
        let sign = if change.starts_with(['+', '-', '*']) { " " } else { "" };
        format!("{}{sign}{}", escape::label(axis), escape::label(change))
    };
    change.0.iter().map(text).collect::<Vec<_>>().join(", ")
}

/// Describes the pairs that break a relation.
fn details(found: &Metamorphic, relation: &MetamorphicRelation) -> String {
    let verdicts = &relation.verdicts;
    let mut text = format!(
        "{}: broken by {}. Verdicts: {} satisfied in both cases, {} violated in both, {} only in the follow-up case, {} only in \
         the source case",
        escape::label(&relation.name),
        plural(relation.broken, "pair"),
        verdicts.both_satisfied,
        verdicts.both_violated,
        verdicts.worse,
        verdicts.better
    );
    let header = ["pair", "source", "follow-up", "difference", "source case"].map(String::from).to_vec();
    let axes = &found.subject.space_axes;
    let row = |pair: &BrokenPair| {
        vec![
            pair.pair.to_string(),
            case(&pair.source),
            case(&pair.follow_up),
            decimal(pair.difference.0, 4),
            scenario::summary(axes, &pair.source.scenario),
        ]
    };
    let shown = relation.worst.iter().take(MAX_PAIRS).map(row);
    let rows: Vec<Vec<String>> = std::iter::once(header).chain(shown).collect();
    text.push_str(&format!("\n{}", output::table(&rows)));
    if let Some(smallest) = &relation.smallest_change {
        text.push_str(&format!("\n{}", smallest_text(found, smallest)));
    }
    text
}

/// Formats robustness and verdict of a case.
fn case(case: &PairCase) -> String {
    let verdict = match case.is_violated {
        Some(true) => "violated",
        Some(false) => "satisfied",
        None => "no verdict",
    };
    case.robustness.map_or(verdict.to_string(), |rho| format!("{verdict} ({})", decimal(rho, 4)))
}

/// Says how much of the change is enough.
fn smallest_text(found: &Metamorphic, smallest: &SmallestChange) -> String {
    let change = |(axis, change): &(String, f64)| {
        let facts = found.subject.space_axes.iter().find(|facts| facts.name == *axis);
        let unit = facts.map_or(String::new(), |facts| match facts.unit.as_str() {
            "" => String::new(),
            unit => format!(" {}", escape::label(unit)),
        });
        let sign = if *change < 0.0 { "" } else { "+" };
        let decimals = if facts.is_some_and(AxisFacts::is_discrete) { 0 } else { 4 };
        format!("{} {sign}{}{unit}", escape::label(axis), decimal(*change, decimals))
    };
    // A share of a whole number is rounded, so it would say less than the change itself.
    let is_changed = |facts: &AxisFacts| smallest.change.0.iter().any(|(axis, _)| facts.name == *axis);
    let is_whole = found.subject.space_axes.iter().any(|facts| is_changed(facts) && facts.is_discrete());
    let changes: Vec<String> = smallest.change.0.iter().map(change).collect();
    format!(
        "from the source case of pair {}, {} is enough: {} ({})",
        smallest.pair,
        if is_whole {
            "this change".to_string()
        } else {
            format!("{} of the change", percent(smallest.share))
        },
        changes.join(", "),
        case(&smallest.follow_up)
    )
}

fn percent(share: f64) -> String {
    format!("{} %", decimal(100.0 * share, 1))
}
