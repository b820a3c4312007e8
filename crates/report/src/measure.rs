//! Measurements that take simulations: failing patches, checks of the physics, repeats under noise,
//! corners and pictures.

use std::cell::Cell;
use std::ops::ControlFlow;

use mishandle::evaluation::{Corners, Estimate, FormulaRoles, Repeats, failure_rate};
use mishandle::falsification::{PhysicsChecks, Repeated, measure_noise, repeat, repeat_seeds};
use mishandle::inspect::{
    ExplainedSimulation, FailureMode, MinimalFailure, explain_recorded, further_unrecorded,
};
use mishandle::plan::ReportSettings;
use mishandle::results::{self, Answer, Noise, PhysicsCheck};
use mishandle::rollout::{Axis, AxisValues, Episode, Request, Scenario, Seed, Space, Stream, System};
use mishandle::run::{KeptSimulations, has_random_rows};
use mishandle::store::RunFile;
use mishandle::{MishandleError, ResolvedPlan};

use crate::RunReport;
use crate::load::{MAX_MODES, Point, smallest_failure};
use crate::pictures::{self, LeadPictures, Painter, PictureError, Pictures};
use crate::sensitivity::{self, Sensitivity};
use crate::space::Extent;

/// By what fraction of an axis the box of a failure mode is widened on each side.
const MARGIN: f64 = 0.1;

/// Number of scenarios that measure the share of noise, and simulations of each.
const NOISE: (u64, u64) = (Repeated::NOISE_SCENARIOS, Repeated::Noise.simulations());

/// Returns the number of random scenarios of the whole space.
fn scenarios_of_space(probes: u32) -> u64 {
    (4 * u64::from(probes)).min(NOISE.0)
}

/// Number of failures between a found one and the minimal one, which the total of the progress
/// assumes.
const WAY: u64 = 8;

/// Says where simulations come from that were not simulated for this page.
const KEPT: &str = "were kept in a file beside the run, from a page that was written or interrupted before";

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
    /// The failure with which the page begins, beside the nominal simulation.
    pub lead: LeadPictures,
    /// Scenarios of the whole space, for the maps: random ones, or all.
    pub scenarios: Vec<Point>,
    /// Whether `scenarios` are all points of the space, each once.
    pub has_all_points: bool,
    pub noise: Option<Noise>,
    /// Total effects of the axes.
    pub sensitivity: Option<Sensitivity>,
    /// Corners and center of the initial box. For an evaluation, they are in the run file.
    pub corners: Option<results::Corners>,
}

/// Numbers of random scenarios of the simulations of a report.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Samples {
    /// Scenarios that estimate the size of each failing patch; 0 skips it, and all random scenarios
    /// of the whole space.
    pub probes: u32,
    /// Scenarios that measure the total effects of the axes, each simulated twice and once more for
    /// each axis; 0 skips them.
    pub sensitivity: u32,
    /// Simulations of each counterexample of a random target with other seeds, as in the answer of
    /// a falsification; 0 skips them.
    pub repeats: u32,
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

/// Scenarios in a box around the failures of a mode: random ones, or all points of the space.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Patch {
    /// Extent of the space.
    pub extent: Extent,
    /// Whether all points of the space in the box were simulated.
    pub has_all_points: bool,
    /// Volume of the box as a share of the space.
    pub volume: f64,
    /// Number of the scenarios that fail.
    pub failures: u64,
    /// Number of the scenarios without a verdict.
    pub undecided: u64,
    /// Share of the scenarios that fail, of those that start.
    pub failing: Estimate,
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
            Ok(resolved) => self.measure_target(run, &resolved, None, samples, watch),
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
        self.measure_target(run, resolved, painter, samples, watch)
    }

    /// Returns the number of random scenarios that the maps need: none with `probes` of 0, if
    /// others are simulated anyway, or if the run has enough.
    fn mapped(&self, resolved: &ResolvedPlan, probes: u32) -> u64 {
        let axes = resolved.space.axes().iter().filter(|axis| !axis.is_fixed()).count();
        let needed = match axes {
            0 => 0,
            1 => u64::from(probes),
            _ => scenarios_of_space(probes),
        };
        let has_others = mishandle::resolve::space_depends_on_seed(resolved)
            || (has_random_rows(&self.header) && self.counts.simulations >= needed);
        if has_others { 0 } else { needed }
    }

    fn measure_target(
        &mut self,
        run: &RunFile,
        resolved: &ResolvedPlan,
        painter: Option<&mut dyn Painter>,
        samples: Samples,
        watch: impl FnMut(u64, u64) -> ControlFlow<()>,
    ) -> Result<Measurement, MishandleError> {
        let then = &run.header().target;
        let now = &resolved.target.identity;
        if then.kind != now.kind || then.hash != now.hash {
            let reason = format!("the target {} is not the one of the run any more", then.name);
            return Ok(Measurement::Skipped { reason });
        }
        let mut painter = painter;
        let mut watch = watch;
        let began = self.measure_in(run, resolved, &mut painter, samples, &mut watch);
        let Some(kept) = self.kept.take_if(|_| began.is_err()) else { return began };
        // The kept simulations can be those of another page.
        let _ = std::fs::remove_file(kept);
        self.measure_in(run, resolved, &mut painter, samples, &mut watch)
    }

    fn measure_in(
        &mut self,
        run: &RunFile,
        resolved: &ResolvedPlan,
        painter: &mut Option<&mut dyn Painter>,
        samples: Samples,
        watch: &mut dyn FnMut(u64, u64) -> ControlFlow<()>,
    ) -> Result<Measurement, MishandleError> {
        let Samples { probes, sensitivity, .. } = samples;
        let settings =
            format!("{} {} {probes} {sensitivity}", self.counts.simulations, self.counts.falsified);
        let kept = self.kept.as_deref().map(|path| KeptSimulations::open(resolved, path, settings));
        let kept = match kept.transpose() {
            Ok(kept) => kept,
            Err(error) => {
                self.notes.push(format!("The simulations of this page were not kept: {error}."));
                None
            }
        };
        let mut system = kept.as_ref().map_or_else(|| resolved.system(), |kept| Ok(kept.system()))?;
        let axes = resolved.space.axes();
        let seed = Seed(self.header.seed).child(u64::MAX);
        let depends_on_seed = mishandle::resolve::space_depends_on_seed(resolved);
        let corners =
            if self.is_evaluation() { None } else { Corners::new(&resolved.space, depends_on_seed, seed) };
        let modes = self.representatives.len() as u64;
        let noise = if depends_on_seed { scenarios_of_space(probes) * NOISE.1 } else { 0 };
        let repeats = if depends_on_seed { Repeated::Representative.simulations() } else { 0 };
        let extent = Extent::of(axes);
        let mapped = self.mapped(resolved, probes);
        // A random sample of a few points has each of them several times.
        let is_asked = probes > 0 && !depends_on_seed && (modes > 0 || mapped > 0);
        let points = if is_asked { extent.scenarios(axes, scenarios_of_space(probes)) } else { None };
        let (mapped, probed) = match &points {
            Some(points) => (points.len() as u64, 0),
            None => (mapped, u64::from(probes)),
        };
        let unmoved = self.minimal.iter().filter(|minimal| minimal.is_none()).count() as u64;
        let mut checks = resolved.physics_checks()?;
        let checked = if checks.are_possible() {
            PhysicsChecks::most_to_go_back(WAY) * (modes + u64::from(self.lead.is_some()))
        } else {
            0
        };
        let moved = unmoved * MinimalFailure::most(&resolved.space);
        let total = moved
            + checked
            + modes * (probed + repeats)
            + noise
            + mapped
            + sensitivity::simulations(&resolved.space, sensitivity)
            + corners.as_ref().map_or(0, |corners| u64::from(corners.simulations()));
        let mut watch_answer = |done, all| watch(done, all + total);
        let before = self.complete_answer(run, resolved, samples.repeats, &mut watch_answer)?;
        let watch = &mut |done: u64, all: u64| watch(before + done, before + all);
        if watch(0, total).is_break() {
            return Ok(Measurement::Interrupted);
        }
        let mut measured = Measured::default();
        let mut done = 0;
        for index in 0..self.representatives.len() {
            if self.minimal[index].is_some() {
                continue;
            }
            let failure = self.representatives[index].recorded.clone();
            let watch = |count| watch(done + count, total);
            let found = MinimalFailure::found(resolved, run.header(), failure, &mut *system, watch)?;
            let Some(found) = found else { return Ok(Measurement::Interrupted) };
            done += MinimalFailure::most(&resolved.space);
            self.minimal[index] = Some(found);
        }
        if checks.are_possible() {
            let mut watch = |count| watch(moved + count, total);
            for minimal in self.minimal.iter_mut().chain([&mut self.lead]).flatten() {
                if !minimal.check(run, resolved, &mut checks, &mut watch)? {
                    return Ok(Measurement::Interrupted);
                }
            }
            measured.physics =
                self.minimal.iter().flatten().filter_map(|minimal| minimal.cause.physics.clone()).collect();
        }
        for (representative, minimal) in self.representatives.iter_mut().zip(&self.minimal) {
            if let Some(minimal) = minimal {
                *representative = minimal.explained.clone();
            }
        }
        if self.lead().is_none()
            && let Some((trial, number)) = self.nearest
        {
            self.closest = nearest(run, trial, number, resolved)?;
        }
        let mut done = moved + checked;
        let is_interrupted = Cell::new(false);
        let mut count = |_: &Episode| {
            done += 1;
            let flow = watch(done, total);
            is_interrupted.set(is_interrupted.get() || flow.is_break());
            flow
        };
        let mut simulated = Vec::new();
        if let Some(points) = &points {
            let requests = points.iter().map(|point| Request::new(point.clone(), seed));
            simulated = simulate(&mut *system, requests, &mut count)?;
        }
        for (index, mode) in (0..).zip(self.modes.modes.iter().take(MAX_MODES)) {
            let unit_box = unit_box(axes, mode).filter(|_| probes > 0);
            measured.patches.push(match (unit_box, &points) {
                (Some(bounds), Some(_)) => Some(patch_of_points(axes, extent, &bounds, &simulated)),
                (Some(bounds), None) => {
                    let requests = probes_in(&resolved.space, &bounds, seed.child(index), probes);
                    let found = simulate(&mut *system, requests, &mut count)?;
                    Some(Patch { extent, ..patch(&bounds, found.iter()) })
                }
                (None, _) => None,
            });
            let scenario = Scenario::new(self.representatives[index as usize].recorded.scenario.clone());
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
        let mut scenarios: Vec<Point> = simulated.into_iter().map(|(point, _)| point).collect();
        let mut count_mapped = |episode: &Episode| {
            scenarios.push(Point::from(episode));
            count(episode)
        };
        if noise > 0 {
            let random = scenarios_of_space(probes);
            measured.noise = measure_noise(&mut *system, seed, random, NOISE.1, &mut count_mapped)?;
        }
        if mapped > 0 && points.is_none() {
            // The share of noise of one simulation each is nothing to show.
            measure_noise(&mut *system, seed, mapped, 1, &mut count_mapped)?;
        }
        measured.scenarios = scenarios;
        measured.has_all_points = points.is_some();
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
        drop(system);
        if let Some(kept) = kept {
            let answered = kept.answered();
            if answered > 0 {
                let simulations = mishandle_text::plural(answered, "simulation");
                self.notes.push(format!("{simulations} of this page {KEPT}."));
            }
            kept.close()?;
        }
        let witness = self.witness.as_slice();
        let mut must_end = || watch(done, total).is_break();
        let lead = self.lead().map(|lead| lead.explained.clone());
        let mut draw = || -> Result<_, PictureError> {
            let lead = match (&lead, &mut *painter) {
                (None, _) => LeadPictures::default(),
                (Some(lead), None) => pictures::lead(resolved, run.header(), lead)?,
                (Some(lead), Some(painter)) => {
                    pictures::painted_lead(resolved, run.header(), lead, &mut **painter)?
                }
            };
            let mut strips = |simulations: &[ExplainedSimulation]| match &mut *painter {
                None => pictures::strips(run.header(), resolved, simulations, &mut must_end),
                Some(painter) => {
                    pictures::painted_strips(simulations, resolved, &mut **painter, &mut must_end)
                }
            };
            Ok((lead, strips(&self.representatives)?, strips(witness)?))
        };
        match draw() {
            Err(PictureError::Interrupted) => return Ok(Measurement::Interrupted),
            Ok((lead, strips, witness)) => {
                measured.lead = lead;
                measured.strips = strips;
                measured.witness = witness.into_iter().next();
            }
            Err(error) => self.notes.push(format!("There are no pictures of the failures: {error}.")),
        }
        self.measured = Some(measured);
        Ok(Measurement::Done)
    }
}

impl RunReport {
    /// Adds to the answer of a falsification what the terminal has: checks of the physics, repeats
    /// with other seeds, and facts of the target. The page then begins with the same failure.
    /// Returns the largest number of simulations of these parts.
    fn complete_answer(
        &mut self,
        run: &RunFile,
        resolved: &ResolvedPlan,
        repeats: u32,
        watch: &mut dyn FnMut(u64, u64) -> ControlFlow<()>,
    ) -> Result<u64, MishandleError> {
        let Some(answer) = &mut self.answer else { return Ok(0) };
        let mut before = 0;
        let mut part = None;
        let settings = ReportSettings { repeats, ..ReportSettings::default() };
        further_unrecorded(resolved, answer, &settings, |of, done, all| {
            if let Some((_, ended)) = part.filter(|(known, _)| *known != of) {
                before += ended;
            }
            part = Some((of, all));
            watch(before + done, before + all)
        })?;
        if let Answer::Falsification(found) = answer {
            found.subject.offered = resolved.subject().offered;
            self.lead = smallest_failure(run, found)?;
        }
        Ok(before + part.map_or(0, |(_, all)| all))
    }
}

/// Simulates the simulation again that came closest to a failure. `None` without a verdict.
fn nearest(
    run: &RunFile,
    trial: u32,
    number: u32,
    resolved: &ResolvedPlan,
) -> Result<Option<ExplainedSimulation>, MishandleError> {
    let recorded = run.simulation(trial, number)?;
    let request = pictures::request(&recorded);
    let Some(episode) = resolved.system()?.rollout(&[request])?.pop() else { return Ok(None) };
    Ok(episode.robustness().and_then(|_| explain_recorded(run.header(), recorded, episode.trace).ok()))
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

/// Returns requests of random scenarios in a box.
fn probes_in(space: &Space, bounds: &[[f64; 2]], seed: Seed, probes: u32) -> impl Iterator<Item = Request> {
    (1..=probes).map(move |probe| {
        let value = |(number, (axis, [low, high])): (u32, (&Axis, &[f64; 2]))| {
            let u = seed.uniform(Stream::InitialConfiguration, u64::from(probe), number);
            axis.at(low + (high - low) * u)
        };
        let values: Vec<f64> = (0..).zip(space.axes().iter().zip(bounds)).map(value).collect();
        Request::new(space.canonical(Scenario::from(values)), seed.child(u64::from(probe)))
    })
}

/// A simulation, and whether it counts in rates.
type Simulated = (Point, bool);

/// Simulates requests in batches, of which `watch` can end those after the running one.
fn simulate(
    system: &mut dyn System,
    requests: impl Iterator<Item = Request>,
    mut watch: impl FnMut(&Episode) -> ControlFlow<()>,
) -> Result<Vec<Simulated>, MishandleError> {
    let numbered = (1..).zip(requests).map(|(number, request)| Request { number, ..request });
    let numbered: Vec<Request> = numbered.collect();
    let mut simulated = Vec::new();
    for batch in numbered.chunks(BATCH) {
        let mut is_interrupted = false;
        for episode in system.rollout(batch)? {
            is_interrupted |= watch(&episode).is_break();
            simulated.push((Point::from(&episode), episode.end.counts_in_rates()));
        }
        if is_interrupted {
            break;
        }
    }
    Ok(simulated)
}

/// Returns what the simulations in a box say about it.
fn patch<'a>(bounds: &[[f64; 2]], simulated: impl Iterator<Item = &'a Simulated>) -> Patch {
    let (mut failing, mut undecided, mut started) = (0, 0, 0);
    for (point, starts) in simulated {
        started += u64::from(*starts);
        undecided += u64::from(*starts && point.robustness.is_none());
        failing += u64::from(point.fails());
    }
    Patch {
        extent: Extent::Volume,
        has_all_points: false,
        volume: bounds.iter().map(|[low, high]| high - low).product(),
        failures: failing,
        undecided,
        failing: failure_rate(failing, undecided, started),
    }
}

/// Returns what the simulations of all points of a space say about those in a box.
fn patch_of_points(axes: &[Axis], extent: Extent, bounds: &[[f64; 2]], simulated: &[Simulated]) -> Patch {
    let is_inside = |(point, _): &&Simulated| {
        let values = axes.iter().zip(&point.scenario).zip(bounds);
        values.into_iter().all(|((axis, value), [low, high])| {
            axis.is_fixed() || value.is_some_and(|v| (*low..=*high).contains(&axis.unit_coordinate(v)))
        })
    };
    let found = patch(bounds, simulated.iter().filter(is_inside));
    let volume = found.failing.n as f64 / simulated.len() as f64;
    Patch { extent, has_all_points: true, volume, ..found }
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
