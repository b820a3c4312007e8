//! docs/json.md documents exactly the keys of the JSON documents.

#![allow(clippy::unwrap_used)]

mod bench;

use std::collections::BTreeMap;

use bench::{Bench, SMALL};
use serde_json::Value;

/// Returns the documented keys of each section, with their types.
fn documented() -> BTreeMap<String, BTreeMap<String, String>> {
    let mut sections: BTreeMap<String, BTreeMap<String, String>> = BTreeMap::new();
    let mut section = String::new();
    for line in include_str!("../../../docs/json.md").lines() {
        if let Some(title) = line.strip_prefix("## ") {
            section = title.trim_matches('`').to_string();
        }
        let cells: Vec<&str> = line.split('|').map(str::trim).collect();
        if cells.len() >= 4 && cells[1].starts_with('`') {
            for key in cells[1].split(',') {
                let key = key.trim().trim_matches('`').to_string();
                let again =
                    sections.entry(section.clone()).or_default().insert(key.clone(), cells[2].to_string());
                assert!(again.is_none(), "{section}: {key} is documented twice");
            }
        }
    }
    sections
}

/// Collects each key of a document with the type of its value, including `null`. Some objects are maps.
fn keys(value: &Value, path: &str, found: &mut Vec<(String, &'static str)>) {
    match value {
        Value::Object(entries) => {
            for (key, value) in entries {
                let path = if path.is_empty() { key.clone() } else { format!("{path}.{key}") };
                let is_map = [
                    "scenario",
                    "region",
                    "search_options",
                    "formats",
                    "training_time",
                    "result",
                    "explanation",
                ]
                .contains(&key.as_str());
                found.push((path.clone(), kind(value, is_map && key != "training_time")));
                if !is_map {
                    keys(value, &path, found);
                }
            }
        }
        Value::Array(values) => values.iter().for_each(|value| {
            if value.is_object() {
                keys(value, &if path.is_empty() { String::new() } else { format!("{path}[]") }, found);
            }
        }),
        _ => {}
    }
}

fn kind(value: &Value, is_map: bool) -> &'static str {
    match value {
        Value::Null => "null",
        Value::Bool(_) => "boolean",
        Value::Number(_) => "number",
        Value::String(_) => "string",
        Value::Array(_) => "array",
        Value::Object(_) if is_map => "map",
        Value::Object(_) => "object",
    }
}

#[test]
fn the_page_documents_the_keys_that_every_command_prints() {
    let bench = Bench::new();
    bench.write("d.csv", "time,d\n0.0,0.2\n0.1,0.3\n");
    bench.write("small.toml", SMALL);
    bench.write(
        "grid.toml",
        "target = 'toy/sphere-2d'\n[falsify]\nsearch = 'random'\ntrials = 1\n[evaluate]\nepisodes = 5\n",
    );
    let linear = concat!(env!("CARGO_MANIFEST_DIR"), "/../interchange/tests/data/point_reaching.pt");
    let import = format!(
        "controller import {linear} --task point-reaching --output-activation identity --out i.safetensors"
    );
    let commands = [
        ("tasks", "tasks", 0),
        ("targets", "targets", 0),
        ("targets TARGET", "targets toy/noisy", 0),
        ("searches", "searches", 0),
        ("monitor", "monitor --formula 'd < 1' d.csv", 0),
        ("campaign", "campaign grid.toml --out grid", 0),
        ("evaluate", "evaluate point-reaching --controller expert --episodes 12 --out e.sqlite", 0),
        ("falsify", "falsify point-reaching --controller expert --trials 1 --budget 3 --out f.sqlite", 0),
        ("falsify", "falsify toy/noisy --search random --trials 2 --budget 200 --seed 1 --out g.sqlite", 1),
        (
            "falsify",
            "falsify toy/noisy --search random --trials 1 --budget 200 --seed 1 --repeats 5 --out h.sqlite",
            1,
        ),
        (
            "falsify",
            "falsify toy/sphere-2d --formula 'always(distance >= -1)' --search random --trials 1 --budget 60 --out s.sqlite",
            0,
        ),
        ("falsify", "falsify toy/pits --search random --keep-going --trials 2 --budget 90 --out k.sqlite", 1),
        (
            "evaluate",
            "evaluate point-reaching --controller expert --episodes 12 --action-noise 3 --out n.sqlite",
            0,
        ),
        ("compare", "compare e.sqlite n.sqlite", 1),
        ("compare", "compare n.sqlite e.sqlite", 0),
        ("reproduce", "reproduce tables grid", 0),
        ("simulate", "simulate toy/noisy --repeat 5 --scenarios 3", 0),
        ("simulate", "simulate toy/noisy", 0),
        ("margin", "margin toy/car-following --space dynamics+events --budget 400", 1),
        ("risk", "risk toy/sphere-2d --formula 'always(distance >= 0.02)' --simulations 210000", 1),
        ("replay", "replay g.sqlite", 0),
        ("replay", "replay e.sqlite --trial 2", 0),
        ("explain", "explain g.sqlite", 1),
        ("explain --masking", "explain g.sqlite --masking=20", 0),
        ("runs", "runs g.sqlite", 0),
        ("counterexamples", "counterexamples g.sqlite", 0),
        ("counterexamples export", "counterexamples export g.sqlite --minimize --all --out failures", 0),
        ("replay", "replay failures/g-mode-1.json", 0),
        ("explain", "explain failures/g-mode-1.json", 1),
        ("regress", "regress failures --repeat 5", 1),
        ("counterexamples export", "counterexamples export n.sqlite --out noisy/a.json", 0),
        ("regress", "regress noisy --controller expert --baseline expert", 0),
        ("train --dry-run", "train point-reaching --settings small.toml --out b.safetensors --dry-run", 0),
        ("train", "train point-reaching --settings small.toml --out a.safetensors --csv c.csv", 0),
        ("controller", "controller a.safetensors", 0),
        ("controller export", "controller export a.safetensors --onnx a.onnx", 0),
        ("controller import", &import, 0),
    ];
    bench.refuses(
        "targets toy/nosiy --json",
        &["there is no target `toy/nosiy`", "did you mean `toy/noisy`?"],
    );
    let documented = documented();
    let mut printed: BTreeMap<&str, BTreeMap<String, &str>> = BTreeMap::new();
    for (section, command, code) in commands {
        let mut found = Vec::new();
        keys(&bench.json(&format!("{command} --json"), code), "", &mut found);
        let page = documented.get(section).unwrap_or_else(|| panic!("no section {section}"));
        for (key, kind) in found {
            let known = page
                .get(&key)
                .unwrap_or_else(|| panic!("`{command}` prints `{key}`, which is not documented"));
            assert!(
                kind == "null" || known.split(" or ").any(|known| known == kind),
                "`{command}`: {key} is documented as {known} and is a {kind}"
            );
            assert!(!key.ends_with("seed") || kind == "string", "`{command}`: a seed is a string");
            printed.entry(section).or_default().insert(key, kind);
        }
    }
    for (section, page) in &documented {
        let printed = printed.get(section.as_str()).unwrap_or_else(|| panic!("{section} was not run"));
        for key in page.keys() {
            assert!(printed.contains_key(key), "`{section}` does not print `{key}`, which is documented");
        }
    }
}
