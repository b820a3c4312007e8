//! Settings presets: what the settings are that a file leaves out.
//!
//! Settings as TOML may say `preset = "skrl-0.10"`: what they leave out is then as that preset has it. A preset is
//! itself TOML, and states what it has other than the defaults.

use crate::Settings;

/// Names of the presets: `best`, the defaults, which is meant if none is named; and `skrl-0.10`, what skrl 0.10.2 does if it is told
/// nothing else. Not every algorithm has every preset.
pub const PRESETS: [&str; 2] = [BEST, SKRL_0_10];

/// Name of the preset that is the defaults.
pub const BEST: &str = "best";

/// Name of the preset that is what skrl 0.10.2 does if it is told nothing else.
pub(crate) const SKRL_0_10: &str = "skrl-0.10";

/// Names of the settings presets of an algorithm.
pub(crate) fn preset_names<S: Settings>() -> Vec<&'static str> {
    std::iter::once(BEST).chain(S::PRESETS.iter().map(|(name, _)| *name)).collect()
}

/// All settings of a preset, but for those that have no value; of a name that is none's, the defaults.
pub(crate) fn preset<S: Settings>(name: &str) -> toml::Table {
    let parsed = |text: &str| text.parse::<toml::Table>().expect("settings and presets are TOML");
    let mut settings = parsed(&S::default().to_toml());
    if let Some((_, stated)) = S::PRESETS.iter().find(|(known, _)| *known == name) {
        overlay(&mut settings, parsed(stated));
    }
    settings
}

/// Lets `own` have what `other` states.
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
    use crate::ppo::PpoConfig;
    use crate::{ALGORITHMS, AlgorithmEntry};

    /// Checks that each preset of an algorithm can be read, and states nothing that is so anyway.
    fn check(entry: &AlgorithmEntry) {
        let read = |text: &str| (entry.from_toml)(text).unwrap();
        let default = (entry.default)();
        assert_eq!(read(""), default);
        assert_eq!(read(&default.to_toml()), default);
        for (name, stated) in entry.presets {
            let alone = read(&format!("preset = \"{name}\""));
            assert_eq!(read(&alone.to_toml()), alone, "all of it is written out");
            check_differs(name, &stated.parse().unwrap(), &default.to_toml().parse().unwrap());
        }
    }

    fn check_differs(within: &str, stated: &toml::Table, default: &toml::Table) {
        for (key, value) in stated {
            match (value, default.get(key)) {
                (toml::Value::Table(stated), Some(toml::Value::Table(default))) => {
                    check_differs(key, stated, default);
                }
                (value, default) => assert!(Some(value) != default, "{within}: `{key}` is {value} anyway"),
            }
        }
    }

    #[test]
    fn presets_and_defaults_come_back_from_their_text_and_differ_in_all_that_presets_state() {
        ALGORITHMS.iter().for_each(check);
    }

    #[test]
    fn best_is_the_defaults() {
        let best = PpoConfig::from_toml("preset = \"best\"\ngamma = 0.9").unwrap();
        assert_eq!(best, PpoConfig { gamma: 0.9, ..PpoConfig::default() });
    }

    #[test]
    fn a_preset_that_an_algorithm_lacks_is_refused() {
        let refusal = PpoConfig::from_toml("preset = \"rllib\"").unwrap_err().to_string();
        let wanted = "the name of a settings preset of ppo: \"best\" or \"skrl-0.10\"";
        assert_eq!(refusal, format!("line 1: the setting `preset` must be {wanted}, found \"rllib\""));
        let refusal = PpoConfig::from_toml("gamma = 0.9\npreset = 3").unwrap_err().to_string();
        assert_eq!(refusal, format!("line 2: the setting `preset` must be {wanted}, found 3"));
    }
}
