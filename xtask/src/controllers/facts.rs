//! What a controller's training hung on, and where that is not what it would hang on now.

use std::collections::BTreeMap;
use std::fmt;
use std::fs;
use std::path::Path;

use anyhow::{Context, Result, ensure};
use serde_json::Value;
use sha2::{Digest, Sha256};

use super::plan::Training;

/// The preset and the reward of every training of the plan.
const PRESET: &str = "paper";
const REWARD: &str = "shaped";

/// How a controller was trained, as its file tells it, in one table.
#[derive(Clone, Debug, PartialEq)]
pub struct Facts(pub Value);

/// What a training would hang on now.
#[derive(Clone, Debug, PartialEq)]
pub struct Wanted {
    /// All settings as TOML; `None` where the plan's pair has no settings file.
    pub settings: Option<String>,
    pub task_hash: String,
    pub layout_hash: String,
    /// The version of the file's format by the kind of policy.
    pub formats: Value,
}

/// Why a controller is not the one that would be trained now.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Difference {
    /// It is of another training altogether.
    Other { what: &'static str, wanted: String, found: String },
    /// What it takes and gives has changed.
    Layout,
    /// The task has changed: physics, starts, observations or reward.
    Task,
    /// Settings have other values.
    Settings(Vec<String>),
    /// Its file is written otherwise by now.
    Format { found: u64, wanted: u64 },
}

impl fmt::Display for Difference {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Difference::Other { what, wanted, found } => write!(f, "its {what} is {found}, not {wanted}"),
            Difference::Layout => write!(f, "task changed: observations or actions"),
            Difference::Task => write!(f, "task changed"),
            Difference::Settings(keys) => write!(f, "settings changed: {}", keys.join(", ")),
            Difference::Format { found, wanted } => write!(f, "format {found}, now {wanted}"),
        }
    }
}

impl Facts {
    /// What the header of a controller's file tells: eight bytes of length, then JSON.
    ///
    /// # Errors
    /// If it is no controller.
    pub fn of_file(path: &Path) -> Result<Facts> {
        let read = || {
            let bytes = fs::read(path)?;
            let length = bytes.first_chunk::<8>().map(|bytes| u64::from_le_bytes(*bytes) as usize);
            let json = length.and_then(|length| bytes.get(8..)?.get(..length));
            let header: Value = serde_json::from_slice(json.context("the file is cut short")?)?;
            let ours = header["__metadata__"]["mishandle"].as_str().context("it is no controller")?;
            let mut ours: Value = serde_json::from_str(ours)?;
            let mut facts = ours["training"].take();
            ensure!(facts.is_object(), "it says nothing of a training");
            for key in ["task", "algorithm", "preset", "reward", "task_hash", "layout_hash", "format_version"]
            {
                facts[key] = ours[key].take();
            }
            facts["kind"] = ours["policy"]["kind"].take();
            Ok(Facts(facts))
        };
        read().with_context(|| path.display().to_string())
    }

    pub fn text(&self, key: &str) -> &str {
        self.0[key].as_str().unwrap_or_default()
    }

    pub fn number(&self, key: &str) -> Option<f64> {
        self.0[key].as_f64()
    }

    /// Whether the file was written before files told which task they were trained on.
    pub fn knows_task(&self) -> bool {
        !self.text("task_hash").is_empty()
    }

    /// Whether it is taken to be trained on the present task though its file does not say so.
    pub fn is_adopted(&self) -> bool {
        self.0["adopted"] == true
    }

    /// Takes it to be trained on the present task.
    pub fn adopt(&mut self, task_hash: &str) {
        self.0["task_hash"] = task_hash.into();
        self.0["adopted"] = true.into();
    }

    /// All that keeps it from being what `training` would give now. Settings are compared as they stand: both have to be
    /// told in full.
    pub fn differences(&self, training: &Training, wanted: &Wanted) -> Vec<Difference> {
        let seed = self.0["seed"].to_string();
        let mut differences = Vec::new();
        for (what, wanted, found) in [
            ("task", training.task.as_str(), self.text("task")),
            ("algorithm", &training.algorithm, self.text("algorithm")),
            ("seed", &training.seed.to_string(), &seed),
            ("preset", PRESET, self.text("preset")),
            ("reward", REWARD, self.text("reward")),
        ] {
            if wanted != found {
                let (wanted, found) = (wanted.to_string(), found.to_string());
                differences.push(Difference::Other { what, wanted, found });
            }
        }
        if self.text("layout_hash") != wanted.layout_hash {
            differences.push(Difference::Layout);
        } else if self.knows_task() && self.text("task_hash") != wanted.task_hash {
            differences.push(Difference::Task);
        }
        let keys = differing_keys(self.text("settings"), wanted.settings.as_deref().unwrap_or_default());
        if !keys.is_empty() {
            differences.push(Difference::Settings(keys));
        }
        let found = self.0["format_version"].as_u64().unwrap_or_default();
        let version = wanted.formats[self.text("kind")].as_u64().unwrap_or_default();
        if found != version {
            differences.push(Difference::Format { found, wanted: version });
        }
        differences
    }
}

/// SHA-256 of a file.
///
/// # Errors
/// If it cannot be read.
pub fn file_hash(path: &Path) -> Result<String> {
    let bytes = fs::read(path).with_context(|| path.display().to_string())?;
    Ok(Sha256::digest(&bytes).iter().map(|byte| format!("{byte:02x}")).collect())
}

/// Keys whose values differ, with those that only one of the two has.
fn differing_keys(found: &str, wanted: &str) -> Vec<String> {
    let (found, wanted) = (keys(found), keys(wanted));
    let all: std::collections::BTreeSet<&String> = found.keys().chain(wanted.keys()).collect();
    all.into_iter().filter(|key| found.get(*key) != wanted.get(*key)).cloned().collect()
}

/// The values of a TOML text as the program writes it: a key a line, tables under their names.
pub fn keys(toml: &str) -> BTreeMap<String, String> {
    let mut table = String::new();
    let mut keys = BTreeMap::new();
    for line in toml.lines() {
        if let Some(name) = line.strip_prefix('[').and_then(|rest| rest.strip_suffix(']')) {
            table = format!("{name}.");
        } else if let Some((key, value)) = line.split_once(" = ") {
            keys.insert(format!("{table}{key}"), value.to_string());
        }
    }
    keys
}

#[cfg(test)]
pub mod tests {
    use serde_json::json;

    use super::*;

    const SETTINGS: &str = "gamma = 0.99\n\n[run]\ntotal_steps = 2048\n";

    pub fn training() -> Training {
        Training { task: "point-reaching".to_string(), algorithm: "ppo".to_string(), seed: 0 }
    }

    pub fn wanted() -> Wanted {
        Wanted {
            settings: Some(SETTINGS.to_string()),
            task_hash: "aa".to_string(),
            layout_hash: "bb".to_string(),
            formats: json!({ "gaussian": 2, "squashed-gaussian": 3 }),
        }
    }

    /// What a training gives that was made as wanted.
    pub fn facts() -> Value {
        json!({
            "task": "point-reaching", "algorithm": "ppo", "seed": 0, "preset": "paper", "reward": "shaped",
            "task_hash": "aa", "layout_hash": "bb", "kind": "gaussian", "format_version": 2,
            "settings": SETTINGS, "command": "mishandle train", "git_commit": "c0ffee",
            "environment_steps": 1024, "wall_clock_secs": 1.5,
        })
    }

    /// A file with a controller's header, and no weights.
    pub fn write_header(path: &Path, facts: &Value) {
        let mut ours = json!({ "training": {}, "policy": { "kind": facts["kind"] } });
        for (key, value) in facts.as_object().unwrap() {
            let is_training =
                ["seed", "settings", "command", "git_commit", "environment_steps", "wall_clock_secs"];
            match is_training.contains(&key.as_str()) {
                true => ours["training"][key] = value.clone(),
                false => ours[key] = value.clone(),
            }
        }
        let json = json!({ "__metadata__": { "mishandle": ours.to_string() } }).to_string();
        let bytes = [&(json.len() as u64).to_le_bytes(), json.as_bytes()].concat();
        super::super::home::write(path, &bytes).unwrap();
    }

    #[track_caller]
    fn check(key: &str, value: Value, told: &[&str]) {
        let mut changed = facts();
        changed[key] = value;
        let found: Vec<String> =
            Facts(changed).differences(&training(), &wanted()).iter().map(ToString::to_string).collect();
        assert_eq!(found, told, "{key}");
    }

    #[test]
    fn each_fact_counts_and_is_named() {
        check("command", "another".into(), &[]);
        check("seed", 1.into(), &["its seed is 1, not 0"]);
        check("algorithm", "trpo".into(), &["its algorithm is trpo, not ppo"]);
        check("reward", "original".into(), &["its reward is original, not shaped"]);
        check("task_hash", "ab".into(), &["task changed"]);
        check("layout_hash", "ba".into(), &["task changed: observations or actions"]);
        check("format_version", 1.into(), &["format 1, now 2"]);
        check("kind", "squashed-gaussian".into(), &["format 2, now 3"]);
        let settings = "gamma = 0.99\nepochs = 5\n\n[run]\ntotal_steps = 4096\n";
        check("settings", settings.into(), &["settings changed: epochs, run.total_steps"]);
        // A file from before there was a hash says nothing against it.
        check("task_hash", "".into(), &[]);
    }

    #[test]
    fn a_header_tells_the_facts() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.safetensors");
        write_header(&path, &facts());
        let read = Facts::of_file(&path).unwrap();
        assert_eq!(read.differences(&training(), &wanted()), []);
        assert_eq!((read.text("command"), read.number("wall_clock_secs")), ("mishandle train", Some(1.5)));
        fs::write(&path, b"no controller").unwrap();
        assert!(format!("{:#}", Facts::of_file(&path).unwrap_err()).contains("cut short"));
    }
}
