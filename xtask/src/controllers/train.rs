//! Trains one controller, from where it was stopped.

use std::fs;
use std::path::Path;

use anyhow::{Context, Result, ensure};
use serde_json::Value;

use super::home::{lock, write};
use super::intake::take_in;
use super::measure::Bench;
use super::state::{BEGUN, CHECKPOINT, Standing, State, mark};
use super::workers;

/// Trains, measures and puts in place.
///
/// # Errors
/// If the program cannot train, is interrupted, or gives something else than was wanted.
pub fn train(bench: &Bench<'_>, task: &Value, standing: &Standing) -> Result<()> {
    let Standing { training, wanted, state, .. } = standing;
    let file = |ending: &str| bench.home.work(training, ending);
    // Left behind by a call that was killed, its own training may live on.
    let mine = lock(&file(".safetensors.lock"))?;
    ensure!(mine.is_some(), "another process is training it");
    drop(mine);
    if !matches!(state, State::Interrupted { .. }) {
        clear(&file(""), &[])?;
        write(&file(BEGUN), mark(wanted).as_bytes())?;
    }
    let (controller, csv, seed) = (file(".safetensors"), file(".csv"), training.seed.to_string());
    let (out, table) = (controller.to_string_lossy(), csv.to_string_lossy());
    let mut words = vec!["train", &training.task, "--algorithm", &training.algorithm, "--seed", &seed];
    words.extend(["--out", &out, "--csv", &table]);
    if file(CHECKPOINT).is_file() {
        words.push("--resume");
    }
    workers::run(&mut bench.program.nice(&words), &[0], &file(".out"), &file(".log"), bench.stop)?;
    take_in(bench, task, training, wanted, &controller, &csv)?;
    let kept: &[&str] = if training.is_shipped() { &[] } else { &[".safetensors"] };
    clear(&file(""), kept)
}

/// Removes all files whose names start with this one's and a point, but for those that end like one of `kept`.
fn clear(start: &Path, kept: &[&str]) -> Result<()> {
    let folder = start.parent().context("a file without a folder")?;
    let name = start.file_name().unwrap_or_default().to_string_lossy().into_owned() + ".";
    if !folder.is_dir() {
        return Ok(());
    }
    for entry in fs::read_dir(folder)? {
        let path = entry?.path();
        let own = path.file_name().unwrap_or_default().to_string_lossy();
        if own.starts_with(&name) && !kept.iter().any(|ending| own.ends_with(ending)) {
            fs::remove_file(&path).with_context(|| path.display().to_string())?;
        }
    }
    Ok(())
}
