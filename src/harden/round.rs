//! A round: search for failures, train on them.

use std::path::{Path, PathBuf};

use mishandle_files::{limits, read_text_bounded};
use mishandle_rollout::Seed;
use mishandle_text::path_text;
use mishandle_training::{AlgorithmSettings, SpaceSetting, TrainingControl, TrainingError, TrainingProgress};
use serde::{Deserialize, Serialize};

use super::controller_files::ControllerFiles;
use super::folder::Folder;
use super::minimized::{minimized, suite_of, write_keys};
use super::search::search;
use super::trainer::Trainer;
use super::{HardenProgress, HardenUnit, Hardener, Watch};
use crate::archive::{Simulated, TABLE, csv, shows_nan, weighted};
use crate::error::MishandleError;
use crate::plan::{HardenPlan, Plan, TrainPlan};
use crate::resolve::{ResolvedPlan, default_reward};
use crate::run::Device;
use crate::train::{TrainObserver, train};

/// Index of the child seed of the searches, and of the training, of round 0. Each round has its
/// own.
const SEARCHES: u64 = 1 << 32;
const TRAINING: u64 = 2 << 32;

/// Total steps per step in which only the critic learns.
const CRITIC_SHARE: u64 = 10;

/// Who trains.
pub(super) enum Training<'a> {
    /// This program.
    Own {
        /// Settings of the controller.
        settings: Box<AlgorithmSettings>,
        /// Device of the physics.
        gpu: Option<&'a Device>,
    },
    /// A program of the user.
    Trainer(Trainer),
}

/// End of a round.
pub(super) enum RoundEnd {
    /// A controller was trained.
    Trained { candidate: PathBuf, failures: u64, environment_steps: u64 },
    /// The search found nothing to train on.
    NothingFound,
    /// Training failed: weights became infinite.
    Diverged { failures: u64, reason: String },
    /// It was interrupted.
    Interrupted,
}

/// Runs a round from a controller.
///
/// # Errors
/// If a simulation or the training cannot be run, or a file cannot be written.
pub(super) fn run_round(
    hardener: &Hardener<'_>,
    round: u32,
    controller: &Path,
    watch: Watch<'_>,
) -> Result<RoundEnd, MishandleError> {
    let Hardener { plan: base, table, training, folder } = *hardener;
    let seed = Seed(base.seed);
    let phase = format!("round {round}: search");
    let prefix = folder.of_round(round, "search");
    let seed_of_searches = seed.child(SEARCHES + u64::from(round));
    let Some(searched) = search(hardener, controller, &prefix, seed_of_searches, &phase, &mut *watch)? else {
        return Ok(RoundEnd::Interrupted);
    };
    let (mut simulated, modes) = searched.simulated()?;
    let failures = simulated.iter().filter(|found| found.robustness.is_sign_negative()).count() as u64;
    if failures == 0 {
        return Ok(RoundEnd::NothingFound);
    }
    let resolved =
        ResolvedPlan::new(&Plan { harden: None, controller: path_text(controller), ..base.clone() })?;
    let suite = suite_of(folder, round);
    if let Some(name) = controller.file_name() {
        // A counterexample names the controller that lies beside it.
        ControllerFiles::read(controller)?.write(folder, &suite.join(name))?;
    }
    let phase = format!("round {round}: minimization");
    write_keys(folder, round, &modes)?;
    let Some(smaller) = minimized(folder, &resolved, &suite, &simulated, &modes, &phase, &mut *watch)? else {
        return Ok(RoundEnd::Interrupted);
    };
    simulated.extend(smaller);
    let archive = suite.join(TABLE);
    let trainable: Vec<Simulated> =
        simulated.into_iter().filter(|found| !shows_nan(resolved.space.axes(), &found.scenario)).collect();
    folder.write(&archive, csv(resolved.space.axes(), &weighted(&trainable)).as_bytes())?;
    let marker = folder.of_round(round, MARKER);
    let candidate = folder.candidate(round);
    if let Some(trained) = Trained::read(&marker) {
        return Ok(trained.end(candidate, failures));
    }
    let session = Session {
        folder,
        plan: base,
        table,
        round,
        controller,
        seed: seed.child(TRAINING + u64::from(round)),
        phase: format!("round {round}: training"),
    };
    let trained = match training {
        Training::Own { settings, gpu } => session.own(settings, &archive, *gpu, watch)?,
        Training::Trainer(trainer) => trainer
            .train(&session, &suite, watch)?
            .is_continue()
            .then_some(Trained { environment_steps: 0, diverged: None }),
    };
    let Some(trained) = trained else { return Ok(RoundEnd::Interrupted) };
    folder.write(&marker, toml::to_string(&trained).unwrap_or_default().as_bytes())?;
    Ok(trained.end(candidate, failures))
}

/// The training of a round.
pub(super) struct Session<'a> {
    pub folder: &'a Folder,
    pub plan: &'a Plan,
    pub table: &'a HardenPlan,
    pub round: u32,
    /// The controller from which it starts.
    pub controller: &'a Path,
    pub seed: Seed,
    pub phase: String,
}

impl Session<'_> {
    /// Trains with this program. Returns `None` if it was interrupted.
    fn own(
        &self,
        settings: &AlgorithmSettings,
        archive: &Path,
        gpu: Option<&Device>,
        watch: Watch<'_>,
    ) -> Result<Option<Trained>, MishandleError> {
        let Session { folder, plan: base, table, round, .. } = *self;
        let settings = round_settings(settings, base, table, archive);
        let file = folder.of_round(round, "settings.toml");
        folder.write(&file, settings.to_toml().as_bytes())?;
        let mut plan = TrainPlan {
            task: base.target.clone(),
            algorithm: settings.algorithm().to_string(),
            reward: default_reward(&base.target).to_string(),
            device: table.device.clone(),
            settings: Some(file),
            from: Some(path_text(self.controller)),
            guard: base.guard.clone(),
            seed: self.seed.0,
            csv: Some(folder.of_round(round, CURVE)),
            out: folder.candidate(round),
            ..TrainPlan::default()
        };
        plan.resume = plan.checkpoint().exists();
        if !plan.resume {
            // A kill before the first checkpoint leaves the beginning of a curve.
            folder.remove(&folder.of_round(round, CURVE))?;
        }
        let mut observer = Observer { phase: self.phase.clone(), watch, stopped: false };
        match train(&plan, gpu, &mut observer) {
            Ok(_) if observer.stopped => Ok(None),
            Ok(mut report) => match report.write_failures.pop() {
                Some(error) => Err(error),
                None => {
                    Ok(Some(Trained { environment_steps: report.result.environment_steps, diverged: None }))
                }
            },
            Err(MishandleError::Training(error)) if matches!(error, TrainingError::NotFinite { .. }) => {
                Ok(Some(Trained { environment_steps: 0, diverged: Some(error.to_string()) }))
            }
            Err(error) => Err(error),
        }
    }
}

/// Learning curve of a round.
const CURVE: &str = "curve.csv";

/// File that says that the training of a round has ended, and how.
const MARKER: &str = "training.toml";

/// End of a training run.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Trained {
    environment_steps: u64,
    /// Why it diverged.
    #[serde(skip_serializing_if = "Option::is_none")]
    diverged: Option<String>,
}

impl Trained {
    fn read(path: &Path) -> Option<Trained> {
        toml::from_str(&read_text_bounded(path, limits::PLAN).ok()?).ok()
    }

    fn end(self, candidate: PathBuf, failures: u64) -> RoundEnd {
        match self.diverged {
            Some(reason) => RoundEnd::Diverged { failures, reason },
            None => RoundEnd::Trained { candidate, failures, environment_steps: self.environment_steps },
        }
    }
}

/// Returns the settings of a round: those of the controller, with the scenarios of the plan.
pub(super) fn round_settings(
    settings: &AlgorithmSettings,
    base: &Plan,
    table: &HardenPlan,
    archive: &Path,
) -> AlgorithmSettings {
    let mut settings = settings.clone();
    let run = settings.run_mut();
    run.total_steps = table.steps;
    run.critic_steps = table.steps / CRITIC_SHARE;
    (run.stop_success, run.stop_strict) = (None, None);
    let scenarios = settings.scenarios_mut();
    scenarios.space = Some(SpaceSetting::One(base.space.clone()));
    scenarios.axes = base.axes.clone();
    scenarios.nominal = table.nominal;
    scenarios.corners = table.corners;
    scenarios.file_share = table.archive;
    scenarios.file = (table.archive > 0.0).then(|| path_text(archive));
    settings
}

/// Forwards the progress of a training run.
struct Observer<'w> {
    phase: String,
    watch: Watch<'w>,
    stopped: bool,
}

impl TrainObserver for Observer<'_> {
    fn iteration_finished(&mut self, progress: &TrainingProgress) -> TrainingControl {
        let progress = HardenProgress {
            phase: self.phase.clone(),
            done: progress.environment_steps,
            all: progress.total_steps,
            unit: HardenUnit::EnvironmentSteps,
        };
        self.stopped = (self.watch)(&progress).is_break();
        if self.stopped { TrainingControl::Stop } else { TrainingControl::Continue }
    }

    /// The report has the errors that remain.
    fn write_failed(&mut self, _error: &MishandleError) {}
}
