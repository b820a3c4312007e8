//! `cargo xtask external`: builds and runs the crate of docs/guide/library.md outside the
//! repository.

use std::fs;
use std::path::Path;
use std::process::Command;

use anyhow::{Context, Result, ensure};

use crate::process::{cargo, output};

const PAGE: &str = "docs/guide/library.md";

/// Follows the page in a temporary folder, and checks that the program prints the output on the
/// page and starts without cargo. The first run compiles Mishandle, which takes minutes.
///
/// # Errors
/// If the page has no program, or the program prints something else.
pub fn check(root: &Path) -> Result<()> {
    let page = fs::read_to_string(root.join(PAGE)).context(PAGE)?;
    let program = block(&page, "```rust\n")?;
    let shown = block(&page, "```console\n")?;
    let expected = shown.lines().nth(1).with_context(|| format!("{PAGE} shows no output"))?;
    let folder = std::env::temp_dir().join(format!("mishandle-external-{}", std::process::id()));
    let run = follow(root, &folder, program);
    fs::remove_dir_all(&folder).with_context(|| format!("cannot remove {}", folder.display()))?;
    for (how, found) in run? {
        ensure!(
            found.trim() == expected,
            "{how} printed `{}`, expected `{expected}` from {PAGE}",
            found.trim()
        );
    }
    eprintln!("a crate outside the repository prints the output in {PAGE}");
    Ok(())
}

fn block<'a>(page: &'a str, fence: &str) -> Result<&'a str> {
    let rest = page.split_once(fence).map(|(_, rest)| rest);
    let text = rest.and_then(|rest| rest.split_once("```")).map(|(text, _)| text);
    text.with_context(|| format!("{PAGE} has no block {}", fence.trim()))
}

/// Writes the crate and returns its output, run by cargo and on its own.
fn follow(root: &Path, folder: &Path, program: &str) -> Result<[(&'static str, String); 2]> {
    let write = |name: &str, text: String| {
        let path = folder.join(name);
        fs::create_dir_all(path.parent().unwrap_or(folder))
            .and_then(|()| fs::write(&path, text))
            .context(path.display().to_string())
    };
    write(
        "Cargo.toml",
        format!(
            "[package]\nname = \"my_crate\"\nedition = \"2024\"\n\n[dependencies]\nmishandle = {{ path = {root:?} }}\n"
        ),
    )?;
    write(".cargo/config.toml", format!("include = [{:?}]\n", root.join(".cargo/config.toml")))?;
    write("src/main.rs", program.to_string())?;
    // The same versions as in this repository, so that nothing is downloaded.
    fs::copy(root.join("Cargo.lock"), folder.join("Cargo.lock"))?;
    let by_cargo = output(cargo(root, &["run", "--quiet", "--release"]).current_dir(folder))?;
    let by_itself = output(
        Command::new(folder.join("target/release/my_crate")).env_remove("LD_LIBRARY_PATH").current_dir("/"),
    )?;
    Ok([("`cargo run`", by_cargo), ("the program on its own", by_itself)])
}
