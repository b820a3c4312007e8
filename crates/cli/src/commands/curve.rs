use std::num::NonZeroUsize;

use anyhow::Result;
use mishandle::Curve;
use serde_json::json;

use crate::output::{self, number};
use crate::{Outcome, args};

pub fn run(command: &args::Curve) -> Result<Outcome> {
    let curve = Curve::load(&command.file)?;
    let environments = command.environments.map(NonZeroUsize::get);
    let flat_after = curve.flat_after();
    if command.json {
        output::json(&json!({
            "iterations": curve.rows.len(),
            "environment_steps": curve.rows.last().map(|row| row.environment_steps),
            "wall_clock_secs": curve.rows.last().map(|row| number(row.wall_clock_secs)),
            "training_time": flat_after.map(|row| json!({
                "environment_steps": row.environment_steps,
                "control_steps": environments.map(|environments| row.control_steps(environments)),
                "secs": number(row.wall_clock_secs),
            })),
        }))?;
        return Ok(Outcome::Done);
    }
    if let Some(last) = curve.rows.last() {
        let (count, steps, secs) = (curve.rows.len(), last.environment_steps, last.wall_clock_secs);
        output::line(&format!("{count} iterations, {steps} environment steps in {secs:.0} s"))?;
    }
    if let Some(row) = flat_after {
        let each = environments.map_or(String::new(), |environments| {
            format!(", {} control steps of each environment", row.control_steps(environments))
        });
        output::line(&format!(
            "training time, until the return is flat: {} environment steps{each}, {:.0} s",
            row.environment_steps, row.wall_clock_secs
        ))?;
    }
    Ok(Outcome::Done)
}
