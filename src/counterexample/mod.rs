//! Counterexamples as values of their own: one failing scenario with all that a replay needs.

mod export;
mod file;
mod regress;
mod result;
mod suite;

use std::fmt::Debug;
use std::ops::ControlFlow;
use std::path::Path;

use mishandle_falsification::FalsificationError;
use mishandle_results::PhysicsCheck;
use mishandle_rollout::{Episode, Request, Scenario, Seed, Space};
use mishandle_stl::is_violated;
use mishandle_store::{
    AxisRecord, BuildRecord, ComponentRecord, RunFile, RunHeader, Simulation, SimulationEnd, TargetRecord,
};

use crate::error::{MishandleError, RunError, problem};
use crate::inspect::{ExplainedSimulation, explain, explain_episode};
use crate::plan::{FalsifyPlan, Plan};
use crate::portable;
use crate::resolve::{Moved, ResolvedPlan, controller_name, is_target_file, resolve_recorded};
use crate::run::{differences_of_builds, without_verdict_error};

pub use export::{Chosen, Exported, Preparation, export, representatives};
pub(crate) use export::{Failing, is_same_failure, smaller};
pub use regress::{Regression, regress, regress_with};
pub use suite::{Suite, Tested, suite_files};

/// A failing simulation: setup, scenario, seed and the expected result.
///
/// Unlike a run file it is small, and it contains no path of the machine that made it: a shipped
/// controller has its name, any other and a target file have their file names, which are looked up
/// beside the counterexample.
///
/// # Example
/// ```
/// use std::ops::ControlFlow;
/// use mishandle::rollout::{Request, Seed};
/// use mishandle::{Plan, ResolvedPlan};
/// use mishandle::counterexample::Counterexample;
/// use mishandle::falsification::{any_violation, minimize};
/// # let folder = tempfile::tempdir().unwrap();
/// let resolved = ResolvedPlan::new(&Plan::new("toy/sphere-2d", "")).unwrap();
/// let mut system = resolved.system().unwrap();
/// // The point that must be avoided is (0.3, -0.4), by 0.1 m.
/// let found = Request::new([0.35, -0.42], Seed(0));
/// let minimized = minimize(&mut *system, &found, 300, &any_violation, |_| ControlFlow::Continue(())).unwrap();
/// let counterexample = Counterexample::from_episode(&resolved, &minimized.episode).unwrap();
/// let distance = |axis: usize, center: f64| counterexample.scenario[axis].value.unwrap() - center;
/// assert!((distance(0, 0.3).hypot(distance(1, -0.4)) - 0.1).abs() < 0.02);
/// let read = Counterexample::from_json(&counterexample.to_json()).unwrap();
/// assert_eq!(read, counterexample);
/// assert!(read.replay(&read.resolve(folder.path(), None).unwrap()).unwrap().differences.is_empty());
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Counterexample {
    /// Target, space, controller, noise and formula. Its seed is that of the simulation.
    pub plan: Plan,
    /// Identity of the target.
    pub target: TargetRecord,
    /// The exchangeable parts of the target, such as its controller.
    pub components: Vec<ComponentRecord>,
    /// The program that simulated the scenario.
    pub build: BuildRecord,
    /// Name and version of each dependency that affects the simulation.
    pub versions: Vec<(String, String)>,
    /// One value per axis of the space.
    pub scenario: Vec<AxisValue>,
    /// Random seed of the simulation.
    pub seed: u64,
    /// The result.
    pub expected: Expected,
    /// The predicate that sets the robustness; `None` without one.
    pub decisive: Option<Decisive>,
    /// Number of the trial in the run.
    pub trial: u32,
    /// Number of the simulation within its trial.
    pub simulation: u32,
    /// The recorded counterexample, if the scenario was moved toward the nominal one.
    pub minimized_from: Option<MinimizedFrom>,
    /// The check of its physics; `None` if it was not checked.
    pub physics: Option<PhysicsCheck>,
}

/// Value of an axis in a counterexample.
#[derive(Clone, Debug, PartialEq)]
pub struct AxisValue {
    /// Name of the axis.
    pub axis: String,
    /// Unit; empty if it has none.
    pub unit: String,
    /// Value; `None` if it is drawn from the seed.
    pub value: Option<f64>,
    /// Value of the undisturbed episode; `None` for a random draw.
    pub nominal: Option<f64>,
}

/// Result of a simulation that a replay must give again.
#[derive(Clone, Debug, PartialEq)]
pub struct Expected {
    /// End of the simulation.
    pub end: SimulationEnd,
    /// Number of control steps.
    pub steps: u32,
    /// Robustness; negative.
    pub robustness: f64,
    /// Digest of the trace.
    pub trace_digest: u128,
}

/// The predicate that sets the robustness, at its sample.
#[derive(Clone, Debug, PartialEq)]
pub struct Decisive {
    /// Text of the predicate.
    pub predicate: String,
    /// Sample.
    pub sample: u64,
    /// Time of the sample, in seconds.
    pub time: f64,
    /// Texts of the two sides.
    pub sides: [String; 2],
    /// Values of the two sides.
    pub values: [f64; 2],
}

/// The counterexample from which a minimized one was made.
#[derive(Clone, Debug, PartialEq)]
pub struct MinimizedFrom {
    /// One value per axis.
    pub scenario: Vec<Option<f64>>,
    /// Robustness.
    pub robustness: f64,
    /// Number of simulations that the minimization ran.
    pub simulations: u64,
    /// Whether the minimization ended before its budget.
    pub is_complete: bool,
}

/// A replay of a counterexample.
#[derive(Debug)]
pub struct CounterexampleReplay {
    /// The replayed simulation with its explanation.
    pub explained: ExplainedSimulation,
    /// Describes the simulation as the header of a run.
    pub header: RunHeader,
    /// The episode.
    pub episode: Episode,
    /// Differences between the file and what the target and the replay give. Empty if everything
    /// has the same bits.
    pub differences: Vec<String>,
    /// Differences between the recorded build and the present one. Results can differ between
    /// builds.
    pub build_differences: Vec<String>,
}

impl Counterexample {
    /// Returns simulation `number` of trial `trial` of a run as a counterexample. The target need
    /// not be part of this program.
    ///
    /// # Errors
    /// If the run has no such simulation, its robustness is not negative, or it has no recorded
    /// trace and cannot be replayed.
    pub fn from_run(run: &RunFile, trial: u32, number: u32) -> Result<Counterexample, MishandleError> {
        let recorded = run.simulation(trial, number)?;
        check_failing(recorded.robustness)?;
        describe(run.header(), &explain(run, trial, number, None)?)
    }

    /// Returns an episode of a target as a counterexample.
    ///
    /// # Errors
    /// If its robustness is not negative.
    pub fn from_episode(
        resolved: &ResolvedPlan,
        episode: &Episode,
    ) -> Result<Counterexample, MishandleError> {
        check_failing(episode.robustness())?;
        let (header, explained) = explain_episode(resolved, episode)?;
        describe(&header, &explained)
    }

    /// Simulates a request with the target's system and returns the episode as a counterexample.
    ///
    /// # Errors
    /// If the simulation cannot be run, or its robustness is not negative.
    pub fn simulate(resolved: &ResolvedPlan, request: Request) -> Result<Counterexample, MishandleError> {
        let episode =
            resolved.system()?.rollout(&[request])?.pop().ok_or(MishandleError::Run(RunError::NoEpisode))?;
        Counterexample::from_episode(resolved, &episode)
    }

    /// Reads a counterexample file.
    ///
    /// # Errors
    /// If the file cannot be read, is larger than
    /// [`limits::COUNTEREXAMPLE`](mishandle_files::limits::COUNTEREXAMPLE), or is not a
    /// counterexample.
    pub fn read(path: &Path) -> Result<Counterexample, MishandleError> {
        let bytes = mishandle_files::read_bounded(path, mishandle_files::limits::COUNTEREXAMPLE)
            .map_err(MishandleError::file(path))?;
        let text =
            String::from_utf8(bytes).map_err(|_| file::no_counterexample("the file is not UTF-8 text"))?;
        Counterexample::from_json(&text)
    }

    /// Parses a counterexample. Every number has the bits with which it was written.
    ///
    /// # Errors
    /// If the text is not JSON, has an unknown or a missing key or an invalid value, or has a newer
    /// format.
    pub fn from_json(text: &str) -> Result<Counterexample, MishandleError> {
        file::read(text)
    }

    /// Returns the counterexample as JSON.
    pub fn to_json(&self) -> String {
        file::write(self)
    }

    /// Looks up the target and checks that its components are the recorded ones.
    ///
    /// `folder` is the folder of the file. `moved` has the present paths of a controller that is
    /// neither shipped nor in that folder, and of a target file that is not in it; an
    /// `Option<&str>` is that of the controller.
    ///
    /// # Errors
    /// If the target is not part of this program, or a part of it cannot be loaded or has another
    /// hash.
    pub fn resolve<'a>(
        &self,
        folder: &Path,
        moved: impl Into<Moved<'a>>,
    ) -> Result<ResolvedPlan, MishandleError> {
        let plan = portable::plan_in(&self.plan, folder);
        let moved = moved.into();
        if moved.target.is_none() {
            portable::check_target(&plan)?;
        }
        resolve_recorded(plan, &self.components, moved)
    }

    /// Looks up the target with the files of a folder of evidence, as
    /// [`resolve_in`](portable::resolve_in) does.
    ///
    /// # Errors
    /// The errors of [`resolve_in`](portable::resolve_in).
    pub fn resolve_in(&self, folder: &Path) -> Result<ResolvedPlan, MishandleError> {
        portable::resolve_plan_in(self.plan.clone(), &self.components, folder)
    }

    /// Looks up the target with another controller. A target without a controller stays as it is.
    /// `folder` is the folder of the file.
    ///
    /// # Errors
    /// If the target is not part of this program, or the controller cannot be loaded.
    pub fn resolve_with(&self, folder: &Path, controller: &str) -> Result<ResolvedPlan, MishandleError> {
        let mut plan = portable::plan_in(&self.plan, folder);
        portable::check_target(&plan)?;
        // The controller of a target file can be in the file.
        if !plan.controller.is_empty() || is_target_file(&plan.target) {
            plan.controller = controller.to_string();
        }
        ResolvedPlan::new(&plan).map_err(|error| match error {
            MishandleError::UnknownName { kind: "target", name, .. }
            | MishandleError::NotATarget { name } => MishandleError::Run(RunError::ForeignTarget { name }),
            error => error,
        })
    }

    /// Returns the scenario in the order of the axes of `space`.
    ///
    /// # Errors
    /// If the space has other axes, or does not allow a value.
    pub fn scenario_in(&self, space: &Space) -> Result<Scenario, MishandleError> {
        let find = |name: &str| self.scenario.iter().find(|known| known.axis == name);
        let values: Option<Vec<Option<f64>>> =
            space.axes().iter().map(|axis| find(&axis.name).map(|known| known.value)).collect();
        let Some(values) = values.filter(|values| values.len() == self.scenario.len()) else {
            let recorded: Vec<&str> = self.scenario.iter().map(|known| known.axis.as_str()).collect();
            let found: Vec<&str> = space.axes().iter().map(|axis| axis.name.as_str()).collect();
            return Err(problem(format!(
                "the counterexample has the axes {}; the space {} of {} has: {}",
                recorded.join(", "),
                space.name(),
                self.target.name,
                found.join(", ")
            )));
        };
        let scenario = Scenario::new(values);
        space.check(&scenario)?;
        Ok(scenario)
    }

    /// Returns the request of the simulation.
    ///
    /// # Errors
    /// The errors of [`scenario_in`](Self::scenario_in).
    pub fn request(&self, space: &Space) -> Result<Request, MishandleError> {
        let scenario = self.scenario_in(space)?;
        Ok(Request { trial: self.trial, number: self.simulation, ..Request::new(scenario, Seed(self.seed)) })
    }

    /// Returns the check of the physics of the scenario; `None` if its target has no changes to
    /// check.
    ///
    /// # Errors
    /// If the space has other axes, or the target cannot run the scenario.
    pub fn check_physics(&self, resolved: &ResolvedPlan) -> Result<Option<PhysicsCheck>, MishandleError> {
        let mut checks = resolved.physics_checks()?;
        if !checks.are_possible() {
            return Ok(None);
        }
        let request = self.request(&resolved.space)?;
        let found = checks.check(&[request], &mut |_| ControlFlow::Continue(()))?;
        Ok(found.and_then(|mut found| found.pop()))
    }

    /// Simulates the scenario again and compares the result, bit for bit. A recorded check of its
    /// physics is made again, too.
    ///
    /// # Errors
    /// If the space has other axes, the target cannot run the scenario, or the simulation has no
    /// robustness.
    pub fn replay(&self, resolved: &ResolvedPlan) -> Result<CounterexampleReplay, MishandleError> {
        let request = self.request(&resolved.space)?;
        let episode =
            resolved.system()?.rollout(&[request])?.pop().ok_or(MishandleError::Run(RunError::NoEpisode))?;
        if episode.robustness().is_none() {
            return Err(without_verdict_error(&episode));
        }
        let (header, explained) = explain_episode(resolved, &episode)?;
        let mut again = describe(&header, &explained)?;
        if self.physics.is_some() {
            again.physics = self.check_physics(resolved)?;
        }
        Ok(CounterexampleReplay {
            differences: self.differences(&again),
            build_differences: differences_of_builds(&self.build, &self.versions, resolved),
            explained,
            header,
            episode,
        })
    }

    /// Lists the recorded facts that differ from those of a replay, except for the build.
    fn differences(&self, again: &Counterexample) -> Vec<String> {
        let mut found = Vec::new();
        let mut compare = |what: &str, recorded: &dyn Debug, again: &dyn Debug| {
            // The text has all digits and the sign of a zero.
            let recorded = format!("{recorded:?}");
            let again = format!("{again:?}");
            if recorded != again {
                found.push(format!("{what}: recorded {recorded}, replayed {again}"));
            }
        };
        compare("target", &self.target, &again.target);
        compare("scenario", &self.scenario, &again.scenario);
        compare("end", &self.expected.end, &again.expected.end);
        compare("number of control steps", &self.expected.steps, &again.expected.steps);
        compare("robustness", &self.expected.robustness, &again.expected.robustness);
        let digest = |of: &Counterexample| format!("{:032x}", of.expected.trace_digest);
        compare("digest of the trace", &digest(self), &digest(again));
        // A controller that was moved can have another name.
        let is_moved = self.plan.controller != again.plan.controller;
        let components = |of: &Counterexample| {
            of.components.iter().map(|component| facts(component, is_moved)).collect::<Vec<_>>()
        };
        compare("components", &components(self), &components(again));
        compare("decisive predicate", &self.decisive, &again.decisive);
        compare("check of the physics", &self.physics, &again.physics);
        found
    }
}

/// Returns the facts of a component. The file of a controller can be in another folder.
fn facts(component: &ComponentRecord, is_moved: bool) -> [String; 4] {
    let ComponentRecord { role, name, hash, file_hash } = component;
    let name = if is_moved { String::new() } else { controller_name(name) };
    [role.clone(), name, hash.clone(), file_hash.clone()]
}

/// Describes a simulation, whatever its robustness.
fn describe(header: &RunHeader, explained: &ExplainedSimulation) -> Result<Counterexample, MishandleError> {
    let ExplainedSimulation { recorded, explanation, .. } = explained;
    let recorded_plan = Plan::from_toml(&header.plan)?;
    let falsify = FalsifyPlan { formula: Some(header.formula.clone()), ..FalsifyPlan::default() };
    let plan = Plan {
        controller: portable::controller(&recorded_plan, &header.components),
        target: portable::target(&recorded_plan),
        guard: portable::guard(&recorded_plan),
        folder: String::new(),
        seed: recorded.seed,
        // The trace has the signals of the run.
        careful: header.formulas.iter().any(|formula| formula.name == "careful"),
        falsify: Some(falsify),
        // The scenarios have the axes of its space.
        metamorphic: recorded_plan.metamorphic.clone(),
        ..recorded_plan.without_questions()
    };
    let value = |(axis, value): (&AxisRecord, &Option<f64>)| AxisValue {
        axis: axis.name.clone(),
        unit: axis.unit.clone(),
        value: *value,
        nominal: axis.nominal,
    };
    let decisive = explanation.diagnosis.predicate.as_ref().map(|predicate| Decisive {
        predicate: predicate.text.clone(),
        sample: predicate.sample as u64,
        time: predicate.sample as f64 * header.control_dt,
        sides: predicate.sides.clone(),
        values: predicate.values,
    });
    let Simulation { trial, number, seed, end, steps, .. } = *recorded;
    let trace_digest = recorded.trace_digest.or_else(|| Some(recorded.trace.as_ref()?.digest()));
    let trace_digest = trace_digest.ok_or_else(|| {
        problem(format!(
            "the run file was changed: simulation {number} of trial {trial} has no digest of its trace"
        ))
    })?;
    Ok(Counterexample {
        plan,
        target: header.target.clone(),
        components: header.components.clone(),
        build: header.build.clone(),
        versions: header.versions.clone(),
        scenario: header.axes.iter().zip(&recorded.scenario).map(value).collect(),
        seed,
        expected: Expected { end, steps, robustness: recorded.robustness.unwrap_or(f64::NAN), trace_digest },
        decisive,
        trial,
        simulation: number,
        minimized_from: None,
        physics: None,
    })
}

fn check_failing(robustness: Option<f64>) -> Result<(), MishandleError> {
    match robustness {
        Some(rho) if is_violated(rho) => Ok(()),
        Some(rho) => Err(FalsificationError::NotACounterexample { robustness: rho.to_string() }.into()),
        None => Err(FalsificationError::NotACounterexample { robustness: "undecided".to_string() }.into()),
    }
}
