//! The answer of a margin: the verdict, the amplitudes that were tried, and the witness.

use crate::charts::{Chart, Mark, Panel, Series};
use mishandle::falsification::norms;
use mishandle::resolve::nominal_values;
use mishandle::results::{CategoryMargin, Level, Margin, Named, Witness};
use mishandle::rollout::{Scenario, Space};
use mishandle::stl::is_violated;
use mishandle_text::plural;

use crate::html::{figure, number, percent, short, table, text, visible, with_code};
use crate::load::RunReport;
use crate::map::SIZE;
use crate::space::{around, linear, value_text};
use crate::{color, commands, modes, trace, words};

/// Largest number of rows in the table of the witness.
const MAX_AXES: usize = 12;

/// Returns the verdict: one sentence of HTML.
pub fn headline(report: &RunReport, found: &Margin) -> String {
    let subject = words::subject(report);
    match &found.witness {
        Some(witness) if witness.axes == 0 => {
            format!("{subject} violates its requirement without a disturbance.")
        }
        Some(witness) => format!(
            "A disturbance of {} of its range makes {subject} violate its requirement{}.",
            percent(witness.norms.amplitude),
            match &witness.repeats {
                Some(repeats) if !repeats.fails_in_most() => ", but not with most other seeds",
                _ => "",
            }
        ),
        None if !found.has_verdict() => format!("No simulation of {subject} has a verdict."),
        None if !found.is_complete => format!("No violation of {subject} found so far."),
        None if found.no_violation_up_to.is_none() => {
            format!("No violation of {subject} was found, which says nothing about the space.")
        }
        None => {
            let space = text(&found.subject.space);
            format!(
                "No disturbance within the space {space} was found that makes {subject} violate its requirement."
            )
        }
    }
}

/// Returns what the verdict means, as sentences of HTML.
pub fn meaning(found: &Margin) -> Vec<String> {
    let mut sentences = Vec::new();
    if !found.is_complete {
        sentences.push("<strong>The run is not finished.</strong>".to_string());
    }
    sentences.push(
        "The amplitude of a disturbance is the largest offset of an axis from its nominal value, as a share of the distance to its \
         bound."
            .to_string(),
    );
    let from = nominal_values(found.measured_axes());
    if !from.is_empty() {
        sentences
            .push(format!("Offsets are measured from {}, because the plan sets these ranges.", text(&from)));
    }
    if !found.at_nominal.is_empty() {
        sentences.push(format!("Other axes of the target are {}.", text(&found.at_nominal_text())));
    }
    if found.subject.space_axes.iter().any(|axis| axis.kind == "start") {
        sentences.push("Initial states vary in their whole range at every amplitude.".to_string());
    }
    if !found.categories.0.is_empty() {
        sentences.push(format!("Categories stay: {}.", categories(&found.categories)));
    }
    if found.witness.is_some() {
        sentences.push(
            "The amplitude is an upper bound of the margin: a smaller disturbance that violates the requirement may exist."
                .to_string(),
        );
    }
    if let Some(amplitude) = found.no_violation_up_to {
        let is_exhaustive = found.no_violation_is_exhaustive == Some(true);
        let all = match found.no_violation_seeds {
            _ if is_exhaustive => ", which are all scenarios".to_string(),
            Some(seeds) if found.is_random => format!(" with {}", plural(seeds, "seed")),
            _ => String::new(),
        };
        let proof = if is_exhaustive { "" } else { " This is evidence, not a proof." };
        sentences.push(format!(
            "Up to amplitude {}, there is no violation in {}{all}.{proof}",
            number(amplitude),
            plural(found.no_violation_simulations.unwrap_or(0), "simulation")
        ));
    }
    if let Some(amplitude) = found.smallest_without_verdict {
        sentences.push(format!(
            "Nothing is claimed from amplitude {} on: simulations there have no verdict.",
            number(amplitude)
        ));
    }
    if let Some(repeats) = found.witness.as_ref().and_then(|witness| witness.repeats.as_ref()) {
        let luck = if repeats.fails_in_most() { "." } else { ": the failure is the luck of its seed." };
        sentences.push(format!(
            "With other seeds, the witness fails in {} of {}{luck}",
            repeats.failures,
            plural(repeats.simulations, "repeat")
        ));
    }
    sentences
}

/// Returns the key numbers.
pub fn tiles(found: &Margin) -> Vec<(String, String)> {
    let witness = found.witness.as_ref();
    let of = |value: Option<f64>| value.map_or("–".to_string(), number);
    vec![
        (of(witness.map(|witness| witness.norms.amplitude)), "smallest amplitude with a violation".into()),
        (of(found.no_violation_up_to), "largest amplitude without a violation".into()),
        (
            witness.map_or("–".into(), |witness| witness.axes.to_string()),
            "disturbed axes of the witness".into(),
        ),
        (found.simulations.to_string(), "simulations of the search".into()),
    ]
}

/// Returns the amplitudes and the witness as HTML.
pub fn section(report: &RunReport, found: &Margin, id: usize) -> String {
    let mut out = format!(
        "<h3 id=\"r{id}-search\">How large a disturbance must be</h3>\n<div class=\"grid\">{}</div>\n{}{}",
        chart(report, found),
        each_category(found),
        levels(found)
    );
    if let Some(witness) = &found.witness {
        out.push_str(&format!("<h3 id=\"r{id}-witness\">The smallest disturbance found</h3>\n"));
        out.push_str(&witness_section(report, witness));
    }
    out
}

/// Draws the robustness of the simulations against the amplitudes of their disturbances.
fn chart(report: &RunReport, found: &Margin) -> String {
    let Ok(space) = Space::new(&report.header.space, report.axes.clone()) else {
        return String::new();
    };
    let place = |point: &crate::load::Point| {
        let rho = point.robustness.filter(|rho| rho.is_finite())?;
        Some([norms(&space, &Scenario::new(point.scenario.clone())).amplitude, rho])
    };
    // The repeats of the witness are at one amplitude.
    let points: Vec<[f64; 2]> =
        report.points.iter().filter(|point| point.trial == 1).filter_map(place).collect();
    let (failing, passing): (Vec<_>, Vec<_>) = points.iter().partition(|[_, rho]| is_violated(*rho));
    let mut lowest: Vec<[f64; 2]> = found
        .levels
        .iter()
        .filter_map(|level| Some([level.amplitude, level.minimum_robustness.filter(|rho| rho.is_finite())?]))
        .collect();
    lowest.sort_by(|a, b| a[0].total_cmp(&b[0]));
    let range = around(points.iter().map(|[_, rho]| *rho));
    let witness = found.witness.iter().map(|witness| witness.norms.amplitude);
    let sorted = |mut points: Vec<[f64; 2]>| {
        points.sort_by(|a, b| a[0].total_cmp(&b[0]));
        points
    };
    let mut series = vec![
        Series::new(color::LIMIT, Mark::ThinLine, [[0.0, 0.0], [1.0, 0.0]]),
        Series::new(color::PASS, Mark::Dot, sorted(passing)),
        Series::new(color::FAIL, Mark::Dot, sorted(failing)),
        Series::new(color::FOURTH, Mark::Line, lowest),
    ];
    series.extend(witness.map(|x| Series::new(color::LIMIT, Mark::DashedLine, range.map(|y| [x, y]))));
    let panel = Panel {
        title: String::new(),
        x: linear("amplitude", [0.0, 1.0]),
        y: linear("robustness", range),
        areas: Vec::new(),
        series,
        marks: Vec::new(),
    };
    let title = String::new();
    let caption = String::new();
    let legend = Vec::new();
    let chart = Chart { title, caption, legend, columns: 1, panel_size: SIZE, panels: vec![panel] };
    let dashed = if found.witness.is_some() {
        " The dashed line is at the smallest amplitude with a violation."
    } else {
        ""
    };
    let caption = format!(
        "Each dot is a simulation; it is violated below 0. The line connects the lowest robustness of the amplitudes that were \
         tried.{dashed}"
    );
    figure(
        &chart.figure(&visible("Robustness against the amplitude of the disturbance")),
        "Robustness.",
        &caption,
    )
}

/// Returns the names of categories as HTML.
fn categories(named: &Named<String>) -> String {
    let name = |(axis, category): &(String, String)| {
        format!("{} = {}", text(&short(axis, 40)), text(&short(category, 40)))
    };
    named.0.iter().map(name).collect::<Vec<_>>().join(", ")
}

/// Returns the table of the searches for each combination of categories.
fn each_category(found: &Margin) -> String {
    if found.each_category.is_empty() {
        return String::new();
    }
    let of = |value: Option<f64>| value.map_or("–".to_string(), number);
    let row = |each: &CategoryMargin| {
        let passed = each.no_violation_text(number).unwrap_or("–".to_string());
        vec![categories(&each.categories), each.simulations.to_string(), of(each.amplitude), passed]
    };
    let head = ["categories", "simulations", "smallest amplitude", "no violation up to"];
    table("Searches for each category", &head, &found.each_category.iter().map(row).collect::<Vec<_>>())
}

/// Returns the table of the amplitudes that were tried.
fn levels(found: &Margin) -> String {
    let smallest = found.witness.as_ref().map_or(f64::INFINITY, |witness| witness.norms.amplitude);
    let result = |level: &Level| match level {
        Level { is_violated: true, .. } => "violated",
        Level { amplitude, .. } if *amplitude >= smallest => "missed a violation",
        Level { is_complete: false, .. } => "interrupted",
        Level { minimum_robustness: None, .. } => "no verdict",
        _ => "no violation",
    };
    let row = |level: &Level| {
        vec![
            number(level.amplitude),
            level.simulations.to_string(),
            level.without_verdict.to_string(),
            level.minimum_robustness.map_or("–".to_string(), number),
            result(level).to_string(),
        ]
    };
    let head = ["amplitude", "simulations", "without a verdict", "lowest robustness", "result"];
    table(
        "Amplitudes in the order in which they were tried",
        &head,
        &found.levels.iter().map(row).collect::<Vec<_>>(),
    )
}

fn witness_section(report: &RunReport, witness: &Witness) -> String {
    let Some(explained) = &report.witness else { return String::new() };
    let header = &report.header;
    let mut out = format!(
        "<p>Amplitude {}, L2 norm {}, L1 norm {}; simulation {}, seed {}.</p>\n<div class=\"facts-and-trace\">\n<div>{}<ul \
         class=\"why\">",
        number(witness.norms.amplitude),
        number(witness.norms.l2),
        number(witness.norms.l1),
        witness.simulation,
        witness.seed.0,
        disturbed(report, &explained.recorded.scenario)
    );
    for sentence in
        explained.explanation.sentences(|sample| mishandle_text::instant(sample, header.control_dt))
    {
        out.push_str(&format!("<li>{}</li>", with_code(&sentence)));
    }
    let mut figures = trace::figures(header, explained, None, report.samples()).into_iter();
    out.push_str(&format!("</ul>\n</div>\n<div>{}</div>\n</div>\n", figures.next().unwrap_or_default()));
    let pictures = report.measured.as_ref().and_then(|measured| measured.witness.as_ref());
    out.push_str(
        &pictures.map_or(String::new(), |pictures| modes::frames(&report.header, pictures, explained)),
    );
    out.push_str(&commands::details(report, 1, witness.simulation));
    out
}

/// Returns the table of the axes that are not at their nominal values, the initial state among
/// them.
fn disturbed(report: &RunReport, scenario: &[Option<f64>]) -> String {
    let shown: Vec<_> = report
        .axes
        .iter()
        .zip(scenario)
        .filter(|(axis, value)| axis.nominal.is_none() || **value != axis.nominal)
        .collect();
    let rows: Vec<Vec<String>> = shown
        .iter()
        .take(MAX_AXES)
        .map(|(axis, value)| {
            let bounds =
                format!("{} to {}", value_text(axis, Some(axis.low)), value_text(axis, Some(axis.high)));
            let cells =
                [short(&axis.name, 40), value_text(axis, **value), value_text(axis, axis.nominal), bounds];
            cells.iter().map(|cell| text(cell)).collect()
        })
        .collect();
    let more = if shown.len() > MAX_AXES {
        format!("<p class=\"notes\">{MAX_AXES} of {} axes are shown.</p>\n", shown.len())
    } else {
        String::new()
    };
    table("Scenario of the witness", &["axis", "value", "nominal", "range"], &rows) + &more
}
