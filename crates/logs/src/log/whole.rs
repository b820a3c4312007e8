//! Whole logs: all columns that have numbers.

use std::collections::BTreeMap;

use super::{Log, OpenLog, full_name};
use crate::error::{Result, content};
use crate::options::Missing;

impl OpenLog {
    /// Reads all columns, but those with the times and the topics. A cell without a finite number
    /// is NaN. Returns the log, and why other columns were left out.
    ///
    /// # Errors
    /// If a row has no time, or the file is not what its format requires.
    pub fn read_all(mut self) -> Result<(Log, BTreeMap<String, String>)> {
        let mut left_out = BTreeMap::new();
        if self.options.missing == Missing::Error {
            self.options.missing = Missing::Hold;
        }
        let mut log = match self.options.topic_column.clone() {
            Some(column) => self.read_split(None, &column)?,
            None => {
                let mut signals = Vec::new();
                for (topic, table) in &self.tables {
                    for (name, reason) in table.not_read() {
                        drop(left_out.insert(full_name(topic.as_deref(), name), reason.clone()));
                    }
                    let time = self.time_columns(table.as_ref())?;
                    let names = table.names();
                    let is_time = |index: &usize| time.is_some_and(|time| time.has(*index));
                    for (index, name) in names.iter().enumerate().filter(|(index, _)| !is_time(index)) {
                        let signal = full_name(topic.as_deref(), name);
                        if names.iter().enumerate().any(|(other, same)| other != index && same == name) {
                            drop(left_out.insert(signal, "two columns have its name".to_owned()));
                        } else {
                            signals.push(signal);
                        }
                    }
                }
                let signals: Vec<&str> = signals.iter().map(String::as_str).collect();
                self.read(&signals)?
            }
        };
        for topic in &mut log.topics {
            topic.columns.retain(|column| {
                let has_numbers = column.values.iter().any(|value| !value.is_nan());
                if !has_numbers {
                    left_out.insert(column.name.clone(), "it has no numbers".to_owned());
                }
                has_numbers
            });
        }
        if log.topics.is_empty() {
            return Err(content("the file has no samples"));
        }
        Ok((log, left_out))
    }
}
