//! What to try instead of what was wrong.

use mishandle_rollout::RolloutError;
use mishandle_search::SearchError;
use mishandle_stl::nearest;
use mishandle_training::TrainingError;

use crate::{MishandleError, home_in_words};

impl MishandleError {
    /// What to try instead, if something can be said.
    pub fn hint(&self) -> Option<String> {
        match self {
            MishandleError::Name { kind, name, known } => {
                let place = || {
                    format!("shipped controllers are {}; give the path of another as ./FILE", home_in_words())
                };
                if *kind == "task" && name.starts_with("toy/") {
                    return Some(format!("it is a toy, not a task; `mishandle targets {name}` explains it"));
                }
                if *kind == "space" && name == "noise" {
                    return Some("a task has it with --action-noise above 0 or a random start".to_string());
                }
                let near = meant(name, known.iter().map(String::as_str));
                near.or_else(|| kind.starts_with("controller").then(place))
            }
            MishandleError::Settings { source, .. } => match &**source {
                TrainingError::UnknownSetting { name, known, .. } => meant_setting(name, known),
                TrainingError::Setting { found, known, .. } => {
                    meant(found.trim_matches(['"', '\'']), known.iter().copied())
                }
                _ => None,
            },
            MishandleError::Search(SearchError::UnknownOption { name: wanted, known, .. }) => {
                meant(wanted, known.iter().map(String::as_str))
            }
            MishandleError::Rollout(RolloutError::Monitor { source, .. }) => source.hint(),
            _ => None,
        }
    }
}

fn meant<'a>(name: &str, known: impl IntoIterator<Item = &'a str>) -> Option<String> {
    nearest(name, known).map(|near| format!("did you mean `{near}`?"))
}

/// A setting of the same key in another table, else the nearest name of a setting or a table.
fn meant_setting(name: &str, known: &[&str]) -> Option<String> {
    let key = |name: &str| name.rsplit('.').next().unwrap_or_default().to_string();
    let elsewhere: Vec<&str> = known.iter().copied().filter(|known| key(known) == key(name)).collect();
    if elsewhere.is_empty() {
        let tables = known.iter().filter_map(|known| Some(known.rsplit_once('.')?.0));
        return meant(name, known.iter().copied().chain(tables));
    }
    let names: Vec<String> = elsewhere.iter().map(|name| format!("`{name}`")).collect();
    Some(format!("did you mean {}?", names.join(" or ")))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_misspelt_setting_is_looked_for_in_its_table_and_one_of_another_table_there() {
        let known = ["gamma", "run.total_steps", "policy.hidden", "critic.hidden"];
        for (name, told) in [
            ("gama", Some("did you mean `gamma`?")),
            ("run.total_step", Some("did you mean `run.total_steps`?")),
            ("total_steps", Some("did you mean `run.total_steps`?")),
            ("hidden", Some("did you mean `policy.hidden` or `critic.hidden`?")),
            ("polcy", Some("did you mean `policy`?")),
            ("momentum", None),
        ] {
            assert_eq!(meant_setting(name, &known).as_deref(), told, "{name}");
        }
    }
}
