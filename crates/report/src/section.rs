//! The section of one run.

use mishandle::resolve::recorded_guard;
use mishandle::results::{Answer, Metrics, Noise};
use mishandle::stl::{Clock, EvaluationTime, Formula};
use mishandle::store::{RunHeader, RunKind};
use mishandle_text::short_unit;

use crate::html::{number, percent, short, text};
use crate::load::RunReport;
use crate::{
    axis_rates, curves, head, map, margin, metamorphic, modes, risk, sensitivity, survey, tables, words,
};

/// Names, paths and versions among the facts are cut to this length.
const NAME: usize = 200;

/// Returns the section of a run. `id` is its number on the page, from 1.
pub fn section(report: &RunReport, id: usize) -> String {
    let mut out = format!("<section class=\"run\" id=\"r{id}\">\n{}", head::section(report, id));
    out.push_str(&format!(
        "<p class=\"requirement\"><b>{}:</b> {}</p>\n{}",
        text(&words::formula_label(report)),
        requirement(&report.header),
        tables::requirements(report)
    ));
    let notes: Vec<&String> = report.notes.iter().chain(&report.no_simulations).collect();
    if !notes.is_empty() {
        let notes: String = notes.into_iter().map(|note| format!("<li>{}</li>", text(note))).collect();
        out.push_str(&format!("<ul class=\"notes\">{notes}</ul>\n"));
    }
    let result = result(report);
    let is_search = matches!(report.answer, Some(Answer::Falsification(_)));
    if !is_search {
        out.push_str(&result);
    }
    out.push_str(&match &report.answer {
        Some(Answer::Margin(found)) => margin::section(report, found, id),
        Some(Answer::Metamorphic(found)) => metamorphic::section(report, found, id),
        Some(Answer::Risk(found)) => risk::section(report, found, id),
        _ => String::new(),
    });
    if report.modes.failures > 0 {
        out.push_str(&format!("<h3 id=\"r{id}-modes\">Ways it fails</h3>\n{}", modes::section(report, id)));
    }
    let heading = if report.counts.falsified > 0 { "Where it fails" } else { "Where it was tested" };
    out.push_str(&format!("<h3 id=\"r{id}-map\">{heading}</h3>\n{}", map::figures(report, id)));
    if let Some(corners) = tables::corners(report) {
        out.push_str(&format!("<h3>Corners</h3>\n{corners}"));
    }
    let sensitivity = report.measured.as_ref().and_then(|measured| measured.sensitivity.as_ref());
    if sensitivity.is_some() || report.axis_rates().is_some() {
        out.push_str(&format!("<h3 id=\"r{id}-axes\">Which axes matter</h3>\n"));
    }
    if let Some(rates) = report.axis_rates() {
        out.push_str(&axis_rates::section(rates, "the random simulations"));
        if report.stops_by_itself() {
            out.push_str(
                "<p>All these intervals hold at any time, because a rule ended the evaluation.</p>\n",
            );
        }
    }
    if let Some(found) = sensitivity {
        out.push_str(&sensitivity::section(report, found));
    }
    if let Some(noise) = report.measured.as_ref().and_then(|measured| measured.noise) {
        out.push_str(&format!("<h3>Noise</h3>\n<p>{}</p>\n", noise_text(&noise)));
    }
    let mut rest = Vec::new();
    match report.header.kind {
        RunKind::Evaluate => rest.push(("search", "How robust it is", curves::figures(report))),
        RunKind::Falsify => rest.push((
            "search",
            "How it was found",
            result + &curves::figures(report) + &survey::section(report) + &tables::trials(report, id),
        )),
        _ => {}
    }
    rest.push(("tested", "What was tested", facts(report) + &tables::axes(report)));
    rest.push(("simulations", "Simulations", tables::simulations(report, id)));
    for (name, heading, html) in rest {
        out.push_str(&format!(
            "<details class=\"rest\" id=\"r{id}-{name}\"><summary><h3>{heading}</h3></summary>\n{html}</details>\n"
        ));
    }
    out + "</section>\n"
}

/// Returns what the question found, in sentences, numbers and rates.
fn result(report: &RunReport) -> String {
    let meaning = words::meaning(report).join(" ");
    let verdict = match report.answer {
        Some(Answer::Falsification(_)) => words::headline(report) + " ",
        _ => String::new(),
    };
    format!("<p>{verdict}{meaning}</p>\n{}{}", tiles(report), tables::rates(report))
}

/// Returns the requirement in words, or its text if it cannot be explained.
pub fn requirement(header: &RunHeader) -> String {
    let formula = Formula::parse(&header.formula).ok();
    let unit = |name: &str| {
        header.signals.iter().find(|signal| signal.name == name).map_or("", |signal| short_unit(&signal.unit))
    };
    let lines = formula.as_ref().and_then(|formula| {
        formula.explain(&Clock::steps(header.control_dt), EvaluationTime::Start, unit).ok()
    });
    match lines {
        Some(lines) => format!("<span class=\"words\">{}</span>", crate::html::lines(&lines)),
        None => format!("<code>{}</code>", text(&header.formula)),
    }
}

/// Returns the key numbers.
fn tiles(report: &RunReport) -> String {
    let mut tiles = match &report.answer {
        Some(Answer::Margin(found)) => margin::tiles(found),
        Some(Answer::Metamorphic(found)) => metamorphic::tiles(found),
        Some(Answer::Risk(found)) => risk::tiles(found),
        Some(Answer::Evaluation(found)) => {
            let Metrics { violations, violation_rate, .. } = &found.metrics;
            vec![(format!("{violations} of {}", violation_rate.n), "random scenarios fail".to_string())]
        }
        Some(Answer::Falsification(found)) => {
            let median = found.median_simulations.map_or("–".to_string(), |median| median.to_string());
            vec![
                (
                    format!("{} of {}", words::falsified(found), found.trials.len()),
                    "trials falsified".to_string(),
                ),
                (median, "simulations to a failure (median)".to_string()),
            ]
        }
        Some(Answer::Hardening(_)) | None => Vec::new(),
    };
    let modes = report.modes.modes.len();
    tiles.push((modes.to_string(), if modes == 1 { "failure mode" } else { "failure modes" }.to_string()));
    tiles.push((words::worst(report).map_or("–".to_string(), number), "lowest robustness".to_string()));
    if matches!(report.answer, Some(Answer::Evaluation(_) | Answer::Falsification(_)) | None) {
        tiles.push((report.counts.simulations.to_string(), "simulations".to_string()));
    }
    let share =
        report.measured.as_ref().and_then(|measured| measured.noise).and_then(|noise| noise.scenario_share);
    tiles.extend(share.map(|share| (percent(1.0 - share), "of the variance is noise".to_string())));
    let tile = |(value, name): &(String, String)| format!("<div><dd>{value}</dd><dt>{name}</dt></div>");
    format!("<dl class=\"tiles\">{}</dl>\n", tiles.iter().map(tile).collect::<String>())
}

fn noise_text(noise: &Noise) -> String {
    let Noise { scenario_share, scenario_share_interval, scenarios, repeats } = noise;
    let of = format!("{scenarios} random scenarios, {repeats} simulations each");
    match scenario_share {
        Some(share) => format!(
            "{} of the variance of the robustness comes from the scenario{} and {} from noise ({of}). A region of \
             failures that none of them met is in neither share.",
            percent(*share),
            scenario_share_interval.map_or(String::new(), |[low, high]| format!(
                " (95 % interval {} to {})",
                percent(low),
                percent(high)
            )),
            percent(1.0 - share)
        ),
        None => format!("The robustness of {of} is constant or infinite, so its variance has no shares."),
    }
}

/// Returns what was tested as a list.
fn facts(report: &RunReport) -> String {
    let header = &report.header;
    let formula = |value: &str| format!("<code>{}</code>", text(value));
    let code = |value: &str| formula(&short(value, NAME));
    let mut facts: Vec<(String, String)> = vec![
        ("run file".into(), code(&report.path)),
        (
            "target".into(),
            format!("{} ({})", code(&header.target.name), text(&short(&header.target.kind, 30))),
        ),
        ("hash of the target".into(), code(&header.target.hash)),
    ];
    for component in &header.components {
        let role = text(&short(&component.role, 30));
        facts.push((role.clone(), code(&component.name)));
        facts.push((format!("hash of the {role}"), code(&component.hash)));
    }
    if let Some(guard) = recorded_guard(header) {
        facts.push(("settings of the guard".into(), text(&guard.sentence())));
    }
    facts.push(("formula".into(), formula(&header.formula)));
    if let Ok(found) = Formula::parse(&header.formula) {
        facts.push(("in symbols".into(), formula(&found.symbols().to_string())));
    }
    facts.push(("space".into(), format!("{}, {}", code(&header.space), axes(report.axes.len()))));
    if let Some(plan) = &report.plan {
        let noise = [("action noise", plan.action_noise), ("observation noise", plan.observation_noise)];
        for (name, value) in noise.into_iter().filter(|(_, value)| *value > 0.0) {
            facts.push((name.into(), format!("standard deviation {}", number(value))));
        }
        if plan.stochastic {
            facts.push(("actions".into(), "sampled from the policy".into()));
        }
        if let Some(falsify) = &plan.falsify {
            facts.push((
                "search".into(),
                format!(
                    "{}, {} of at most {} simulations",
                    code(&falsify.search),
                    mishandle_text::plural(falsify.trials, "trial"),
                    falsify.budget
                ),
            ));
        }
    }
    facts.push(("seed".into(), header.seed.to_string()));
    let seconds = header.control_dt * f64::from(header.episode_steps);
    facts.push((
        "episode".into(),
        format!(
            "{} of {} s ({} s)",
            mishandle_text::plural(header.episode_steps, "control step"),
            number(header.control_dt),
            number(seconds)
        ),
    ));
    let build = &header.build;
    let program = format!("mishandle {} {}", build.program_version, build.git_commit);
    facts.push(("program".into(), text(&short(&program, NAME))));
    let versions: Vec<String> =
        header.versions.iter().map(|(name, version)| format!("{name} {version}")).collect();
    if !versions.is_empty() {
        facts.push(("with".into(), text(&short(&versions.join(", "), 3 * NAME))));
    }
    let fact = |(name, value): &(String, String)| format!("<div><dt>{name}</dt><dd>{value}</dd></div>\n");
    format!("<dl class=\"facts\">{}</dl>\n", facts.iter().map(fact).collect::<String>())
}

fn axes(count: usize) -> String {
    if count == 1 { "1 axis".to_string() } else { format!("{count} axes") }
}
