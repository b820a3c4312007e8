//! Suggestions for correcting an error.

use std::io::ErrorKind;
use std::path::Path;

use mishandle_controllers::ControllerError;
use mishandle_interchange::InterchangeError;
use mishandle_rollout::RolloutError;
use mishandle_search::SearchError;
use mishandle_stl::nearest;
use mishandle_store::StoreError;
use mishandle_text::shell_quote;
use mishandle_training::TrainingError;

use crate::error::MishandleError;
use crate::resolve::target_names;
use crate::shipped::controllers_description;

/// Hint for a target that is a program.
const NAME_COMMAND: &str = "a simulator that is a program is named by its command: --command 'python3 FILE'";

impl MishandleError {
    /// Returns a suggestion for correcting the error, if there is one.
    pub fn hint(&self) -> Option<String> {
        match self {
            MishandleError::OfRequirement { source, .. } => source.hint(),
            MishandleError::UnknownName { kind, name, known } => {
                let path_hint = || {
                    format!(
                        "shipped controllers are {}; for another controller give its path, such as ./FILE",
                        controllers_description()
                    )
                };
                if *kind == "task" && name.starts_with("toy/") {
                    return Some(format!("{name} is a toy, not a task; see `mishandle list {name}`"));
                }
                if *kind == "task" && name.starts_with("arch/") {
                    return Some(format!(
                        "{name} is a problem of the ARCH competition, not a task; see `mishandle list {name}`"
                    ));
                }
                if *kind == "space" && name == "noise" {
                    return Some(
                        "a task has this space only with --action-noise above 0 or a random initial state, and a target \
                         file with axes of the kind \"noise\""
                            .to_string(),
                    );
                }
                if let (true, Some(file)) = (matches!(*kind, "target" | "task"), target_file(name)) {
                    return Some(format!("did you mean the target file `{file}`?"));
                }
                if *kind == "target" && Path::new(name).is_file() {
                    return Some(NAME_COMMAND.to_string());
                }
                let suggestion = suggest(name, known.iter().map(String::as_str));
                suggestion.or_else(|| kind.starts_with("controller").then(path_hint))
            }
            MishandleError::NotATarget { name } => Some(match target_file(name) {
                Some(file) => format!("did you mean the target file `{file}`?"),
                None if is_controller_file(name) => {
                    format!("a controller is not a target: name it with --controller {}", shell_quote(name))
                }
                None if Path::new(name).is_file() => NAME_COMMAND.to_string(),
                None => return suggest(name, target_names().iter().map(String::as_str)),
            }),
            MishandleError::Controller(ControllerError::Read { source, .. })
            | MishandleError::Interchange(InterchangeError::Read { source, .. })
                if source.kind() == ErrorKind::NotFound =>
            {
                Some(
                    "a controller is the path of a file, or the name of a shipped one, which `mishandle list TASK --all` shows"
                        .to_string(),
                )
            }
            MishandleError::CampaignRun { source, .. } | MishandleError::Fallback { source, .. } => {
                source.hint()
            }
            MishandleError::UnknownPlanKey { key, known, .. } | MishandleError::UnknownKey { key, known } => {
                suggest_setting(key, known)
            }
            MishandleError::Settings { source, .. } => match &**source {
                TrainingError::UnknownSetting { name, known, .. } => suggest_setting(name, known),
                TrainingError::Setting { found, known, .. } => {
                    suggest(found.trim_matches(['"', '\'']), known.iter().copied())
                }
                _ => None,
            },
            MishandleError::Search(SearchError::UnknownOption { name, known, .. }) => {
                suggest(name, known.iter().map(String::as_str))
            }
            // SQLite reports a file that is too large as an I/O error.
            MishandleError::Store(StoreError::Io { what, .. }) if what.starts_with("cannot write") => {
                Some("is a quota or the limit on file sizes (`ulimit -f`) reached?".to_string())
            }
            MishandleError::Rollout(RolloutError::Monitor { source, .. }) => source.hint(),
            _ => None,
        }
    }
}

/// Returns the target file with this name without its ending, if there is one.
fn target_file(name: &str) -> Option<String> {
    let file = format!("{name}.toml");
    Path::new(&file).is_file().then_some(file)
}

/// Returns whether a path has the ending of a controller.
fn is_controller_file(name: &str) -> bool {
    let extension = Path::new(name).extension();
    ["onnx", "safetensors"]
        .iter()
        .any(|known| extension.is_some_and(|found| found.eq_ignore_ascii_case(known)))
}

fn suggest<'a>(name: &str, known: impl IntoIterator<Item = &'a str>) -> Option<String> {
    nearest(name, known).map(|near| format!("did you mean `{near}`?"))
}

/// Suggests the settings with the same key in other tables, or else the most similar name of a
/// setting or a table.
fn suggest_setting(name: &str, known: &[&str]) -> Option<String> {
    let key = |name: &str| name.rsplit('.').next().unwrap_or_default().to_string();
    let elsewhere: Vec<&str> = known.iter().copied().filter(|known| key(known) == key(name)).collect();
    if elsewhere.is_empty() {
        let tables = known.iter().filter_map(|known| Some(known.rsplit_once('.')?.0));
        return suggest(name, known.iter().copied().chain(tables));
    }
    let names: Vec<String> = elsewhere.iter().map(|name| format!("`{name}`")).collect();
    Some(format!("did you mean {}?", names.join(" or ")))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_misspelled_or_misplaced_setting_gets_a_suggestion() {
        let known = ["gamma", "run.total_steps", "policy.hidden", "critic.hidden"];
        for (name, expected) in [
            ("gama", Some("did you mean `gamma`?")),
            ("run.total_step", Some("did you mean `run.total_steps`?")),
            ("total_steps", Some("did you mean `run.total_steps`?")),
            ("hidden", Some("did you mean `policy.hidden` or `critic.hidden`?")),
            ("polcy", Some("did you mean `policy`?")),
            ("momentum", None),
        ] {
            assert_eq!(suggest_setting(name, &known).as_deref(), expected, "{name}");
        }
    }
}
