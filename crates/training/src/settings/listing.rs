//! Lists all settings of a training run with their values.

use crate::{AlgorithmSettings, Setting};

impl AlgorithmSettings {
    /// Returns each setting with its value as TOML, in order of declaration; `None` for a setting
    /// that is not set.
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

    /// Returns the differences from other settings of the same algorithm: name, own value and the
    /// other's, as TOML.
    pub(crate) fn differing(&self, other: &AlgorithmSettings) -> Vec<[String; 3]> {
        let or_not_set = |value: Option<String>| value.unwrap_or_else(|| "not set".to_string());
        self.values()
            .into_iter()
            .zip(other.values())
            .filter(|((_, own), (_, other))| own != other)
            .map(|((setting, own), (_, other))| {
                [setting.name.to_string(), or_not_set(own), or_not_set(other)]
            })
            .collect()
    }

    /// Returns the settings as TOML with a comment for each setting that is not set. Reading the
    /// text gives equal settings.
    ///
    /// # Example
    /// ```
    /// use mishandle_training::AlgorithmSettings;
    /// let settings = AlgorithmSettings::from_toml("ppo", "run.stop_strict = 0.9").unwrap()?;
    /// let listing = settings.listing();
    /// assert!(listing.contains("# stop_success: not set\nstop_strict = 0.9\n"));
    /// assert_eq!(AlgorithmSettings::from_toml("ppo", &listing).unwrap()?, settings);
    /// # Ok::<(), mishandle_training::TrainingError>(())
    /// ```
    pub fn listing(&self) -> String {
        let mut listing = String::new();
        let mut within = "";
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
