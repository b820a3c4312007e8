//! Hardening: a controller and a space in, a better controller with evidence out.
//!
//! A round searches for failures, trains on them, and is accepted or not. Three sets of seeds are
//! disjoint: that of searches and training, that of validations, which decide, and that of the
//! final comparison, which is simulated once, after the last decision. Each phase is a run file or
//! a training run in the folder of the hardening, so that a hardening continues where it stopped.

mod controller_files;
mod decision;
mod examples;
mod folder;
mod measure;
mod minimized;
mod result;
mod round;
mod search;
mod trainer;

use std::collections::BTreeSet;
use std::fmt;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};

use controller_files::ControllerFiles;
use decision::decide;
use mishandle_controllers::ControllerFile;
use mishandle_files::{limits, read_text_bounded};
use mishandle_results::{Choice, Hardening, HardeningRound, Key, Remedy};
use mishandle_rollout::Seed;
use mishandle_store::RunFile;
use mishandle_text::path_text;
use mishandle_training::AlgorithmSettings;

use crate::error::{Compared, MishandleError, exists, invalid};
use crate::plan::{EvaluatePlan, GPU, HardenPlan, Plan, key_values};
use crate::resolve::{
    ResolvedPlan, STARTS, default_reward, has_scene, is_onnx, shipped_file, training_target,
};
use crate::run::{Device, Opening};
pub use examples::{ExampleSource, ModeExample, ModeExamples};
use folder::Folder;
use measure::measure;
use round::{RoundEnd, Training, run_round};
use trainer::Trainer;

/// Indices of the child seeds of validations and of the final comparison. Searches and training
/// runs have others.
const VALIDATION: u64 = 3 << 32;
const FINAL: u64 = 4 << 32;

/// Extension of the files of networks of this program.
const EXTENSION: &str = "safetensors";

/// Extension of the files of ONNX models.
const ONNX_EXTENSION: &str = "onnx";

/// Extension of the folders of hardenings.
pub(crate) const FOLDER_EXTENSION: &str = "harden";

/// Progress of a hardening.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct HardenProgress {
    /// Phase, such as `round 1: training`, with the last line that a trainer printed.
    pub phase: String,
    /// Finished part of the phase; 0 while a trainer of the user runs, which does not say.
    pub done: u64,
    /// The whole phase.
    pub all: u64,
    /// Unit of both.
    pub unit: HardenUnit,
}

/// Unit of the progress of a phase.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum HardenUnit {
    /// Of all phases but training.
    Simulations,
    /// Of training.
    EnvironmentSteps,
}

impl fmt::Display for HardenUnit {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(match self {
            HardenUnit::Simulations => "simulations",
            HardenUnit::EnvironmentSteps => "environment steps",
        })
    }
}

/// Gets the progress now and then, and can end the hardening, which a later call continues.
pub type Watch<'w> = &'w mut (dyn FnMut(&HardenProgress) -> ControlFlow<()> + Send);

/// Returns about the largest numbers of simulations and of environment steps of a hardening.
/// Corners come besides.
pub fn largest_cost(table: &HardenPlan) -> [u64; 2] {
    let rounds = u64::from(table.rounds);
    // Random scenarios have the budget of a search.
    let searches = (table.searches.len() as u64 + 1).saturating_mul(table.budget.into());
    let validation = measure::SPACES.saturating_mul(table.validation);
    let round = searches.saturating_add(minimized::LARGEST).saturating_add(validation);
    let comparison = [measure::SPACES.saturating_mul(table.episodes), table.risk, table.margin, searches];
    let comparison = comparison.into_iter().fold(0, u64::saturating_add);
    let simulations = validation
        .saturating_add(rounds.saturating_mul(round))
        // Before and after.
        .saturating_add(comparison.saturating_mul(2));
    [simulations, rounds.saturating_mul(table.steps)]
}

/// Returns the folder of the runs of a hardening that writes its controller to `out`.
pub fn harden_folder(out: &Path) -> PathBuf {
    out.with_extension(FOLDER_EXTENSION)
}

/// Hardens the controller of a plan and writes the accepted one to `out`. Returns `None` if it was
/// interrupted: [`resume`] continues it.
///
/// # Errors
/// If the plan has no table `[harden]` or is wrong, nothing can train the controller, an output
/// exists, or a simulation, a training run or a file fails.
pub fn harden(
    plan: &Plan,
    out: &Path,
    gpu: Option<&Device>,
    watch: Watch<'_>,
) -> Result<Option<Hardening>, MishandleError> {
    let checked = CheckedHardening::new(plan)?;
    check_device(checked.table, gpu)?;
    let format = checked.before.extension;
    if out.extension().is_none_or(|extension| extension != format) {
        let what = "the file of the controller";
        let value = path_text(out);
        let expected = match format {
            ONNX_EXTENSION => "a name that ends in .onnx, as that of the controller before",
            _ => "a name that ends in .safetensors",
        };
        return Err(invalid(what, value, expected));
    }
    if out.exists() {
        return Err(exists(out, Key::OUT));
    }
    let folder = harden_folder(out);
    checked.create(&folder)?;
    run(&folder, Opening::default(), checked.table.is_trainer_typed, gpu, watch)
}

/// A hardening that can start: its plan is checked.
pub struct CheckedHardening<'p> {
    plan: &'p Plan,
    table: &'p HardenPlan,
    before: ControllerFiles,
    /// Settings of training by this program.
    settings: Option<AlgorithmSettings>,
}

impl CheckedHardening<'_> {
    /// Checks a plan. The device of the training is not needed yet.
    ///
    /// # Errors
    /// If the plan has no table `[harden]` or is wrong, or neither this program nor a trainer of
    /// the plan can train the controller.
    pub fn new(plan: &Plan) -> Result<CheckedHardening<'_>, MishandleError> {
        let table = plan.harden.as_ref().ok_or(MishandleError::MissingPlanTable { table: "harden" })?;
        table.check()?;
        check_target(plan)?;
        if let Some(trainer) = Trainer::of(plan, table)? {
            trainer.check()?;
            let before = ControllerFiles::of_plan(plan)?;
            check(&with_space(plan, plan.controller.clone())?, table, None)?;
            return Ok(CheckedHardening { plan, table, before, settings: None });
        }
        if is_onnx(shipped_file(plan)?.path()) {
            let what = "the controller of a hardening";
            let value = plan.controller.clone();
            let expected = "a network of this program; an ONNX model needs a trainer of yours \
                            (docs/guide/harden.md#with-your-own-trainer)";
            let trainer = Remedy::set(Key::TRAINER, Choice::Text("python train.py".to_string()));
            return Err(invalid(what, value, expected).with(trainer));
        }
        let target = training_target(&plan.target, &table.device)?;
        let before = target.start_controller(&plan.controller)?;
        let settings = given_settings(table, &before)?;
        target.scene(default_reward(&plan.target), &settings)?;
        check(&with_space(plan, plan.controller.clone())?, table, Some(&settings))?;
        let before = ControllerFiles::of_network(before.to_bytes());
        Ok(CheckedHardening { plan, table, before, settings: Some(settings) })
    }

    /// Creates the folder of the hardening, in which [`resume`] starts it.
    ///
    /// # Errors
    /// If the folder exists, or a file cannot be written.
    pub fn create(&self, folder: &Path) -> Result<(), MishandleError> {
        let plan = self.plan.with_absolute_paths();
        let settings = self.settings.as_ref().map(AlgorithmSettings::to_toml);
        Folder::create(folder, &plan, &self.before, settings.as_deref())
    }
}

/// Returns whether a folder is that of a hardening, and whether that is finished.
pub fn is_hardening(folder: &Path) -> Option<bool> {
    plan_file(folder).exists().then(|| folder.join(folder::RESULT).exists())
}

/// Returns the result of the hardening in a folder; `None` if it is not finished.
///
/// # Errors
/// If the folder contains no hardening, or symbolic links, or its result cannot be read.
pub fn finished(folder: &Path) -> Result<Option<Hardening>, MishandleError> {
    Folder::open(folder)?.0.result()
}

/// Returns the path of the plan in the folder of a hardening.
pub fn plan_file(folder: &Path) -> PathBuf {
    folder.join(folder::PLAN)
}

/// A run of the final comparison.
pub struct FinalRun {
    /// Run file.
    pub run: PathBuf,
    /// Present path of its controller: the run names the path at which the folder was made.
    pub controller: PathBuf,
}

/// Returns the runs of the final comparison with failures to look at: of random scenarios in the
/// space, before and after.
pub fn final_runs(folder: &Path, found: &Hardening) -> Vec<FinalRun> {
    let folder = Folder::at(folder);
    let run = |name: &str| measure::path_of(&folder.of_final(name), "space");
    let before = FinalRun { run: run("before"), controller: folder.before() };
    let accepted = found.rounds.iter().rev().find(|round| round.accepted);
    let after =
        accepted.map(|round| FinalRun { run: run("after"), controller: folder.candidate(round.number) });
    [Some(before), after].into_iter().flatten().collect()
}

/// Checks that the hardening of a folder has this plan.
///
/// # Errors
/// If the folder contains no hardening, or one with other settings.
pub fn check_plan(folder: &Path, plan: &Plan) -> Result<(), MishandleError> {
    let (_, recorded) = Folder::open(folder)?;
    let mut plan = plan.clone();
    if plan.folder.is_empty() {
        plan.folder.clone_from(&recorded.folder);
    }
    let [recorded, given] =
        [&recorded, &plan].map(|plan| toml::Table::try_from(plan.with_absolute_paths()).unwrap_or_default());
    let differences = differences(&recorded, &given);
    if differences.is_empty() {
        Ok(())
    } else {
        Err(MishandleError::differs(Compared::Settings, differences))
    }
}

/// Lists the differences between the builds that made the runs of an unfinished hardening and the
/// present one. A finished one gets no rows.
///
/// # Errors
/// If the folder contains no hardening, or a file cannot be read.
pub fn build_differences(folder: &Path) -> Result<Vec<String>, MishandleError> {
    let (folder, plan) = Folder::open(folder)?;
    let mut all = Vec::new();
    if folder.result()?.is_some() {
        return Ok(all);
    }
    // A hardening depends on no other file than those of its folder.
    let controller = path_text(&folder.before());
    let resolved = ResolvedPlan::new(&Plan { controller, ..evaluation(&plan) })?;
    for path in folder.run_files()? {
        for difference in crate::run::build_differences(RunFile::open(&path)?.header(), &resolved) {
            if !all.contains(&difference) {
                all.push(difference);
            }
        }
    }
    Ok(all)
}

/// Lists the settings that differ, each with the recorded and the given value.
fn differences(recorded: &toml::Table, given: &toml::Table) -> Vec<String> {
    let [then, now] = [recorded, given].map(key_values);
    let names: BTreeSet<&String> = then.keys().chain(now.keys()).collect();
    let text = |value: Option<&String>| value.map_or("none", String::as_str).to_string();
    let differing = names.into_iter().filter(|name| then.get(*name) != now.get(*name));
    let sentence =
        |name: &String| format!("{name}: recorded {}, given {}", text(then.get(name)), text(now.get(name)));
    differing.map(sentence).collect()
}

/// Starts or continues the hardening of a folder, or reads the result of a finished one, without a
/// simulation. Returns `None` if it was interrupted.
///
/// # Errors
/// If the folder contains no hardening, or names a trainer that the user has not allowed, or as for
/// [`harden`].
pub fn resume(
    folder: &Path,
    opening: Opening,
    gpu: Option<&Device>,
    watch: Watch<'_>,
) -> Result<Option<Hardening>, MishandleError> {
    run(folder, opening, false, gpu, watch)
}

/// Continues the hardening of a plan as [`resume`] does. The plan's trainer can be typed.
///
/// # Errors
/// If the hardening has other settings, or as for [`resume`].
pub fn resume_plan(
    folder: &Path,
    plan: &Plan,
    gpu: Option<&Device>,
    watch: Watch<'_>,
) -> Result<Option<Hardening>, MishandleError> {
    check_plan(folder, plan)?;
    let is_trainer_typed = plan.harden.as_ref().is_some_and(|table| table.is_trainer_typed);
    run(folder, Opening::default(), is_trainer_typed, gpu, watch)
}

/// Runs the phases of a folder that have not ended.
fn run(
    folder: &Path,
    opening: Opening,
    is_trainer_typed: bool,
    gpu: Option<&Device>,
    watch: Watch<'_>,
) -> Result<Option<Hardening>, MishandleError> {
    let (folder, plan) = Folder::resume(folder, opening)?;
    if let Some(found) = folder.result()? {
        return Ok(Some(found));
    }
    let recorded = plan.harden.clone().ok_or(MishandleError::MissingPlanTable { table: "harden" })?;
    let table = HardenPlan { is_trainer_typed, ..recorded };
    check_device(&table, gpu)?;
    let training = match Trainer::of(&plan, &table)? {
        Some(trainer) => Training::Trainer(trainer),
        None => {
            let settings = settings(&folder.settings(), &ControllerFile::load(&folder.before())?)?;
            Training::Own { settings: Box::new(settings), gpu }
        }
    };
    // The working folder is the trainer's alone.
    let plan = Plan { folder: String::new(), ..with_space(&plan, path_text(&folder.before()))? };
    let out = folder.accepted();
    Hardener { plan: &plan, table: &table, training: &training, folder: &folder }.run(&out, watch)
}

/// Checks that the device of the training is there.
fn check_device(table: &HardenPlan, gpu: Option<&Device>) -> Result<(), MishandleError> {
    if table.device == GPU && gpu.is_none() {
        Err(MishandleError::NoDevice { device: table.device.clone() })
    } else {
        Ok(())
    }
}

/// Checks that a plan's target can be hardened, and the names of the plan.
fn check_target(plan: &Plan) -> Result<(), MishandleError> {
    let resolved = ResolvedPlan::new(&evaluation(plan))?;
    let expected = if !has_scene(&resolved.target.identity.kind) {
        "a task or a target file, because this program runs no controller of other targets"
    } else if resolved.target.spaces.iter().all(|space| space.name() != STARTS) {
        "one with an axis of the kind start: each round measures success from random starts"
    } else {
        return Ok(());
    };
    let what = "the target of a hardening";
    let value = plan.target.clone();
    Err(invalid(what, value, expected))
}

/// Returns a plan with the names of a hardening's plan, which can be resolved.
fn evaluation(plan: &Plan) -> Plan {
    Plan { evaluate: Some(EvaluatePlan::default()), harden: None, ..plan.clone() }
}

/// Returns a plan that names its space, also if the user named none.
fn with_space(plan: &Plan, controller: String) -> Result<Plan, MishandleError> {
    let resolved = ResolvedPlan::new(&Plan { controller, ..evaluation(plan) })?;
    Ok(Plan { space: resolved.plan.space, ..plan.clone() })
}

/// Returns the training settings of a controller, or those of the file that the plan names.
fn given_settings(table: &HardenPlan, before: &ControllerFile) -> Result<AlgorithmSettings, MishandleError> {
    match &table.settings {
        Some(file) => settings(Path::new(file), before),
        None => settings_of(before, &before.header.training.settings, Path::new("the controller")),
    }
}

/// Reads a file of training settings for a controller.
fn settings(path: &Path, before: &ControllerFile) -> Result<AlgorithmSettings, MishandleError> {
    let text = read_text_bounded(path, limits::SETTINGS).map_err(MishandleError::file(path))?;
    settings_of(before, &text, path)
}

fn settings_of(
    before: &ControllerFile,
    text: &str,
    path: &Path,
) -> Result<AlgorithmSettings, MishandleError> {
    let unknown = || MishandleError::UnknownName {
        kind: "training algorithm",
        name: before.header.algorithm.clone(),
        known: mishandle_training::ALGORITHMS.iter().map(|entry| entry.name.to_string()).collect(),
    };
    let settings = AlgorithmSettings::from_toml(&before.header.algorithm, text).ok_or_else(unknown)?;
    settings.map_err(|error| MishandleError::from(error).of(path_text(path)))
}

/// Checks what all phases need, before the first one.
fn check(
    plan: &Plan,
    table: &HardenPlan,
    settings: Option<&AlgorithmSettings>,
) -> Result<(), MishandleError> {
    if plan.screening.is_some() {
        let what = "the question of a screening";
        let value = "harden".to_string();
        return Err(invalid(what, value, "evaluate, falsify or risk"));
    }
    for name in &table.searches {
        crate::resolve::search_entry(name)?;
    }
    if let Some(settings) = settings {
        let no_file = HardenPlan { archive: 0.0, ..table.clone() };
        round::round_settings(settings, plan, &no_file, Path::new("")).check()?;
    }
    Ok(())
}

/// A hardening with its parts.
struct Hardener<'a> {
    plan: &'a Plan,
    table: &'a HardenPlan,
    training: &'a Training<'a>,
    folder: &'a Folder,
}

impl Hardener<'_> {
    fn run(&self, out: &Path, watch: Watch<'_>) -> Result<Option<Hardening>, MishandleError> {
        let before = self.folder.before();
        let mut current = before.clone();
        let Some(mut validated) = self.validate(0, &current, &mut *watch)? else { return Ok(None) };
        let mut rounds = Vec::new();
        let mut accepted = None;
        for number in 1..=self.table.rounds {
            let end = run_round(self, number, &current, &mut *watch)?;
            let bound = validated.bound()?;
            let round = |failures, environment_steps, accepted, reason| HardeningRound {
                number,
                failures,
                environment_steps,
                file_hash: None,
                bound_before: Some(bound),
                bound_after: None,
                accepted,
                reason,
            };
            match end {
                RoundEnd::Interrupted => return Ok(None),
                RoundEnd::NothingFound => {
                    rounds.push(round(0, 0, false, "the searches found no failure".to_string()));
                    break;
                }
                RoundEnd::Diverged { failures, reason } => rounds.push(round(failures, 0, false, reason)),
                RoundEnd::Trained { candidate, failures, environment_steps } => {
                    let Some(found) = self.validate(number, &candidate, &mut *watch)? else {
                        return Ok(None);
                    };
                    let (measures, corners) = validated.compare(&found)?;
                    let decision = decide(&measures, corners, [bound, found.bound()?], &self.table.allow);
                    rounds.push(HardeningRound {
                        bound_after: Some(found.bound()?),
                        // A network of this program has the date and the paths of its training.
                        file_hash: self.table.trainer.as_ref().map(|_| found.file_hash()).transpose()?,
                        ..round(failures, environment_steps, decision.accepted, decision.reason)
                    });
                    if decision.accepted {
                        accepted = Some(candidate.clone());
                        (current, validated) = (candidate, found);
                        // Kept if a later phase is interrupted.
                        ControllerFiles::read(&current)?.write(self.folder, out)?;
                    }
                    if !decision.improves {
                        break;
                    }
                }
            }
        }
        self.conclude(&before, accepted.as_deref(), out, rounds, watch)
    }

    /// Measures a controller on the validation set, the same in every round.
    fn validate(
        &self,
        round: u32,
        controller: &Path,
        watch: Watch<'_>,
    ) -> Result<Option<measure::Measured>, MishandleError> {
        let prefix = self.folder.of_round(round, "validation");
        let seed = Seed(self.plan.seed).child(VALIDATION);
        let phase = format!("round {round}: validation");
        measure(self, controller, &prefix, seed, self.table.validation, &phase, watch)
    }
}
