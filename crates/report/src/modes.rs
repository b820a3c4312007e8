//! Failure modes: what fails, where, when, how large the failing patch is, and one simulation of
//! each.

use mishandle::evaluation::Estimate;
use mishandle::falsification::physics_text;
use mishandle::inspect::{ExplainedSimulation, FailureMode, MinimalFailure};
use mishandle::resolve::nominal_scenario;
use mishandle::results::Answer;
use mishandle::run::has_random_rows;
use mishandle::store::RunHeader;

use crate::html::{base64, percent, short, table, text, with_code, with_unit};
use crate::load::RunReport;
use crate::measure::Patch;
use crate::pictures::{Film, Frame, Pictures};
use crate::space::{Bound, Extent, value_text};
use crate::{commands, head, tables, trace, words};

/// If the share of failing scenarios in the box of a mode may be above this, the patch is taken to
/// be larger than the box.
const REACHES_BEYOND: f64 = 0.9;

/// A box with at least this share of the space is taken for the whole space.
const WHOLE: f64 = 0.999;

/// Largest number of axes in the tables of a mode.
const MAX_AXES: usize = 12;

/// A box with a smaller part of the space says nothing about the size of the failing patch, since
/// most failures are outside.
const SMALL: f64 = 0.001;

/// Returns the descriptions of the failure modes of a run. `id` is its number on the page.
pub fn section(report: &RunReport, id: usize) -> String {
    let modes = &report.modes;
    let described = report.representatives.len();
    let mut out = format!(
        "<p>{} in {}. Failures belong to one mode if the same predicate decides them, at a similar time, and the same axes \
         cause them, or, where the cause was not searched for, their scenarios are neighbors.{}</p>\n",
        mishandle_text::plural((modes.failures - modes.not_grouped) as u64, "failure"),
        mishandle_text::plural(modes.modes.len() as u64, "failure mode"),
        match modes.not_grouped {
            0 => String::new(),
            n => format!(" {n} more have no recorded trace and are not grouped."),
        }
    );
    if described < modes.modes.len() {
        out.push_str(&format!(
            "<p>Only the {} with the most failures {} described.</p>\n",
            mishandle_text::plural(described as u64, "mode"),
            if described == 1 { "is" } else { "are" }
        ));
    }
    for (index, (mode, explained)) in modes.modes.iter().zip(&report.representatives).enumerate() {
        out.push_str(&card(report, id, index, mode, explained));
    }
    out
}

fn card(
    report: &RunReport,
    id: usize,
    index: usize,
    mode: &FailureMode,
    explained: &ExplainedSimulation,
) -> String {
    let header = &report.header;
    let representative = mode.representative();
    let trial = representative.trial;
    let number_of = representative.number;
    let time = |sample: usize| mishandle_text::instant(sample, header.control_dt);
    let minimal = report.minimal.get(index).and_then(Option::as_ref);
    let (first, last) = mode.samples;
    let instant = explained.explanation.instant().unwrap_or(first);
    let range = if first == last || minimal.is_some_and(|minimal| minimal.cause.went_back) {
        String::new()
    } else {
        format!(" (in this mode between {} and {})", time(first), time(last))
    };
    let when = format!("From {} on{range}", time(instant));
    let predicate = match representative.predicate.as_str() {
        "" => "the whole formula".to_string(),
        predicate => format!("<code>{}</code>", text(predicate)),
    };
    let with = head::cause(report, explained);
    let mut out = format!(
        "<article class=\"mode\" id=\"{}\">\n<h4>{}: {with} <span class=\"count\">{} of {}</span></h4>\n\
         <p>{when}, nothing can satisfy the requirement: {predicate} is violated.",
        tables::mode_id(id, index),
        index + 1,
        mode.failures.len(),
        mishandle_text::plural(report.modes.failures as u64, "failure"),
    );
    let measured = report.measured.as_ref();
    let entry = |index: usize| measured.and_then(|measured| measured.patches.get(index).copied().flatten());
    let is_random = measured.is_some_and(|measured| measured.noise.is_some());
    out.extend(entry(index).map(|patch| patch_text(patch, is_random)));
    out.push_str("</p>\n<div class=\"facts-and-trace\">\n<div>");
    out.push_str(&region_table(report, mode, explained, minimal));
    let place = format!("trial {trial}, simulation {}", tables::link(report, id, trial, number_of));
    out.push_str(&match minimal {
        Some(_) => format!("<h5>{}, moved toward nominal</h5>\n<ul class=\"why\">", first_letter(&place)),
        None => format!("<h5>The failure closest to nominal: {place}</h5>\n<ul class=\"why\">"),
    });
    if minimal.is_some_and(|minimal| minimal.cause.went_back) {
        out.push_str("<li>Nearer to nominal are failures that another physics step, collision algorithm or start does not confirm: they do not count as minimal.</li>");
    }
    for sentence in explained.explanation.sentences(time) {
        out.push_str(&format!("<li>{}</li>", with_code(&sentence)));
    }
    out.push_str(&format!(
        "<li>Robustness {}.</li>",
        with_unit(
            explained.recorded.robustness.unwrap_or(f64::NAN),
            &text(&short(&explained.explanation.unit, 20))
        )
    ));
    if let Some(check) = measured.and_then(|measured| measured.physics.get(index)) {
        let label = if check.depends_on_solver { "<strong>Physics</strong>" } else { "Physics" };
        out.push_str(&format!("<li>{label}: {}.</li>", text(&physics_text(check))));
    }
    let repeats = measured.and_then(|measured| measured.repeats.get(index)).and_then(Option::as_ref);
    if let Some(repeats) = repeats {
        out.push_str(&format!(
            "<li>With other random seeds, the same scenario fails in {} of {}{}.</li>",
            repeats.failures,
            mishandle_text::plural(repeats.failure_rate.n, "repeat"),
            interval(&repeats.failure_rate)
        ));
    }
    let mut figures = trace::figures(header, explained, None, report.samples()).into_iter();
    out.push_str(&format!("</ul>\n</div>\n<div>{}</div>\n</div>\n", figures.next().unwrap_or_default()));
    let pictures = measured.and_then(|measured| measured.strips.get(index));
    out.push_str(&pictures.map_or(String::new(), |pictures| frames(header, pictures, explained)));
    let others: String = figures.collect();
    if !others.is_empty() {
        out.push_str(&format!("<div class=\"grid\">{others}</div>\n"));
    }
    let recorded = minimal.filter(|minimal| minimal.is_recorded).map(|_| &explained.recorded);
    let (trial, number) = recorded.map_or((trial, number_of), |found| (found.trial, found.number));
    out.push_str(&commands::details(report, trial, number));
    out + "</article>\n"
}

fn first_letter(text: &str) -> String {
    let (first, rest) = text.split_at(1);
    first.to_uppercase() + rest
}

/// Formats an estimate: `: 12 % [8, 17]`.
fn interval(estimate: &Estimate) -> String {
    match (estimate.value, estimate.low, estimate.high) {
        (Some(value), Some(low), Some(high)) => {
            format!(" ({}, 95 % interval {} to {})", percent(value), percent(low), percent(high))
        }
        _ => String::new(),
    }
}

/// Says how large the failing patch is. If the target `is_random`, a scenario fails with some
/// probability.
fn patch_text(patch: Patch, is_random: bool) -> String {
    let Patch { extent, has_all_points, volume, failures, undecided, failing } = patch;
    let (Some(value), Some(low), Some(high)) = (failing.value, failing.low, failing.high) else {
        return String::new();
    };
    let (without, rule) = match undecided {
        0 => (String::new(), ""),
        1 => (" and 1 has no verdict".to_string(), words::UNDECIDED),
        n => (format!(" and {n} have no verdict"), words::UNDECIDED),
    };
    let fail = if failures == 1 { "fails" } else { "fail" };
    if let (true, Extent::Points(all)) = (has_all_points, extent) {
        return format!(
            " Of the {} of the space, {} in a box around these failures, and <b>{failures} of {all} points</b> {fail} there{without}.",
            mishandle_text::plural(all, "point"),
            match failing.n {
                1 => "1 is".to_string(),
                n => format!("{n} are"),
            },
        );
    }
    let found = format!(
        " Of {} random scenarios in a box around these failures ({}), {failures} {fail}{without}",
        failing.n,
        extent.part(volume, Bound::Value)
    );
    if volume < SMALL {
        return format!("{found}. The box is too small to say which part of the space fails.");
    }
    if failures == 0 {
        return if is_random {
            let most = percent(volume * high);
            format!(
                "{found}: at most {most} of random simulations of the whole space fail here (95 % confidence{rule})."
            )
        } else {
            let most = extent.part(volume * high, Bound::High);
            format!("{found}: at most {most} fail here (95 % confidence{rule}).")
        };
    }
    let is_cut = high > REACHES_BEYOND && volume < WHOLE;
    if is_random {
        let [value, low, high] = [value, low, high].map(|share| percent(volume * share));
        return format!(
            "{found}, so about <b>{value} of random simulations</b> of the whole space fail here (95 % interval {low} to {high}{rule})."
        );
    }
    let interval =
        format!("{} to {}", extent.size(volume * low, Bound::Low), extent.size(volume * high, Bound::High));
    let part = extent.part(volume * value, Bound::Value);
    if is_cut {
        format!(
            "{found}. The failing patch reaches beyond the box, so it has <b>at least about {part}</b> (95 % interval of its part \
             in the box: {interval}{rule})."
        )
    } else {
        format!("{found}, so the failing patch is about <b>{part}</b> (95 % interval {interval}{rule}).")
    }
}

/// Returns the table of the region of a mode and the scenario of its representative. The axes that
/// matter come first.
fn region_table(
    report: &RunReport,
    mode: &FailureMode,
    explained: &ExplainedSimulation,
    minimal: Option<&MinimalFailure>,
) -> String {
    let scenario = &explained.recorded.scenario;
    let caused = minimal.map_or(&mode.axes, |minimal| &minimal.axes);
    let matters = |axis: &usize| caused.contains(axis);
    // The failure of several axes none of which could be moved has no cause among them.
    let has_all = minimal.is_some() && caused.len() > 1 && caused.len() == report.axes.len();
    let all = 0..report.axes.len();
    let order: Vec<usize> = all.clone().filter(matters).chain(all.filter(|axis| !matters(axis))).collect();
    let rows = order.iter().take(MAX_AXES).map(|index| {
        let axis = &report.axes[*index];
        let value = scenario.get(*index).copied().flatten();
        let region = mode.region.get(*index).copied().flatten();
        let region = region.map_or("random".to_string(), |(low, high)| {
            if low == high {
                value_text(axis, Some(low))
            } else {
                format!("{} to {}", value_text(axis, Some(low)), value_text(axis, Some(high)))
            }
        });
        let name = text(&short(&axis.name, 40));
        let name = if matters(index) && !has_all { format!("<b>{name}</b>") } else { name };
        let cells = [region, value_text(axis, value), value_text(axis, axis.nominal)];
        std::iter::once(name).chain(cells.iter().map(|cell| text(cell))).collect()
    });
    let rows: Vec<Vec<String>> = rows.collect();
    let mut notes = Vec::new();
    if minimal.is_some() {
        notes.push(match caused.as_slice() {
            [] => {
                let scenario = match &report.answer {
                    Some(Answer::Falsification(found)) => nominal_scenario(&found.subject),
                    _ => "the nominal scenario".to_string(),
                };
                format!("It fails in the same way in {}.", text(&scenario))
            }
            _ if has_all => {
                "No axis could be moved to nominal without losing the failure, so nothing says which axes cause it.".to_string()
            }
            _ => "Bold axes cause the failure: moved toward nominal, it remains with these axes alone off nominal. The ranges of the \
                  other axes say nothing."
                .to_string(),
        });
    } else if mode.axes.is_empty() && !has_random_rows(&report.header) {
        notes.push(
            "These scenarios were not all drawn at random, so they cannot tell which axes matter. The failures are grouped by \
             predicate, time and categories alone; the ranges are those of the simulations."
                .to_string(),
        );
    } else if mode.axes.is_empty() {
        notes.push(
            "No axis distinguishes these failures from the other simulations, so they are grouped by predicate and time alone: they may fail \
             anywhere in the space, or for a reason that takes several axes together."
                .to_string(),
        );
    } else if mode.axes.len() < report.axes.len() {
        notes.push(
            "Bold axes matter: along them, failures of this predicate are distributed differently from the other simulations \
             (Kolmogorov-Smirnov test, corrected). The ranges of the other axes say little."
                .to_string(),
        );
    }
    if report.axes.len() > MAX_AXES {
        notes.push(format!("{MAX_AXES} of {} axes are shown.", report.axes.len()));
    }
    let notes = if notes.is_empty() {
        String::new()
    } else {
        format!("<p class=\"notes\">{}</p>\n", notes.join(" "))
    };
    table("Where it fails", &["axis", "failures of this mode", "minimal failure", "nominal"], &rows) + &notes
}

/// Returns the pictures of a simulation as HTML.
pub fn frames(header: &RunHeader, pictures: &Pictures, explained: &ExplainedSimulation) -> String {
    let decisive = explained.explanation.event();
    let frame = |frame: &Frame| {
        let time = format!("{:.2} s", frame.sample as f64 * header.control_dt);
        let event = decisive.filter(|event| event.sample == frame.sample);
        let note = event.map_or(String::new(), |event| format!(", {}", event.kind.name()));
        format!(
            "<figure class=\"frame{}\"><img src=\"data:image/png;base64,{}\" width=\"320\" height=\"240\" alt=\"The scene at \
             {time}{note}\"><figcaption>{time}{note}</figcaption></figure>",
            if note.is_empty() { "" } else { " decisive" },
            base64(&frame.png)
        )
    };
    let frames: String = pictures.frames.iter().map(frame).collect();
    let film = pictures.film.as_ref().map_or(String::new(), |found| film(found, header.control_dt));
    let source = if mishandle::resolve::is_python(&header.target.kind) {
        "<p class=\"notes\">The system drew these pictures while the simulation was repeated, with the recorded trace.</p>\n"
    } else {
        ""
    };
    let seen = pictures.seen.as_ref().map_or(String::new(), |seen| seen.html(header));
    format!("<div class=\"strip\">{frames}</div>\n{source}{film}{seen}")
}

/// Returns a film that the reader opens. It repeats until it is closed.
fn film(film: &Film, control_dt: f64) -> String {
    let [from, to] =
        [film.window.0, film.window.1].map(|sample| format!("{:.2} s", sample as f64 * control_dt));
    format!(
        "<details class=\"film\"><summary>Film from {from} to {to}, at half speed</summary><img \
         src=\"data:image/png;base64,{}\" width=\"320\" height=\"240\" alt=\"Film of the scene from {from} to {to}; the \
         pictures above show its instants\"></details>\n",
        base64(&film.png)
    )
}
