//! The training loop of all algorithms: iterate, validate, keep the best policy, save checkpoints.

mod curriculum;
pub(crate) mod origin;
pub(crate) mod progress;
pub(crate) mod selection;

use std::time::Instant;

use mishandle_controllers::Policy;
use mishandle_network::{Mlp, NetworkDevice};
use mishandle_rollout::{BatchFactory, Seed};

use self::origin::Origin;
use crate::{
    AlgorithmSettings, Checkpoint, EpisodeStatistics, Observer, PolicySelection, RunSettings,
    ScenarioSettings, SpaceSetting, TimeShares, TrainingControl, TrainingError, TrainingProgress,
    TrainingResult,
};
use curriculum::Curriculum;

/// An algorithm with the state of a training run.
pub(crate) trait Learner {
    /// Computes networks on another device than the CPU, where the algorithm can. By default, it is
    /// not used.
    ///
    /// # Errors
    /// If the device is not available, or it cannot compute these networks.
    fn use_device(&mut self, _device: &dyn NetworkDevice) -> Result<(), TrainingError> {
        Ok(())
    }

    /// Replaces the random policy of the start by that of a controller, and its normalizer, which
    /// then stays as it is.
    ///
    /// # Errors
    /// If it has another form.
    fn start_from(&mut self, policy: &Policy) -> Result<(), TrainingError>;

    /// Returns the number of completed iterations.
    fn iteration(&self) -> u64;

    /// Returns the number of environment steps of one iteration.
    fn iteration_steps(&self) -> u64;

    /// Runs one iteration: acts and learns. The training loop fills in the fields of the progress
    /// that it knows.
    fn iterate(&mut self) -> Result<TrainingProgress, TrainingError>;

    /// Lets new episodes draw from a share of the range of each axis around its nominal value.
    fn set_scenario_share(&mut self, share: f64);

    /// Returns the current policy.
    fn policy(&self) -> Result<Policy, TrainingError>;

    /// Returns a network of the policy's sizes.
    fn network(&self) -> &Mlp<f32>;

    /// Returns the identity of the environment; a checkpoint of another environment cannot be
    /// resumed.
    fn identity(&self) -> String;

    /// Saves the learner's state to a checkpoint.
    ///
    /// # Errors
    /// If the environment batch fails.
    fn save(&mut self, checkpoint: &mut Checkpoint) -> Result<(), TrainingError>;

    /// Restores the learner's state from a checkpoint.
    ///
    /// # Errors
    /// If the checkpoint contains networks or environments of other sizes.
    fn load(&mut self, checkpoint: &Checkpoint) -> Result<(), TrainingError>;
}

/// Returns the number of iterations of the whole training run, rounded up.
pub(crate) fn iterations(run: &RunSettings, iteration_steps: u64) -> u64 {
    run.total_steps.div_ceil(iteration_steps)
}

/// Trains until the last step or until early stopping.
pub(crate) fn train(
    settings: &AlgorithmSettings,
    environments: &dyn BatchFactory,
    networks: Option<&dyn NetworkDevice>,
    seed: Seed,
    origin: Origin<'_>,
    observer: &mut dyn Observer,
) -> Result<TrainingResult, TrainingError> {
    settings.check()?;
    origin.check(settings.run())?;
    check_environments(settings, environments)?;
    let run = settings.run();
    let mut learner = settings.learner(environments, seed)?;
    if let Some(device) = networks {
        learner.use_device(device)?;
    }
    let iterations = iterations(run, learner.iteration_steps());
    let environment_steps = |learner: &dyn Learner| learner.iteration() * learner.iteration_steps();
    let mut stopwatch = Stopwatch { start: Instant::now(), secs_before: 0.0, steps_before: 0 };
    let mut selection = new_selection(settings);
    let mut curriculum = settings.scenarios().curriculum.map(Curriculum::new);
    let mut last_validation = None;
    match origin {
        Origin::New => {}
        Origin::Policy(policy) => learner.start_from(policy)?,
        Origin::Checkpoint(checkpoint) => {
            load(checkpoint, settings, seed, &mut *learner, &mut selection, &mut curriculum)?;
            stopwatch.secs_before = checkpoint.f64s("wall_clock_secs", 1)?[0];
            stopwatch.steps_before = environment_steps(&*learner);
            last_validation = selection.last_validation();
        }
    }
    let mut finished = learner.iteration() >= iterations || selection.target_reached();
    if !finished {
        observer.training_started(environment_steps(&*learner), run.total_steps);
    }
    while !finished {
        let mut progress = learner.iterate()?;
        progress.scenario_share = curriculum.as_ref().map(Curriculum::share);
        let is_last = learner.iteration() >= iterations;
        if is_last || learner.iteration().is_multiple_of(run.validation_interval) {
            let policy = learner.policy()?;
            if let Some(mut validation) = observer.validate(&policy, run.validation_episodes) {
                if let Some(curriculum) = &mut curriculum {
                    let episodes = run.validation_episodes;
                    curriculum.validate(&policy, episodes, &mut validation, observer, &mut *learner);
                }
                selection.record(&policy, validation, environment_steps(&*learner));
                last_validation = Some(validation);
                progress.validation_is_fresh = true;
            }
        }
        progress.iteration = learner.iteration();
        progress.environment_steps = environment_steps(&*learner);
        progress.total_steps = run.total_steps;
        progress.validation = last_validation;
        stopwatch.set_times(&mut progress);
        let control = observer.iteration_finished(&progress);
        finished = control == TrainingControl::Stop || is_last || selection.target_reached();
        if finished
            || control == TrainingControl::SaveCheckpoint
            || learner.iteration().is_multiple_of(run.checkpoint_interval)
        {
            let mut checkpoint =
                Checkpoint::new(settings.algorithm(), &learner.identity(), seed.0, &settings.to_toml());
            learner.save(&mut checkpoint)?;
            selection.save(&mut checkpoint);
            if let Some(curriculum) = &curriculum {
                curriculum.save(&mut checkpoint);
            }
            // Same value as in the progress report, so that an observer can match its own records
            // with the checkpoint.
            checkpoint.put("wall_clock_secs", vec![progress.wall_clock_secs]);
            observer.save_checkpoint(&checkpoint);
        }
    }
    let last = learner.policy()?;
    let best = selection.best();
    Ok(TrainingResult {
        best: best.map_or_else(|| last.clone(), |best| best.policy.clone()),
        best_validation: best.map(|best| best.validation),
        best_environment_steps: best.map_or(environment_steps(&*learner), |best| best.environment_steps),
        last,
        last_validation: selection.validation_at(environment_steps(&*learner)),
        environment_steps: environment_steps(&*learner),
        wall_clock_secs: stopwatch.secs(),
        reached_target: selection.target_reached(),
    })
}

/// Checks that training could resume from a checkpoint.
pub(crate) fn check_resumption(
    settings: &AlgorithmSettings,
    environments: &dyn BatchFactory,
    seed: Seed,
    checkpoint: &Checkpoint,
) -> Result<(), TrainingError> {
    settings.check()?;
    check_environments(settings, environments)?;
    let mut learner = settings.learner(environments, seed)?;
    let mut curriculum = settings.scenarios().curriculum.map(Curriculum::new);
    let mut selection = new_selection(settings);
    load(checkpoint, settings, seed, &mut *learner, &mut selection, &mut curriculum)
}

/// Checks that the environments have the scenarios and the reward terms that the settings name.
fn check_environments(
    settings: &AlgorithmSettings,
    environments: &dyn BatchFactory,
) -> Result<(), TrainingError> {
    check_scenarios(settings, environments)?;
    let found = environments.spec().reward_terms;
    let weights = settings.rewards().weights().into_iter();
    let missing =
        weights.filter(|(_, weight)| *weight > 0.0).find(|(term, _)| !found.iter().any(|t| t == term));
    missing.map_or(Ok(()), |(term, weight)| Err(TrainingError::MissingRewardTerm { term, weight }))
}

/// Checks that the environments draw from the scenarios that the settings name. Their axes are
/// known to the caller only.
fn check_scenarios(
    settings: &AlgorithmSettings,
    environments: &dyn BatchFactory,
) -> Result<(), TrainingError> {
    let ScenarioSettings { space, file, .. } = settings.scenarios();
    let found = environments.scenarios();
    settings.check_curriculum(&found)?;
    if matches!(space, Some(SpaceSetting::Mixture(_))) == found.mixture.is_empty() {
        let text = |is_mixture: bool| if is_mixture { "a mixture of spaces" } else { "one space" };
        let expected = text(found.mixture.is_empty());
        let found = text(!found.mixture.is_empty());
        let setting = "space";
        let expected = expected.to_string();
        let found = found.to_string();
        return Err(TrainingError::OtherScenarios { setting, expected, found });
    }
    match space.as_ref().map(SpaceSetting::name) {
        Some(space) if space != found.space.name() => Err(TrainingError::OtherScenarios {
            setting: "space",
            expected: space,
            found: format!("the space `{}`", found.space.name()),
        }),
        _ => match file {
            Some(file) if found.given.is_empty() => Err(TrainingError::OtherScenarios {
                setting: "file",
                expected: file.clone(),
                found: "no given scenario".to_string(),
            }),
            _ => Ok(()),
        },
    }
}

fn new_selection(settings: &AlgorithmSettings) -> PolicySelection {
    let RunSettings { stop_success, stop_strict, stop_validations, .. } = *settings.run();
    let selection = PolicySelection::new(stop_success, stop_strict, stop_validations);
    selection.with_weights(settings.scenarios().selection)
}

/// Restores learner, selection and curriculum from a checkpoint.
fn load(
    checkpoint: &Checkpoint,
    settings: &AlgorithmSettings,
    seed: Seed,
    learner: &mut dyn Learner,
    selection: &mut PolicySelection,
    curriculum: &mut Option<Curriculum>,
) -> Result<(), TrainingError> {
    check_origin(checkpoint, settings, learner, seed)?;
    learner.load(checkpoint)?;
    if let Some(curriculum) = curriculum {
        curriculum.load(checkpoint, learner)?;
    }
    if learner.iteration() > iterations(settings.run(), learner.iteration_steps()) {
        let done = learner.iteration() * learner.iteration_steps();
        return Err(TrainingError::PastTotalSteps { done, requested: settings.run().total_steps });
    }
    selection.load(checkpoint, learner.network())
}

/// Checks that a checkpoint belongs to the same training run. Only `run.total_steps` may differ,
/// and only if the learning does not depend on it.
fn check_origin(
    checkpoint: &Checkpoint,
    settings: &AlgorithmSettings,
    learner: &dyn Learner,
    seed: Seed,
) -> Result<(), TrainingError> {
    checkpoint.check(settings.algorithm(), &learner.identity(), seed.0)?;
    let original = AlgorithmSettings::from_toml(settings.algorithm(), checkpoint.settings());
    let mut original = original.expect("the algorithm of settings is known")?;
    let original_steps = original.run().total_steps;
    let requested = settings.run().total_steps;
    let all_iterations = |settings: &AlgorithmSettings| iterations(settings.run(), learner.iteration_steps());
    let same_length = all_iterations(&original) == all_iterations(settings);
    original.run_mut().total_steps = requested;
    let differing = original.differing(settings);
    if !differing.is_empty() {
        return Err(TrainingError::SettingsMismatch { differing });
    }
    match settings.depends_on_total_steps() {
        Some(reason) if !same_length => {
            Err(TrainingError::TotalStepsMismatch { original: original_steps, requested, reason })
        }
        _ => Ok(()),
    }
}

/// Returns the progress of an iteration with the statistics of its episodes; the other fields are
/// empty.
pub(crate) fn progress_of(statistics: &EpisodeStatistics) -> TrainingProgress {
    let mean = |sum: f64| (statistics.episodes > 0).then(|| sum / statistics.episodes as f64);
    TrainingProgress {
        iteration: 0,
        environment_steps: 0,
        total_steps: 0,
        steps_per_second: 0.0,
        wall_clock_secs: 0.0,
        mean_return: mean(statistics.total_reward),
        mean_episode_steps: mean(statistics.total_steps as f64),
        terminated_rate: mean(statistics.terminated as f64),
        diverged: statistics.diverged,
        reward_terms: statistics.reward_terms.iter().map(|sum| sum / statistics.steps as f64).collect(),
        validation: None,
        validation_is_fresh: false,
        scenario_share: None,
        kl: None,
        entropy: None,
        learning_rate: 0.0,
        time_shares: TimeShares::default(),
    }
}

/// Wall-clock time of this process and of the runs that it resumes.
struct Stopwatch {
    start: Instant,
    secs_before: f64,
    steps_before: u64,
}

impl Stopwatch {
    fn secs(&self) -> f64 {
        self.secs_before + self.start.elapsed().as_secs_f64()
    }

    fn set_times(&self, progress: &mut TrainingProgress) {
        let elapsed = self.start.elapsed().as_secs_f64();
        progress.wall_clock_secs = self.secs_before + elapsed;
        progress.steps_per_second = (progress.environment_steps - self.steps_before) as f64 / elapsed;
    }
}
