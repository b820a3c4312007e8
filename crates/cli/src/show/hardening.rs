//! The result of a hardening, as text.

use mishandle::results::{Estimate, HardenedMargin, HardenedMeasure, Hardening};
use mishandle_text::{p_value_text, plural};

use super::{escape, output};

/// Returns all measures before and after, and how they were reached.
pub fn details(found: &Hardening) -> String {
    let mut parts = vec![
        format!(
            "{}, controller {}{}, space {}, seed {}",
            escape::label(&found.target),
            escape::label(&found.before),
            found.guard.as_ref().map_or(String::new(), |guard| format!(", {}", escape::name(&guard.words()))),
            escape::label(&found.space),
            found.seed.0
        ) + &trainer(found),
        output::table(&table(found)),
    ];
    if !found.modes.is_empty() {
        let line = |mode: &mishandle::results::HardenedMode| {
            let axes =
                if mode.axes.is_empty() { String::new() } else { format!(" ({})", mode.axes.join(", ")) };
            format!(
                "  {}: {}{axes}: {} failures before, {} after",
                mode.change.name(),
                mode.predicate,
                mode.before,
                mode.after
            )
        };
        let lines: Vec<String> = found.modes.iter().map(line).collect();
        parts.push(format!("Failure modes of the final searches:\n{}", lines.join("\n")));
    }
    if let Some(archive) = &found.archive {
        parts.push(format!(
            "Of {} that the searches of the rounds found, and training saw, {} are fixed.",
            plural(archive.failures, "failure"),
            archive.fixed
        ));
    }
    let rounds = found.rounds.iter().map(|round| {
        let verdict = if round.accepted { "accepted" } else { "rejected" };
        let steps = match found.trainer {
            Some(_) => String::new(),
            None => format!(", {}", plural(round.environment_steps, "environment step")),
        };
        let failures = plural(round.failures, "failure");
        format!("  {}: {failures}{steps}; {verdict}: {}", round.number, round.reason)
    });
    parts.push(format!("Rounds, by the validation set:\n{}", rounds.collect::<Vec<_>>().join("\n")));
    let simulations = plural(found.simulations, "simulation");
    parts.push(match found.trainer {
        Some(_) => format!("{simulations} in all."),
        None => format!("{simulations} and {} in all.", plural(found.environment_steps, "environment step")),
    });
    parts.join("\n\n")
}

/// Returns who trained, if it was not this program.
fn trainer(found: &Hardening) -> String {
    found.trainer.as_ref().map_or(String::new(), |command| format!("\ntrained by {}", escape::name(command)))
}

fn table(found: &Hardening) -> Vec<Vec<String>> {
    let percent = |estimate: Option<&Estimate>| match estimate {
        Some(Estimate { value: Some(value), low: Some(low), high: Some(high), .. }) => {
            format!("{:.1} [{:.1}, {:.1}] %", 100.0 * value, 100.0 * low, 100.0 * high)
        }
        _ => "-".to_string(),
    };
    let head = ["final comparison", "before", "after", "after - before", "p (Holm)", "n"];
    let mut rows = vec![head.map(String::from).to_vec()];
    for measure in &found.measures {
        let HardenedMeasure { before, after, difference, adjusted_p_value, .. } = measure;
        let points = difference.and_then(|difference| {
            let [value, low, high] =
                [difference.value?, difference.low?, difference.high?].map(|x| 100.0 * x);
            Some(format!("{value:+.1} [{low:+.1}, {high:+.1}]"))
        });
        rows.push(vec![
            measure.label().to_string(),
            percent(Some(before)),
            percent(after.as_ref()),
            points.unwrap_or("-".to_string()),
            adjusted_p_value.map_or("-".to_string(), p_value_text),
            before.n.to_string(),
        ]);
    }
    let both = |name: &str, cells: [String; 2], n: String| {
        let [before, after] = cells;
        vec![name.to_string(), before, after, "-".to_string(), "-".to_string(), n]
    };
    let probability = &found.failure_probability;
    rows.push(both(
        "failure probability in the space",
        [percent(probability.first()), percent(probability.get(1))],
        probability.first().map_or(0, |estimate| estimate.n).to_string(),
    ));
    if let Some(corners) = &found.corners {
        let of = |count: u64| format!("{count} of {}", corners.corners);
        let after = corners.after.map_or("-".to_string(), of);
        rows.push(both("corners that succeed", [of(corners.before), after], "-".to_string()));
    }
    let margin = |margin: Option<&HardenedMargin>| match margin {
        None => "-".to_string(),
        Some(HardenedMargin { amplitude: Some(amplitude), .. }) => format!("{amplitude:.3}"),
        Some(HardenedMargin { without_failure: Some(level), .. }) => format!("above {level:.3}"),
        Some(_) => "none found".to_string(),
    };
    rows.push(both(
        "smallest disturbance that breaks it",
        [margin(found.margin.first()), margin(found.margin.get(1))],
        found.margin.first().map_or(0, |margin| margin.simulations).to_string(),
    ));
    let search = |index: usize| {
        found.searches.get(index).map_or("-".to_string(), |search| {
            format!("{} in {}", search.failures, plural(search.modes, "mode"))
        })
    };
    let simulations = found.searches.first().map_or(0, |search| search.simulations);
    rows.push(both("failures that the searches find", [search(0), search(1)], simulations.to_string()));
    rows
}
