use std::io::Write;

use anyhow::Result;
use mishandle::tasks::{Definition, Preset, Quantity, Reward, Task, compose, tasks};
use serde_json::{Value, json};

use crate::Outcome;
use crate::args;
use crate::output::{self, table};

pub fn run(command: &args::Tasks) -> Result<Outcome> {
    let preset = mishandle::preset(&command.preset)?;
    let chosen: Vec<&'static dyn Task> = match &command.task {
        Some(name) => vec![mishandle::task(name)?],
        None => tasks(),
    };
    if let (Some(path), [task]) = (&command.mjcf, chosen.as_slice()) {
        let scene = compose(*task)?;
        output::write_new(path, |file| Ok(file.write_all(scene.as_bytes())?))?;
        output::say(&format!("wrote {}", path.display()));
        if !command.json {
            return Ok(Outcome::Done);
        }
    }
    let definitions: Vec<&Definition> = chosen.iter().map(|task| task.definition()).collect();
    if command.json {
        let all = definitions.iter().map(|definition| document(definition, preset)).collect();
        output::json(&Value::Array(all))?;
    } else if let (Some(_), [definition]) = (&command.task, definitions.as_slice()) {
        output::line(&page(definition, preset))?;
    } else {
        output::line(&list(&definitions, preset))?;
    }
    Ok(Outcome::Done)
}

fn document(definition: &Definition, preset: Preset) -> Value {
    let formulas = definition.formulas(preset);
    let axes: Vec<Value> = definition
        .initial_box
        .iter()
        .map(|axis| {
            let [low, high] = axis.bounds(preset);
            json!({ "name": axis.name, "unit": axis.unit, "low": low, "high": high })
        })
        .collect();
    let signals: Vec<&str> = definition.signals.iter().map(|signal| signal.name).collect();
    json!({
        "name": definition.name,
        "success": formulas.success,
        "strict": formulas.strict,
        "safe": formulas.safe,
        "completion": formulas.completion,
        "signals": signals,
        "initial_box": axes,
        "controllers": mishandle::shipped_controllers(definition.name),
    })
}

fn list(definitions: &[&Definition], preset: Preset) -> String {
    let mut rows = vec![["task", "success", "controllers"].map(String::from).to_vec()];
    for definition in definitions {
        rows.push(vec![
            definition.name.to_string(),
            definition.formulas(preset).success.to_string(),
            mishandle::shipped_controllers(definition.name).join(", "),
        ]);
    }
    format!("{}\n\n`mishandle tasks TASK` explains one in full.", table(&rows))
}

fn page(definition: &Definition, preset: Preset) -> String {
    let formulas = definition.formulas(preset);
    let mut sections = vec![
        format!("{}: {}", definition.name, definition.summary),
        section(
            "Formulas (bounds count control steps of 1/60 s)",
            &[
                ("success", formulas.success),
                ("strict", formulas.strict),
                ("safe", formulas.safe),
                ("completion", formulas.completion),
            ]
            .map(|(name, text)| vec![name.to_string(), text.to_string()]),
        ),
        section(
            "Initial box",
            &definition
                .initial_box
                .iter()
                .map(|axis| {
                    let [low, high] = axis.bounds(preset);
                    vec![
                        axis.name.to_string(),
                        format!("[{low}, {high}] {}", axis.unit),
                        axis.sets.to_string(),
                    ]
                })
                .collect::<Vec<_>>(),
        ),
        section("Signals", &quantities(definition.signals)),
        section("Observation", &quantities(&definition.whole_observation())),
    ];
    for (title, reward) in [("Original reward", Reward::Original), ("Shaped reward", Reward::Shaped)] {
        sections.push(section(title, &quantities(definition.reward(reward))));
    }
    sections.push(format!("Scale of joint velocities in the observation\n  {}", definition.velocity_scale));
    sections.push(format!("A training episode ends early when\n  {}", definition.termination));
    if definition.start_noise > 0.0 {
        sections.push(format!(
            "Start noise\n  each joint of the arm starts up to {} rad off, drawn with the simulation's seed",
            definition.start_noise
        ));
    }
    sections.push(format!("Differences from the original\n  {}", definition.differences));
    sections.push(format!("Controllers\n  {}", mishandle::shipped_controllers(definition.name).join(", ")));
    sections.join("\n\n")
}

fn quantities(list: &[Quantity]) -> Vec<Vec<String>> {
    list.iter()
        .map(|quantity| {
            vec![
                quantity.name.to_string(),
                quantity.size.to_string(),
                quantity.unit.to_string(),
                quantity.meaning.to_string(),
            ]
        })
        .collect()
}

fn section(title: &str, rows: &[Vec<String>]) -> String {
    let indented: Vec<String> = table(rows).lines().map(|line| format!("  {line}")).collect();
    format!("{title}\n{}", indented.join("\n"))
}
