mod export;
mod import;

use std::path::{Path, PathBuf};

use anyhow::{Result, bail, ensure};
use clap::Args;
use mishandle::controllers::ControllerFile;
use mishandle::resolve::is_onnx;
use mishandle::tasks::{Topic, notes};
use mishandle::training::AlgorithmSettings;
use mishandle_text::plural;

use crate::exit_status::ExitStatus;
use crate::flags;
use crate::show::output::{self, table};

/// Show how a controller was trained, export it as ONNX, or import one from PyTorch
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  mishandle controller my_controller.safetensors
  mishandle controller point-reaching/ppo --json               a shipped controller
  mishandle controller point-reaching/ppo --out ppo.onnx
  mishandle controller sac.zip --task point-reaching --out a.safetensors
  mishandle controller sac.zip --task point-reaching --out a.safetensors -k import.normalizer=n.json
  mishandle controller agent.pt --task point-reaching --out a.safetensors -k import.activation=elu

Without --out, the output is a valid settings file: `mishandle train --settings FILE` trains with
the same settings. Success rates are from validation during training. `mishandle evaluate` measures
the controller on other initial states.

The ONNX model has the normalizer and the clipping of observations and actions. Its input
`observation` has the shape [N, size], in the units of the task. Its output `action` is clipped to
[-1, 1], as the task does; `unclipped_action` is the controller's own output. Both are the mean of a
stochastic policy. `mishandle evaluate TASK --controller ppo.onnx` runs it.

A policy to import is a model of Stable-Baselines3 (PPO, A2C, SAC, TD3, DDPG), a checkpoint of skrl,
or a state dictionary written by `torch.save(model.state_dict(), FILE)`. It must be a multi-layer
perceptron that acts as a controller can; other policies are refused with the reason and run as
ONNX. Weights and texts are read: nothing in the file is unpickled or executed. docs/guide/import.md
shows how to write the statistics of a VecNormalize.")]
pub struct Arguments {
    /// Path of a controller, or TASK/NAME for a shipped controller; to import: a model or
    /// checkpoint (.zip, .pt, .pth)
    #[arg(value_name = "FILE|TASK/NAME")]
    pub controller: String,
    /// Task of a policy to import; `mishandle list tasks` lists them
    #[arg(long, value_name = "TASK", requires = "out")]
    pub task: Option<String>,
    /// File to create: an ONNX model (.onnx), or the controller of an imported policy
    /// (.safetensors)
    #[arg(long, value_name = "FILE")]
    pub out: Option<PathBuf>,
    /// Print one JSON document to stdout
    #[arg(long)]
    pub json: bool,
    #[command(flatten)]
    pub keys: flags::SettingKeys,
}

pub fn run(command: &Arguments) -> Result<ExitStatus> {
    let settings = command.keys.settings("controller")?.import;
    let Some(out) = command.out.as_deref() else { return show(&command.controller, command.json) };
    let is_import = out.extension().is_some_and(|found| found == "safetensors");
    ensure!(
        is_import || is_onnx(out),
        "expected a path that ends in .onnx or .safetensors, found: {}",
        out.display()
    );
    match (&command.task, is_import) {
        (Some(task), true) => import::run(Path::new(&command.controller), task, out, &settings, command.json),
        (None, true) => bail!("--task is missing: an imported policy does not say its task"),
        (Some(_), false) => bail!("--task is for a policy to import; a controller knows its task"),
        (None, false) => export::run(&command.controller, out, command.json),
    }
}

/// Prints how a controller was trained.
pub fn show(controller: &str, json: bool) -> Result<ExitStatus> {
    let file = mishandle::resolve::find_controller(controller)?.controller()?;
    let weaknesses = weaknesses(controller)?;
    if json {
        output::json(&mishandle::train::controller_result(&file, &weaknesses))?;
    } else {
        output::line(&page(&file, &weaknesses))?;
    }
    Ok(ExitStatus::Done)
}

/// Returns the known weaknesses of the shipped controller `TASK/NAME`; none for the path of a file.
fn weaknesses(controller: &str) -> Result<Vec<&'static str>> {
    let Some((task, name)) = controller.split_once('/') else { return Ok(Vec::new()) };
    let Ok(task) = mishandle::resolve::task(task) else { return Ok(Vec::new()) };
    let mut notes = notes(task)?;
    notes.retain(|note| {
        note.topic == Topic::Weaknesses && note.subject.split(", ").any(|known| known == name)
    });
    Ok(notes.iter().flat_map(|note| note.cells.first()).map(|(_, text)| *text).collect())
}

fn page(file: &ControllerFile, weaknesses: &[&str]) -> String {
    let header = &file.header;
    let training = &file.header.training;
    let or_unknown = |text: &str| if text.is_empty() { "unknown" } else { text }.to_string();
    let sizes: Vec<String> = file.policy.network().sizes().iter().map(ToString::to_string).collect();
    let validation = training.validation.map_or("none".to_string(), |found| {
        let success = 100.0 * found.success_rate;
        let strict = 100.0 * found.strict_success_rate;
        format!("success {success:.1} %, strict {strict:.1} %, over {}", plural(found.episodes, "episode"))
    });
    let trained = format!(
        "{:.0} s; best policy after {}",
        training.wall_clock_secs,
        plural(training.environment_steps, "environment step")
    );
    let history = match file.policy.history().length() {
        0 => String::new(),
        length => format!(", a history of {}", plural(length, "control step")),
    };
    let known = format!("{} known; `mishandle list {}` describes them", weaknesses.len(), header.task);
    let rows = [
        ("task", header.task.clone()),
        ("task preset", header.preset.clone()),
        ("algorithm", header.algorithm.clone()),
        ("reward", header.reward.clone()),
        ("seed", training.seed.to_string()),
        ("trained for", trained),
        ("validation", validation),
        ("command", or_unknown(&training.command)),
        ("git commit", or_unknown(&training.git_commit)),
        ("policy", format!("{}, layers {}{history}", file.policy.kind(), sizes.join(", "))),
        ("weaknesses", known),
        ("controller hash", file.policy.hash()),
        ("task hash", or_unknown(&header.task_hash)),
    ];
    let is_shown = |name| name != "weaknesses" || !weaknesses.is_empty();
    let rows: Vec<Vec<String>> = rows
        .into_iter()
        .filter(|(name, _)| is_shown(*name))
        .map(|(name, value)| vec![name.to_string(), value])
        .collect();
    // Written as comments, so that the page is a valid settings file.
    let facts: String = table(&rows).lines().map(|line| format!("# {line}\n")).collect();
    format!("{facts}\n{}", settings(file).trim_end())
}

/// Returns the settings under their present keys; as the file has them if this program cannot read
/// them.
fn settings(file: &ControllerFile) -> String {
    let text = &file.header.training.settings;
    match AlgorithmSettings::from_toml(&file.header.algorithm, text) {
        Some(Ok(settings)) => settings.to_toml(),
        _ => text.clone(),
    }
}
