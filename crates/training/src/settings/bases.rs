//! Settings bases: values of the settings that a file leaves out.
//!
//! A settings file may contain `base = "skrl-0.10"`. The base then supplies every missing value. A
//! base is TOML that states its differences from the defaults.

use crate::TomlSettings;

/// Names of the bases: `best`, the defaults, which apply if a file names no base; and `skrl-0.10`,
/// the skrl 0.10.2 defaults. Not every algorithm has every base.
pub const BASES: [&str; 2] = [BEST, SKRL_0_10];

/// Name of the base with the default settings.
pub const BEST: &str = "best";

/// Name of the base with the skrl 0.10.2 defaults.
pub(crate) const SKRL_0_10: &str = "skrl-0.10";

/// Returns the names of the settings bases of an algorithm.
pub(crate) fn base_names<S: TomlSettings>() -> Vec<&'static str> {
    std::iter::once(BEST).chain(S::BASES.iter().map(|(name, _)| *name)).collect()
}

/// Returns all settings of a base that have a value; the defaults for an unknown name.
pub(crate) fn base<S: TomlSettings>(name: &str) -> toml::Table {
    let parsed = |text: &str| text.parse::<toml::Table>().expect("settings and bases are TOML");
    let mut settings = parsed(&S::default().to_toml());
    if let Some((_, stated)) = S::BASES.iter().find(|(known, _)| *known == name) {
        overlay(&mut settings, parsed(stated));
    }
    settings
}

/// Replaces values of `own` by those that `other` states.
pub(crate) fn overlay(own: &mut toml::Table, other: toml::Table) {
    for (key, value) in other {
        match (own.get_mut(&key), value) {
            (Some(toml::Value::Table(own)), toml::Value::Table(other)) => overlay(own, other),
            (_, value) => {
                own.insert(key, value);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ppo::PpoSettings;
    use crate::{ALGORITHMS, AlgorithmEntry};

    /// Checks that each base of an algorithm can be read and states no default.
    fn check(entry: &AlgorithmEntry) {
        let read = |text: &str| (entry.from_toml)(text).unwrap();
        let default = (entry.default)();
        assert_eq!(read(""), default);
        assert_eq!(read(&default.to_toml()), default);
        for (name, stated) in entry.bases {
            let alone = read(&format!("base = \"{name}\""));
            assert_eq!(read(&alone.to_toml()), alone, "to_toml writes all settings of {name}");
            check_differs(name, &stated.parse().unwrap(), &default.to_toml().parse().unwrap());
        }
    }

    fn check_differs(within: &str, stated: &toml::Table, default: &toml::Table) {
        for (key, value) in stated {
            match (value, default.get(key)) {
                (toml::Value::Table(stated), Some(toml::Value::Table(default))) => {
                    check_differs(key, stated, default);
                }
                (value, default) => {
                    assert!(Some(value) != default, "{within}: {value} is the default of `{key}`");
                }
            }
        }
    }

    #[test]
    fn bases_round_trip_through_toml_and_state_only_differences_from_the_defaults() {
        ALGORITHMS.iter().for_each(check);
    }

    #[test]
    fn best_has_the_defaults() {
        let best = PpoSettings::from_toml("base = \"best\"\ngamma = 0.9").unwrap();
        assert_eq!(best, PpoSettings { gamma: 0.9, ..PpoSettings::default() });
    }

    #[test]
    fn an_unknown_base_is_an_error() {
        let error = PpoSettings::from_toml("base = \"rllib\"").unwrap_err().to_string();
        let expected = "the name of a settings base of ppo: \"best\" or \"skrl-0.10\"";
        assert_eq!(error, format!("line 1: the setting `base` must be {expected}, found \"rllib\""));
        let error = PpoSettings::from_toml("gamma = 0.9\nbase = 3").unwrap_err().to_string();
        assert_eq!(error, format!("line 2: the setting `base` must be {expected}, found 3"));
    }
}
