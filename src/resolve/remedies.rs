//! Remedies of errors.

use std::io::ErrorKind;
use std::path::Path;

use mishandle_controllers::{ControllerError, FileProblem};
use mishandle_falsification::FalsificationError;
use mishandle_interchange::{ACTIVATIONS, InterchangeError, PolicyPart, TorchProblem};
use mishandle_results::{Choice, Command, Key, Remedy};
use mishandle_rollout::RolloutError;
use mishandle_search::SearchError;
use mishandle_stl::nearest;
use mishandle_store::StoreError;
use mishandle_training::TrainingError;

use crate::error::{Compared, CurveProblem, MishandleError, RunError};
use crate::resolve::target_names;
use crate::shipped::controllers_description;

impl MishandleError {
    /// Returns what helps.
    pub fn remedies(&self) -> Vec<Remedy> {
        match self {
            MishandleError::InvalidValue { remedies, .. } | MishandleError::Invalid { remedies, .. } => {
                remedies.clone()
            }
            MishandleError::Of { remedies, source, .. } => [remedies.clone(), source.remedies()].concat(),
            MishandleError::UnknownName { kind, name, known } => of_name(kind, name, known),
            MishandleError::NotATarget { name } => of_path(name),
            MishandleError::UnknownKey { key, known, .. } => suggest_setting(key, known),
            MishandleError::Run(RunError::Differs { whose: Compared::Build, .. }) => vec![
                Remedy::Advice("continue it with the build of the run"),
                Remedy::set(Key::ANY_BUILD, Choice::On).when("the run file may name this build, too"),
            ],
            MishandleError::Curve { problem, .. } => of_curve(problem),
            MishandleError::Controller(ControllerError::File { problem: FileProblem::Archive, .. }) => {
                vec![Remedy::Run(Command::Import)]
            }
            MishandleError::Controller(ControllerError::Read { source, .. })
            | MishandleError::Interchange(InterchangeError::Read { source, .. })
                if source.kind() == ErrorKind::NotFound =>
            {
                hint("a controller is the path of a file, or the name of a shipped one")
            }
            MishandleError::Interchange(InterchangeError::Torch { problem, .. }) => of_checkpoint(problem),
            MishandleError::Training(error) => of_training(error),
            MishandleError::Falsification(FalsificationError::DependsOnSolver { .. }) => {
                vec![Remedy::Advice("add another failure")]
            }
            MishandleError::Search(SearchError::UnknownOption { name, known, .. }) => {
                suggest(name, known.iter().map(String::as_str))
            }
            // SQLite reports a file that is too large as an I/O error.
            MishandleError::Store(StoreError::Write { .. }) => {
                hint("is a quota or the limit on file sizes (`ulimit -f`) reached?")
            }
            MishandleError::Rollout(RolloutError::Monitor { source, .. }) => {
                source.hint().into_iter().map(Remedy::Hint).collect()
            }
            _ => Vec::new(),
        }
    }
}

fn hint(sentence: impl Into<String>) -> Vec<Remedy> {
    vec![Remedy::Hint(sentence.into())]
}

fn of_name(kind: &str, name: &str, known: &[String]) -> Vec<Remedy> {
    let list = || Remedy::Run(Command::List { what: name.to_string(), is_long: false });
    if kind == "task" && name.starts_with("toy/") {
        return vec![list(), Remedy::Hint(format!("{name} is a toy, not a task"))];
    }
    if kind == "task" && name.starts_with("arch/") {
        return vec![
            list(),
            Remedy::Hint(format!("{name} is a problem of the ARCH competition, not a task")),
        ];
    }
    if kind == "space" && name == "noise" {
        let has = "a task has this space only with noise on its actions or a random initial state, and a target file with axes \
                   of the kind \"noise\"";
        let noise = Remedy::set(Key::ACTION_NOISE, Choice::Shape("STD")).when("actions shall be noisy");
        return vec![noise, Remedy::Hint(has.to_string())];
    }
    if matches!(kind, "target" | "task")
        && let Some(file) = target_file(name)
    {
        return hint(format!("did you mean the target file `{file}`?"));
    }
    if kind == "target" && is_environment(name) {
        let environment = Some(name.to_string());
        return vec![Remedy::Run(Command::Gymnasium { environment, policy: None })];
    }
    if kind == "target" && Path::new(name).is_file() {
        return vec![name_command()];
    }
    match suggest(name, known.iter().map(String::as_str)) {
        found if found.is_empty() && kind.starts_with("controller") => hint(format!(
            "shipped controllers are {}; for another controller give its path, such as ./FILE",
            controllers_description()
        )),
        found => found,
    }
}

/// Returns what helps if a path is not a target.
fn of_path(name: &str) -> Vec<Remedy> {
    match target_file(name) {
        Some(file) => hint(format!("did you mean the target file `{file}`?")),
        None if is_controller_file(name) => {
            vec![Remedy::set(Key::CONTROLLER, Choice::Text(name.to_string())).when("it is a controller")]
        }
        None if has_ending(name, &MODELS) => vec![Remedy::Run(Command::Init { model: name.to_string() })],
        None if has_ending(name, &["zip"]) => {
            let policy = Some(name.to_string());
            vec![Remedy::Run(Command::Gymnasium { environment: None, policy })]
        }
        None if has_ending(name, &LOGS) => vec![Remedy::Run(Command::Monitor { log: name.to_string() })],
        None if Path::new(name).is_file() => vec![name_command()],
        None => match suggest(name, target_names().iter().map(String::as_str)) {
            found if found.is_empty() => {
                vec![Remedy::Run(Command::List { what: "targets".to_string(), is_long: false })]
            }
            found => found,
        },
    }
}

/// Returns the remedy to name a simulator that is a program.
fn name_command() -> Remedy {
    let command = Remedy::set(Key::COMMAND, Choice::Text("python3 FILE".to_string()));
    command.when("the simulator is a program")
}

fn of_curve(problem: &CurveProblem) -> Vec<Remedy> {
    match problem {
        CurveProblem::Scenarios { .. }
        | CurveProblem::Curriculum { .. }
        | CurveProblem::MissingRow { .. } => vec![Remedy::Another(Key::CURVE)],
        _ => Vec::new(),
    }
}

fn of_training(error: &TrainingError) -> Vec<Remedy> {
    match error {
        TrainingError::UnknownSetting { name, known, .. } => suggest_setting(name, known),
        TrainingError::Setting { found, known, .. } => {
            suggest(found.trim_matches(['"', '\'']), known.iter().copied())
        }
        TrainingError::SettingsMismatch { .. } => {
            vec![Remedy::Advice("resume with those"), Remedy::Unset(Key::RESUME).when("it shall start again")]
        }
        _ => Vec::new(),
    }
}

fn of_checkpoint(problem: &TorchProblem) -> Vec<Remedy> {
    match problem {
        TorchProblem::Unknown { what, .. } => state(*what),
        TorchProblem::Preprocessor => state(PolicyPart::Normalizer),
        TorchProblem::Contradiction { what, .. } => vec![Remedy::Unset(key(*what))],
        _ => Vec::new(),
    }
}

fn key(part: PolicyPart) -> Key {
    match part {
        PolicyPart::HiddenActivation => Key::ACTIVATION,
        PolicyPart::OutputActivation => Key::OUTPUT_ACTIVATION,
        PolicyPart::Normalizer => Key::NORMALIZER,
    }
}

/// Returns the remedies to state a part of a policy.
fn state(part: PolicyPart) -> Vec<Remedy> {
    let key = key(part);
    match part {
        PolicyPart::Normalizer => {
            let none = Remedy::set(key, Choice::Text("none".to_owned()));
            vec![Remedy::set(key, Choice::FILE), none.when("observations were not normalized")]
        }
        PolicyPart::HiddenActivation | PolicyPart::OutputActivation => {
            vec![Remedy::set(key, Choice::OneOf(ACTIVATIONS))]
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
    has_ending(name, &["onnx", "safetensors"])
}

/// Endings of models of robots, and of logs.
const MODELS: [&str; 3] = ["xml", "mjcf", "urdf"];
const LOGS: [&str; 4] = ["csv", "parquet", "mcap", "bag"];

fn has_ending(name: &str, known: &[&str]) -> bool {
    let extension = Path::new(name).extension();
    known.iter().any(|known| extension.is_some_and(|found| found.eq_ignore_ascii_case(known)))
}

/// Returns whether a name is that of an environment of Gymnasium, such as `CartPole-v1`.
fn is_environment(name: &str) -> bool {
    name.rsplit_once("-v").is_some_and(|(name, version)| {
        !name.is_empty() && !version.is_empty() && version.chars().all(|digit| digit.is_ascii_digit())
    })
}

fn suggest<'a>(name: &str, known: impl IntoIterator<Item = &'a str>) -> Vec<Remedy> {
    nearest(name, known).into_iter().flat_map(|near| hint(format!("did you mean `{near}`?"))).collect()
}

/// Suggests the settings with the same key in other tables, or else the most similar name of a
/// setting or a table.
fn suggest_setting(name: &str, known: &[&str]) -> Vec<Remedy> {
    let key = |name: &str| name.rsplit('.').next().unwrap_or_default().to_string();
    let elsewhere: Vec<&str> = known.iter().copied().filter(|known| key(known) == key(name)).collect();
    if elsewhere.is_empty() {
        let tables = known.iter().filter_map(|known| Some(known.rsplit_once('.')?.0));
        return suggest(name, known.iter().copied().chain(tables));
    }
    let names: Vec<String> = elsewhere.iter().map(|name| format!("`{name}`")).collect();
    hint(format!("did you mean {}?", names.join(" or ")))
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
            let expected: Vec<Remedy> = expected.into_iter().flat_map(hint).collect();
            assert_eq!(suggest_setting(name, &known), expected, "{name}");
        }
    }
}
