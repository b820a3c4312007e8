//! The first screen of a run: what breaks, when, how little is enough, and how sure that is, with
//! the minimal failure beside the nominal simulation.

use mishandle::inspect::ExplainedSimulation;
use mishandle::results::Answer;
use mishandle::rollout::Axis;
use mishandle::stl::is_violated;
use mishandle::verdict::{Fact, sureness, verdict};
use mishandle_text::{instant, plural};

use crate::html::{base64, number, percent, short, text, with_unit};
use crate::load::{Lead, RunReport};
use crate::pictures::PICTURE;
use crate::space::value_text;
use crate::{trace, words};

/// Largest number of axes that a sentence names.
const NAMED: usize = 3;

/// Facts of a verdict that the sentences and tables of the page have.
const STATED: [&str; 3] = ["cause", "since", "requirement"];

/// Texts of facts are cut to this length.
const FACT: usize = 600;

/// Returns the first screen. `id` is the number of the run on the page.
pub fn section(report: &RunReport, id: usize) -> String {
    let Some(lead) = report.lead() else {
        let heading = format!("<h2>{}</h2>\n", words::headline(report));
        return heading + &paragraph(&sentences(report)) + &facts(report, None, id);
    };
    let fails = fails(lead.explained);
    let is_search = matches!(report.answer, Some(Answer::Falsification(_)));
    let mut out = if fails && is_search {
        let at = when(report, lead.explained);
        let with = cause(report, lead.explained);
        let progress = words::progress(report).map_or(String::new(), |text| text + " ");
        format!("<h2>{} fails{at} {with}.</h2>\n<p class=\"lead\">{progress}", words::subject(report))
    } else {
        let what =
            if fails { "The failure closest to nominal" } else { "The simulation closest to a failure" };
        let with = cause(report, lead.explained);
        format!("<h2>{}</h2>\n<p class=\"lead\">{what}: {with}. ", words::headline(report))
    };
    out.push_str(&what_happens(report, &lead));
    if fails && is_search {
        let found = report.answer.as_ref().map(Answer::without_verdict);
        out.push_str(&found.map_or(String::new(), words::without_verdict));
    }
    let pair = pair(report, lead.explained);
    let scene = report.replay.as_ref().map_or(pair.clone(), |replay| replay.html(&format!("r{id}"), &pair));
    out.push_str(&format!("</p>\n{scene}"));
    if !fails && is_search {
        out.push_str(&paragraph(&sentences(report)));
    }
    let nominal = report.measured.as_ref().and_then(|measured| measured.lead.nominal.as_ref());
    let mut charts = trace::figures(&report.header, lead.explained, nominal, report.samples()).into_iter();
    let (first, facts) = (charts.next().unwrap_or_default(), facts(report, Some(&lead), id));
    out.push_str(&format!("<div class=\"facts-and-trace\"><div>{facts}</div><div>{first}</div></div>\n"));
    let others: String = charts.collect();
    if others.is_empty() { out } else { out + &format!("<div class=\"grid\">{others}</div>\n") }
}

fn sentences(report: &RunReport) -> String {
    words::meaning(report).join(" ")
}

fn paragraph(sentences: &str) -> String {
    if sentences.is_empty() { String::new() } else { format!("<p>{sentences}</p>\n") }
}

fn fails(explained: &ExplainedSimulation) -> bool {
    explained.recorded.robustness.is_some_and(is_violated)
}

/// Returns the instant of a failure: ` at 2.38 s`.
fn when(report: &RunReport, explained: &ExplainedSimulation) -> String {
    let time = |sample: usize| format!(" at {:.2} s", sample as f64 * report.header.control_dt);
    explained.explanation.instant().map_or(String::new(), time)
}

/// Returns the values of a simulation off nominal, as HTML: `with payload = 2.28 kg (nominal 0)`.
pub fn cause(report: &RunReport, explained: &ExplainedSimulation) -> String {
    values(&report.axes, &explained.recorded.scenario, report.header.control_dt)
}

/// Returns the values of a scenario off nominal, as HTML. A random draw that the scenario names is
/// not off nominal. `control_dt` is the time of a control step, s.
pub fn values(axes: &[Axis], scenario: &[Option<f64>], control_dt: f64) -> String {
    let off = axes.iter().zip(scenario).filter_map(|(axis, value)| {
        let (nominal, value) = (axis.nominal?, (*value)?);
        (value != nominal).then_some((axis, value, nominal))
    });
    let value = |(axis, value, nominal): (&Axis, f64, f64)| {
        let unitless = Axis { unit: String::new(), ..axis.clone() };
        let nominal = format!("nominal {}", value_text(&unitless, Some(nominal)));
        let time = if axis.unit.starts_with("control step") {
            format!("{} ms; ", number((1e3 * value * control_dt).round()))
        } else {
            String::new()
        };
        text(&format!("{} = {} ({time}{nominal})", short(&axis.name, 40), value_text(axis, Some(value))))
    };
    let off: Vec<String> = off.map(value).collect();
    match off.len() {
        0 => "at nominal".to_string(),
        n if n > NAMED + 1 => {
            format!("with {} and {} other axes off nominal", off[..NAMED].join(", "), n - NAMED)
        }
        _ => format!("with {}", off.join(", ")),
    }
}

/// Says what the failing system does from the instant on, and what the nominal one does.
fn what_happens(report: &RunReport, lead: &Lead<'_>) -> String {
    let Lead { explained, minimal } = lead;
    let explanation = &explained.explanation;
    let unit = text(&short(&explanation.unit, 20));
    let mut out = String::new();
    let words = minimal.and_then(|minimal| minimal.cause.violation.as_ref());
    let words = words.filter(|found| !found.words.is_empty() && found.decided.is_some());
    if let (Some(found), Some(sample)) = (words, explanation.instant()) {
        let at = instant(sample, report.header.control_dt);
        out.push_str(&format!(
            "From {at} on, nothing can satisfy the requirement: {}.",
            text(&short(&found.words, 200))
        ));
    } else if let (Some(sample), Some(predicate), Some(history)) =
        (explanation.instant(), &explanation.diagnosis.predicate, &explanation.history)
    {
        let at = instant(sample, report.header.control_dt);
        let value = |side: usize| history.sides[side].get(sample).copied().unwrap_or(f64::NAN);
        let named = |side: usize| {
            let name = &predicate.sides[side];
            match name.parse::<f64>() {
                Ok(_) => format!("the limit {}", with_unit(value(side), &unit)),
                Err(_) => {
                    format!("<code>{}</code> is {}", text(&short(name, 80)), with_unit(value(side), &unit))
                }
            }
        };
        let [left, right] = [named(0), named(1)];
        let values =
            if left.starts_with("the") { format!("{right}, {left}") } else { format!("{left}, {right}") };
        out.push_str(&if fails(explained) && explanation.decided.is_some() {
            format!("From {at} on, nothing can satisfy the requirement: {values}.")
        } else {
            format!("Decisive is {at}: {values}.")
        });
    }
    let is_alone = minimal.is_some_and(|minimal| (1..report.axes.len()).contains(&minimal.axes.len()));
    if is_alone && fails(explained) {
        out.push_str(" All else is nominal.");
    }
    let nominal = report.measured.as_ref().and_then(|measured| measured.lead.nominal.as_ref());
    if let Some(rho) = nominal.and_then(|nominal| nominal.recorded.robustness) {
        out.push_str(&format!(
            " At nominal it {} the requirement, with robustness {}.",
            if is_violated(rho) { "also violates" } else { "meets" },
            with_unit(rho, &unit)
        ));
    }
    out
}

/// Returns the pictures of both simulations at the instant.
fn pair(report: &RunReport, explained: &ExplainedSimulation) -> String {
    let Some(measured) = &report.measured else { return String::new() };
    let sample = explained.explanation.instant().unwrap_or(0);
    let time = format!("{:.2} s", sample as f64 * report.header.control_dt);
    let verdict = |found: &ExplainedSimulation| if fails(found) { "fails" } else { "passes" };
    let figure = |png: &Option<Vec<u8>>, name: &str, found: &ExplainedSimulation| {
        let png = png.as_ref()?;
        let verdict = verdict(found);
        Some(format!(
            "<figure class=\"frame{}\"><img src=\"data:image/png;base64,{}\" width=\"{}\" height=\"{}\" alt=\"The scene at {time}, \
             {name}: {verdict}\"><figcaption><b>{name}: {verdict}</b>, {time}</figcaption></figure>",
            if fails(found) { " decisive" } else { "" },
            base64(png),
            PICTURE.0,
            PICTURE.1
        ))
    };
    let with = cause(report, explained);
    let failing = figure(&measured.lead.failing, &with, explained);
    let nominal = measured.lead.nominal.as_ref();
    let beside = nominal.and_then(|nominal| figure(&measured.lead.beside, "nominal", nominal));
    let figures: String = failing.into_iter().chain(beside).collect();
    if figures.is_empty() { figures } else { format!("<div class=\"lead-pair\">{figures}</div>\n") }
}

/// Returns the facts of the verdict that no sentence above has, how sure a failure is, and how much
/// of the space fails.
fn facts(report: &RunReport, lead: Option<&Lead<'_>>, id: usize) -> String {
    let verdict = report.answer.as_ref().and_then(verdict);
    let found = verdict.iter().flat_map(|verdict| &verdict.facts);
    let new = found.filter(|fact| !STATED.contains(&fact.label));
    let has_ways = !report.modes.modes.is_empty();
    let line = |fact: &Fact| {
        let found = text(&short(&fact.text, FACT));
        match fact.label {
            "ways" if has_ways => [fact.label.to_string(), format!("<a href=\"#r{id}-modes\">{found}</a>")],
            label => [label.to_string(), found],
        }
    };
    let mut lines: Vec<[String; 2]> = new.map(line).collect();
    let failing = lead.filter(|lead| fails(lead.explained));
    if let Some(lead) = failing.filter(|_| !has(&lines, "sure")) {
        let cause = lead.minimal.map(|minimal| &minimal.cause);
        let is_deterministic = report.measured.as_ref().is_some_and(|measured| measured.noise.is_none());
        let physics = cause.and_then(|cause| cause.physics.as_ref());
        let sure = sureness(cause, None, physics, is_deterministic);
        lines.extend((!sure.is_empty()).then(|| ["sure".to_string(), text(&sure)]));
    }
    let modes = report.modes.modes.len();
    if modes > 1 && !has(&lines, "ways") {
        let ways = plural(modes as u64, "failure mode");
        lines.push(["ways".to_string(), format!("<a href=\"#r{id}-modes\">{ways}</a>")]);
    }
    if let Some(measured) = report.measured.as_ref().filter(|measured| !measured.scenarios.is_empty()) {
        let all = measured.scenarios.len();
        let failing = measured.scenarios.iter().filter(|point| point.fails()).count();
        let share = percent(failing as f64 / all as f64);
        let often = match measured.has_all_points {
            true => Some(format!("{failing} of the {all} points of the space fail")),
            false if report.axis_rates().is_none() => {
                Some(format!("{failing} of {all} random simulations of the space fail ({share})"))
            }
            false => None,
        };
        lines.extend(often.map(|often| ["how often".to_string(), often]));
    }
    let row = |[name, value]: &[String; 2]| format!("<div><dt>{name}</dt><dd>{value}</dd></div>\n");
    let rows: String = lines.iter().map(row).collect();
    if rows.is_empty() { rows } else { format!("<dl class=\"facts\">{rows}</dl>\n") }
}

fn has(lines: &[[String; 2]], label: &str) -> bool {
    lines.iter().any(|[name, _]| name == label)
}
