//! `cargo xtask monitor`: compiles and runs the example of the C interface, and writes its header.

use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, Result, bail, ensure};

use crate::process::{cargo, output, run};

/// Version of cbindgen. Other versions may write other headers.
const VERSION: &str = "0.29.4";
/// cbindgen after its installation, from the root.
const CBINDGEN: &str = "target/tools/bin/cbindgen";
const PACKAGE: &str = "mishandle-monitor-c";
const FOLDER: &str = "crates/monitor-c";
const HEADER: &str = "crates/monitor-c/include/mishandle_monitor.h";
/// Output of the example, from its formulas by hand: the grasp begins at 1.00 s, and force above
/// 20 N from 2.50 s on violates the formula when its window of 50 ms is over.
const EXPECTED: &str = "\
1.00 s: grasp is satisfied, robustness in [0, inf]
2.55 s: force is violated, robustness in [-inf, -6]
";

/// Checks the example. With `--update`, writes the header first.
///
/// # Errors
/// If the header cannot be written, a compiler fails or warns, or the example fails.
pub fn check_or_update(root: &Path, arguments: &[String]) -> Result<()> {
    match arguments {
        [] => {}
        [flag] if flag == "--update" => {
            std::fs::write(root.join(HEADER), header(root)?).context(HEADER)?;
        }
        [other, ..] => bail!("unknown argument `{other}`; expected --update or nothing"),
    }
    check(root)
}

/// The step of `cargo xtask test`. It needs no cbindgen: `crates/monitor-c/tests/header.rs`
/// compares the header with the source.
///
/// # Errors
/// As [`check_or_update`].
pub fn check(root: &Path) -> Result<()> {
    run(&mut cargo(root, &["build", "--quiet", "--package", PACKAGE]), &[0])?;
    let library = root.join("target/debug");
    let programs = root.join("target/monitor-c");
    std::fs::create_dir_all(&programs).context("target/monitor-c")?;
    for (name, arguments) in [
        ("static", vec![library.join("libmishandle_monitor.a").into_os_string(), "-lm".into()]),
        (
            "shared",
            vec![joined("-L", &library), "-lmishandle_monitor".into(), joined("-Wl,-rpath,", &library)],
        ),
    ] {
        let program = programs.join(name);
        let mut compiler = Command::new("cc");
        compiler.args(["-std=c99", "-O1", "-g", "-Wall", "-Wextra", "-Wpedantic", "-Werror"]);
        compiler.args(["-fsanitize=address,undefined", "-fno-sanitize-recover=all"]);
        compiler.arg(joined("-I", &root.join(FOLDER).join("include")));
        compiler.arg(root.join(FOLDER).join("examples/monitor.c")).args(arguments).arg("-o").arg(&program);
        run(&mut compiler, &[0])?;
        let printed = output(&mut Command::new(&program))?;
        ensure!(printed == EXPECTED, "the example ({name}) printed:\n{printed}instead of:\n{EXPECTED}");
    }
    Ok(())
}

fn joined(flag: &str, path: &Path) -> std::ffi::OsString {
    let mut argument = std::ffi::OsString::from(flag);
    argument.push(path);
    argument
}

/// Returns the header that cbindgen writes. The first call installs it into `target/tools`.
fn header(root: &Path) -> Result<String> {
    let program: PathBuf = root.join(CBINDGEN);
    if !program.is_file()
        || output(Command::new(&program).arg("--version"))?.trim() != format!("cbindgen {VERSION}")
    {
        eprintln!("installing cbindgen {VERSION} into target/tools, which takes a minute");
        let arguments = ["install", "cbindgen", "--version", VERSION, "--locked", "--root", "target/tools"];
        run(&mut cargo(root, &arguments), &[0])?;
    }
    let folder = root.join(FOLDER);
    output(
        Command::new(program).arg("--quiet").arg("--config").arg(folder.join("cbindgen.toml")).arg(&folder),
    )
}
