mod page;

use std::io::Write;
use std::path::PathBuf;

use anyhow::Result;
use clap::Args;
use mishandle::tasks::{Definition, Preset, Task, compose_with_start, notes, tasks};

use crate::exit_status::ExitStatus;
use crate::show::output::{self, indented, table_in};

/// List the tasks, or describe one task in full
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  mishandle tasks
  mishandle tasks ball-balancing
  mishandle tasks ball-balancing --mjcf scene.xml     the scene as MJCF, to load into MuJoCo")]
pub struct Arguments {
    /// Name of a task to describe: scene, formulas, initial box, observation, actions and rewards
    pub task: Option<String>,
    /// Task preset: initial boxes and formulas of the benchmark's `paper` or of its `code`
    #[arg(long, default_value = "paper")]
    pub preset: String,
    /// Write the task's scene to this MJCF file, with the initial state as keyframe `start`; the
    /// file does not contain the control of servos and gripper
    #[arg(long, value_name = "FILE", requires = "task")]
    pub mjcf: Option<PathBuf>,
    /// Print one JSON document to stdout
    #[arg(long)]
    pub json: bool,
}

pub fn run(command: &Arguments) -> Result<ExitStatus> {
    let preset = mishandle::resolve::preset(&command.preset)?;
    let selected: Vec<&'static dyn Task> = match &command.task {
        Some(name) => vec![mishandle::resolve::task(name)?],
        None => tasks(),
    };
    if let (Some(path), [task]) = (&command.mjcf, selected.as_slice()) {
        let scene = compose_with_start(*task)?;
        output::write_new(path, |file| Ok(file.write_all(scene.as_bytes())?))?;
        output::message(&format!("wrote {}", path.display()));
        if !command.json {
            return Ok(ExitStatus::Done);
        }
    }
    if command.json {
        let mut described = Vec::with_capacity(selected.len());
        for task in &selected {
            described.push(mishandle::resolve::task_result(*task, preset)?);
        }
        output::json_array(&described)?;
    } else if let (Some(_), [task]) = (&command.task, selected.as_slice()) {
        output::line(&page::page(task.definition(), &notes(*task)?, preset, output::width())?)?;
    } else {
        let definitions: Vec<&Definition> = selected.iter().map(|task| task.definition()).collect();
        output::line(&list(&definitions, preset, output::width()))?;
    }
    Ok(ExitStatus::Done)
}

/// Lists the tasks with success formula and controllers, one paragraph each; variants come last.
fn list(definitions: &[&Definition], preset: Preset, width: usize) -> String {
    let variants = definitions.iter().filter(|definition| definition.variant_of.is_some());
    let tasks = definitions.iter().filter(|definition| definition.variant_of.is_none());
    let paragraph = |definition: &&Definition| {
        let mut rows = vec![
            ["success", definition.formulas(preset).success].map(String::from).to_vec(),
            ["controllers".to_string(), mishandle::shipped::shipped_controllers(definition).join(", ")]
                .to_vec(),
        ];
        if let Some(base) = definition.variant_of {
            rows.push(["variant of", base].map(String::from).to_vec());
        }
        let head = output::folded(&format!("{}: {}", definition.name, definition.summary), width);
        format!("{head}\n  {}", indented(&table_in(&rows, width.saturating_sub(2)), 2))
    };
    let mut paragraphs: Vec<String> = tasks.chain(variants).map(paragraph).collect();
    paragraphs.push("`mishandle tasks TASK` describes a task in full.".to_string());
    paragraphs.join("\n\n")
}
