//! `cargo xtask demo`: from a fresh clone to a falsified controller.

use std::path::Path;
use std::process::Command;
use std::time::Instant;

use anyhow::Result;

use crate::process::{as_typed, cargo, run};
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
const EXPECTED: &[i32] = &[1];
/// Commands to try next, with their purpose.
const NEXT: &[(&str, &str)] = &[
    ("list tasks", "lists the tasks with their formulas and controllers"),
    ("evaluate ball-balancing --controller ppo", "measures success rate and dangerous behavior rate"),
    ("replay RUN", "repeats a recorded simulation, bit for bit"),
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
    run(Command::new(root.join(PROGRAM)).args(FALSIFY).current_dir(root), EXPECTED)?;

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
         writes no Parquet, and has no `render` and `view`. `cargo build --release` builds the whole."
    );
    eprintln!("Commands to try next, in this folder:");
    for (arguments, what) in NEXT {
        eprintln!("  {PROGRAM} {arguments:<42} {what}");
    }
    Ok(())
}
