use std::path::{Path, PathBuf};

use mishandle_results::{Key, Remedy};
use mishandle_text::{path_text, shell_quote};
use mishandle_training::AxisSetting;

use crate::error::{MishandleError, exists, invalid, problem};
use crate::plan::{CPU, GuardPlan, TrainPlan};
use crate::resolve::{TrainingTarget, default_reward, is_target_file, training_target};
use crate::train::curve::has_no_rows;

/// Extension of controller files.
const EXTENSION: &str = "safetensors";

impl TrainPlan {
    /// Returns the target of the training run.
    pub(super) fn target(&self) -> Result<Box<dyn TrainingTarget>, MishandleError> {
        training_target(&self.task, &self.device)
    }

    /// Returns the file of the last controller: that of the best one, with `.last` before its
    /// extension.
    pub fn last(&self) -> PathBuf {
        let mut name = self.out.file_stem().unwrap_or_default().to_os_string();
        name.push(".last");
        if let Some(extension) = self.out.extension() {
            name.push(".");
            name.push(extension);
        }
        self.out.with_file_name(name)
    }

    /// Returns the file of the checkpoint.
    pub fn checkpoint(&self) -> PathBuf {
        with_suffix(&self.out, ".checkpoint")
    }

    /// Returns the command line of this training run, without output files.
    pub fn command(&self) -> String {
        let mut command =
            format!("mishandle train {} --algorithm {}", shell_quote(&self.task), self.algorithm);
        let mut key = |name: &str, value: &str| {
            command += &format!(" -k {}", shell_quote(&format!("{name}={value}")));
        };
        if self.reward != default_reward(&self.task) {
            key("train.reward", &self.reward);
        }
        if self.device != CPU {
            key("train.device", &self.device);
        }
        for (name, value) in self.guard.iter().flat_map(changed_keys) {
            key(&format!("guard.{name}"), &value);
        }
        if let Some(settings) = &self.settings {
            command += &format!(" --settings {}", shell_quote(&path_text(settings)));
        }
        if let Some(from) = &self.from {
            command += &format!(" --from {}", shell_quote(from));
        }
        if let Some(steps) = self.steps {
            command += &format!(" --steps {steps}");
        }
        if let Some(space) = &self.space {
            command += &format!(" --space {}", shell_quote(space));
        }
        for (name, setting) in &self.axes {
            let value = match setting {
                AxisSetting::Value(value) => value.to_string(),
                AxisSetting::Range([low, high]) => format!("{low}:{high}"),
                AxisSetting::Text(text) => text.clone(),
            };
            command += &format!(" --axis {}", shell_quote(&format!("{name}={value}")));
        }
        command + &format!(" --seed {}", self.seed)
    }

    /// Returns the command line of this training run, with output files.
    pub fn full_command(&self) -> String {
        let flags = [("--out", Some(&self.out)), ("--csv", self.csv.as_ref())];
        let flags = flags.into_iter().chain([("--tensorboard", self.tensorboard.as_ref())]);
        let flags = flags.filter_map(|(flag, path)| Some((flag, shell_quote(&path_text(path?)))));
        let outputs: String = flags.map(|(flag, word)| format!(" {flag} {word}")).collect();
        self.command() + &outputs + if self.resume { " --resume" } else { "" }
    }

    /// Returns the command line that resumes this training run.
    pub fn resume_command(&self) -> String {
        TrainPlan { resume: true, ..self.clone() }.full_command()
    }

    /// Returns the outputs: name, path and key of each.
    fn outputs(&self) -> Vec<(&'static str, PathBuf, Key)> {
        let own = [
            ("the best controller", self.out.clone(), Key::OUT),
            ("the last controller", self.last(), Key::OUT),
            ("the checkpoint", self.checkpoint(), Key::OUT),
        ];
        let csv = self.csv.clone().map(|path| ("the curve", path, Key::CURVE));
        let events = self.tensorboard.clone().map(|path| ("the event files", path, Key::EVENTS));
        own.into_iter().chain(csv).chain(events).collect()
    }

    /// Checks that the controller gets the extension by which other commands and tools recognize
    /// it.
    pub(super) fn check_extension(&self) -> Result<(), MishandleError> {
        if self.out.extension().is_some_and(|extension| extension == EXTENSION) {
            Ok(())
        } else {
            Err(invalid("the output file", path_text(&self.out), "a path that ends in .safetensors"))
        }
    }

    /// Checks that all outputs have different paths.
    pub(super) fn check_distinct_outputs(&self) -> Result<(), MishandleError> {
        let outputs = self.outputs();
        for (index, (second, path, key)) in outputs.iter().enumerate() {
            let same = outputs[..index].iter().find(|(_, other, _)| resolved(other) == resolved(path));
            if let Some((first, ..)) = same {
                let text = format!("{} is the path of both {first} and {second}", path.display());
                return Err(problem(text).with(Remedy::Another(*key)));
            }
        }
        Ok(())
    }

    /// Checks that no output file exists, or that the checkpoint to resume from exists. The folder
    /// of event files may exist; the event file has its own check.
    pub(super) fn check_existing_files(&self) -> Result<(), MishandleError> {
        if self.resume {
            let path = self.checkpoint();
            if path.exists() {
                return Ok(());
            }
            let text = format!("there is no checkpoint {} to resume from", path.display());
            let again =
                Remedy::Unset(Key::RESUME).when("it starts again, after the output files are deleted");
            return Err(problem(text).with(again));
        }
        let files = self.outputs().into_iter().filter(|(.., key)| *key != Key::EVENTS);
        // A run that was killed in its first iteration left it.
        let is_started = |path: &Path| path.exists() && !has_no_rows(path);
        let is_taken =
            |path: &Path, key: Key| if key == Key::CURVE { is_started(path) } else { path.exists() };
        match files.into_iter().find(|(_, path, key)| is_taken(path, *key)) {
            Some((_, path, key)) => Err(exists(&path, key)),
            None => Ok(()),
        }
    }
}

/// Returns the keys of a guard without the defaults, each with its value on a command line.
fn changed_keys(guard: &GuardPlan) -> Vec<(String, String)> {
    let [given, default] =
        [guard, &GuardPlan::default()].map(|guard| toml::Table::try_from(guard).unwrap_or_default());
    let changed = given.into_iter().filter(|(key, value)| default.get(key) != Some(value));
    let text = |value: toml::Value| value.as_str().map_or_else(|| value.to_string(), str::to_string);
    changed.map(|(key, value)| (key, text(value))).collect()
}

/// Returns the default file of a trained controller.
pub fn default_out(task: &str, algorithm: &str, seed: u64) -> PathBuf {
    let task = match Path::new(task).file_stem().filter(|_| is_target_file(task)) {
        Some(stem) => stem.to_string_lossy(),
        None => task.into(),
    };
    Path::new("runs").join(format!("{task}-{algorithm}-s{seed}.safetensors"))
}

/// Appends a suffix to a path.
pub(super) fn with_suffix(path: &Path, suffix: &str) -> PathBuf {
    let mut name = path.to_path_buf().into_os_string();
    name.push(suffix);
    name.into()
}

/// Resolves symbolic links and `..` in the existing part of a path.
fn resolved(path: &Path) -> PathBuf {
    let path = std::path::absolute(path).unwrap_or_else(|_| path.to_path_buf());
    let mut found = path
        .ancestors()
        .filter_map(|part| Some(part.canonicalize().ok()?.join(path.strip_prefix(part).ok()?)));
    found.next().unwrap_or_else(|| path.clone())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plan(out: &str) -> TrainPlan {
        TrainPlan {
            task: "point-reaching".to_string(),
            algorithm: "ppo".to_string(),
            reward: "shaped".to_string(),
            seed: 3,
            out: out.into(),
            ..TrainPlan::default()
        }
    }

    #[test]
    fn the_last_controller_is_written_beside_the_best() {
        for (out, last) in [
            ("runs/a.safetensors", "runs/a.last.safetensors"),
            ("a.v2.safetensors", "a.v2.last.safetensors"),
            ("folder.d/a", "folder.d/a.last"),
        ] {
            assert_eq!(plan(out).last(), Path::new(last));
        }
    }

    #[test]
    fn an_output_with_another_extension_is_an_error() {
        assert!(plan("a.safetensors").check_extension().is_ok());
        for out in ["x.txt", "a", "a.safetensors.old", ".safetensors", "a.SafeTensors"] {
            let error = plan(out).check_extension().unwrap_err().to_string();
            assert_eq!(
                error,
                format!("the output file is {out}; it must be a path that ends in .safetensors")
            );
        }
    }

    #[test]
    fn the_resume_command_names_the_same_files() {
        let mut plan = plan("my runs/a.safetensors");
        assert_eq!(
            plan.resume_command(),
            "mishandle train point-reaching --algorithm ppo --seed 3 --out 'my runs/a.safetensors' --resume"
        );
        plan.csv = Some("a.csv".into());
        plan.tensorboard = Some("board".into());
        assert!(plan.resume_command().ends_with(" --csv a.csv --tensorboard board --resume"));
    }

    #[test]
    fn the_command_states_what_has_no_flag_by_keys() {
        let guard = GuardPlan {
            formula: "abs(angle) <= 0.1".to_string(),
            fallback: "expert".to_string(),
            threshold: f64::NEG_INFINITY,
            ..GuardPlan::default()
        };
        let plan = TrainPlan { reward: "original".to_string(), guard: Some(guard), ..plan("a.safetensors") };
        assert_eq!(
            plan.command(),
            "mishandle train point-reaching --algorithm ppo -k train.reward=original -k guard.fallback=expert \
             -k 'guard.formula=abs(angle) <= 0.1' -k guard.threshold=-inf --seed 3"
        );
    }

    #[test]
    fn outputs_with_equal_paths_are_an_error() {
        let check = |csv: &str, board: &str| {
            let plan =
                TrainPlan { csv: Some(csv.into()), tensorboard: Some(board.into()), ..plan("a.safetensors") };
            plan.check_distinct_outputs().map_err(|error| (error.to_string(), error.remedies()))
        };
        assert_eq!(check("a.csv", "board"), Ok(()));
        for (csv, expected, key) in [
            (
                "a.safetensors",
                "a.safetensors is the path of both the best controller and the curve",
                Key::CURVE,
            ),
            ("./a.last.safetensors", "the last controller and the curve", Key::CURVE),
            ("src/../a.safetensors.checkpoint", "the checkpoint and the curve", Key::CURVE),
            ("board/", "board is the path of both the curve and the event files", Key::EVENTS),
        ] {
            let (text, remedies) = check(csv, "board").unwrap_err();
            assert!(text.ends_with(expected), "{text}");
            assert_eq!(remedies, [Remedy::Another(key)]);
        }
    }

    #[cfg(unix)]
    #[test]
    fn a_path_through_a_symbolic_link_is_resolved() {
        let folder = tempfile::tempdir().unwrap();
        std::os::unix::fs::symlink(folder.path(), folder.path().join("link")).unwrap();
        let inside = |name: &str| folder.path().join(name);
        assert_eq!(resolved(&inside("link/link/new/a")), resolved(&inside("new/a")));
        assert_ne!(resolved(&inside("link/a")), resolved(&inside("b")));
    }
}
