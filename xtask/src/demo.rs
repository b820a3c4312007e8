//! `cargo xtask demo`: from a fresh clone to a falsified controller.

use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Instant;

use anyhow::{Context, Result, ensure};

use crate::process::{as_typed, cargo};
use crate::{mujoco, progress};

const PROGRAM: &str = "target/demo/mishandle";
/// Builds the program without the parts that take long to build and that a first use does not need.
const BUILD: &[&str] = &["build", "--profile", "demo", "--package", "mishandle-cli", "--no-default-features"];
/// Falsifies a shipped controller in its first simulation.
const FALSIFY: &[&str] =
    &["falsify", "ball-balancing", "--controller", "ppo", "--space", "delay", "--trials", "2"];
/// Reason for this test.
const WHY: &str = "The shipped controller satisfies the formula from all of 1,000 random starts (controllers/README.md). \
                   Its observations and actions arrive at once there. Here they may be up to 3 control steps late.";
/// The demo must find a counterexample: exit code 1.
const EXPECTED: i32 = 1;
/// Commands to try next, with their purpose.
const NEXT: &[(&str, &str)] = &[
    ("list tasks", "lists the tasks with their formulas and controllers"),
    ("evaluate ball-balancing --controller ppo", "measures success rate and dangerous behavior rate"),
    ("help", "lists all commands"),
];

/// Fetches MuJoCo, builds, falsifies a shipped controller, and suggests commands to try next.
///
/// # Errors
/// If a step fails.
pub fn demo(root: &Path) -> Result<()> {
    let started = Instant::now();
    mujoco::fetch(root)?;
    let mut build = cargo(root, BUILD);
    eprintln!("\n$ {}     (the first time takes some minutes)", as_typed(&build));
    progress::run(&mut build)?;
    eprintln!("\n{WHY}\n\n$ {PROGRAM} {}", FALSIFY.join(" "));
    falsify(root)?;

    eprintln!("\nDone in {:.0} s. Files:", started.elapsed().as_secs_f64());
    for (place, what) in [
        ("target/mujoco/lib", "MuJoCo's library"),
        (PROGRAM, "the program"),
        ("runs/", "the run files with every simulation"),
    ] {
        eprintln!("  {place:<26} {what}");
    }
    eprintln!(
        "This program is built in little time, and runs slower than others. It reads no ONNX files, \
         writes no Parquet, and has no `render`. `cargo build --release` builds the whole."
    );
    eprintln!("Commands to try next, in this folder:");
    for (arguments, what) in NEXT {
        eprintln!("  {PROGRAM} {arguments:<42} {what}");
    }
    Ok(())
}

/// Runs the program, whose messages name it as a user of this folder must type it.
fn falsify(root: &Path) -> Result<()> {
    let mut command = Command::new(root.join(PROGRAM));
    command.args(FALSIFY).current_dir(root).stderr(Stdio::piped());
    let mut child = command.spawn().with_context(|| format!("cannot run {PROGRAM}"))?;
    for line in BufReader::new(child.stderr.take().context("the program has no stderr")?).lines() {
        eprintln!("{}", with_path(&line?));
    }
    let status = child.wait()?;
    ensure!(status.code() == Some(EXPECTED), "`{PROGRAM} {}` ended with {status}", FALSIFY.join(" "));
    Ok(())
}

/// Gives the commands in a message the path of the program, which is not on PATH.
fn with_path(message: &str) -> String {
    [": ", "`"].iter().fold(message.to_string(), |text, before| {
        text.replace(&format!("{before}mishandle "), &format!("{before}{PROGRAM} "))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn commands_in_messages_have_the_path_of_the_program() {
        for (message, expected) in [
            (
                "Replay the first counterexample: mishandle replay runs/a.sqlite",
                "Replay the first counterexample: target/demo/mishandle replay runs/a.sqlite",
            ),
            ("see `mishandle list`", "see `target/demo/mishandle list`"),
            ("Run file: runs/mishandle a.sqlite", "Run file: runs/mishandle a.sqlite"),
        ] {
            assert_eq!(with_path(message), expected);
        }
    }
}
