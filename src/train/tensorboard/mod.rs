//! TensorBoard event files.
//!
//! A file is a sequence of records: length, checksum of the length, message, checksum of the
//! message. A message is a protocol buffer `Event`. Scalars need only a few fields, so this module
//! encodes them without a protocol buffer library.

mod encoding;

use std::io;
use std::path::{Path, PathBuf};
use std::time::{SystemTime, UNIX_EPOCH};

use encoding::{put_bytes, put_double, put_float, put_integer, record};
use mishandle_files::{GrowingFile, NewFolders, read_bounded};
use mishandle_results::Key;
use mishandle_training::{Rates, TrainingProgress, Validation};

use crate::error::{MishandleError, exists};

/// TensorBoard recognizes event files by this part of the name.
const MARK: &str = "tfevents";

/// Length of the record of the version: 16 bytes besides the message, which is a number of 9 bytes
/// and a text of 15.
const FIRST_RECORD: u64 = 40;

/// Writes the event file of a training run.
#[derive(Debug)]
pub(crate) struct EventFile {
    file: GrowingFile,
    reward_terms: Vec<String>,
    /// Whether the next record is the first after a checkpoint.
    resumes: bool,
    _folders: NewFolders,
}

impl EventFile {
    /// Creates an event file in `folder`, and the folder if it does not exist. A resumed run
    /// creates one more file.
    ///
    /// # Errors
    /// If the folder contains event files of another training run, or the file cannot be created.
    pub(crate) fn create(
        folder: &Path,
        reward_terms: &[String],
        resumes: bool,
    ) -> Result<EventFile, MishandleError> {
        let failed = MishandleError::write("folder", folder);
        let mut folders = NewFolders::default();
        folders.create(folder).map_err(failed)?;
        EventFile::check(folder, resumes)?;
        if !resumes {
            remove_empty(folder).map_err(failed)?;
        }
        let mut event = Vec::new();
        put_double(&mut event, event::WALL_TIME, now_secs());
        put_bytes(&mut event, event::FILE_VERSION, b"brain.Event:2");
        let file = create_file(folder, &record(&event)).map_err(|source| write_error(folder, source))?;
        let reward_terms = reward_terms.iter().map(|name| format!("reward/{name}")).collect();
        Ok(EventFile { file, reward_terms, resumes, _folders: folders })
    }

    /// Checks that `folder` contains no event files of another training run.
    ///
    /// # Errors
    /// If it contains one.
    pub(crate) fn check(folder: &Path, resumes: bool) -> Result<(), MishandleError> {
        if resumes || !folder.exists() {
            return Ok(());
        }
        let found = event_file(folder).map_err(MishandleError::write("folder", folder))?;
        found.map_or(Ok(()), |path| Err(exists(&path, Key::EVENTS)))
    }

    /// Deletes the file.
    pub(crate) fn discard(self) {
        self.file.discard();
    }

    /// Writes the scalars of an iteration. The next call repeats a failed write.
    pub(crate) fn write(&mut self, progress: &TrainingProgress) -> Result<(), MishandleError> {
        let mut records = Vec::new();
        if std::mem::take(&mut self.resumes) {
            records = record(&session_start(progress.environment_steps));
        }
        records.extend(record(&scalars(progress, &self.reward_terms)));
        self.file.append(&records).map_err(|source| write_error(self.file.path(), source))
    }

    /// Returns whether a resumed run wrote no scalars, because it had no iterations left.
    pub(crate) fn is_empty(&self) -> bool {
        self.resumes
    }

    /// Flushes all records to disk.
    pub(crate) fn finish(&mut self) -> Result<(), MishandleError> {
        self.file.finish().map_err(|source| write_error(self.file.path(), source))
    }
}

fn write_error(path: &Path, source: io::Error) -> MishandleError {
    MishandleError::Write { what: "event file", path: path.to_path_buf(), source }
}

/// Returns an event file of a folder, if there is one with data.
fn event_file(folder: &Path) -> io::Result<Option<PathBuf>> {
    Ok(event_files(folder)?.into_iter().find(|path| !has_no_data(path)))
}

fn event_files(folder: &Path) -> io::Result<Vec<PathBuf>> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder)? {
        let entry = entry?;
        if entry.file_name().to_string_lossy().contains(MARK) {
            found.push(entry.path());
        }
    }
    Ok(found)
}

/// Returns whether an event file has nothing but the record with which each begins, or a part of
/// it: a run left it that was killed before its first checkpoint.
fn has_no_data(path: &Path) -> bool {
    let length = (FIRST_RECORD - 16).to_le_bytes();
    read_bounded(path, FIRST_RECORD).is_ok_and(|bytes| bytes.iter().zip(length).all(|(a, b)| *a == b))
}

/// Removes the event files without data, which a run that was killed left.
fn remove_empty(folder: &Path) -> io::Result<()> {
    event_files(folder)?.iter().filter(|path| has_no_data(path)).try_for_each(std::fs::remove_file)
}

/// Creates a file with a unique name. TensorBoard reads the files of a folder in the order of their
/// names, so the time is first.
fn create_file(folder: &Path, first: &[u8]) -> io::Result<GrowingFile> {
    let time = now_secs() as u64;
    let host = host();
    let process = std::process::id();
    let mut number = 0;
    loop {
        let name = format!("events.out.{MARK}.{time:010}.{host}.{process}.{number}");
        match GrowingFile::create(folder.join(name), first) {
            Err(error) if error.kind() == io::ErrorKind::AlreadyExists => number += 1,
            created => return created,
        }
    }
}

/// Returns the host name.
fn host() -> String {
    let name = std::fs::read_to_string("/proc/sys/kernel/hostname").unwrap_or_default();
    let name: String =
        name.trim().chars().filter(|c| c.is_ascii_alphanumeric() || "-_.".contains(*c)).collect();
    if name.is_empty() { "localhost".to_string() } else { name }
}

fn now_secs() -> f64 {
    SystemTime::now().duration_since(UNIX_EPOCH).map_or(0.0, |since| since.as_secs_f64())
}

/// Returns an event after which TensorBoard discards earlier data from this step on, because the
/// run repeats these steps.
fn session_start(environment_steps: u64) -> Vec<u8> {
    let mut session = Vec::new();
    put_integer(&mut session, session_log::STATUS, session_log::START);
    let mut event = event_at(environment_steps);
    put_bytes(&mut event, event::SESSION_LOG, &session);
    event
}

/// Returns an event with the scalars of an iteration.
fn scalars(progress: &TrainingProgress, reward_terms: &[String]) -> Vec<u8> {
    let validation = progress.validation.filter(|_| progress.validation_is_fresh);
    let validated = |rate: fn(&Validation) -> f64| validation.as_ref().map(rate);
    let (space, corners) = validation.map_or((None, None), |found| (found.space, found.corners));
    let on_space = |rate: fn(&Rates) -> f64| space.as_ref().map(rate);
    let at_corners = |rate: fn(&Rates) -> f64| corners.as_ref().map(rate);
    let part = validation.and_then(|found| found.part).map(|part| part.rates);
    let on_part = |rate: fn(&Rates) -> f64| part.as_ref().map(rate);
    let named = [
        ("validation/success_rate", validated(|validation| validation.success_rate)),
        ("validation/strict_success_rate", validated(|validation| validation.strict_success_rate)),
        ("validation/mean_return", validated(|validation| validation.mean_return)),
        ("validation/space/success_rate", on_space(|rates| rates.success_rate)),
        ("validation/space/strict_success_rate", on_space(|rates| rates.strict_success_rate)),
        ("validation/space/mean_return", on_space(|rates| rates.mean_return)),
        ("validation/corners/success_rate", at_corners(|rates| rates.success_rate)),
        ("validation/corners/strict_success_rate", at_corners(|rates| rates.strict_success_rate)),
        ("validation/corners/mean_return", at_corners(|rates| rates.mean_return)),
        ("validation/share/success_rate", on_part(|rates| rates.success_rate)),
        ("validation/share/strict_success_rate", on_part(|rates| rates.strict_success_rate)),
        ("validation/share/mean_return", on_part(|rates| rates.mean_return)),
        ("train/scenario_share", progress.scenario_share),
        ("train/mean_return", progress.mean_return),
        ("train/mean_episode_steps", progress.mean_episode_steps),
        ("train/terminated_rate", progress.terminated_rate),
        ("train/kl", progress.kl),
        ("train/entropy", progress.entropy),
        ("train/learning_rate", Some(progress.learning_rate)),
        ("time/steps_per_second", Some(progress.steps_per_second)),
        ("time/wall_clock_secs", Some(progress.wall_clock_secs)),
        ("time/physics_share", Some(progress.time_shares.physics)),
        ("time/inference_share", Some(progress.time_shares.inference)),
        ("time/learning_share", Some(progress.time_shares.learning)),
    ];
    let rewards =
        reward_terms.iter().map(String::as_str).zip(progress.reward_terms.iter().copied().map(Some));
    let mut summary = Vec::new();
    for (tag, number) in named.into_iter().chain(rewards) {
        if let Some(number) = number {
            let mut value = Vec::new();
            put_bytes(&mut value, value::TAG, tag.as_bytes());
            put_float(&mut value, value::SIMPLE_VALUE, number as f32);
            put_bytes(&mut summary, summary::VALUE, &value);
        }
    }
    let mut event = event_at(progress.environment_steps);
    put_bytes(&mut event, event::SUMMARY, &summary);
    event
}

fn event_at(environment_steps: u64) -> Vec<u8> {
    let mut event = Vec::new();
    put_double(&mut event, event::WALL_TIME, now_secs());
    put_integer(&mut event, event::STEP, environment_steps);
    event
}

/// Field numbers of TensorFlow's `Event`.
mod event {
    pub const WALL_TIME: u8 = 1;
    pub const STEP: u8 = 2;
    pub const FILE_VERSION: u8 = 3;
    pub const SUMMARY: u8 = 5;
    pub const SESSION_LOG: u8 = 7;
}

/// Field numbers of `Summary`.
mod summary {
    pub const VALUE: u8 = 1;
}

/// Field numbers of `Summary.Value`.
mod value {
    pub const TAG: u8 = 1;
    pub const SIMPLE_VALUE: u8 = 2;
}

/// Field number of `SessionLog`, and its value at the start of a session.
mod session_log {
    pub const STATUS: u8 = 1;
    pub const START: u64 = 1;
}

#[cfg(test)]
mod tests;
