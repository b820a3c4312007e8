//! Chores around the build, in Rust so that they need only the toolchain. `cargo xtask` lists them.
//!
//! Uses no other crate of this repository and not MuJoCo, because fetching MuJoCo is one of the
//! chores.

mod book;
mod budget;
mod check;
mod clients;
mod corpus;
mod demo;
mod deny;
mod dist;
mod examples;
mod external;
mod falsifier_bench;
mod figures;
mod fuzz;
mod golden;
mod markdown;
mod monitor;
mod mujoco;
mod pictures;
mod platform;
mod process;
mod progress;
mod readme;
mod reference;
mod robots;
mod sanitize;
mod tidy;
mod venv;
mod wheel;

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Result, bail};

/// A command of `cargo xtask`.
struct Chore {
    name: &'static str,
    /// Arguments as the list shows them; empty if the chore takes none.
    arguments: &'static str,
    about: &'static str,
    run: fn(root: &Path, arguments: &[String]) -> Result<()>,
}

const CHORES: &[Chore] = &[
    Chore {
        name: "demo",
        arguments: "",
        about: "fetch MuJoCo, build, run `mishandle demo`: a controller fails, and a page shows it",
        run: |root, _| demo::demo(root),
    },
    Chore {
        name: "test",
        arguments: "[--all]",
        about: "run fmt, tidy, lints, tests, doc tests, python, monitor, clients, pages; --all: everything",
        run: check::check,
    },
    Chore {
        name: "mujoco",
        arguments: "",
        about: "download MuJoCo's library to target/mujoco/lib (from PyPI, with a SHA-256 check)",
        run: |root, _| mujoco::fetch(root),
    },
    Chore {
        name: "tidy",
        arguments: "",
        about: "compare ARCHITECTURE.md with the crates; check rules and links",
        run: |root, _| tidy::check(root),
    },
    Chore {
        name: "readme",
        arguments: "[--update]",
        about: "run the commands in README.md and compare their output; --update writes it to the page",
        run: readme::check_or_update,
    },
    Chore {
        name: "clients",
        arguments: "",
        about: "test the clients of the simulator protocol in clients/",
        run: |root, _| clients::test(root, check::Extent::All),
    },
    Chore {
        name: "monitor",
        arguments: "[--update]",
        about: "run the example of the C interface with AddressSanitizer; --update writes its header",
        run: monitor::check_or_update,
    },
    Chore {
        name: "external",
        arguments: "",
        about: "build and run the crate of docs/guide/library.md outside the repository",
        run: |root, _| external::check(root),
    },
    Chore {
        name: "examples",
        arguments: "[NAME...] [--record] [--train]",
        about: "run examples/robots, and python/examples in a virtual environment with PyTorch (gigabytes the first time)",
        run: examples::examples,
    },
    Chore {
        name: "falsifier-bench",
        arguments: "[--quick] [--estimate] [--large] ...",
        about: "compare our searches with those of other libraries (studies/notebook/2026-11-23-falsifiers.md); --quick: minutes",
        run: falsifier_bench::bench,
    },
    Chore {
        name: "fuzz",
        arguments: "[--minutes N] [--keep] [--add FILE] [TARGET...]",
        about: "run the fuzz targets on the corpus and on new inputs; --keep and --add write inputs to the corpus",
        run: fuzz::fuzz,
    },
    Chore {
        name: "sanitize",
        arguments: "[PACKAGE...]",
        about: "run the tests of crates with unsafe or C code with AddressSanitizer; needs a nightly toolchain",
        run: sanitize::sanitize,
    },
    Chore {
        name: "deny",
        arguments: "[--fetch]",
        about: "check advisories, licenses, duplicates and sources of all dependencies (cargo-deny)",
        run: deny::deny,
    },
    Chore {
        name: "dist",
        arguments: "[--check]",
        about: "build a wheel, an archive and a recipe of a container in target/packages; --check uses and times them in empty folders",
        run: dist::dist,
    },
    Chore {
        name: "golden",
        arguments: "[NAME...]",
        about: "regenerate the golden files of the tests with the reference programs",
        run: golden::remake,
    },
    Chore {
        name: "book",
        arguments: "",
        about: "build the documentation as HTML with search in target/book (mdBook) and check its links",
        run: |root, _| book::build(root),
    },
    Chore {
        name: "settings",
        arguments: "",
        about: "write the reference of all training settings to target/reference",
        run: |root, _| reference::settings(root),
    },
    Chore {
        name: "results",
        arguments: "",
        about: "write the reference and the schemas of JSON documents to target/reference, and python/mishandle/results.py",
        run: |root, _| reference::results(root),
    },
    Chore {
        name: "pictures",
        arguments: "",
        about: "draw every task to picture.png in its folder",
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
        bail!("unknown chore `{name}`; expected one of {}", names.join(", "));
    };
    if let ([first, ..], "") = (rest, chore.arguments) {
        bail!("`cargo xtask {name}` takes no arguments, found `{first}`");
    }
    (chore.run)(&root(), rest)
}

#[expect(
    clippy::print_stdout,
    reason = "the list is the output of this command; everything else goes to stderr"
)]
fn list() -> Result<()> {
    println!("cargo xtask CHORE\n");
    for chore in CHORES {
        println!("  {:<48} {}", format!("{} {}", chore.name, chore.arguments), chore.about);
    }
    Ok(())
}

/// Returns the repository's root. Cargo knows where this package is now, even if the tree was moved
/// after the build.
fn root() -> PathBuf {
    let package = std::env::var_os("CARGO_MANIFEST_DIR").unwrap_or_else(|| env!("CARGO_MANIFEST_DIR").into());
    PathBuf::from(package).join("..").canonicalize().unwrap_or_else(|_| PathBuf::from("."))
}
