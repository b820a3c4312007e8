//! Training settings.

use mishandle::training::ALGORITHMS;

/// Checks that settings that are read and written read as the same settings. The first byte selects
/// the algorithm.
pub fn check(bytes: &[u8]) {
    let Some((algorithm, text)) = bytes.split_first() else { return };
    let Ok(text) = std::str::from_utf8(text) else { return };
    let entry = &ALGORITHMS[usize::from(*algorithm) % ALGORITHMS.len()];
    let Ok(settings) = (entry.from_toml)(text) else { return };
    settings.check().expect("settings that are read are valid");
    let written = settings.to_toml();
    let again = (entry.from_toml)(&written).unwrap_or_else(|error| panic!("{error} in {written}"));
    assert_eq!(again, settings, "written as {written}");
    assert_eq!(again.to_toml(), written);
}

pub fn seeds() -> Vec<Vec<u8>> {
    let mut seeds = Vec::new();
    for (index, entry) in (0_u8..).zip(ALGORITHMS) {
        let bases = entry.bases.iter().map(|(name, _)| format!("base = \"{name}\"\n"));
        for text in bases.chain([(entry.default)().to_toml(), "run.total_steps = 5_000".to_string()]) {
            seeds.push([&[index], text.as_bytes()].concat());
        }
    }
    seeds
}
