//! docs/reference/bases.md lists the bases.

use std::collections::BTreeMap;

use mishandle_training::{ALGORITHMS, AlgorithmSettings, BASES, BEST};

const PAGE: &str = include_str!("../../../docs/reference/bases.md");

/// Returns the settings of a base by their full names; `None` if the algorithm does not have it.
fn settings(algorithm: &str, base: &str) -> Option<BTreeMap<String, String>> {
    let of_base = AlgorithmSettings::from_toml(algorithm, &format!("base = \"{base}\"")).unwrap().ok()?;
    let mut settings = BTreeMap::new();
    flatten("", &of_base.to_toml().parse().unwrap(), &mut settings);
    Some(settings)
}

fn flatten(within: &str, table: &toml::Table, settings: &mut BTreeMap<String, String>) {
    for (key, value) in table {
        match value {
            toml::Value::Table(table) => flatten(&format!("{within}{key}."), table, settings),
            value => {
                settings.insert(format!("{within}{key}"), value.to_string());
            }
        }
    }
}

#[test]
fn the_page_lists_the_differences_of_each_base_from_best() {
    for base in BASES.into_iter().filter(|base| *base != BEST) {
        for algorithm in ALGORITHMS.iter().map(|entry| entry.name) {
            let Some(own) = settings(algorithm, base) else { continue };
            let best = settings(algorithm, BEST).unwrap();
            let mut table = format!("| `{algorithm}` | `{BEST}` | `{base}` |\n|---|---|---|\n");
            for (name, value) in own.iter().filter(|(name, value)| best.get(*name) != Some(value)) {
                let best = best.get(name).map_or("", |value| value);
                table += &format!("| `{name}` | {best} | {value} |\n");
            }
            assert!(
                PAGE.contains(&format!("{table}\n")),
                "docs/reference/bases.md lacks this table:\n\n{table}"
            );
        }
    }
}
