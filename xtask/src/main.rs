//! Chores around the build, in Rust so that they need nothing but the toolchain: `cargo xtask` lists them.
//!
//! Depends on no crate of ours and not on MuJoCo, since fetching MuJoCo is one of the chores.

mod check;
mod controllers;
mod demo;
mod external;
mod golden;
mod marks;
mod mujoco;
mod pictures;
mod process;
mod readme;
mod settings;
mod tidy;

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Result, bail};

/// One thing that `cargo xtask` can do.
struct Chore {
    name: &'static str,
    /// What may follow the name, as shown to the user; empty if nothing may.
    arguments: &'static str,
    about: &'static str,
    run: fn(root: &Path, arguments: &[String]) -> Result<()>,
}

const CHORES: &[Chore] = &[
    Chore {
        name: "demo",
        arguments: "",
        about: "fetch MuJoCo, build, break a shipped controller, say what to do next",
        run: |root, _| demo::demo(root),
    },
    Chore {
        name: "test",
        arguments: "",
        about: "everything CI runs: fmt, tidy, clippy, tests, doc tests, python, readme",
        run: |root, _| check::check(root),
    },
    Chore {
        name: "mujoco",
        arguments: "",
        about: "put MuJoCo's library into target/mujoco/lib (from PyPI, its SHA-256 checked)",
        run: |root, _| mujoco::fetch(root),
    },
    Chore {
        name: "tidy",
        arguments: "",
        about: "compare ARCHITECTURE.md and the page of settings with the crates; check rules and links",
        run: |root, _| tidy::check(root),
    },
    Chore {
        name: "readme",
        arguments: "",
        about: "run the commands that README.md shows",
        run: |root, _| readme::check(root),
    },
    Chore {
        name: "external",
        arguments: "",
        about: "build and run the crate of docs/library.md outside the repository",
        run: |root, _| external::check(root),
    },
    Chore {
        name: "golden",
        arguments: "[NAME...]",
        about: "make the golden files of the tests again, from the programs we agree with",
        run: golden::remake,
    },
    Chore {
        name: "controllers",
        arguments: "[OPTIONS]",
        about: "train and measure what is missing or out of date; make tables and curves again",
        run: controllers::make,
    },
    Chore {
        name: "settings",
        arguments: "",
        about: "write docs/algorithms/settings.md, the page of all training settings",
        run: |root, _| settings::write(root),
    },
    Chore {
        name: "pictures",
        arguments: "",
        about: "draw every task into docs/tasks, and show the pictures in README.md",
        run: |root, _| pictures::draw(root),
    },
];

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    match dispatch(&arguments) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error:#}");
            ExitCode::from(2)
        }
    }
}

fn dispatch(arguments: &[String]) -> Result<()> {
    let Some((name, rest)) = arguments.split_first() else { return list() };
    if matches!(name.as_str(), "help" | "--help" | "-h") {
        return list();
    }
    let Some(chore) = CHORES.iter().find(|chore| chore.name == name) else {
        let names: Vec<_> = CHORES.iter().map(|chore| chore.name).collect();
        bail!("there is no chore `{name}`; there are {}", names.join(", "));
    };
    if let ([first, ..], "") = (rest, chore.arguments) {
        bail!("`cargo xtask {name}` takes no arguments, but was given `{first}`");
    }
    (chore.run)(&root(), rest)
}

#[expect(clippy::print_stdout, reason = "the list is what was asked for; everything else goes to stderr")]
fn list() -> Result<()> {
    println!("cargo xtask CHORE\n");
    for chore in CHORES {
        println!("  {:<46} {}", format!("{} {}", chore.name, chore.arguments), chore.about);
    }
    Ok(())
}

/// The repository's root: cargo says where this package lies now, even if the tree was moved since it was compiled.
fn root() -> PathBuf {
    let package = std::env::var_os("CARGO_MANIFEST_DIR").unwrap_or_else(|| env!("CARGO_MANIFEST_DIR").into());
    PathBuf::from(package).join("..").canonicalize().unwrap_or_else(|_| PathBuf::from("."))
}
