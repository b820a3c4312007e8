//! A training time, or why there is none.

use mishandle::{CurveRow, NoTrainingTime};
use serde_json::{Value, json};

use crate::output::number;

/// A line for people; control steps if it is known how many environments there were.
pub fn line(training_time: Result<&CurveRow, NoTrainingTime>, environments: Option<usize>) -> String {
    let row = match training_time {
        Ok(row) => row,
        Err(reason) => return format!("no training time: {reason}"),
    };
    let each = environments.map_or(String::new(), |environments| {
        format!(", {} control steps of each environment", row.control_steps(environments))
    });
    format!(
        "training time, until the return is flat: {} environment steps{each}, {:.0} s",
        row.environment_steps, row.wall_clock_secs
    )
}

/// The same as JSON, null if there is none.
pub fn document(training_time: Result<&CurveRow, NoTrainingTime>, environments: Option<usize>) -> Value {
    training_time.map_or(Value::Null, |row| {
        json!({
            "environment_steps": row.environment_steps,
            "control_steps": environments.map(|environments| row.control_steps(environments)),
            "secs": number(row.wall_clock_secs),
        })
    })
}
