//! Lists of tasks, and their descriptions.

use anyhow::Result;
use mishandle::tasks::{Definition, Preset, Task, notes, tasks};

use super::task_page;
use crate::show::output::{self, indented, table_in};

/// Returns the description of a task: scene, formulas, initial box, observation, actions, rewards.
pub fn page(task: &dyn Task, preset: Preset) -> Result<String> {
    task_page::page(task.definition(), &notes(task)?, preset, output::width())
}

/// Lists the tasks with success formula and controllers, one paragraph each; variants come last.
pub fn list(preset: Preset) -> String {
    let width = output::width();
    let definitions: Vec<&Definition> = tasks().into_iter().map(<dyn Task>::definition).collect();
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
    paragraphs.push("`mishandle list TASK --all` describes a task in full.".to_string());
    paragraphs.join("\n\n")
}
