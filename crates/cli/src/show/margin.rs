//! The smallest disturbance, as text.

use mishandle::resolve::{nominal_scenario, nominal_values};
use mishandle::results::{AxisFacts, CategoryMargin, Level, Margin, Named, Scenario, Subject, Witness};
use mishandle_text::{decimal, plural};

use super::{answer, escape, output, reasons, scenario, subject};

/// Returns the amplitudes that were tried, and the witness.
pub fn text(found: &Margin) -> String {
    let header = ["amplitude", "simulations", "lowest robustness", "result"].map(String::from).to_vec();
    let row = |level: &Level| {
        vec![
            decimal(level.amplitude, 4),
            level.simulations.to_string(),
            level.minimum_robustness.map_or("-".to_string(), |rho| decimal(rho, 4)),
            result(level, found),
        ]
    };
    let rows: Vec<Vec<String>> = std::iter::once(header).chain(found.levels.iter().map(row)).collect();
    let conclusion = match (&found.witness, found.no_violation_up_to) {
        (Some(witness), _) => witness_text(found, witness),
        (None, Some(_)) => {
            format!("no violation in {}, up to the largest disturbance of the space", evidence(found))
        }
        (None, None) if found.is_complete => format!(
            "no violation was found, which says nothing about the space{}",
            found.smallest_without_verdict.map_or(String::new(), |amplitude| format!(
                ": simulations have no verdict from amplitude {} on",
                decimal(amplitude, 4)
            ))
        ),
        (None, None) => "no violation so far, but the search is not finished".to_string(),
    };
    let parts = [found.at_nominal_text(), measured_from(found)].into_iter();
    let from: String = parts.filter(|part| !part.is_empty()).map(|part| format!(", {part}")).collect();
    let from = escape::name(&from);
    format!(
        "{}{}{from}\nformula {}\n{}\n{}\n\n{conclusion}{}",
        answer::without_verdict(&found.without_verdict, "nothing is claimed about disturbances as large"),
        subject::heading(&found.subject),
        found.formula,
        categories_text(found),
        output::table(&rows),
        reasons::text(found.reasons.as_deref())
    )
}

/// Says from where the offsets of disturbances are measured, if the plan may have moved it.
fn measured_from(found: &Margin) -> String {
    match nominal_values(found.measured_axes()) {
        values if values.is_empty() => values,
        values => format!("measured from {values}"),
    }
}

/// Names the categories, which a margin does not vary, and the search for each of them.
fn categories_text(found: &Margin) -> String {
    if found.categories.0.is_empty() {
        return String::new();
    }
    let chosen = category_names(&found.categories);
    if found.each_category.is_empty() {
        return format!(
            "numbers vary, categories stay: {chosen}; -k margin.each-category=true searches each of them\n"
        );
    }
    let header = ["categories", "simulations", "smallest amplitude", "no violation up to"].map(String::from);
    let row = |each: &CategoryMargin| {
        let passed = each.no_violation_text(|amplitude| decimal(amplitude, 4));
        vec![
            category_names(&each.categories),
            each.simulations.to_string(),
            each.amplitude.map_or("-".to_string(), |amplitude| decimal(amplitude, 4)),
            passed.unwrap_or("-".to_string()),
        ]
    };
    let rows: Vec<Vec<String>> =
        std::iter::once(header.to_vec()).chain(found.each_category.iter().map(row)).collect();
    format!("\n{}\n\nthe smallest is that of {chosen}:\n", output::table(&rows))
}

fn category_names(categories: &Named<String>) -> String {
    let name =
        |(axis, category): &(String, String)| format!("{} = {}", escape::name(axis), escape::name(category));
    categories.0.iter().map(name).collect::<Vec<_>>().join(", ")
}

fn result(level: &Level, found: &Margin) -> String {
    let smallest = found.witness.as_ref().map_or(f64::INFINITY, |witness| witness.norms.amplitude);
    let result = match level {
        Level { is_violated: true, .. } => "violated",
        Level { is_violated: false, amplitude, .. } if *amplitude >= smallest => "missed a violation",
        Level { is_complete: false, .. } => "interrupted",
        Level { minimum_robustness: None, .. } => "no verdict",
        _ => "no violation",
    };
    let undecided = match level.without_verdict - level.invalid_starts {
        0 => String::new(),
        n => format!(", {n} without a verdict"),
    };
    let invalid_starts = match level.invalid_starts {
        0 => String::new(),
        n => format!(", {n} without a start"),
    };
    format!("{result}{undecided}{invalid_starts}")
}

/// Describes the simulations on which a claim that nothing fails rests.
fn evidence(found: &Margin) -> String {
    let all = match (found.no_violation_is_exhaustive, found.no_violation_seeds) {
        (Some(true), _) => ", which are all scenarios".to_string(),
        (_, Some(seeds)) if found.is_random => format!(" with {}", plural(seeds, "seed")),
        _ => String::new(),
    };
    format!("{}{all}", plural(found.no_violation_simulations.unwrap_or(0), "simulation"))
}

fn witness_text(found: &Margin, witness: &Witness) -> String {
    let Witness { norms, repeats, .. } = witness;
    let size = match witness.axes {
        0 => "the controller fails without a disturbance".to_string(),
        axes => format!(
            "smallest disturbance found: amplitude {} (L2 {}, L1 {}) on {}",
            decimal(norms.amplitude, 4),
            decimal(norms.l2, 4),
            decimal(norms.l1, 4),
            scenario::axes(axes as usize),
        ),
    };
    let doubt = match repeats {
        Some(repeats) if !repeats.fails_in_most() => ", but not with most other seeds",
        _ => "",
    };
    let mut text = format!(
        "{size}{doubt}, after {}\nwitness: {}, seed {}: robustness {}",
        plural(found.simulations, "simulation"),
        disturbed_text(&found.subject, &witness.scenario),
        witness.seed.0,
        decimal(witness.robustness.map_or(f64::NAN, |rho| rho.0), 4),
    );
    if let Some(repeats) = repeats {
        text.push_str(&format!(
            "\nwith other seeds, the witness fails in {} of {}",
            repeats.failures,
            plural(repeats.simulations, "repeat")
        ));
        if !repeats.fails_in_most() {
            text.push_str(": the failure is the luck of its seed");
        }
    }
    if let Some(amplitude) = found.no_violation_up_to {
        text.push_str(&format!(
            "\nup to amplitude {}, no violation in {}",
            decimal(amplitude, 4),
            evidence(found)
        ));
    }
    text
}

/// Formats the initial state and the disturbed axes.
fn disturbed_text(subject: &Subject, scenario: &Scenario) -> String {
    let is_shown = |(axis, value): &(&AxisFacts, Option<f64>)| axis.kind == "start" || *value != axis.nominal;
    let shown: Vec<(&AxisFacts, Option<f64>)> =
        subject.space_axes.iter().zip(scenario.values().copied()).filter(is_shown).collect();
    if shown.is_empty() { escape::name(&nominal_scenario(subject)) } else { scenario::text(shown) }
}
