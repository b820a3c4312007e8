//! All settings of a training, for people.

use crate::{Config, Setting};

impl Config {
    /// The value of each setting as TOML, in the same order; `None` for one that has none.
    pub fn values(&self) -> Vec<(Setting, Option<String>)> {
        let table: toml::Table = self.to_toml().parse().expect("settings are TOML");
        let value = |setting: &Setting| {
            let (within, key) = setting.table_and_key();
            let table = if within.is_empty() { Some(&table) } else { table.get(within)?.as_table() };
            Some(table?.get(key)?.to_string())
        };
        let settings = self.settings().into_iter();
        settings.map(|setting| (value(&setting), setting)).map(|(value, setting)| (setting, value)).collect()
    }

    /// The settings in which those of the same algorithm differ: name, own value and the other's, as TOML.
    pub(crate) fn differing(&self, other: &Config) -> Vec<[String; 3]> {
        let or_none = |value: Option<String>| value.unwrap_or_else(|| "not set".to_string());
        self.values()
            .into_iter()
            .zip(other.values())
            .filter(|((_, own), (_, other))| own != other)
            .map(|((setting, own), (_, other))| [setting.name.to_string(), or_none(own), or_none(other)])
            .collect()
    }

    /// The settings as TOML that says of those without a value that they have none. Read again, they are the same.
    ///
    /// # Example
    /// ```
    /// use mishandle_training::Config;
    /// let config = Config::from_toml("ppo", "run.stop_strict = 0.9").unwrap()?;
    /// let listing = config.listing();
    /// assert!(listing.contains("# stop_success: not set\nstop_strict = 0.9\n"));
    /// assert_eq!(Config::from_toml("ppo", &listing).unwrap()?, config);
    /// # Ok::<(), mishandle_training::TrainingError>(())
    /// ```
    pub fn listing(&self) -> String {
        let (mut listing, mut within) = (String::new(), "");
        for (setting, value) in self.values() {
            let (table, key) = setting.table_and_key();
            if table != within {
                listing += &format!("\n[{table}]\n");
                within = table;
            }
            listing +=
                &value.map_or_else(|| format!("# {key}: not set\n"), |value| format!("{key} = {value}\n"));
        }
        listing
    }
}
