//! Falsification with simulations that a GPU screens.

use mishandle::falsification::{CampaignOutcome, RepeatedCount, ScreenedCounts};
use serde_json::{Value, json};

use crate::{output, run};

/// Returns the paragraphs about the engines.
pub fn text(counts: &ScreenedCounts) -> String {
    let table = output::table(&engines(counts));
    let without = run::without_gpu_verdict(counts.without_verdict.simulations, counts.overflows);
    format!("\n\n{table}{without}")
}

/// Returns what MuJoCo C found in the simulations that it repeated.
fn engines(counts: &ScreenedCounts) -> Vec<Vec<String>> {
    let row = |name: &str, simulations: u64, repeated: RepeatedCount| {
        [
            name.to_string(),
            simulations.to_string(),
            repeated.simulations.to_string(),
            repeated.violations.to_string(),
        ]
        .to_vec()
    };
    let all = |name: &str, repeated: RepeatedCount| row(name, repeated.simulations, repeated);
    vec![
        ["screened by MuJoCo Warp", "simulations", "repeated by MuJoCo C", "violations there"]
            .map(String::from)
            .to_vec(),
        all("violated", counts.violated),
        all("no verdict", counts.without_verdict),
        all("lowest of its trial so far", counts.minima),
        row("others", counts.sampled.simulations + counts.not_repeated, counts.sampled),
    ]
}

/// Returns the keys that a screening adds to the JSON document of a falsification.
pub fn document(found: &CampaignOutcome, counts: &ScreenedCounts) -> Value {
    let repeated =
        |count: RepeatedCount| json!({ "simulations": count.simulations, "violations": count.violations });
    json!({
        "backend": "gpu",
        "screening": { "simulations": found.simulations, "overflows": counts.overflows },
        "confirmation": {
            "violated": repeated(counts.violated),
            "without_verdict": repeated(counts.without_verdict),
            "minima": repeated(counts.minima),
            "sampled": repeated(counts.sampled),
        },
    })
}
