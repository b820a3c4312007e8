//! The list of algorithms.

use crate::algorithm::Algorithm;
use crate::ddpg::DdpgSettings;
use crate::ppo::PpoSettings;
use crate::sac::SacSettings;
use crate::td3::Td3Settings;
use crate::trpo::TrpoSettings;
use crate::{AlgorithmSettings, TrainingError};

/// Entry of the list of algorithms.
#[derive(Clone, Copy, Debug)]
pub struct AlgorithmEntry {
    /// Name on the command line and in files.
    pub name: &'static str,
    /// One-line summary.
    pub summary: &'static str,
    /// Settings bases besides `best`: name, and the differences from the defaults as TOML.
    pub bases: &'static [(&'static str, &'static str)],
    /// Returns the default settings.
    pub default: fn() -> AlgorithmSettings,
    /// Reads settings from TOML.
    pub from_toml: fn(&str) -> Result<AlgorithmSettings, TrainingError>,
}

impl AlgorithmEntry {
    const fn of<S: Algorithm>() -> AlgorithmEntry {
        AlgorithmEntry {
            name: S::ALGORITHM,
            summary: S::SUMMARY,
            bases: S::BASES,
            default: || S::default().into(),
            from_toml: |text| S::from_toml(text).map(AlgorithmSettings::from),
        }
    }
}

/// All algorithms. A new algorithm adds one line.
pub static ALGORITHMS: &[AlgorithmEntry] = &[
    AlgorithmEntry::of::<PpoSettings>(),
    AlgorithmEntry::of::<TrpoSettings>(),
    AlgorithmEntry::of::<SacSettings>(),
    AlgorithmEntry::of::<Td3Settings>(),
    AlgorithmEntry::of::<DdpgSettings>(),
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_unique_and_defaults_return_their_algorithm() {
        for (index, entry) in ALGORITHMS.iter().enumerate() {
            assert_eq!((entry.default)().algorithm(), entry.name);
            assert!(ALGORITHMS[..index].iter().all(|other| other.name != entry.name), "{}", entry.name);
        }
    }
}
