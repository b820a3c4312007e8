//! The training time, as text.

use mishandle::results::TrainingTime;
use mishandle_text::plural;

/// Returns a line for the terminal; with control steps per environment if the number of environments is known. `reason` says why
/// there is no training time.
pub fn line(time: Option<&TrainingTime>, reason: Option<&str>) -> String {
    let Some(time) = time else {
        return format!("no training time: {}", reason.unwrap_or_default());
    };
    let each = time
        .control_steps
        .map_or(String::new(), |steps| format!(", {} per environment", plural(steps, "control step")));
    format!(
        "training time until the return converged: {}{each}, {:.0} s",
        plural(time.environment_steps, "environment step"),
        time.secs.0
    )
}
