//! Measurements that take simulations: failing patches, checks of the physics, repeats under noise,
//! corners and pictures.

use std::cell::Cell;
use std::ops::ControlFlow;

use mishandle::evaluation::{Corners, Estimate, FormulaRoles, Repeats, failure_rate};
use mishandle::falsification::{PhysicsChecks, Repeated, measure_noise, repeat, repeat_seeds};
use mishandle::inspect::{ExplainedSimulation, FailureMode};
use mishandle::results::{self, Noise, PhysicsCheck};
use mishandle::rollout::{Axis, AxisValues, Episode, Request, Scenario, Seed, Space, Stream, System};
use mishandle::store::RunFile;
use mishandle::{MishandleError, ResolvedPlan};

use crate::RunReport;
use crate::load::MAX_MODES;
use crate::pictures::{self, Painter, PictureError, Pictures};
use crate::sensitivity::{self, Sensitivity};

/// By what fraction of an axis the box of a failure mode is widened on each side.
const MARGIN: f64 = 0.1;

/// Number of scenarios that measure the share of noise, and simulations of each.
const NOISE: (u64, u64) = (Repeated::NOISE_SCENARIOS, Repeated::Noise.simulations());

/// Number of simulations per batch.
const BATCH: usize = 64;

/// Results of the simulations. The lists have one entry for each representative.
#[derive(Debug, Default)]
pub struct Measured {
    pub patches: Vec<Option<Patch>>,
    pub repeats: Vec<Option<Repeats>>,
    /// Checks of the physics; empty for a target whose physics MuJoCo C does not step.
    pub physics: Vec<PhysicsCheck>,
    pub strips: Vec<Pictures>,
    /// Pictures of the witness of a margin.
    pub witness: Option<Pictures>,
    pub noise: Option<Noise>,
    /// Total effects of the axes.
    pub sensitivity: Option<Sensitivity>,
    /// Corners and center of the initial box. For an evaluation, they are in the run file.
    pub corners: Option<results::Corners>,
}

/// Numbers of random scenarios of the simulations of a report.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Samples {
    /// Scenarios that estimate the size of each failing patch; 0 skips it.
    pub probes: u32,
    /// Scenarios that measure the total effects of the axes, each simulated twice and once more for
    /// each axis; 0 skips them.
    pub sensitivity: u32,
}

/// How the simulations of a report ended.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Measurement {
    /// The report has the results.
    Done,
    /// The target of the run cannot be simulated.
    Skipped {
        /// Why.
        reason: String,
    },
    /// The caller ended them, and the report has no results.
    Interrupted,
}

/// Random scenarios in a box around the failures of a mode.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Patch {
    /// Volume of the box as a share of the space.
    pub volume: f64,
    /// Number of the scenarios that fail.
    pub failures: u64,
    /// Number of the scenarios without a verdict.
    pub undecided: u64,
    /// Share of the scenarios that fail, of those that start.
    pub failing: Estimate,
}

/// The source of the pictures of a target.
enum Drawn<'a> {
    /// Its scene, if it has one, with the present path of the run's controller.
    Scene(Option<&'a str>),
    /// The target itself.
    Painted(&'a mut dyn Painter),
}

impl RunReport {
    /// Adds what takes simulations: the size of each mode's failing patch, whether its
    /// representative depends on the solver of the physics, how often it fails with other seeds,
    /// the share of noise, corners, and pictures of tasks.
    /// Calls `watch` after each simulation with the number of simulations so far and in total; it
    /// can end them after the running batch.
    ///
    /// `controller` is the present path of the run's controller, if the file was moved. Nothing is
    /// simulated if the target of the run cannot be.
    ///
    /// # Errors
    /// If a simulation cannot be run.
    pub fn measure(
        &mut self,
        run: &RunFile,
        controller: Option<&str>,
        samples: Samples,
        watch: impl FnMut(u64, u64) -> ControlFlow<()>,
    ) -> Result<Measurement, MishandleError> {
        match mishandle::resolve::recorded_plan(run.header(), controller) {
            Ok(resolved) => self.measure_target(run, &resolved, Drawn::Scene(controller), samples, watch),
            Err(error) => Ok(Measurement::Skipped { reason: error.to_string() }),
        }
    }

    /// Like [`measure`](Self::measure), with a target that is not part of this program, such as a
    /// Python system. A `painter` draws its pictures.
    ///
    /// # Errors
    /// If a simulation cannot be run.
    pub fn measure_with(
        &mut self,
        run: &RunFile,
        resolved: &ResolvedPlan,
        painter: Option<&mut dyn Painter>,
        samples: Samples,
        watch: impl FnMut(u64, u64) -> ControlFlow<()>,
    ) -> Result<Measurement, MishandleError> {
        let drawn = painter.map_or(Drawn::Scene(None), Drawn::Painted);
        self.measure_target(run, resolved, drawn, samples, watch)
    }

    fn measure_target(
        &mut self,
        run: &RunFile,
        resolved: &ResolvedPlan,
        drawn: Drawn<'_>,
        samples: Samples,
        watch: impl FnMut(u64, u64) -> ControlFlow<()>,
    ) -> Result<Measurement, MishandleError> {
        let then = &run.header().target;
        let now = &resolved.target.identity;
        if then.kind != now.kind || then.hash != now.hash {
            let reason = format!("the target {} is not the one of the run any more", then.name);
            return Ok(Measurement::Skipped { reason });
        }
        self.measure_in(run, resolved, drawn, samples, watch)
    }

    fn measure_in(
        &mut self,
        run: &RunFile,
        resolved: &ResolvedPlan,
        drawn: Drawn<'_>,
        samples: Samples,
        mut watch: impl FnMut(u64, u64) -> ControlFlow<()>,
    ) -> Result<Measurement, MishandleError> {
        let Samples { probes, sensitivity } = samples;
        let mut system = resolved.system()?;
        let axes = resolved.space.axes();
        let seed = Seed(self.header.seed).child(u64::MAX);
        let depends_on_seed = mishandle::resolve::space_depends_on_seed(resolved);
        let corners =
            if self.is_evaluation() { None } else { Corners::new(&resolved.space, depends_on_seed, seed) };
        let modes = self.representatives.len() as u64;
        let noise = if depends_on_seed { NOISE.0 * NOISE.1 } else { 0 };
        let repeats = if depends_on_seed { Repeated::Representative.simulations() } else { 0 };
        let mut checks = resolved.physics_checks()?;
        let checked = if checks.are_possible() { PhysicsChecks::most(modes) } else { 0 };
        let total = modes * (u64::from(probes) + repeats)
            + checked
            + noise
            + sensitivity::simulations(&resolved.space, sensitivity)
            + corners.as_ref().map_or(0, |corners| u64::from(corners.simulations()));
        let mut measured = Measured::default();
        if checks.are_possible() {
            let representatives = self.modes.modes.iter().take(MAX_MODES).map(FailureMode::representative);
            let failures: Vec<Request> =
                representatives.map(|found| Request::new(Scenario::from(found), Seed(found.seed))).collect();
            match checks.check(&failures, &mut |done| watch(done, total))? {
                Some(found) => measured.physics = found,
                None => return Ok(Measurement::Interrupted),
            }
        }
        let mut done = checked;
        let is_interrupted = Cell::new(false);
        let mut count = |_: &Episode| {
            done += 1;
            let flow = watch(done, total);
            is_interrupted.set(is_interrupted.get() || flow.is_break());
            flow
        };
        for (index, mode) in (0..).zip(self.modes.modes.iter().take(MAX_MODES)) {
            let unit_box = unit_box(axes, mode).filter(|_| probes > 0);
            measured.patches.push(match unit_box {
                Some(bounds) => {
                    let seed = seed.child(index);
                    Some(patch(&mut *system, &resolved.space, &bounds, seed, probes, &mut count)?)
                }
                None => None,
            });
            let scenario = Scenario::from(mode.representative());
            measured.repeats.push(match repeats {
                0 => None,
                _ if is_interrupted.get() => None,
                _ => {
                    let seeds = repeat_seeds(seed.child(index), repeats);
                    Some(repeat(&mut *system, &scenario, seeds, &mut count)?)
                }
            });
            if is_interrupted.get() {
                return Ok(Measurement::Interrupted);
            }
        }
        if noise > 0 {
            let (scenarios, repeats) = NOISE;
            measured.noise = measure_noise(&mut *system, seed, scenarios, repeats, &mut count)?;
        }
        if sensitivity > 0 {
            let seed = seed.child(u64::MAX);
            measured.sensitivity =
                sensitivity::measure(&mut *system, &resolved.space, seed, sensitivity, &mut count)?;
        }
        if let Some(corners) = corners {
            let requests: Vec<Request> =
                (1..=corners.simulations()).filter_map(|number| corners.request(number)).collect();
            let mut counter = corners.counter(FormulaRoles::default(), false, |_| None);
            for batch in requests.chunks(BATCH) {
                if is_interrupted.get() {
                    break;
                }
                for mut episode in system.rollout(batch)? {
                    let _ = count(&episode);
                    // The page says where the requirement of the run fails.
                    episode.verdict.success = episode.verdict.robustness;
                    counter.add(&episode);
                }
            }
            measured.corners = Some(counter.report());
        }
        if is_interrupted.get() {
            return Ok(Measurement::Interrupted);
        }
        let witness = self.witness.as_slice();
        let mut must_end = || watch(done, total).is_break();
        let mut drawn = drawn;
        let mut strips = |simulations: &[ExplainedSimulation]| match &mut drawn {
            Drawn::Scene(controller) => pictures::strips(run, simulations, *controller, &mut must_end),
            Drawn::Painted(painter) => {
                pictures::painted_strips(run, simulations, resolved, &mut **painter, &mut must_end)
            }
        };
        match strips(&self.representatives).and_then(|modes| Ok((modes, strips(witness)?))) {
            Err(PictureError::Interrupted) => return Ok(Measurement::Interrupted),
            Ok((strips, witness)) => {
                measured.strips = strips;
                measured.witness = witness.into_iter().next();
            }
            Err(error) => self.notes.push(format!("There are no pictures of the failures: {error}.")),
        }
        self.measured = Some(measured);
        Ok(Measurement::Done)
    }
}

/// Returns the box of a mode in unit coordinates, widened by [`MARGIN`] except for categories,
/// which a mode never mixes; the whole unit interval for other axes by which failures were not
/// grouped, and for those that are drawn at random. Returns `None` if an axis has no valid bounds.
fn unit_box(axes: &[Axis], mode: &FailureMode) -> Option<Vec<[f64; 2]>> {
    axes.iter()
        .zip(&mode.region)
        .enumerate()
        .map(|(index, (axis, region))| {
            let has_categories = matches!(axis.values, AxisValues::Categorical(_));
            let is_grouped = has_categories || mode.axes.contains(&index);
            let Some((low, high)) = region.filter(|_| is_grouped) else {
                return Some([0.0, 1.0]);
            };
            let margin = if has_categories { 0.0 } else { MARGIN };
            // A discrete value is a whole interval of the coordinate.
            let half = axis.levels().map_or(0.0, |levels| 0.5 / levels as f64);
            let low = (axis.unit_coordinate(low) - half - margin).clamp(0.0, 1.0);
            let high = (axis.unit_coordinate(high) + half + margin).clamp(0.0, 1.0);
            (low < high).then_some([low, high])
        })
        .collect()
}

fn patch(
    system: &mut dyn System,
    space: &Space,
    bounds: &[[f64; 2]],
    seed: Seed,
    probes: u32,
    mut watch: impl FnMut(&Episode) -> ControlFlow<()>,
) -> Result<Patch, MishandleError> {
    let scenario = |probe: u32| {
        let value = |(number, (axis, [low, high])): (u32, (&Axis, &[f64; 2]))| {
            let u = seed.uniform(Stream::InitialConfiguration, u64::from(probe), number);
            axis.at(low + (high - low) * u)
        };
        let values: Vec<f64> = (0..).zip(space.axes().iter().zip(bounds)).map(value).collect();
        space.canonical(Scenario::from(values))
    };
    let requests: Vec<Request> = (1..=probes)
        .map(|number| Request { number, ..Request::new(scenario(number), seed.child(u64::from(number))) })
        .collect();
    let mut failing = 0;
    let mut undecided = 0;
    let mut started = 0;
    let mut is_interrupted = false;
    for batch in requests.chunks(BATCH) {
        if is_interrupted {
            break;
        }
        for episode in system.rollout(batch)? {
            is_interrupted |= watch(&episode).is_break();
            let starts = episode.end.counts_in_rates();
            started += u64::from(starts);
            undecided += u64::from(starts && episode.robustness().is_none());
            failing += u64::from(episode.is_violated());
        }
    }
    let volume = bounds.iter().map(|[low, high]| high - low).product();
    Ok(Patch { volume, failures: failing, undecided, failing: failure_rate(failing, undecided, started) })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_box_of_a_mode_is_widened_within_the_space() {
        let axes = [Axis::start("x", "m", 0.0, 2.0), Axis::start("y", "m", 0.0, 1.0)];
        let mode = FailureMode {
            failures: vec![],
            region: vec![Some((1.0, 1.2)), None],
            samples: (0, 0),
            axes: vec![0, 1],
            is_isolated: false,
        };
        let bounds = unit_box(&axes, &mode).unwrap();
        assert!((bounds[0][0] - 0.4).abs() < 1e-12 && (bounds[0][1] - 0.7).abs() < 1e-12, "{bounds:?}");
        assert_eq!(bounds[1], [0.0, 1.0]);
        let edge = FailureMode {
            failures: vec![],
            region: vec![Some((0.0, 2.0)), Some((1.0, 1.0))],
            samples: (0, 0),
            axes: vec![0, 1],
            is_isolated: false,
        };
        assert_eq!(unit_box(&axes, &edge).unwrap(), [[0.0, 1.0], [0.9, 1.0]]);
        let of_first = FailureMode { axes: vec![0], ..edge };
        assert_eq!(unit_box(&axes, &of_first).unwrap(), [[0.0, 1.0], [0.0, 1.0]]);
    }
}
