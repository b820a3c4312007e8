//! The comparison of two evaluations, as text.

use mishandle::evaluation::Corners;
use mishandle::results::{ComparedPair, Comparison, Estimate, Number};
use mishandle_text::{decimal, p_value_text, plural};

use super::{escape, output, scenario};

/// Largest number of new or fixed failures in the text. The JSON document lists all.
const MAX_LISTED: usize = 20;

/// Largest number of axes whose values the text shows.
const MAX_VALUES: usize = 6;

/// Returns what stands below the verdict: what else differs between the runs, and the failures.
pub fn text(found: &Comparison) -> String {
    let mut parts = Vec::new();
    parts.extend(mishandle::inspect::sameness(&found.first, &found.second).map(|text| escape::name(&text)));
    if !found.differences.is_empty() {
        let listed: Vec<String> =
            found.differences.iter().map(|difference| escape::name(difference)).collect();
        parts.push(format!("A and B also differ in:\n  {}", listed.join("\n  ")));
    }
    let [new, fixed] = found.changes();
    let replay = |pairs: &[ComparedPair]| {
        pairs.first().map_or(String::new(), |pair| format!("; replay the first: {}", pair.replay))
    };
    let lines = [
        ("new failures, where A succeeds and B fails", new, &found.new_failures),
        ("fixed failures, where A fails and B succeeds", fixed, &found.fixed_failures),
    ];
    let lines = lines.into_iter().filter(|(_, all, _)| *all > 0);
    parts.extend(lines.map(|(title, all, pairs)| format!("{all} {title}{}", replay(pairs))));
    let wrapped = |part: &String| {
        part.lines().map(|line| output::folded(line, output::width())).collect::<Vec<_>>().join("\n")
    };
    parts.iter().map(wrapped).collect::<Vec<_>>().join("\n")
}

/// Returns the means of both runs, and the first of the failures with their scenarios.
pub fn details(found: &Comparison) -> String {
    let mut parts = vec![format!("{} on the same scenarios and seeds", plural(found.pairs, "pair"))];
    parts.push(output::table(&table(found)));
    if found.at_any_time {
        parts.push(
            "All p-values and intervals hold at any time; those marked with * are for a number of pairs that is fixed \
             beforehand."
                .to_string(),
        );
    } else {
        parts.push("These p-values are of exact sign tests.".to_string());
    }
    let [new, fixed] = found.changes();
    let lists = [
        ("New failures: A succeeds, B fails", new, &found.new_failures),
        ("Fixed failures: A fails, B succeeds", fixed, &found.fixed_failures),
    ];
    parts.extend(
        lists
            .into_iter()
            .filter(|(_, all, _)| *all > 0)
            .map(|(title, all, pairs)| list(found, &format!("{title} ({all})"), all, pairs)),
    );
    parts.join("\n\n")
}

fn table(found: &Comparison) -> Vec<Vec<String>> {
    let mut rows = vec![["", "A", "B", "B - A", "95 % interval", "p", "n"].map(String::from).to_vec()];
    let is_clipped = found.sequential.as_ref().is_some_and(|rule| rule.robustness_bounds.is_some());
    let robustness = if is_clipped { "robustness, clipped" } else { "robustness" };
    let means = [
        (robustness, 4, Some(&found.robustness)),
        ("dangerous control steps", 2, found.dangerous_steps.as_ref()),
        ("completion step, if both succeed", 2, found.completion_step.as_ref()),
    ];
    for (name, decimals, means) in means.into_iter().filter_map(|(name, n, means)| Some((name, n, means?))) {
        let mean = |value: Option<f64>| value.map_or("-".to_string(), |mean| decimal(mean, decimals));
        let signed = |value: f64| {
            let text = decimal(value, decimals);
            let has_digit = text.bytes().any(|byte| (b'1'..=b'9').contains(&byte));
            match (has_digit, value.is_sign_negative()) {
                (true, true) => text,
                (true, false) => format!("+{text}"),
                // Neither +0.00 nor -0.00.
                (false, _) => decimal(0.0, decimals),
            }
        };
        let mark = if found.at_any_time && name != "robustness, clipped" { " *" } else { "" };
        rows.push(vec![
            name.to_string(),
            mean(means.first),
            mean(means.second),
            means.difference.value.map_or("-".to_string(), signed),
            interval(&means.difference, &signed) + means.difference.low.map_or("", |_| mark),
            means.difference.value.map_or("-".to_string(), |_| p_value_text(means.p_value)),
            means.difference.n.to_string(),
        ]);
    }
    rows
}

fn interval(estimate: &Estimate, show: &dyn Fn(f64) -> String) -> String {
    let ends = estimate.low.zip(estimate.high);
    ends.map_or("-".to_string(), |(low, high)| format!("[{}, {}]", show(low), show(high)))
}

fn list(found: &Comparison, title: &str, all: u64, pairs: &[ComparedPair]) -> String {
    let mut rows = vec![
        ["trial", "simulation", "seed", "scenario", "robustness A", "robustness B"]
            .map(String::from)
            .to_vec(),
    ];
    let robustness = |value: Option<Number>| value.map_or("no verdict".to_string(), |rho| decimal(rho.0, 4));
    for pair in pairs.iter().take(MAX_LISTED) {
        rows.push(vec![
            pair.trial.to_string(),
            pair.simulation.to_string(),
            pair.seed.0.to_string(),
            scenario::first_text(&found.space_axes, &pair.scenario, MAX_VALUES),
            robustness(pair.first_robustness),
            robustness(pair.second_robustness),
        ]);
    }
    let more = all.saturating_sub(MAX_LISTED as u64);
    let lists = if all > pairs.len() as u64 { "lists the first of them" } else { "lists all" };
    let more = if more > 0 { format!("\n… and {more} more: --json {lists}") } else { String::new() };
    let has_corners = pairs.iter().any(|pair| pair.trial == Corners::TRIAL);
    let corners = if has_corners { "; trial 2: corners and center of the initial box" } else { "" };
    format!("{title}{corners}\n{}{more}", output::table(&rows))
}
