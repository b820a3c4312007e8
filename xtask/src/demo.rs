//! `cargo xtask demo`: from a fresh clone to a failure and its page, by `mishandle demo`.

use std::fs;
use std::path::Path;
use std::process::Command;
use std::time::Instant;

use anyhow::{Context, Result, ensure};

use crate::process::{as_typed, cargo, run};
use crate::{mujoco, progress};

const PROGRAM: &str = "target/demo/mishandle";
/// Builds the program without the parts that take long to build and that a first use does not need.
const BUILD: &[&str] = &["build", "--profile", "demo", "--package", "mishandle-cli", "--no-default-features"];

/// Labels of lines that the verdict must have, in this order.
const LABELS: [&str; 6] = ["FAILS", "cause", "since", "sure", "look", "fix"];
/// Folders in which the check runs the demo: an empty one, the same again, and one in which not
/// even root can write.
const FOLDERS: [&str; 3] = ["target/demo-check", "target/demo-check", "/sys"];

/// Fetches MuJoCo, builds, and runs the demo.
///
/// # Errors
/// If a step fails.
pub fn demo(root: &Path) -> Result<()> {
    build(root)?;
    eprintln!("[3/3] {PROGRAM} demo\n");
    run(Command::new(root.join(PROGRAM)).arg("demo").current_dir(root), &[0])?;
    eprintln!(
        "\nThis program is built in little time, and runs slower than others. It reads no ONNX files, writes no \
         Parquet, and has no `render`. `cargo build --release` builds the whole.\n\
         Before you type the commands above: export PATH=\"$PWD/target/demo:$PATH\""
    );
    Ok(())
}

fn build(root: &Path) -> Result<()> {
    eprintln!("[1/3] MuJoCo's library");
    mujoco::fetch(root)?;
    let mut build = cargo(root, BUILD);
    eprintln!("[2/3] {}     (the first time takes some minutes)", as_typed(&build));
    progress::run(&mut build)
}

/// Builds the program of the demo, and checks what the demo prints and writes.
///
/// # Errors
/// If the demo fails, or misses a line or the page.
pub fn check(root: &Path) -> Result<()> {
    build(root)?;
    let empty = root.join(FOLDERS[0]);
    if empty.exists() {
        fs::remove_dir_all(&empty).context("cannot empty the folder of the demo")?;
    }
    fs::create_dir_all(&empty).context("cannot create the folder of the demo")?;
    FOLDERS.iter().try_for_each(|folder| check_in(&root.join(PROGRAM), &root.join(folder)))
}

/// Runs the demo in a folder, without a display.
fn check_in(program: &Path, folder: &Path) -> Result<()> {
    let started = Instant::now();
    let mut command = Command::new(program);
    command.arg("demo").current_dir(folder).env_remove("DISPLAY").env_remove("WAYLAND_DISPLAY");
    let output = command.output().with_context(|| format!("cannot run {}", program.display()))?;
    let took = started.elapsed().as_secs_f64();
    let verdict = String::from_utf8_lossy(&output.stdout);
    let messages = String::from_utf8_lossy(&output.stderr);
    let said = || format!("the demo in {} printed:\n{verdict}\n{messages}", folder.display());
    ensure!(output.status.code() == Some(0), "{}; {}", output.status, said());
    let page = page(&verdict, &messages).with_context(said)?;
    let html = fs::read_to_string(folder.join(page)).with_context(|| format!("there is no page {page}"))?;
    ensure!(html.contains("</html>"), "{page} is no page");
    eprintln!("demo in {}: {took:.1} s, page {page} with {} kB", folder.display(), html.len() / 1000);
    Ok(())
}

/// Returns the path of the page.
///
/// # Errors
/// If the verdict lacks a line, or no page is named.
fn page<'a>(verdict: &str, messages: &'a str) -> Result<&'a str> {
    let mut labels = verdict.lines().filter_map(|line| line.split(' ').next());
    let missing = LABELS.iter().find(|label| !labels.any(|shown| shown == **label));
    ensure!(missing.is_none(), "the verdict has no line `{}` in its place", missing.unwrap_or(&""));
    let named = messages.lines().find_map(|line| line.strip_prefix("wrote ")?.split_once(" ("));
    named.map(|(page, _)| page).context("no page is named")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_line_of_the_verdict_and_a_page_are_needed() {
        let verdict = LABELS.map(|label| format!("{label}  text\n       more text\n")).concat();
        let messages = "$ mishandle report\nwrote runs/demo-2.html (816 kB)\nThe demo took 4.0 s\n";
        assert_eq!(page(&verdict, messages).unwrap(), "runs/demo-2.html");
        assert!(page(&verdict, "The demo took 4.0 s\n").is_err());
        for label in LABELS {
            let error = page(&verdict.replace(label, "other"), messages).unwrap_err().to_string();
            assert!(error.contains(&format!("no line `{label}`")), "{error}");
        }
    }
}
