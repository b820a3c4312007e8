//! Success rates over the values of axes, from the random simulations of a run.

use mishandle_evaluation::AxisRateCounter;
use mishandle_results::AxisRates;
use mishandle_rollout::Space;
use mishandle_store::{RANDOM_TRIAL, RunFile, RunKind};

use crate::error::MishandleError;
use crate::plan::Plan;
use crate::run::{has_random_rows, recorded_axis, recorded_episode, stops_by_itself};

/// Returns the success rates of an evaluation over the values of its axes; `None` for another run,
/// because its simulations are not a random sample of fixed size, and if too few simulations have a
/// verdict.
///
/// # Errors
/// If the run cannot be read.
pub fn axis_rates(run: &RunFile) -> Result<Option<AxisRates>, MishandleError> {
    let header = run.header();
    let is_random = header.kind == RunKind::Evaluate && has_random_rows(header);
    let Ok(space) = Space::new(&header.space, header.axes.iter().map(recorded_axis).collect()) else {
        return Ok(None);
    };
    let planned = run.trials()?.into_iter().find(|trial| trial.trial.number == RANDOM_TRIAL);
    let Some(planned) = planned.filter(|_| is_random) else { return Ok(None) };
    let is_any_time = Plan::from_toml(&header.plan).is_ok_and(|plan| stops_by_itself(&plan));
    let counter = AxisRateCounter::new(&space, planned.counts.simulations);
    let mut counter = counter.with_intervals_at_any_time(is_any_time);
    for simulation in run.trial_simulations(RANDOM_TRIAL) {
        counter.add(&recorded_episode(&simulation?));
    }
    Ok(counter.report())
}
