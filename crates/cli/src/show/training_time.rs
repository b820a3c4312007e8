//! Output of the training time.

use mishandle::{CurveRow, NoTrainingTime, plural};
use serde_json::{Value, json};

use super::output::number;

/// Returns a line for the terminal; with control steps per environment if the number of environments is known.
pub fn line(training_time: Result<&CurveRow, NoTrainingTime>, environments: Option<usize>) -> String {
    let row = match training_time {
        Ok(row) => row,
        Err(reason) => return format!("no training time: {reason}"),
    };
    let each = environments.map_or(String::new(), |environments| {
        format!(", {} per environment", plural(row.control_steps(environments), "control step"))
    });
    format!(
        "training time until the return converged: {}{each}, {:.0} s",
        plural(row.environment_steps, "environment step"),
        row.wall_clock_secs
    )
}

/// Returns the training time as JSON; null if it is undefined.
pub fn document(training_time: Result<&CurveRow, NoTrainingTime>, environments: Option<usize>) -> Value {
    training_time.map_or(Value::Null, |row| {
        json!({
            "environment_steps": row.environment_steps,
            "control_steps": environments.map(|environments| row.control_steps(environments)),
            "secs": number(row.wall_clock_secs),
        })
    })
}
