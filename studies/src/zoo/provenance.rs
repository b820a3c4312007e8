//! How a controller was trained, and where that differs from how it would be trained now.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt;
use std::path::Path;

use mishandle::controllers::{ControllerError, ControllerFile, TrainingRecord, WRITTEN_VERSIONS};
use mishandle::training::AlgorithmSettings;
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

use crate::zoo::folder::read;
use crate::zoo::plan::SEED;
use crate::zoo::{Training, ZooError};

/// The task preset and the reward of every training run of the plan.
const PRESET: &str = "paper";
pub(crate) const REWARD: &str = "shaped";

/// Version of a file format that no present program writes.
const OTHER_FORMAT: u64 = 0;

/// How a controller was trained: the header of its file, and the time that its training took.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrainingSummary {
    /// The record in the header.
    #[serde(flatten)]
    pub record: TrainingRecord,
    /// Name of the task.
    pub task: String,
    /// Name of the algorithm.
    pub algorithm: String,
    /// Task preset.
    pub preset: String,
    /// Name of the reward.
    pub reward: String,
    /// Hash of the task.
    pub task_hash: String,
    /// Hash of the layout of observations and actions.
    pub layout_hash: String,
    /// Version of the controller's file format.
    pub format_version: u64,
    /// Kind of the policy: `gaussian` or `squashed-gaussian`.
    pub kind: String,
    /// Whether the controller counts as trained on the present task although its file names
    /// another.
    #[serde(default, skip_serializing_if = "is_false")]
    pub adopted: bool,
    /// When the return became flat; `None` if the curve does not show it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub training_time: Option<TrainingTime>,
    /// Environment steps of the whole training run; `None` for a controller that was put in place
    /// by hand.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub trained_steps: Option<u64>,
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde passes a reference")]
fn is_false(flag: &bool) -> bool {
    !flag
}

/// The time until the training return is flat.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrainingTime {
    /// Control steps of all environments together.
    pub environment_steps: u64,
    /// Control steps of each environment.
    pub control_steps: u64,
    /// Wall-clock time, s.
    pub secs: f64,
}

/// Present versions of everything that a training run depends on.
#[derive(Clone, Debug, PartialEq)]
pub struct TrainingInputs {
    /// All settings, as TOML; `None` if the repository has no settings file for this task and
    /// algorithm.
    pub settings: Option<String>,
    /// Hash of the task.
    pub task_hash: String,
    /// Hash of the layout of observations and actions.
    pub layout_hash: String,
}

/// Why a controller is not the one that would be trained now.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Difference {
    /// It belongs to another training run.
    Other {
        /// The property that differs.
        what: &'static str,
        /// Its value in the plan.
        expected: String,
        /// Its value in the file.
        found: String,
    },
    /// Observations or actions changed.
    Layout,
    /// The task changed: physics, starts, observations or reward.
    Task,
    /// These settings changed.
    Settings(Vec<String>),
    /// The file has an older format.
    Format,
}

impl fmt::Display for Difference {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Difference::Other { what, expected, found } => {
                write!(f, "{what} is {found}, expected {expected}")
            }
            Difference::Layout => write!(f, "task changed: observations or actions"),
            Difference::Task => write!(f, "task changed"),
            Difference::Settings(keys) => write!(f, "settings changed: {}", keys.join(", ")),
            Difference::Format => write!(f, "older file format"),
        }
    }
}

impl TrainingSummary {
    /// Reads the header of a controller's file.
    ///
    /// # Errors
    /// If the file cannot be read or is not a controller.
    pub fn load(path: &Path) -> Result<TrainingSummary, ZooError> {
        let bytes = read(path)?;
        let file = ControllerFile::from_bytes(&bytes)
            .map_err(|problem| ControllerError::File { problem, path: path.to_path_buf() })?;
        let kind = file.policy.kind();
        // The same controller and header give the same bytes, so only another format gives others.
        let is_present_format = file.to_bytes() == bytes;
        let format_version = present_format(kind).filter(|_| is_present_format).unwrap_or(OTHER_FORMAT);
        let layout_hash = file.header.layout.hash();
        let header = file.header;
        Ok(TrainingSummary {
            record: header.training,
            task: header.task,
            algorithm: header.algorithm,
            preset: header.preset,
            reward: header.reward,
            task_hash: header.task_hash,
            layout_hash,
            format_version,
            kind: kind.to_string(),
            adopted: false,
            training_time: None,
            trained_steps: None,
        })
    }

    /// Returns the settings; `None` if the present program cannot read them.
    pub fn config(&self) -> Option<AlgorithmSettings> {
        AlgorithmSettings::from_toml(&self.algorithm, &self.record.settings)?.ok()
    }

    /// Compares the summary with what the training run would give now, and adds the defaults of
    /// settings that its program did not know. With `adopt`, a controller that differs in its task
    /// alone is adopted.
    pub fn reconcile(
        &mut self,
        training: &Training,
        expected: &TrainingInputs,
        adopt: bool,
    ) -> Vec<Difference> {
        if expected.settings.as_deref() != Some(&self.record.settings)
            && let Some(config) = self.config()
        {
            self.record.settings = config.to_toml();
        }
        let found = self.differences(training, expected);
        if adopt && found == [Difference::Task] {
            self.task_hash.clone_from(&expected.task_hash);
            self.adopted = true;
            return Vec::new();
        }
        found
    }

    /// Returns everything that differs from what the training run would give now.
    fn differences(&self, training: &Training, expected: &TrainingInputs) -> Vec<Difference> {
        let mut differences = Vec::new();
        for (what, expected, found) in [
            ("task", training.task.as_str(), self.task.as_str()),
            ("algorithm", &training.algorithm, &self.algorithm),
            ("seed", &SEED.to_string(), &self.record.seed.to_string()),
            ("preset", PRESET, &self.preset),
            ("reward", REWARD, &self.reward),
        ] {
            if expected != found {
                let expected = expected.to_string();
                let found = found.to_string();
                differences.push(Difference::Other { what, expected, found });
            }
        }
        if self.layout_hash != expected.layout_hash {
            differences.push(Difference::Layout);
        } else if self.task_hash != expected.task_hash {
            differences.push(Difference::Task);
        }
        let keys = differing_keys(&self.record.settings, expected.settings.as_deref().unwrap_or_default());
        if !keys.is_empty() {
            differences.push(Difference::Settings(keys));
        }
        if Some(self.format_version) != present_format(&self.kind) {
            differences.push(Difference::Format);
        }
        differences
    }
}

/// Returns the version of the file format that controllers with this kind of policy are written in.
fn present_format(kind: &str) -> Option<u64> {
    WRITTEN_VERSIONS.iter().find(|(known, _)| *known == kind).map(|(_, version)| *version)
}

/// Returns the SHA-256 of a file, in hexadecimal.
pub(crate) fn file_hash(path: &Path) -> Result<String, ZooError> {
    Ok(Sha256::digest(read(path)?).iter().map(|byte| format!("{byte:02x}")).collect())
}

/// Returns the keys of two settings texts whose values differ, or that only one of them has.
fn differing_keys(found: &str, expected: &str) -> Vec<String> {
    let found = values_by_key(found);
    let expected = values_by_key(expected);
    let all: BTreeSet<&String> = found.keys().chain(expected.keys()).collect();
    all.into_iter().filter(|key| found.get(*key) != expected.get(*key)).cloned().collect()
}

/// Returns every value of a TOML text under its dotted key; no value of a text that is not TOML.
fn values_by_key(text: &str) -> BTreeMap<String, toml::Value> {
    fn add(prefix: &str, table: toml::Table, found: &mut BTreeMap<String, toml::Value>) {
        for (key, value) in table {
            match value {
                toml::Value::Table(inner) => add(&format!("{prefix}{key}."), inner, found),
                value => drop(found.insert(format!("{prefix}{key}"), value)),
            }
        }
    }
    let mut found = BTreeMap::new();
    add("", text.parse().unwrap_or_default(), &mut found);
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    const SETTINGS: &str = "gamma = 0.99\n\n[run]\ntotal_steps = 2048\n";

    fn training() -> Training {
        Training { task: "point-reaching".to_string(), algorithm: "ppo".to_string() }
    }

    fn expected() -> TrainingInputs {
        TrainingInputs {
            settings: Some(SETTINGS.to_string()),
            task_hash: "aa".to_string(),
            layout_hash: "bb".to_string(),
        }
    }

    /// A controller that was trained as expected.
    fn summary() -> TrainingSummary {
        TrainingSummary {
            record: TrainingRecord {
                seed: SEED,
                environment_steps: 1024,
                wall_clock_secs: 1.5,
                git_commit: "c0ffee".to_string(),
                command: "mishandle train".to_string(),
                settings: SETTINGS.to_string(),
                validation: None,
            },
            task: "point-reaching".to_string(),
            algorithm: "ppo".to_string(),
            preset: "paper".to_string(),
            reward: "shaped".to_string(),
            task_hash: "aa".to_string(),
            layout_hash: "bb".to_string(),
            format_version: 2,
            kind: "gaussian".to_string(),
            adopted: false,
            training_time: None,
            trained_steps: None,
        }
    }

    #[track_caller]
    fn check(change: impl Fn(&mut TrainingSummary), expected_words: &[&str]) {
        let mut changed = summary();
        change(&mut changed);
        let found: Vec<String> =
            changed.differences(&training(), &expected()).iter().map(ToString::to_string).collect();
        assert_eq!(found, expected_words);
    }

    #[test]
    fn each_difference_is_named() {
        check(|summary| summary.record.command = "another".into(), &[]);
        check(|summary| summary.record.seed = 1, &["seed is 1, expected 0"]);
        check(|summary| summary.algorithm = "trpo".into(), &["algorithm is trpo, expected ppo"]);
        check(|summary| summary.reward = "original".into(), &["reward is original, expected shaped"]);
        check(|summary| summary.task_hash = "ab".into(), &["task changed"]);
        check(|summary| summary.layout_hash = "ba".into(), &["task changed: observations or actions"]);
        check(|summary| summary.format_version = 1, &["older file format"]);
        check(|summary| summary.kind = "squashed-gaussian".into(), &["older file format"]);
        let settings = "gamma = 0.99\nepochs = 5\n\n[run]\ntotal_steps = 4096\n";
        check(
            |summary| summary.record.settings = settings.into(),
            &["settings changed: epochs, run.total_steps"],
        );
    }

    #[test]
    fn settings_that_an_older_program_left_out_count_with_their_defaults() {
        let full = AlgorithmSettings::from_toml("ppo", SETTINGS).unwrap().unwrap().to_toml();
        let expected = TrainingInputs { settings: Some(full.clone()), ..expected() };
        let mut old = summary();
        assert_eq!(old.reconcile(&training(), &expected, false), []);
        assert_eq!(old.record.settings, full);
    }

    #[test]
    fn a_controller_is_adopted_only_if_its_task_alone_differs() {
        let expected =
            TrainingInputs { settings: summary().config().map(|config| config.to_toml()), ..expected() };
        let adopted = |change: &dyn Fn(&mut TrainingSummary), adopt| {
            let mut changed = summary();
            change(&mut changed);
            let differences = changed.reconcile(&training(), &expected, adopt);
            (changed.adopted, differences.len())
        };
        let other_task = |summary: &mut TrainingSummary| summary.task_hash = "ab".into();
        assert_eq!(adopted(&other_task, false), (false, 1));
        assert_eq!(adopted(&other_task, true), (true, 0));
        let other_seed =
            |summary: &mut TrainingSummary| (summary.task_hash, summary.record.seed) = ("ab".into(), 1);
        assert_eq!(adopted(&other_seed, true), (false, 2));
    }

    #[test]
    fn the_header_of_a_shipped_controller_is_read_and_its_format_is_the_present_one() {
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
        let found = TrainingSummary::load(&root.join("controllers/point-reaching/ppo.safetensors")).unwrap();
        assert_eq!(
            (found.task.as_str(), found.algorithm.as_str(), found.record.seed),
            ("point-reaching", "ppo", 0)
        );
        assert_eq!(Some(found.format_version), present_format(&found.kind));
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.safetensors");
        std::fs::write(&path, b"no controller").unwrap();
        let error = TrainingSummary::load(&path).unwrap_err().to_string();
        assert!(error.contains("a.safetensors"), "{error}");
    }
}
