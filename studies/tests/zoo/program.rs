//! The program `zoo` from outside.

use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};

use rustix::process::{Pid, Signal, kill_process};
use serde_json::Value;

/// Training settings of a run that takes long, with iterations that take no time.
const SETTINGS: &str = "rollout_steps = 16\nminibatch_size = 128\nepisodes.environments = 16\nrun.total_steps = 100_000_000\n\
                        run.validation_interval = 4\nrun.validation_episodes = 4\n";

/// The program in a repository.
struct Program {
    repository: PathBuf,
}

impl Program {
    fn command(&self, arguments: &str) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_studies"));
        command.arg("zoo").args(arguments.split_whitespace()).env("MISHANDLE_HOME", &self.repository);
        command.stdout(Stdio::piped()).stderr(Stdio::piped());
        command
    }

    fn run(&self, arguments: &str) -> Output {
        self.command(arguments).output().unwrap()
    }

    /// Runs the program, which must fail with a message that contains all `parts`.
    #[track_caller]
    fn refuses(&self, arguments: &str, parts: &[&str]) {
        let output = self.run(arguments);
        let words = text(&output.stderr);
        assert_eq!((output.status.code(), &output.stdout[..]), (Some(2), &b""[..]), "{arguments}: {words}");
        for part in parts {
            assert!(words.contains(part), "{arguments} does not print `{part}`:\n{words}");
        }
    }
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8(bytes.to_vec()).unwrap()
}

/// The program in this repository.
fn here() -> Program {
    Program { repository: Path::new(env!("CARGO_MANIFEST_DIR")).join("..") }
}

/// A repository whose PPO training run on one task takes long.
fn repository(folder: &Path) -> Program {
    let write = |name: &str, text: String| {
        let path = folder.join(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, text).unwrap();
    };
    write("controllers/training/point-reaching/ppo.toml", SETTINGS.to_string());
    let page = |names: &[&str]| -> String {
        names.iter().map(|name| format!("<!-- figures: {name} -->\n<!-- end of figures -->\n")).collect()
    };
    write("docs/reference/tasks.md", page(&["pictures", "tasks"]));
    let tables = ["summary", "controllers", "noise", "training", "curves"];
    write("controllers/README.md", page(&tables));
    Program { repository: folder.to_path_buf() }
}

#[test]
fn an_interrupted_training_run_leaves_a_checkpoint_and_exits_with_130() {
    let folder = tempfile::tempdir().unwrap();
    let zoo = repository(folder.path());
    let child = zoo.command("train --only point-reaching/ppo --jobs 1").spawn().unwrap();
    let checkpoint = folder.path().join("target/controllers/point-reaching-ppo.safetensors.checkpoint");
    let start = Instant::now();
    while !checkpoint.exists() {
        assert!(start.elapsed() < Duration::from_secs(60), "no checkpoint within a minute");
        std::thread::sleep(Duration::from_millis(5));
    }
    let second = text(&zoo.run("train --only point-reaching/ppo").stderr);
    assert!(second.contains("another `studies zoo` is running"), "{second}");
    kill_process(Pid::from_child(&child), Signal::INT).unwrap();
    let output = child.wait_with_output().unwrap();
    let words = text(&output.stderr);
    assert_eq!(output.status.code(), Some(130), "{words}");
    assert!(words.contains("interrupted after 0 of 1 job;"), "{words}");
    let listed = zoo.run("list --only point-reaching/ppo --json");
    let document: Value = serde_json::from_slice(&listed.stdout).unwrap();
    let entry = &document[0];
    assert_eq!((&entry["state"], &entry["reason"]), (&"interrupted".into(), &"no controller".into()));
    assert!(entry["checkpoint_environment_steps"].as_u64().unwrap() >= 256, "{entry}");
    assert!(
        std::fs::read_to_string(folder.path().join("docs/reference/tasks.md"))
            .unwrap()
            .contains("| `point-reaching` |")
    );
}

#[test]
fn an_empty_selection_and_an_unknown_subcommand_are_errors() {
    let zoo = here();
    zoo.refuses(
        "list --only ball-puhsing",
        &["--only is `ball-puhsing`; it must be TASK or TASK/CONTROLLER", "did you mean `ball-pushing`?"],
    );
    for flags in ["", "--json"] {
        zoo.refuses(
            &format!("list --only ball-pushing/expert {flags}"),
            &["an expert is not trained", "`studies zoo measure --only ball-pushing/expert` measures it"],
        );
    }
    zoo.refuses("lst", &["unrecognized subcommand 'lst'", "list"]);
    zoo.refuses("train --jobs 0", &["0 is not in 1..=1024"]);
}

#[test]
fn every_shipped_controller_of_the_repository_is_listed_with_its_success_rate() {
    let zoo = here();
    let document: Value = serde_json::from_slice(&zoo.run("list --json").stdout).unwrap();
    let entries = document.as_array().unwrap();
    assert_eq!(entries.len(), 40);
    for entry in entries {
        assert_eq!(entry["has_curve"], true, "{entry}");
        assert!(entry["success_rate"].as_f64().unwrap() > 0.8, "{entry}");
        // Everything that is not done says why.
        assert_eq!(entry["reason"].is_null(), entry["state"] == "done", "{entry}");
    }
}
