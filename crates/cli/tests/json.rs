//! The documents that the commands print satisfy their JSON Schemas.

use std::path::{Path, PathBuf};
use std::process::Command;

use crate::bench::{Bench, SMALL};
use serde_json::Value;

/// Writes the reference as `cargo xtask results` does, and returns its folder. The feature that
/// makes schemas is off in the build of this test, as in the program.
fn reference() -> PathBuf {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let made = Command::new(env!("CARGO"))
        .args(["run", "--quiet", "-p", "mishandle-results", "--features", "schema", "--example", "generate"])
        .current_dir(&root)
        .output()
        .unwrap();
    assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
    root.join("target/reference")
}

/// Reads the schema of a command's document.
fn schema(reference: &Path, command: &str) -> Value {
    let name = command.to_lowercase().replace(" --", "-").replace(' ', "-");
    let path = reference.join(format!("schemas/{name}.json"));
    serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap()
}

/// Checks values against a schema, with the keywords that the schemas of this repository use.
struct Checker<'a> {
    root: &'a Value,
}

impl<'a> Checker<'a> {
    /// Returns the first violation as text.
    fn check(&self, schema: &'a Value, value: &Value, path: &str) -> Result<(), String> {
        if let Some(reference) = schema["$ref"].as_str() {
            let name = reference.strip_prefix("#/$defs/").unwrap();
            return self.check(&self.root["$defs"][name], value, name);
        }
        if let Some(alternatives) = schema["anyOf"].as_array() {
            let results: Vec<_> = alternatives.iter().map(|schema| self.check(schema, value, path)).collect();
            return if results.iter().any(Result::is_ok) {
                Ok(())
            } else {
                Err(results.into_iter().map(Result::unwrap_err).collect::<Vec<_>>().join("; or "))
            };
        }
        let is_known = |allowed: &Value| allowed.as_array().unwrap().contains(value);
        if schema.get("enum").is_some_and(|allowed| !is_known(allowed))
            || schema.get("const").is_some_and(|constant| constant != value)
        {
            return Err(format!("{path} is {value}"));
        }
        if let Some(kinds) = schema.get("type") {
            let kind = kind(value);
            let fits = |allowed: &Value| *allowed == kind || (*allowed == "number" && kind == "integer");
            let fits = kinds.as_array().map_or_else(|| fits(kinds), |kinds| kinds.iter().any(fits));
            if !fits {
                return Err(format!("{path} is {value} and not of the type {kinds}"));
            }
        }
        match value {
            Value::String(text) if schema.get("pattern").is_some() => {
                let is_seed = !text.is_empty() && text.bytes().all(|byte| byte.is_ascii_digit());
                if is_seed { Ok(()) } else { Err(format!("{path} is not a seed: {text}")) }
            }
            Value::Array(items) => {
                let length = items.len() as u64;
                if schema["minItems"].as_u64().is_some_and(|min| length < min)
                    || schema["maxItems"].as_u64().is_some_and(|max| length > max)
                {
                    return Err(format!("{path} has {length} items"));
                }
                items.iter().try_for_each(|item| self.check(&schema["items"], item, path))
            }
            Value::Object(entries) => self.check_object(schema, entries, path),
            _ => Ok(()),
        }
    }

    fn check_object(
        &self,
        schema: &'a Value,
        entries: &serde_json::Map<String, Value>,
        path: &str,
    ) -> Result<(), String> {
        if let Some(values) = schema.get("additionalProperties") {
            return entries.values().try_for_each(|value| self.check(values, value, path));
        }
        for (key, value) in entries {
            let property = &schema["properties"][key];
            if property.is_null() {
                return Err(format!("{path} has the key {key}, which is not in its schema"));
            }
            let key = format!("{path}.{key}");
            self.check(property, value, &key)?;
        }
        Ok(())
    }
}

fn kind(value: &Value) -> &'static str {
    match value {
        Value::Null => "null",
        Value::Bool(_) => "boolean",
        Value::Number(number) if number.is_f64() => "number",
        Value::Number(_) => "integer",
        Value::String(_) => "string",
        Value::Array(_) => "array",
        Value::Object(_) => "object",
    }
}

#[test]
fn every_document_satisfies_its_schema() {
    let bench = Bench::new();
    bench.write("d.csv", "time,d\n0.0,0.2\n0.1,0.3\n");
    bench.write("small.toml", SMALL);
    bench.write(
        "grid.toml",
        "target = 'toy/sphere-2d'\n[falsify]\nsearch = 'random'\ntrials = 1\n[evaluate]\nepisodes = 5\n",
    );
    let linear = concat!(env!("CARGO_MANIFEST_DIR"), "/../interchange/tests/data/point_reaching.pt");
    let import = format!(
        "controller '{linear}' --task point-reaching -k import.output-activation=identity --out i.safetensors"
    );
    let commands = [
        ("list", "list", 0),
        ("list", "list toy/noisy", 0),
        ("monitor", "monitor --formula 'd < 1' d.csv", 2),
        ("monitor --explain", "monitor --explain --formula 'always(d < 1)' d.csv", 0),
        ("formula --parameter", "formula 'always(d < c)' --parameter c=0:1 d.csv", 0),
        ("run", "run grid.toml --out grid", 0),
        ("evaluate", "evaluate point-reaching --controller expert --episodes 12 --out e.sqlite", 0),
        ("falsify", "falsify point-reaching --controller expert --trials 1 --budget 3 --out f.sqlite", 0),
        ("falsify", "falsify toy/noisy --search random --trials 2 --budget 200 --seed 1 --out g.sqlite", 1),
        (
            "falsify",
            "falsify toy/noisy --search random --trials 1 --budget 200 --seed 1 -k report.repeats=5 --out h.sqlite",
            1,
        ),
        (
            "falsify",
            "falsify toy/sphere-2d --formula 'always(distance >= -1)' --search random --trials 1 --budget 60 --out s.sqlite",
            0,
        ),
        (
            "falsify",
            "falsify toy/pits --search random -k falsify.keep-going=true --trials 2 --budget 90 --out k.sqlite",
            1,
        ),
        (
            "evaluate",
            "evaluate point-reaching --controller expert --episodes 12 --action-noise 3 --out n.sqlite",
            0,
        ),
        ("compare", "compare e.sqlite n.sqlite", 1),
        ("compare", "compare n.sqlite e.sqlite", 0),
        ("compare --exact", "compare n.sqlite e.sqlite --exact", 1),
        ("evaluate --expect", "evaluate --expect 0.9 --until width=0.1", 0),
        ("evaluate --expect", "compare --expect 0.90 --expect 0.94", 0),
        ("simulate", "simulate toy/noisy --repeat 5 -k simulate.scenarios=3", 0),
        ("simulate", "simulate toy/noisy", 0),
        ("margin", "margin toy/car-following --space dynamics+events --budget 400", 1),
        ("risk", "risk toy/sphere-2d --formula 'always(distance >= 0.02)' --simulations 210000", 1),
        ("replay", "replay g.sqlite", 0),
        ("replay", "replay e.sqlite --trial 2", 0),
        ("show --simulation", "show g.sqlite --simulation first", 1),
        ("show --masking", "show g.sqlite --masking=20", 0),
        ("show FOLDER", "show g.sqlite e.sqlite", 0),
        ("show", "show g.sqlite", 0),
        ("regress --add", "regress failures --add g.sqlite -k regress.all=true -k regress.minimize=true", 0),
        ("replay", "replay failures/g-mode-1.json", 0),
        ("show --simulation", "show failures/g-mode-1.json", 1),
        ("regress", "regress failures --repeat 5", 1),
        ("regress --add", "regress --add n.sqlite --out noisy/a.json", 0),
        ("regress", "regress noisy --controller expert --baseline expert", 0),
        ("train --dry-run", "train point-reaching --settings small.toml --out b.safetensors --dry-run", 0),
        ("train", "train point-reaching --settings small.toml --out a.safetensors --csv c.csv", 0),
        ("show CONTROLLER", "show a.safetensors", 0),
        ("controller --out", "controller a.safetensors --out a.onnx", 0),
        ("controller --task", &import, 0),
    ];
    bench.refuses("list toy/nosiy --json", &["there is no target `toy/nosiy`", "did you mean `toy/noisy`?"]);
    bench.check("run grid.toml --out made", 0);
    let reference = reference();
    let page = std::fs::read_to_string(reference.join("json.md")).unwrap();
    for (section, command, code) in commands {
        assert!(page.contains(&format!("\n## `{section}`\n")), "the page has no section {section}");
        let schema = schema(&reference, section);
        let document = bench.json(&format!("{command} --json"), code);
        let checker = Checker { root: &schema };
        let checked = checker.check(&schema, &document, "");
        assert!(checked.is_ok(), "`{command}`: {}", checked.unwrap_err());
    }
}
