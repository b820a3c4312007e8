//! Reads settings from TOML and reports mistakes with their line.

use serde::Deserialize;
use toml::Spanned;
use toml::de::{DeTable, DeValue};

use super::bases::{BEST, base, base_names, overlay};
use super::setting::one_of;
use crate::{Setting, TomlSettings, TrainingError};

/// Key that names the settings base.
const BASE: &str = "base";

/// Reads settings from TOML. A missing key, at any depth, takes its value from the base that the
/// text names.
///
/// # Errors
/// If the text is not TOML, contains an unknown setting, or assigns a value that is not allowed.
pub(crate) fn read<S: TomlSettings>(text: &str) -> Result<S, TrainingError> {
    let not_toml = |error: toml::de::Error| TrainingError::NotToml {
        line: line_at(text, error.span().map_or(0, |span| span.start)),
        message: error.message().replace('\n', ", "),
    };
    let mut stated = DeTable::parse(text).map_err(not_toml)?;
    let base_of_text = stated.get_mut().remove_entry(BASE);
    let reader = Reader { algorithm: S::ALGORITHM, text, settings: S::settings() };
    let name = base_of_text.map_or(Ok(BEST.to_string()), |(key, value)| reader.base::<S>(&key, &value))?;
    reader.check("", stated.get_ref())?;
    let positions = stated.clone();
    let mut settings = base::<S>(&name);
    overlay(&mut settings, toml::Table::deserialize(toml::Deserializer::from(stated)).map_err(not_toml)?);
    let settings: S = settings.try_into().map_err(not_toml)?;
    settings.check().map_err(|error| reader.with_line(error, positions.get_ref()))?;
    Ok(settings)
}

struct Reader<'t> {
    algorithm: &'static str,
    text: &'t str,
    settings: Vec<Setting>,
}

impl Reader<'_> {
    /// Checks that each key of a table is known and has a value of the right type; `within` is the
    /// name of the table with a period at its end.
    fn check(&self, within: &str, table: &DeTable<'_>) -> Result<(), TrainingError> {
        for (key, value) in table {
            let name = format!("{within}{}", key.get_ref());
            let line = self.line(key);
            let as_table = format!("{name}.");
            let setting = self.settings.iter().find(|setting| setting.name == name);
            match (setting, value.get_ref()) {
                (Some(setting), _) if (setting.reads)(value.clone()) => {}
                (Some(setting), _) => {
                    let known = setting.choices.iter().map(|choice| choice.name).collect();
                    return Err(self.wrong(&name, line, &setting.allowed, value, known));
                }
                (None, _) if !self.settings.iter().any(|setting| setting.name.starts_with(&as_table)) => {
                    let known = self.settings.iter().map(|setting| setting.name).chain([BASE]).collect();
                    return Err(TrainingError::UnknownSetting {
                        algorithm: self.algorithm,
                        line,
                        name,
                        known,
                    });
                }
                (None, DeValue::Table(table)) => self.check(&as_table, table)?,
                (None, _) => {
                    let expected = format!("a table, as [{name}]");
                    return Err(self.wrong(&name, line, &expected, value, Vec::new()));
                }
            }
        }
        Ok(())
    }

    /// Returns the base that the text names.
    fn base<S: TomlSettings>(
        &self,
        key: &Spanned<impl Sized>,
        value: &Spanned<DeValue<'_>>,
    ) -> Result<String, TrainingError> {
        let known = base_names::<S>();
        match value.get_ref() {
            DeValue::String(name) if known.iter().any(|known| known == name) => Ok(name.to_string()),
            _ => {
                let expected = format!("the name of a settings base of {}: ", self.algorithm);
                let expected = expected + &one_of(known.iter().copied());
                Err(self.wrong(BASE, self.line(key), &expected, value, known))
            }
        }
    }

    fn wrong(
        &self,
        name: &str,
        line: usize,
        expected: &str,
        value: &Spanned<DeValue<'_>>,
        known: Vec<&'static str>,
    ) -> TrainingError {
        let found = match value.get_ref() {
            // The entries of one table may be spread over the text, so it has no single span.
            DeValue::Table(table) => {
                let keys: Vec<&str> = table.keys().map(|key| key.get_ref().as_ref()).collect();
                format!("a table of {}", keys.join(", "))
            }
            _ => self.text[value.span()].replace('\n', " "),
        };
        let name = name.to_string();
        let expected = expected.to_string();
        TrainingError::Setting { line: Some(line), name, expected, found, known }
    }

    fn line(&self, key: &Spanned<impl Sized>) -> usize {
        line_at(self.text, key.span().start)
    }

    /// Adds the line that states the setting to an error, if the text states it.
    fn with_line(&self, error: TrainingError, stated: &DeTable<'_>) -> TrainingError {
        match error {
            TrainingError::Setting { line: None, name, expected, found, known } => {
                let line = self.line_of(&name, stated);
                TrainingError::Setting { line, name, expected, found, known }
            }
            other => other,
        }
    }

    fn line_of(&self, name: &str, table: &DeTable<'_>) -> Option<usize> {
        let (key, rest) = name.split_once('.').map_or((name, None), |(key, rest)| (key, Some(rest)));
        let (key, value) = table.get_key_value(key)?;
        match (rest, value.get_ref()) {
            (Some(rest), DeValue::Table(table)) => self.line_of(rest, table),
            (Some(_), _) => None,
            (None, _) => Some(self.line(key)),
        }
    }
}

/// Returns the line of a byte offset, counted from 1.
fn line_at(text: &str, offset: usize) -> usize {
    1 + text.as_bytes()[..offset.min(text.len())].iter().filter(|byte| **byte == b'\n').count()
}
