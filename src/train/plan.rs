use std::path::{Path, PathBuf};

use crate::{MishandleError, shell_quote};

/// What to train.
#[derive(Clone, Debug, PartialEq)]
pub struct TrainPlan {
    /// Name of the task.
    pub task: String,
    /// Name of the algorithm.
    pub algorithm: String,
    /// Name of the reward: `original` or `shaped`.
    pub reward: String,
    /// The settings file, or the name of a settings preset; without one, and for `best`, the shipped settings of the task
    /// and algorithm, or the algorithm's defaults if none are shipped.
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
            command += &format!(" --settings {}", shell_quote(&settings.to_string_lossy()));
        }
        if let Some(steps) = self.steps {
            command += &format!(" --steps {steps}");
        }
        command + &format!(" --seed {}", self.seed)
    }

    /// The command line that does the same again, files and all.
    pub fn whole_command(&self) -> String {
        let flags = [("--out", Some(&self.out)), ("--csv", self.csv.as_ref())];
        let flags = flags.into_iter().chain([("--tensorboard", self.tensorboard.as_ref())]);
        let flags = flags.filter_map(|(flag, path)| Some((flag, shell_quote(&path?.to_string_lossy()))));
        let places: String = flags.map(|(flag, word)| format!(" {flag} {word}")).collect();
        self.command() + &places + if self.resume { " --resume" } else { "" }
    }

    /// The command line that carries on.
    pub fn resuming_command(&self) -> String {
        TrainPlan { resume: true, ..self.clone() }.whole_command()
    }

    /// What is written where: its name, the place, and the flag that says it.
    fn places(&self) -> Vec<(&'static str, PathBuf, &'static str)> {
        let own = [
            ("the best controller", self.out.clone(), "--out"),
            ("the last controller", self.last(), "--out"),
            ("the checkpoint", self.checkpoint(), "--out"),
        ];
        let csv = self.csv.clone().map(|path| ("the curve", path, "--csv"));
        let events = self.tensorboard.clone().map(|path| ("the event files", path, "--tensorboard"));
        own.into_iter().chain(csv).chain(events).collect()
    }

    /// Checks that no two things go to one place.
    pub(super) fn check_places(&self) -> Result<(), MishandleError> {
        let places = self.places();
        for (at, (second, path, flag)) in places.iter().enumerate() {
            let same = places[..at].iter().find(|(_, other, _)| resolved(other) == resolved(path));
            if let Some((first, ..)) = same {
                return Err(MishandleError::SamePath { path: path.clone(), first, second, flag });
            }
        }
        Ok(())
    }

    /// Checks that nothing is in the way of what is to be written, and that what is to be carried on is there. The
    /// folder of event files may be there already; they look for themselves.
    pub(super) fn check_presence(&self) -> Result<(), MishandleError> {
        if self.resume {
            let path = self.checkpoint();
            return if path.exists() { Ok(()) } else { Err(MishandleError::NoCheckpoint { path }) };
        }
        let files = self.places().into_iter().filter(|(.., flag)| *flag != "--tensorboard");
        match files.into_iter().find(|(_, path, _)| path.exists()) {
            Some((_, path, flag)) => Err(MishandleError::Exists { path, flag }),
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

/// A path without links and detours, as far as it is there.
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
    fn no_two_things_go_to_one_place() {
        let check = |csv: &str, board: &str| {
            let places = (Some(csv.into()), Some(board.into()));
            let plan = TrainPlan { csv: places.0, tensorboard: places.1, ..plan("a.safetensors") };
            plan.check_places().map_err(|error| error.to_string())
        };
        assert_eq!(check("a.csv", "board"), Ok(()));
        for (csv, told) in [
            ("a.safetensors", "a.safetensors would hold both the best controller and the curve"),
            ("./a.last.safetensors", "the last controller and the curve; give another --csv"),
            ("src/../a.safetensors.checkpoint", "the checkpoint and the curve; give another --csv"),
            ("board/", "board would hold both the curve and the event files; give another --tensorboard"),
        ] {
            let refused = check(csv, "board").unwrap_err();
            assert!(refused.contains(told), "{refused}");
        }
    }

    #[cfg(unix)]
    #[test]
    fn one_place_under_two_names_is_found_out() {
        let folder = tempfile::tempdir().unwrap();
        std::os::unix::fs::symlink(folder.path(), folder.path().join("link")).unwrap();
        let inside = |name: &str| folder.path().join(name);
        assert_eq!(resolved(&inside("link/link/new/a")), resolved(&inside("new/a")));
        assert_ne!(resolved(&inside("link/a")), resolved(&inside("b")));
    }
}
