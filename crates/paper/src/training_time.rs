//! Training times of the shipped controllers.

use std::path::Path;

use mishandle::files::{limits, read_bounded};
use serde::Deserialize;

use crate::PaperError;

/// The part of a record of the controller zoo that the tables show.
#[derive(Deserialize)]
struct Record {
    training: Option<Training>,
}

#[derive(Deserialize)]
struct Training {
    training_time: Option<TrainingTime>,
}

#[derive(Deserialize)]
struct TrainingTime {
    control_steps: u64,
}

/// Returns the training time of a shipped controller in control steps of each environment, from its
/// record in `controllers/figures`; `None` if there is no record or its learning curve does not
/// show the time. `root` is the repository.
///
/// # Errors
/// If the record cannot be read.
pub fn training_steps(root: &Path, task: &str, controller: &str) -> Result<Option<u64>, PaperError> {
    let path = root.join("controllers/figures").join(task).join(format!("{controller}.json"));
    if !path.is_file() {
        return Ok(None);
    }
    let text = read_bounded(&path, limits::CONTROLLER).map_err(PaperError::file(&path))?;
    let record: Record = serde_json::from_slice(&text).map_err(|error| PaperError::results(&path, &error))?;
    let time = record.training.and_then(|training| training.training_time);
    Ok(time.map(|time| time.control_steps))
}
