use std::path::{Path, PathBuf};

use crate::{MishandleError, shell_word};

/// What to train.
#[derive(Clone, Debug, PartialEq)]
pub struct TrainPlan {
    /// Name of the task.
    pub task: String,
    /// Name of the algorithm.
    pub algorithm: String,
    /// Name of the reward: `original` or `shaped`.
    pub reward: String,
    /// The settings file, or the name of a settings preset; without one, and for `best`, the file of the task and
    /// algorithm in `experiments/training/`.
    pub settings: Option<PathBuf>,
    /// Environment steps, if others than the settings say.
    pub steps: Option<u64>,
    /// Seed of everything random.
    pub seed: u64,
    /// Where the best controller goes; the last one and the checkpoint go beside it.
    pub out: PathBuf,
    /// Where the training's curve goes, if anywhere.
    pub csv: Option<PathBuf>,
    /// The folder of the event files for TensorBoard, if any are wanted.
    pub tensorboard: Option<PathBuf>,
    /// Whether to carry on from the checkpoint.
    pub resume: bool,
}

impl TrainPlan {
    /// Where the last controller goes: the name of the best one's file, with `.last` before its extension.
    pub fn last(&self) -> PathBuf {
        let mut name = self.out.file_stem().unwrap_or_default().to_os_string();
        name.push(".last");
        if let Some(extension) = self.out.extension() {
            name.push(".");
            name.push(extension);
        }
        self.out.with_file_name(name)
    }

    /// Where the checkpoint is.
    pub fn checkpoint(&self) -> PathBuf {
        with_ending(&self.out, ".checkpoint")
    }

    /// The command line that does the same again, but for where things go.
    pub fn command(&self) -> String {
        let mut command = format!("mishandle train {} --algorithm {}", self.task, self.algorithm);
        if self.reward != "shaped" {
            command += &format!(" --reward {}", self.reward);
        }
        if let Some(settings) = &self.settings {
            command += &format!(" --settings {}", shell_word(&settings.to_string_lossy()));
        }
        if let Some(steps) = self.steps {
            command += &format!(" --steps {steps}");
        }
        command + &format!(" --seed {}", self.seed)
    }

    /// The command line that carries on.
    pub fn resuming_command(&self) -> String {
        let flags = [("--out", Some(&self.out)), ("--csv", self.csv.as_ref())];
        let flags = flags.into_iter().chain([("--tensorboard", self.tensorboard.as_ref())]);
        let flags = flags.filter_map(|(flag, path)| Some((flag, shell_word(&path?.to_string_lossy()))));
        let places: String = flags.map(|(flag, word)| format!(" {flag} {word}")).collect();
        format!("{}{places} --resume", self.command())
    }

    /// Checks that nothing is in the way of what is to be written, and that no two things go to one place.
    pub(super) fn check_places(&self) -> Result<(), MishandleError> {
        let (last, checkpoint) = (self.last(), self.checkpoint());
        let own = [("--out", &self.out), ("--out", &last), ("--out", &checkpoint)];
        let all = own.into_iter().chain(self.csv.as_ref().map(|csv| ("--csv", csv)));
        if self.resume && !checkpoint.exists() {
            return Err(MishandleError::NoCheckpoint { path: checkpoint.clone() });
        }
        for (flag, path) in all {
            if !self.resume && path.exists() {
                return Err(MishandleError::Exists { path: path.clone(), flag });
            }
        }
        let same = |other: &Path| self.csv.as_ref().is_some_and(|csv| absolute(csv) == absolute(other));
        match own.into_iter().find(|(_, path)| same(path)) {
            Some((_, path)) => Err(MishandleError::SamePlace { path: path.clone() }),
            None => Ok(()),
        }
    }
}

/// Where a training puts its controller if nothing else is said.
pub fn default_out(task: &str, algorithm: &str, seed: u64) -> PathBuf {
    Path::new("runs").join(format!("{task}-{algorithm}-s{seed}.safetensors"))
}

/// A path with this at its end.
pub(super) fn with_ending(path: &Path, ending: &str) -> PathBuf {
    let mut name = path.to_path_buf().into_os_string();
    name.push(ending);
    name.into()
}

fn absolute(path: &Path) -> PathBuf {
    std::path::absolute(path).unwrap_or_else(|_| path.to_path_buf())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plan(out: &str) -> TrainPlan {
        TrainPlan {
            task: "point-reaching".to_string(),
            algorithm: "ppo".to_string(),
            reward: "shaped".to_string(),
            settings: None,
            steps: None,
            seed: 3,
            out: out.into(),
            csv: None,
            tensorboard: None,
            resume: false,
        }
    }

    #[test]
    fn the_last_controller_goes_beside_the_best() {
        for (out, last) in [
            ("runs/a.safetensors", "runs/a.last.safetensors"),
            ("a.v2.safetensors", "a.v2.last.safetensors"),
            ("folder.d/a", "folder.d/a.last"),
        ] {
            assert_eq!(plan(out).last(), Path::new(last));
        }
    }

    #[test]
    fn a_stopped_training_carries_on_with_the_same_files() {
        let mut plan = plan("my runs/a.safetensors");
        assert_eq!(
            plan.resuming_command(),
            "mishandle train point-reaching --algorithm ppo --seed 3 --out 'my runs/a.safetensors' --resume"
        );
        plan.csv = Some("a.csv".into());
        plan.tensorboard = Some("board".into());
        assert!(plan.resuming_command().ends_with(" --csv a.csv --tensorboard board --resume"));
    }

    #[test]
    fn a_curve_does_not_go_where_another_file_does() {
        for csv in ["a.safetensors", "./a.last.safetensors", "a.safetensors.checkpoint"] {
            let plan = TrainPlan { csv: Some(csv.into()), ..plan("a.safetensors") };
            assert!(matches!(plan.check_places(), Err(MishandleError::SamePlace { .. })), "{csv}");
        }
        let plan = TrainPlan { csv: Some("a.csv".into()), ..plan("a.safetensors") };
        assert!(plan.check_places().is_ok());
    }
}
