use anyhow::Result;
use mishandle::{Curve, plural};
use serde_json::json;

use crate::output::{self, number};
use crate::{ExitStatus, args, training_time};

pub fn run(command: &args::Curve) -> Result<ExitStatus> {
    let curve = Curve::load(&command.file)?;
    if curve.is_truncated {
        let file = command.file.display();
        output::message(&format!("warning: the last line of {file} is incomplete and was ignored"));
    }
    let environments = command.environments;
    let time = curve.training_time();
    if command.json {
        output::json(json!({
            "iterations": curve.rows.len(),
            "environment_steps": curve.rows.last().map(|row| row.environment_steps),
            "wall_clock_secs": curve.rows.last().map(|row| number(row.wall_clock_secs)),
            "training_time": training_time::document(time, environments),
        }))?;
        if time.is_err() {
            output::message(&training_time::line(time, environments));
        }
        return Ok(ExitStatus::Done);
    }
    if let Some(last) = curve.rows.last() {
        let (count, secs) = (plural(curve.rows.len(), "iteration"), last.wall_clock_secs);
        let steps = plural(last.environment_steps, "environment step");
        output::line(&format!("{count}, {steps} in {secs:.0} s"))?;
    }
    output::line(&training_time::line(time, environments))?;
    Ok(ExitStatus::Done)
}
