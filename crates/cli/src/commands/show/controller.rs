use anyhow::Result;
use mishandle::controllers::ControllerFile;
use mishandle::tasks::{Topic, notes};
use mishandle::training::AlgorithmSettings;
use mishandle_text::plural;

use crate::exit_status::ExitStatus;
use crate::show::output::{self, table};

/// Shows how a controller was trained.
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
    let numbers = |numbers: &[f64]| numbers.iter().map(ToString::to_string).collect::<Vec<_>>().join(", ");
    let interface = header.action_interface.as_ref().map(|interface| {
        format!(
            "at most {} rad/s and {} rad/s²; targets at most {} rad/s, {} rad from the ends, {} s ahead",
            numbers(&interface.velocity),
            numbers(&interface.acceleration),
            numbers(&interface.target_velocity),
            interface.margin,
            interface.lead
        )
    });
    let known = format!("{} known; `mishandle list {} --all` describes them", weaknesses.len(), header.task);
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
        ("action interface", interface.clone().unwrap_or_default()),
        ("weaknesses", known),
        ("controller hash", file.hash()),
        ("task hash", or_unknown(&header.task_hash)),
    ];
    let is_shown = |name| match name {
        "weaknesses" => !weaknesses.is_empty(),
        "action interface" => interface.is_some(),
        _ => true,
    };
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
