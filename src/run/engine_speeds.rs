//! The choice between both engines of a question: they are measured on its first simulations.

use std::ops::ControlFlow;
use std::time::Instant;

use mishandle_evaluation::SCREENED_CHUNK;
use mishandle_rollout::{Request, Screen, ScreenedEpisode, Seed};
use mishandle_store::RunKind;
use mishandle_text::plural;
use mishandle_world::WorldDevice;

use crate::error::MishandleError;
use crate::plan::{FalsifyPlan, Plan, ScreeningPlan};
use crate::resolve::ResolvedPlan;
use crate::run::device::screening;

/// Number of simulations with which the target's own system is measured.
const DIRECT: usize = 64;

/// Speeds of both engines on the first simulations of a question.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EngineSpeeds {
    /// Number of simulations of the device, and of the target's own system.
    pub simulations: [u64; 2],
    /// Seconds of each for one simulation.
    pub seconds: [f64; 2],
    /// Fraction of the screened simulations that the target's own system repeats.
    pub repeated: f64,
}

impl EngineSpeeds {
    /// Returns the simulations per second of the screening with its repetitions, and of the
    /// target's own system alone.
    pub fn per_second(&self) -> [f64; 2] {
        let [device, direct] = self.seconds;
        [1.0 / (device + self.repeated * direct), 1.0 / direct]
    }

    /// Returns whether the screening is faster.
    pub fn prefers_screening(&self) -> bool {
        let [screened, direct] = self.per_second();
        screened > direct
    }

    /// Describes the choice.
    pub fn text(&self) -> String {
        let [screened, direct] = self.per_second();
        let (faster, factor) = if self.prefers_screening() {
            ("screening is", screened / direct)
        } else {
            ("MuJoCo C alone is", direct / screened)
        };
        let [on_device, of_system] = self.simulations;
        format!(
            "{faster} {factor:.1} times as fast, so the run uses it: {screened:.3} simulations per second with screening, which \
             repeats {:.1} %, and {direct:.3} without (measured on {} and {of_system})",
            100.0 * self.repeated,
            plural(on_device, "simulation")
        )
    }
}

/// Measures both engines on the first simulations of a question: the device on as many as it has
/// worlds, the target's own system on up to 64. They belong to no run. A first simulation of the
/// device, in which kernels are compiled, is not measured. Returns `None` if `watch`, which gets
/// the number of finished simulations of the device, ends it.
///
/// # Errors
/// If the device cannot simulate the target, or a simulation cannot be run.
pub fn measure_engines(
    resolved: &ResolvedPlan,
    plan: &ScreeningPlan,
    device: &dyn WorldDevice,
    watch: &(dyn Fn(usize) -> ControlFlow<()> + Sync),
) -> Result<Option<EngineSpeeds>, MishandleError> {
    let planned = planned_simulations(&resolved.plan).min(SCREENED_CHUNK);
    let count = planned.min(plan.rows.into()).max(1);
    let seed = Seed(resolved.plan.seed);
    let request = |index: u64| Request::new(resolved.space.sample(seed, index), seed.child(index));
    let requests: Vec<Request> = (0..count).map(request).collect();
    let mut screen = screening(resolved, device, plan.rows as usize)?;
    let mut run = |requests: &[Request]| -> Result<Option<Vec<ScreenedEpisode>>, MishandleError> {
        let found = screen.run(requests, &|done| watch(done).is_continue())?;
        Ok(found.into_iter().collect())
    };
    if run(&requests[..1])?.is_none() {
        return Ok(None);
    }
    let start = Instant::now();
    let Some(screened) = run(&requests)? else { return Ok(None) };
    let on_device = start.elapsed().as_secs_f64();
    let direct = &requests[..requests.len().min(DIRECT)];
    let mut system = resolved.system()?;
    let start = Instant::now();
    system.rollout(direct)?;
    let of_system = start.elapsed().as_secs_f64();
    let is_flagged = |episode: &&ScreenedEpisode| {
        let fails = match resolved.plan.kind() {
            RunKind::Evaluate => !episode.verdict.is_success(),
            _ => episode.is_violated(),
        };
        fails || episode.robustness().is_none()
    };
    let flagged = screened.iter().filter(is_flagged).count() as f64 / count as f64;
    Ok(Some(EngineSpeeds {
        simulations: [count, direct.len() as u64],
        seconds: [on_device / count as f64, of_system / direct.len() as f64],
        repeated: flagged + (1.0 - flagged) * plan.confirm,
    }))
}

/// Returns the largest number of simulations of a question that has a screening.
fn planned_simulations(plan: &Plan) -> u64 {
    let of_evaluation = plan.evaluate.as_ref().map(|table| table.episodes);
    let of_falsification =
        plan.falsify.as_ref().map(|table| u64::from(table.trials) * u64::from(table.budget));
    let of_risk = plan.risk.as_ref().map(|table| table.simulations);
    [of_evaluation, of_falsification, of_risk].into_iter().flatten().max().unwrap_or(1)
}

/// Returns a plan with the engine that is faster: with a screening, or without one. A plan without
/// a table of a screening is measured with its defaults. Returns `None` if `watch` ends the
/// measurement.
///
/// # Errors
/// As for [`measure_engines`], or if the plan cannot have a screening.
pub fn with_faster_engine(
    resolve: &dyn Fn(&Plan) -> Result<ResolvedPlan, MishandleError>,
    plan: &Plan,
    device: &dyn WorldDevice,
    watch: &(dyn Fn(usize) -> ControlFlow<()> + Sync),
) -> Result<Option<(Plan, EngineSpeeds)>, MishandleError> {
    let screening = plan.screening.clone().unwrap_or_default();
    let screened = Plan { screening: Some(screening.clone()), ..plan.clone() };
    let resolved = resolve(&screened)?;
    let Some(speeds) = measure_engines(&resolved, &screening, device, watch)? else { return Ok(None) };
    if speeds.prefers_screening() {
        return Ok(Some((screened, speeds)));
    }
    let mut direct = Plan { screening: None, ..screened };
    if let Some(falsify) = direct.falsify.as_mut().filter(|falsify| falsify.batch == screening.batch()) {
        // The default of a screening fills its worlds.
        falsify.batch = FalsifyPlan::default().batch;
    }
    Ok(Some((direct, speeds)))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn speeds(seconds: [f64; 2], repeated: f64) -> EngineSpeeds {
        EngineSpeeds { simulations: [100, 64], seconds, repeated }
    }

    #[test]
    fn the_repetitions_belong_to_the_time_of_a_screening() {
        // The device alone is four times as fast; it repeats more and more.
        let repeats = [0.0, 0.5, 0.74, 0.76, 1.0];
        let chosen = repeats.map(|repeated| speeds([0.25, 1.0], repeated).prefers_screening());
        assert_eq!(chosen, [true, true, true, false, false]);
        assert_eq!(speeds([0.25, 1.0], 0.25).per_second(), [2.0, 1.0]);
        let text = speeds([0.25, 1.0], 0.25).text();
        assert!(text.starts_with("screening is 2.0 times as fast"), "{text}");
        let text = speeds([3.0, 1.0], 1.0).text();
        assert!(text.starts_with("MuJoCo C alone is 4.0 times as fast"), "{text}");
    }
}
