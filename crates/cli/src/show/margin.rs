//! The smallest disturbance, as text.

use mishandle::results::{CategoryMargin, Level, Margin};
use mishandle::verdict::category_names;
use mishandle_text::{measured, plural};

use super::{escape, output, reasons, scenario, subject};

/// Returns what stands below the verdict: the search for each combination of categories, and
/// reasons.
pub fn text(found: &Margin) -> String {
    format!("{}{}", categories_text(found), reasons::text(found.reasons.as_deref()))
}

/// Returns the amplitudes that were tried, and all values of the witness.
pub fn details(found: &Margin) -> String {
    let header = ["amplitude", "simulations", "lowest robustness", "result"].map(String::from).to_vec();
    let row = |level: &Level| {
        vec![
            measured(level.amplitude),
            level.simulations.to_string(),
            level.minimum_robustness.map_or("-".to_string(), measured),
            result(level, found),
        ]
    };
    let rows: Vec<Vec<String>> = std::iter::once(header).chain(found.levels.iter().map(row)).collect();
    let mut parts = vec![
        format!("{}\nformula {}", subject::heading(&found.subject), escape::name(&found.formula)),
        output::table(&rows),
    ];
    if let Some(witness) = &found.witness {
        let values = found.subject.space_axes.iter().zip(witness.scenario.values().copied());
        let text = format!(
            "witness: {}, seed {}, amplitude {} (L2 {}, L1 {}): robustness {}, after {}",
            scenario::text(values),
            witness.seed.0,
            measured(witness.norms.amplitude),
            measured(witness.norms.l2),
            measured(witness.norms.l1),
            measured(witness.robustness.map_or(f64::NAN, |rho| rho.0)),
            plural(found.simulations, "simulation")
        );
        parts.push(output::folded(&text, output::width()));
    }
    parts.join("\n\n")
}

/// Returns the search for each combination of categories, which a margin does not vary.
fn categories_text(found: &Margin) -> String {
    if found.each_category.is_empty() {
        return String::new();
    }
    let header = ["categories", "simulations", "smallest amplitude", "no violation up to"].map(String::from);
    let row = |each: &CategoryMargin| {
        let passed = each.no_violation_text(measured);
        vec![
            escape::name(&category_names(&each.categories)),
            each.simulations.to_string(),
            each.amplitude.map_or("-".to_string(), measured),
            passed.unwrap_or("-".to_string()),
        ]
    };
    let rows: Vec<Vec<String>> =
        std::iter::once(header.to_vec()).chain(found.each_category.iter().map(row)).collect();
    format!("\n\n{}", output::table(&rows))
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
