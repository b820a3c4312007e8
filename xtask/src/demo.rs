//! `cargo xtask demo`: from a fresh clone to a falsified controller.

use std::path::Path;
use std::process::Command;
use std::time::Instant;

use anyhow::Result;

use crate::mujoco;
use crate::process::{cargo, run};

const PROGRAM: &str = "target/release/mishandle";
/// Breaks a shipped controller, within a minute.
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
/// Why it is broken in this way.
const WHY: &str = "The shipped controller meets the paper's formula from every start that we tried. So it is put to a \
                   harder test: the strict formula (the ball stays on the tray and comes to its middle), with the \
                   paper's noise on its actions.";
/// Falsified: a demo without a counterexample would be none.
const EXPECTED: &[i32] = &[1];
/// What to type next, and why.
const NEXT: &[(&str, &str)] = &[
    ("tasks", "the tasks, their formulas and the controllers that come with them"),
    ("evaluate ball-balancing --controller ppo", "how good and how safe that controller is"),
    ("replay RUN", "a recorded simulation again, the same to the bit"),
    ("help", "everything else"),
];

/// Fetches MuJoCo, builds, falsifies a shipped controller, and says what to do next.
///
/// # Errors
/// What the steps say.
pub fn demo(root: &Path) -> Result<()> {
    let started = Instant::now();
    mujoco::fetch(root)?;
    eprintln!("\n$ cargo build --release     (the first time takes a few minutes)");
    run(&mut cargo(root, &["build", "--release"]), &[0])?;
    eprintln!("\n{WHY}\n\n$ {PROGRAM} {}", FALSIFY.join(" "));
    run(Command::new(root.join(PROGRAM)).args(FALSIFY).current_dir(root), EXPECTED)?;

    eprintln!("\nDone in {:.0} s. What is where:", started.elapsed().as_secs_f64());
    for (place, what) in [
        ("target/mujoco/lib", "MuJoCo's library"),
        (PROGRAM, "the program"),
        ("runs/", "the run, with every simulation; the program named its file above"),
    ] {
        eprintln!("  {place:<26} {what}");
    }
    eprintln!("What to type next, in this folder:");
    for (arguments, what) in NEXT {
        eprintln!("  {PROGRAM} {arguments:<42} {what}");
    }
    Ok(())
}
