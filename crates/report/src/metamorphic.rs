//! The answer of relations between pairs of scenarios: the counts, the pairs, and the smallest
//! changes that break a relation.

use std::collections::{BTreeMap, BTreeSet};

use crate::charts::{Chart, Mark, Panel, Series};
use mishandle::results::{BrokenPair, Metamorphic, MetamorphicRelation, Named, PairCase, SmallestChange};
use mishandle_text::plural;

use crate::html::{figure, number, percent, short, table, text, visible};
use crate::load::RunReport;
use crate::map::SIZE;
use crate::space::{around, linear};
use crate::{color, commands, words};

/// Trial of the source cases.
const SOURCES: u32 = 1;

/// Largest number of rows in the table of broken pairs.
const MAX_PAIRS: usize = 20;

/// Returns the verdict: one sentence of HTML.
pub fn headline(report: &RunReport, found: &Metamorphic) -> String {
    let subject = words::subject(report);
    let broken: Vec<String> = found
        .relations
        .iter()
        .filter(|relation| relation.broken > 0)
        .map(|relation| text(&short(&relation.name, 40)))
        .collect();
    match (broken.len(), found.relations.len()) {
        _ if !found.has_verdict() => format!("No pair of {subject} has two verdicts."),
        (0, _) if !found.is_complete => format!("No broken relation of {subject} found so far."),
        (0, _) if found.relations.iter().any(|relation| relation.without_verdict > 0) => {
            format!("No pair of {subject} with two verdicts breaks a relation.")
        }
        (0, 1) => format!("No pair of {subject} breaks the relation."),
        (0, all) => format!("No pair of {subject} breaks one of the {all} relations."),
        (1, _) => format!("{subject} breaks the relation {}.", broken.join(", ")),
        _ => format!("{subject} breaks the relations {}.", broken.join(", ")),
    }
}

/// Returns what the verdict means, as sentences of HTML.
pub fn meaning(found: &Metamorphic) -> Vec<String> {
    let mut sentences = Vec::new();
    if !found.is_complete {
        sentences.push("<strong>The run is not finished.</strong>".to_string());
    }
    sentences.push(
        "A source case is a random scenario. A relation changes some of its axes, which gives the follow-up case, and says what \
         must hold between the two results."
            .to_string(),
    );
    if found.is_random {
        sentences.push("Both cases of a pair have the same seed, so their noise is equal.".to_string());
    }
    for relation in &found.relations {
        let name = text(&short(&relation.name, 40));
        if relation.out_of_bounds > 0 {
            sentences.push(format!(
                "{name}: {} out of bounds and not simulated.",
                plural(relation.out_of_bounds, "follow-up case")
            ));
        }
        if relation.without_verdict > 0 {
            sentences.push(format!(
                "{name}: {} without two verdicts, which say nothing.",
                plural(relation.without_verdict, "pair")
            ));
        }
    }
    if found.has_verdict() && !found.is_broken() {
        sentences.push("This is evidence, not a proof.".to_string());
    }
    sentences
}

/// Returns the key numbers.
pub fn tiles(found: &Metamorphic) -> Vec<(String, String)> {
    let broken = found.relations.iter().filter(|relation| relation.broken > 0).count();
    let pairs: u64 = found.relations.iter().map(|relation| relation.broken).sum();
    vec![
        (format!("{broken} of {}", found.relations.len()), "relations are broken".into()),
        (pairs.to_string(), "broken pairs".into()),
        (found.pairs.to_string(), "source cases".into()),
        (found.simulations.to_string(), "simulations".into()),
    ]
}

/// Returns the relations and their broken pairs as HTML.
pub fn section(report: &RunReport, found: &Metamorphic, id: usize) -> String {
    let mut out = format!("<h3 id=\"r{id}-search\">Relations between pairs</h3>\n{}", relations(found));
    let charts: String =
        (1..).zip(&found.relations).map(|(index, relation)| chart(report, relation, index)).collect();
    out.push_str(&format!("<div class=\"grid\">{charts}</div>\n"));
    for relation in found.relations.iter().filter(|relation| relation.broken > 0) {
        out.push_str(&format!("<h3>Pairs that break {}</h3>\n", text(&short(&relation.name, 40))));
        out.push_str(&pairs(found, relation));
        out.push_str(&relation.smallest_change.as_ref().map_or(String::new(), smallest_text));
        if let Some(worst) = relation.worst.first() {
            for case in [&worst.source, &worst.follow_up] {
                out.push_str(&commands::details(report, case.trial, case.simulation));
            }
        }
    }
    out
}

fn relations(found: &Metamorphic) -> String {
    let row = |relation: &MetamorphicRelation| {
        let rate = &relation.broken_rate;
        let of = |share: Option<f64>| share.map_or("–".to_string(), percent);
        vec![
            text(&short(&relation.name, 40)),
            changes(&relation.change),
            text(&relation.holds),
            relation.pairs.to_string(),
            relation.broken.to_string(),
            format!("{} ({} to {})", of(rate.value), of(rate.low), of(rate.high)),
            relation.verdicts.both_satisfied.to_string(),
            relation.verdicts.both_violated.to_string(),
            relation.verdicts.worse.to_string(),
            relation.verdicts.better.to_string(),
        ]
    };
    let head = [
        "relation",
        "change",
        "holds",
        "pairs",
        "broken",
        "rate (95 %)",
        "satisfied in both",
        "violated in both",
        "violated by the change",
        "satisfied by the change",
    ];
    table("Relations and their pairs", &head, &found.relations.iter().map(row).collect::<Vec<_>>())
}

fn changes(change: &Named<String>) -> String {
    let one = |(axis, change): &(String, String)| {
        format!("{} {}", text(&short(axis, 40)), text(&short(change, 40)))
    };
    change.0.iter().map(one).collect::<Vec<_>>().join(", ")
}

/// Draws the robustness of follow-up cases against that of their source cases.
fn chart(report: &RunReport, relation: &MetamorphicRelation, index: u32) -> String {
    let finite = |rho: Option<f64>| rho.filter(|rho| rho.is_finite());
    let of_trial = |trial: u32| {
        let points = report.points.iter().filter(move |point| point.trial == trial);
        points.filter_map(|point| Some((point.number, finite(point.robustness)?))).collect::<BTreeMap<_, _>>()
    };
    let follow_ups = of_trial(SOURCES + index);
    // A large run has a part of its simulations on the page, but all of the worst pairs.
    let worst: BTreeSet<u32> = relation.worst.iter().map(|pair| pair.pair).collect();
    let sorted = |mut places: Vec<[f64; 2]>| {
        places.sort_by(|a, b| a[0].total_cmp(&b[0]));
        places
    };
    let place = |(number, source): (u32, f64)| Some([source, *follow_ups.get(&number)?]);
    let others = of_trial(SOURCES).into_iter().filter(|(number, _)| !worst.contains(number));
    let others = sorted(others.filter_map(place).collect());
    let place =
        |pair: &BrokenPair| Some([finite(pair.source.robustness)?, finite(pair.follow_up.robustness)?]);
    let broken = sorted(relation.worst.iter().filter_map(place).collect());
    let range = around(others.iter().chain(&broken).flat_map(|place| *place));
    let series = vec![
        Series::new(color::LIMIT, Mark::DashedLine, range.map(|rho| [rho, rho])),
        Series::new(color::LIMIT, Mark::ThinLine, range.map(|rho| [rho, 0.0])),
        Series::new(color::LIMIT, Mark::ThinLine, range.map(|rho| [0.0, rho])),
        Series::new(color::PASS, Mark::Dot, others),
        Series::new(color::FAIL, Mark::Dot, broken),
    ];
    let panel = Panel {
        title: String::new(),
        x: linear("robustness of the source case", range),
        y: linear("robustness of the follow-up case", range),
        areas: Vec::new(),
        series,
        marks: Vec::new(),
    };
    let title = String::new();
    let caption = String::new();
    let legend = Vec::new();
    let chart = Chart { title, caption, legend, columns: 1, panel_size: SIZE, panels: vec![panel] };
    let name = short(&relation.name, 40);
    figure(
        &chart.figure(&visible(&format!("Robustness of the pairs of {name}"))),
        &format!("{name}."),
        "Each dot is a pair. On the dashed line, the change has no effect. The largest breaks of the relation have the color of \
         failures.",
    )
}

fn pairs(found: &Metamorphic, relation: &MetamorphicRelation) -> String {
    let case = |case: &PairCase| {
        let verdict = match case.is_violated {
            Some(true) => "violated",
            Some(false) => "satisfied",
            None => "no verdict",
        };
        format!("{verdict}, {}", case.robustness.map_or("–".to_string(), number))
    };
    let scenario = |pair: &BrokenPair| {
        let value = |(axis, value): &(String, f64)| format!("{} {}", text(&short(axis, 40)), number(*value));
        let named = found.subject.axes.iter().cloned().zip(pair.source.scenario.values().copied());
        let values: Vec<(String, f64)> = named.filter_map(|(axis, value)| Some((axis, value?))).collect();
        let more = if values.len() > 6 { ", …" } else { "" };
        values.iter().take(6).map(value).collect::<Vec<_>>().join(", ") + more
    };
    let row = |pair: &BrokenPair| {
        vec![
            pair.pair.to_string(),
            case(&pair.source),
            case(&pair.follow_up),
            number(pair.difference.0),
            scenario(pair),
        ]
    };
    let rows: Vec<Vec<String>> = relation.worst.iter().take(MAX_PAIRS).map(row).collect();
    let head = ["pair", "source case", "follow-up case", "difference", "source scenario"];
    let more = if relation.broken as usize > rows.len() {
        format!("<p class=\"notes\">{} of {} pairs are shown.</p>\n", rows.len(), relation.broken)
    } else {
        String::new()
    };
    table("Broken pairs, the largest difference first", &head, &rows) + &more
}

fn smallest_text(smallest: &SmallestChange) -> String {
    let change =
        |(axis, change): &(String, f64)| format!("{} by {}", text(&short(axis, 40)), number(*change));
    let changes: Vec<String> = smallest.change.0.iter().map(change).collect();
    format!(
        "<p>From the source case of pair {}, {} of the change is enough: {}.</p>\n",
        smallest.pair,
        percent(smallest.share),
        changes.join(", ")
    )
}
