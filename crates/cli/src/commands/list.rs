mod search;
mod target;
mod task;
mod task_page;

use anyhow::Result;
use clap::Args;
use mishandle::MishandleError;
use mishandle::plan::Values;
use mishandle::requirements::{Pattern, patterns};
use mishandle::results::Listing;
use mishandle::search::SEARCHES;
use mishandle::tasks::tasks;
use toml::Table;

use crate::exit_status::ExitStatus;
use crate::flags::{self, Planned};
use crate::run::formula_context::described_plan;
use crate::show::{formula, output};

/// Most lines of a description without `--all`.
const LINES: usize = 40;

/// List tasks, targets, searches, controllers and patterns of requirements, or describe one
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  mishandle list
  mishandle list tasks
  mishandle list ball-balancing                 formulas, signals and scenario spaces of a target
  mishandle list ball-balancing --all           all axes; for a task also scene, rewards and notes
  mishandle list ./robot.toml                   a robot that a file describes
  mishandle list nelder-mead                    the options of a search
  mishandle list --command 'python3 my_simulator.py'")]
pub struct Arguments {
    /// tasks, targets, searches, controllers or patterns; or the name of a target, of a search or
    /// of a pattern, or the path of a target file (.toml)
    #[arg(value_name = "WORD|NAME")]
    pub name: Option<String>,
    /// Describe the simulator of this command, such as 'python3 my_simulator.py'
    #[arg(long, value_name = "COMMAND", conflicts_with = "name")]
    pub command: Option<String>,
    /// Show a description in full, not only its first screen
    #[arg(long)]
    pub all: bool,
    #[command(flatten)]
    pub keys: flags::SettingKeys,
    /// Print one JSON document to stdout, which is always complete
    #[arg(long)]
    pub json: bool,
}

pub fn run(command: &Arguments) -> Result<ExitStatus> {
    let mut planned = Planned::from(Table::new());
    planned.assign(&command.keys.keys, "list", Values::One)?;
    let table = planned.into_table(Values::One)?;
    let preset = table.get("preset").and_then(toml::Value::as_str);
    let typed = command.command.as_deref().map(mishandle::resolve::command_target);
    let name = typed.as_deref().or(command.name.as_deref());
    let found = find(name, preset)?;
    if command.json {
        output::json(&found)?;
        return Ok(ExitStatus::Done);
    }
    let text = match name {
        None => overview(&found),
        Some(word) if WORDS.contains(&word) => group(word, &found, preset)?,
        Some(name) => page(name, &found, preset, command.all)?,
    };
    let lines: Vec<&str> = text.lines().collect();
    let is_page = name.is_some_and(|name| !WORDS.contains(&name));
    if is_page && !command.all && lines.len() > LINES {
        output::line(&lines[..LINES - 1].join("\n"))?;
        let more = lines.len() - (LINES - 1);
        output::line(&format!("... {more} more lines with --all"))?;
    } else {
        output::line(&text)?;
    }
    Ok(ExitStatus::Done)
}

/// The groups.
const WORDS: [&str; 5] = ["tasks", "targets", "searches", "controllers", "patterns"];

/// Returns what there is: everything, one group, or what has a name.
fn find(name: Option<&str>, preset: Option<&str>) -> Result<Listing> {
    let is = |word: &str| name.is_none_or(|name| name == word);
    let preset_of_task = mishandle::resolve::preset(preset.unwrap_or("paper"))?;
    let mut found = Listing::default();
    if is("tasks") {
        for task in tasks() {
            found.tasks.push(mishandle::resolve::task_result(task, preset_of_task)?);
        }
    }
    if is("targets") {
        found.targets = mishandle::resolve::target_names();
    }
    if is("searches") {
        found.searches = SEARCHES.iter().map(mishandle::resolve::search_result).collect();
    }
    if is("controllers") {
        let of_task = |task: &'static dyn mishandle::tasks::Task| {
            let definition = task.definition();
            let names = mishandle::shipped::shipped_controllers(definition);
            names.into_iter().map(|name| format!("{}/{name}", definition.name))
        };
        found.controllers = tasks().into_iter().flat_map(of_task).collect();
    }
    if is("patterns") {
        found.patterns = patterns().map(Pattern::result).collect();
    }
    let Some(name) = name.filter(|name| !WORDS.contains(name)) else { return Ok(found) };
    if let Some(entry) = SEARCHES.iter().find(|entry| entry.name == name) {
        found.searches = vec![mishandle::resolve::search_result(entry)];
    } else if let Some(pattern) = patterns().find(|pattern| pattern.name == name) {
        found.patterns = vec![pattern.result()];
    } else {
        let plan = described_plan(name, preset);
        let target = mishandle::resolve::described_target(&plan).map_err(|error| with_names(name, error))?;
        for warning in mishandle::resolve::described_warnings(&plan)? {
            output::message(&format!("warning: {warning}"));
        }
        found.target = Some(mishandle::resolve::target_result(&target));
        if let Some(task) = mishandle::tasks::task(name) {
            found.tasks = vec![mishandle::resolve::task_result(task, preset_of_task)?];
        }
    }
    Ok(found)
}

/// Adds the names of searches and patterns to those that an unknown name may mean.
fn with_names(name: &str, error: MishandleError) -> MishandleError {
    match error {
        MishandleError::UnknownName { kind: "target", known, .. } => {
            let searches = SEARCHES.iter().map(|entry| entry.name.to_string());
            let patterns = patterns().map(|pattern| pattern.name.to_string());
            let words = WORDS.map(String::from);
            let known = known.into_iter().chain(searches).chain(patterns).chain(words).collect();
            MishandleError::UnknownName { kind: "target", name: name.to_string(), known }
        }
        error => error,
    }
}

/// Returns one screen with the names of everything.
fn overview(found: &Listing) -> String {
    let names = |title: &str, names: Vec<String>| {
        let text = output::wrapped(&names.join(", "), output::width().saturating_sub(2));
        format!("{title}\n  {}", text.replace('\n', "\n  "))
    };
    let controllers = |task: &mishandle::results::Task| task.controllers.clone();
    let mut shipped: Vec<String> = found.tasks.iter().flat_map(controllers).collect();
    shipped.sort_unstable();
    shipped.dedup();
    [
        names("Targets: tasks, toys and problems of the ARCH competition", found.targets.clone()),
        names("Searches", found.searches.iter().map(|search| search.name.clone()).collect()),
        names("Controllers of tasks", shipped),
        names("Patterns of requirements", found.patterns.iter().map(|found| found.name.clone()).collect()),
        format!(
            "`mishandle list NAME` describes one, `mishandle show TASK/NAME` a controller; {} list a group.",
            WORDS.join(", ")
        ),
    ]
    .join("\n\n")
}

/// Returns the list of one group.
fn group(word: &str, found: &Listing, preset: Option<&str>) -> Result<String> {
    Ok(match word {
        "tasks" => task::list(mishandle::resolve::preset(preset.unwrap_or("paper"))?),
        "targets" => target::list(),
        "searches" => search::list(),
        "controllers" => found.controllers.join("\n"),
        _ => formula::patterns(&found.patterns),
    })
}

/// Returns the description of what has a name.
fn page(name: &str, found: &Listing, preset: Option<&str>, all: bool) -> Result<String> {
    if let Some(entry) = SEARCHES.iter().find(|entry| entry.name == name) {
        return Ok(search::page(entry));
    }
    if found.target.is_none() {
        return Ok(formula::patterns(&found.patterns));
    }
    let plan = described_plan(name, preset);
    let target = mishandle::resolve::described_target(&plan)?;
    let mut text = target::page(&target, &plan, all);
    if let Some(task) = mishandle::tasks::task(name).filter(|_| all) {
        let preset = mishandle::resolve::preset(&plan.preset)?;
        text = format!("{text}\n\n{}", task::page(task, preset)?);
    }
    Ok(text)
}
