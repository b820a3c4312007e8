//! `cargo xtask demo`: from a fresh clone to a falsified controller.

use std::path::Path;
use std::process::Command;
use std::time::Instant;

use anyhow::Result;

use crate::mujoco;
use crate::process::{as_typed, cargo, run};

const PROGRAM: &str = "target/release/mishandle";
/// Builds the program without the parts that take long to build and that a first use does not need.
const BUILD: &[&str] =
    &["build", "--release", "--package", "mishandle-cli", "--no-default-features", "--features", "render"];
/// Falsifies a shipped controller within a minute.
const FALSIFY: &[&str] = &[
    "falsify",
    "ball-balancing",
    "--controller",
    "ppo",
    "--formula",
    "strict",
    "--action-noise",
    "0.5",
    "--trials",
    "3",
    "--seed",
    "1",
];
/// Reason for this test.
const WHY: &str = "The shipped controller satisfies the paper's formula from all of 1,000 random starts (controllers/README.md). \
                   We therefore test it against the strict formula: the ball must stay on the tray and reach its center. \
                   The actions have the paper's noise.";
/// The demo must find a counterexample: exit code 1.
const EXPECTED: &[i32] = &[1];
/// Commands to try next, with their purpose.
const NEXT: &[(&str, &str)] = &[
    ("tasks", "lists the tasks with their formulas and controllers"),
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
    eprintln!("\n$ {}     (the first time takes a few minutes)", as_typed(&build));
    run(&mut build, &[0])?;
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
        "This program reads no ONNX files and writes no Parquet; `cargo build --release` builds one that does."
    );
    eprintln!("Commands to try next, in this folder:");
    for (arguments, what) in NEXT {
        eprintln!("  {PROGRAM} {arguments:<42} {what}");
    }
    Ok(())
}
