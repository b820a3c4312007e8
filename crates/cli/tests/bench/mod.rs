//! Runs the program in a temporary folder.

use std::path::PathBuf;
use std::process::{Child, Command, Output};

use rustix::process::{Pid, Signal, kill_process};
use serde_json::Value;

/// A temporary folder to run the program in.
pub struct Bench {
    folder: tempfile::TempDir,
}

impl Bench {
    pub fn new() -> Bench {
        Bench { folder: tempfile::tempdir().unwrap() }
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    pub fn write(&self, name: &str, text: &str) {
        std::fs::write(self.path(name), text).unwrap();
    }

    pub fn command(&self, arguments: &str) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_mishandle"));
        command.args(words(arguments)).current_dir(self.folder.path());
        command
    }

    pub fn run(&self, arguments: &str) -> Output {
        self.command(arguments).output().unwrap()
    }

    /// Runs the program, which must exit with `code`, and returns stdout.
    #[track_caller]
    pub fn check(&self, arguments: &str, code: i32) -> String {
        let output = self.run(arguments);
        let out = text(&output.stdout);
        let err = text(&output.stderr);
        assert_eq!(output.status.code(), Some(code), "mishandle {arguments}\n{out}\n{err}");
        out
    }

    /// Returns the JSON document on stdout without the path of the run file, which differs between
    /// runs.
    #[track_caller]
    pub fn document(&self, arguments: &str, code: i32) -> Value {
        without_run(self.json(arguments, code))
    }

    #[track_caller]
    pub fn json(&self, arguments: &str, code: i32) -> Value {
        serde_json::from_str(&self.check(arguments, code)).unwrap()
    }

    /// Runs the program, which must fail with a message that contains all `parts`.
    #[track_caller]
    pub fn refuses(&self, arguments: &str, parts: &[&str]) {
        let output = self.run(arguments);
        let err = text(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "mishandle {arguments}\n{err}");
        assert!(output.stdout.is_empty(), "{}", text(&output.stdout));
        for part in parts {
            assert!(err.contains(part), "mishandle {arguments} does not print `{part}`:\n{err}");
        }
    }
}

pub fn text(bytes: &[u8]) -> String {
    String::from_utf8(bytes.to_vec()).unwrap()
}

/// Returns a wrapped text on one line, with single spaces.
pub fn unwrapped(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}

/// Returns messages without those that say what a question costs.
pub fn without_costs(messages: &str) -> String {
    let is_cost = |line: &&str| {
        line.starts_with("at most ") || (line.starts_with("after ") && line.contains(": about "))
    };
    messages.split_inclusive('\n').filter(|line| !is_cost(line)).collect()
}

/// Removes the path of the run file from a JSON document.
pub fn without_run(mut document: Value) -> Value {
    document.as_object_mut().unwrap().remove("run").unwrap();
    document
}

/// Splits at spaces outside of single quotes.
fn words(arguments: &str) -> Vec<String> {
    let parts = arguments.split('\'').enumerate();
    parts
        .flat_map(|(i, part)| match i % 2 {
            0 => part.split_whitespace().map(String::from).collect::<Vec<_>>(),
            _ => vec![part.to_string()],
        })
        .collect()
}

/// Returns whether `ssh-keygen` is there. Without it, the test says that it is skipped, or fails
/// with `MISHANDLE_TEST_ALL=1`.
pub fn has_ssh_keygen() -> bool {
    let is_there = Command::new("ssh-keygen").arg("-?").output().is_ok();
    if !is_there {
        let needs = "signatures need ssh-keygen: apt install openssh-client";
        assert!(std::env::var("MISHANDLE_TEST_ALL").as_deref() != Ok("1"), "{needs}");
        eprintln!("skipped: {}: {needs}", std::thread::current().name().unwrap_or_default());
    }
    is_there
}

/// Runs `ssh-keygen`, which must succeed, with the file `input` as standard input.
#[track_caller]
pub fn keygen(bench: &Bench, arguments: &[&str], input: &str) -> String {
    let mut command = Command::new("ssh-keygen");
    command.args(arguments).current_dir(bench.path(""));
    if !input.is_empty() {
        command.stdin(std::fs::File::open(bench.path(input)).unwrap());
    }
    let output = command.output().unwrap();
    assert!(output.status.success(), "{arguments:?}: {}", text(&output.stderr));
    text(&output.stdout)
}

/// Sends the signal with this name.
pub fn signal(child: &Child, name: &str) {
    let signals =
        [("HUP", Signal::HUP), ("INT", Signal::INT), ("KILL", Signal::KILL), ("TERM", Signal::TERM)];
    let signal = signals.into_iter().find_map(|(known, signal)| (known == name).then_some(signal));
    kill_process(Pid::from_child(child), signal.unwrap()).unwrap();
}

/// Training settings with which an iteration takes no time.
pub const SMALL: &str = "rollout_steps = 16\nminibatch_size = 128\nepisodes.environments = 16\nrun.total_steps = 2048\n\
                     run.validation_interval = 4\nrun.validation_episodes = 4\n";
