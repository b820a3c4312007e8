//! Folders of evidence, as text.

use mishandle::results::{Evidence, EvidenceSigner, EvidenceVerification, VerifiedRun};
use mishandle_text::plural;

use super::{escape, output};

/// Largest number of problems and replays that are printed; the JSON document has all.
const MAX_LINES: usize = 50;

/// Returns a written folder.
pub fn text(found: &Evidence) -> String {
    let header = ["run", "page", "target", "simulations"].map(String::from).to_vec();
    let rows = found.runs.iter().map(|run| {
        let state = if run.is_complete { "" } else { ", not finished" };
        let simulations = format!("{}{state}", run.simulations);
        vec![escape::name(&run.file), escape::name(&run.page), escape::name(&run.target), simulations]
    });
    let rows: Vec<Vec<String>> = std::iter::once(header).chain(rows).collect();
    let signed =
        found.signer.as_ref().map_or("not signed".to_string(), |key| format!("signed by {}", signer(key)));
    let checks: String = found
        .checks
        .iter()
        .map(|check| format!("\n\n{}: {}", escape::name(&check.folder), escape::name(&check.verdicts)))
        .collect();
    format!(
        "{}{checks}\n\n{}: {}, {} kB, {signed}",
        output::table(&rows),
        escape::name(&found.folder),
        plural(found.files, "file"),
        found.bytes.div_ceil(1000)
    )
}

/// Returns a verified folder.
pub fn verification_text(found: &EvidenceVerification) -> String {
    let key = || found.signer.as_ref().map_or("an unknown key".to_string(), signer);
    let signature = match found.signature.as_str() {
        "trusted" => format!("signature: by {}, a key that you trust", key()),
        "valid" => format!("signature: by {}, for which nobody vouches", key()),
        "missing" => "signature: none".to_string(),
        "unchecked" => "signature: not checked".to_string(),
        _ => format!("signature: WRONG, by {}", key()),
    };
    let unverified = |text: &String| format!("not verified: {}", escape::name(text));
    let mut lines: Vec<String> = found.unverified.iter().take(MAX_LINES).map(unverified).collect();
    if found.unverified.len() > MAX_LINES {
        lines.push(format!("{} more that are not verified", found.unverified.len() - MAX_LINES));
    }
    lines.extend([signature, format!("hashes: {} compared", plural(found.files, "file"))]);
    let is_read = !found.runs.is_empty();
    lines.extend(is_read.then(|| {
        if found.pages_compared {
            "README and pages: made again and compared"
        } else {
            "README and pages: not all compared"
        }
        .to_string()
    }));
    for run in &found.runs {
        lines.push(run_text(run));
        for replayed in run.replayed.iter().take(MAX_LINES) {
            let result = if replayed.differences.is_empty() {
                "agrees to the bit".to_string()
            } else {
                format!("DIFFERS: {}", escape::name(&replayed.differences.join("; ")))
            };
            lines.push(format!("  trial {}, simulation {}: {result}", replayed.trial, replayed.simulation));
        }
        if run.replayed.len() > MAX_LINES {
            lines.push(format!("  {} more", run.replayed.len() - MAX_LINES));
        }
    }
    lines.extend(found.checks.iter().map(|check| {
        let verdicts = plural(check.verdicts, "verdict");
        let replayed = plural(check.replayed, "counterexample");
        format!(
            "{}: {verdicts} derived again from the runs, {replayed} replayed",
            escape::name(&check.folder)
        )
    }));
    lines.extend(
        found.problems.iter().take(MAX_LINES).map(|problem| format!("problem: {}", escape::name(problem))),
    );
    if found.problems.len() > MAX_LINES {
        lines.push(format!("{} more problems", found.problems.len() - MAX_LINES));
    }
    let sum = |count: fn(&VerifiedRun) -> u64| found.runs.iter().map(count).sum::<u64>();
    let chosen = sum(|run| run.chosen);
    let replays = sum(|run| run.replayed.len() as u64);
    let is_different = !found.problems.is_empty()
        || found.runs.iter().flat_map(|run| &run.replayed).any(|replayed| !replayed.differences.is_empty());
    let verdict = match () {
        () if is_different => "NOT VERIFIED.",
        () if !found.is_complete => "INTERRUPTED: nothing differs so far, but not all was verified.",
        () if !found.unverified.is_empty() => "NOT VERIFIED: nothing differs, but not all can be verified.",
        () => "All agrees.",
    };
    let replayed = match chosen {
        0 => "No simulation was replayed.".to_string(),
        _ => format!("Seed {} chose {}; {replays} replayed.", found.seed.0, plural(chosen, "simulation")),
    };
    lines.push(format!("{verdict} {replayed}"));
    lines.join("\n")
}

fn run_text(run: &VerifiedRun) -> String {
    let name = escape::name(&run.file);
    let simulations = plural(run.simulations, "simulation");
    match &run.not_replayed {
        Some(why) => format!("{name}: {simulations}, none replayed: {}", escape::name(why)),
        None => format!("{name}: {simulations}, {} of {} chosen replayed", run.replayed.len(), run.chosen),
    }
}

fn signer(key: &EvidenceSigner) -> String {
    let names = match key.principals.as_slice() {
        [] => String::new(),
        names => format!("{}, ", escape::name(&names.join("; "))),
    };
    format!("{names}{} ({})", escape::name(&key.fingerprint), escape::name(&key.algorithm))
}
