//! What is known of a controller: how it was trained, and what was measured of it.

use std::fs;

use anyhow::{Context, Result};
use serde_json::{Value, json};

use super::facts::Facts;
use super::home::{Home, write};
use super::measure::Measured;

/// One controller's record, kept as `controllers/figures/TASK/CONTROLLER.json`.
#[derive(Clone, Debug, PartialEq)]
pub struct Record {
    pub task: String,
    pub controller: String,
    document: Value,
}

impl Record {
    /// The record that was kept, if there is one.
    ///
    /// # Errors
    /// If it cannot be read.
    pub fn load(home: &Home, task: &str, controller: &str) -> Result<Option<Record>> {
        let path = home.record(task, controller);
        if !path.is_file() {
            return Ok(None);
        }
        let document =
            serde_json::from_slice(&fs::read(&path)?).with_context(|| path.display().to_string())?;
        Ok(Some(Record { task: task.to_string(), controller: controller.to_string(), document }))
    }

    /// A record of what was measured of a trained controller in a file of that hash.
    pub fn trained(task: &str, controller: &str, facts: &Facts, file_hash: &str, found: Measured) -> Record {
        let mut record = Record::untrained(task, controller, found);
        record.document["training"] = facts.0.clone();
        record.document["file_hash"] = file_hash.into();
        record
    }

    /// A record of what was measured of a controller that nobody trained.
    pub fn untrained(task: &str, controller: &str, found: Measured) -> Record {
        let Measured { commit, conditions, evaluations, whole_box, falsification } = found;
        let document = json!({
            "commit": commit,
            "conditions": conditions,
            "evaluations": evaluations,
            "whole_box": whole_box,
            "falsification": falsification,
        });
        Record { task: task.to_string(), controller: controller.to_string(), document }
    }

    /// Writes the record.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn save(&self, home: &Home) -> Result<()> {
        let text = format!("{:#}\n", self.document);
        write(&home.record(&self.task, &self.controller), text.as_bytes())
    }

    /// The commit that was measured.
    pub fn commit(&self) -> &str {
        self.document["commit"].as_str().unwrap_or_default()
    }

    /// How the controller was trained; nothing for an expert.
    pub fn facts(&self) -> Option<Facts> {
        self.document["training"].is_object().then(|| Facts(self.document["training"].clone()))
    }

    /// Takes the controller to be trained on the present task.
    pub fn adopt(&mut self, facts: &Facts) {
        self.document["training"] = facts.0.clone();
    }

    /// The hash of the file that was measured; empty for an expert.
    pub fn file_hash(&self) -> &str {
        self.document["file_hash"].as_str().unwrap_or_default()
    }

    /// Whether it was measured under these conditions.
    pub fn is_of(&self, conditions: &Value) -> bool {
        self.document["conditions"] == *conditions
    }

    /// An estimate under one of the noises, from the part of the box from which the task can be done.
    pub fn estimate(&self, noise: usize, key: &str) -> &Value {
        &self.document["evaluations"][noise][key]
    }

    /// The same over the whole box, where that is another.
    pub fn estimate_of_whole_box(&self, noise: usize, key: &str) -> Option<&Value> {
        self.document["whole_box"].get(noise).map(|evaluation| &evaluation[key])
    }

    /// In how many of its trials random search broke the success formula under noise, if it was put to that test.
    pub fn broken(&self) -> Option<String> {
        let trials = self.document["falsification"]["trials"].as_array()?.len();
        Some(format!("{} of {trials}", self.document["falsification"]["falsified_trials"]))
    }
}
