//! The list of algorithms, by name.

use crate::algorithm::Algorithm;
use crate::ddpg::DdpgConfig;
use crate::ppo::PpoConfig;
use crate::sac::SacConfig;
use crate::td3::Td3Config;
use crate::trpo::TrpoConfig;
use crate::{Config, TrainingError};

/// One line of the list of algorithms.
#[derive(Clone, Copy, Debug)]
pub struct AlgorithmEntry {
    /// The name users type.
    pub name: &'static str,
    /// What it is, in one line.
    pub summary: &'static str,
    /// Settings presets besides the default: names, and as TOML how each differs from the default.
    pub presets: &'static [(&'static str, &'static str)],
    /// Returns its default settings.
    pub default: fn() -> Config,
    /// Reads its settings from TOML.
    pub from_toml: fn(&str) -> Result<Config, TrainingError>,
}

impl AlgorithmEntry {
    const fn of<C: Algorithm>() -> AlgorithmEntry {
        AlgorithmEntry {
            name: C::ALGORITHM,
            summary: C::SUMMARY,
            presets: C::PRESETS,
            default: || C::default().into(),
            from_toml: |text| C::from_toml(text).map(Config::from),
        }
    }
}

/// Every algorithm there is; a further one is one more line.
pub static ALGORITHMS: &[AlgorithmEntry] = &[
    AlgorithmEntry::of::<PpoConfig>(),
    AlgorithmEntry::of::<TrpoConfig>(),
    AlgorithmEntry::of::<SacConfig>(),
    AlgorithmEntry::of::<Td3Config>(),
    AlgorithmEntry::of::<DdpgConfig>(),
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_differ_and_defaults_name_their_algorithm() {
        for (index, entry) in ALGORITHMS.iter().enumerate() {
            assert_eq!((entry.default)().algorithm(), entry.name);
            assert!(ALGORITHMS[..index].iter().all(|other| other.name != entry.name), "{}", entry.name);
        }
    }
}
