//! The loop that all algorithms share: learn, validate, keep the best, save.

use std::time::Instant;

use mishandle_controllers::Policy;
use mishandle_network::Mlp;
use mishandle_rollout::{BatchFactory, Seed};

use crate::{
    Checkpoint, Config, EpisodeStatistics, Flow, Observer, Progress, RunSettings, Selection, Shares, Trained,
    TrainingError,
};

/// An algorithm at work.
pub(crate) trait Learner {
    /// Iterations done.
    fn iteration(&self) -> u64;

    /// Environment steps of one iteration.
    fn iteration_steps(&self) -> u64;

    /// Acts and learns; the loop fills in what it knows itself.
    fn iterate(&mut self) -> Result<Progress, TrainingError>;

    /// The policy so far.
    fn policy(&self) -> Result<Policy, TrainingError>;

    /// A network of the policy's sizes.
    fn network(&self) -> &Mlp<f32>;

    /// What its environment is: a checkpoint of another one does not fit.
    fn identity(&self) -> String;

    /// Puts all that its future depends on into a checkpoint.
    ///
    /// # Errors
    /// If the environment batch fails as a whole.
    fn save(&mut self, checkpoint: &mut Checkpoint) -> Result<(), TrainingError>;

    /// Goes on where a checkpoint was taken.
    ///
    /// # Errors
    /// If the checkpoint holds networks or simulations of other sizes.
    fn load(&mut self, checkpoint: &Checkpoint) -> Result<(), TrainingError>;
}

/// Iterations of the whole training: enough for all its steps.
pub(crate) fn iterations(run: &RunSettings, iteration_steps: u64) -> u64 {
    run.total_steps.div_ceil(iteration_steps)
}

/// Trains to the end, from a checkpoint if there is one.
pub(crate) fn train(
    config: &Config,
    environments: &dyn BatchFactory,
    seed: Seed,
    resume: Option<&Checkpoint>,
    observer: &mut dyn Observer,
) -> Result<Trained, TrainingError> {
    config.check()?;
    let run = config.run();
    let mut learner = config.learner(environments, seed)?;
    let iterations = iterations(run, learner.iteration_steps());
    let environment_steps = |learner: &dyn Learner| learner.iteration() * learner.iteration_steps();
    let mut clock = Clock { start: Instant::now(), secs_before: 0.0, steps_before: 0 };
    let mut selection = new_selection(run);
    let mut validation = None;
    if let Some(checkpoint) = resume {
        load(checkpoint, config, seed, &mut *learner, &mut selection)?;
        clock.secs_before = checkpoint.f64s("wall_clock_secs", 1)?[0];
        clock.steps_before = environment_steps(&*learner);
        validation = selection.last();
    }
    let mut ended = learner.iteration() >= iterations || selection.content();
    if !ended {
        observer.begins(environment_steps(&*learner), run.total_steps);
    }
    while !ended {
        let mut progress = learner.iterate()?;
        let is_last = learner.iteration() >= iterations;
        if is_last || learner.iteration().is_multiple_of(run.validation_every) {
            let policy = learner.policy()?;
            if let Some(found) = observer.validate(&policy, run.validation_episodes) {
                selection.offer(&policy, found, environment_steps(&*learner));
                validation = Some(found);
                progress.validation_is_fresh = true;
            }
        }
        progress.iteration = learner.iteration();
        progress.environment_steps = environment_steps(&*learner);
        progress.total_steps = run.total_steps;
        progress.validation = validation;
        clock.tell(&mut progress);
        let flow = observer.progress(&progress);
        ended = flow == Flow::Stop || is_last || selection.content();
        if ended || flow == Flow::Save || learner.iteration().is_multiple_of(run.checkpoint_every) {
            let mut checkpoint =
                Checkpoint::new(config.algorithm(), &learner.identity(), seed.0, &config.to_toml());
            learner.save(&mut checkpoint)?;
            selection.save(&mut checkpoint);
            // As the observer was told, so that a record of its own can be known again by it.
            checkpoint.put("wall_clock_secs", vec![progress.wall_clock_secs]);
            observer.checkpoint(&checkpoint);
        }
    }
    let last = learner.policy()?;
    let best = selection.best();
    Ok(Trained {
        best: best.map_or_else(|| last.clone(), |best| best.policy.clone()),
        best_validation: best.map(|best| best.validation),
        best_environment_steps: best.map_or(environment_steps(&*learner), |best| best.environment_steps),
        last,
        last_validation: selection.last_at(environment_steps(&*learner)),
        environment_steps: environment_steps(&*learner),
        wall_clock_secs: clock.secs(),
        reached: selection.content(),
    })
}

/// Checks that a training could go on from a checkpoint.
pub(crate) fn check_resumption(
    config: &Config,
    environments: &dyn BatchFactory,
    seed: Seed,
    checkpoint: &Checkpoint,
) -> Result<(), TrainingError> {
    config.check()?;
    let mut learner = config.learner(environments, seed)?;
    load(checkpoint, config, seed, &mut *learner, &mut new_selection(config.run()))
}

fn new_selection(run: &RunSettings) -> Selection {
    Selection::new(run.stop_success, run.stop_strict, run.stop_validations)
}

/// Goes on where a checkpoint was taken.
fn load(
    checkpoint: &Checkpoint,
    config: &Config,
    seed: Seed,
    learner: &mut dyn Learner,
    selection: &mut Selection,
) -> Result<(), TrainingError> {
    check_origin(checkpoint, config, learner, seed)?;
    learner.load(checkpoint)?;
    if learner.iteration() > iterations(config.run(), learner.iteration_steps()) {
        let done = learner.iteration() * learner.iteration_steps();
        return Err(TrainingError::Done { done, wanted: config.run().total_steps });
    }
    selection.load(checkpoint, learner.network())
}

/// Checks that a checkpoint is of the same training: only how long it is to last may differ, and only if what is
/// learned does not hang on it.
fn check_origin(
    checkpoint: &Checkpoint,
    config: &Config,
    learner: &dyn Learner,
    seed: Seed,
) -> Result<(), TrainingError> {
    checkpoint.check(config.algorithm(), &learner.identity(), seed.0)?;
    let began = Config::from_toml(config.algorithm(), checkpoint.settings());
    let mut began = began.expect("the algorithm of settings is known")?;
    let (old, new) = (began.run().total_steps, config.run().total_steps);
    let all = |config: &Config| iterations(config.run(), learner.iteration_steps());
    let is_as_long = all(&began) == all(config);
    began.run_mut().total_steps = new;
    let differing = began.differing(config);
    if !differing.is_empty() {
        return Err(TrainingError::OtherSettings { differing });
    }
    match config.hangs_on_total() {
        Some(why) if !is_as_long => Err(TrainingError::OtherTotal { began: old, wanted: new, why }),
        _ => Ok(()),
    }
}

/// What an iteration tells of the episodes that ended in it; the rest is to be filled in.
pub(crate) fn progress_of(statistics: &EpisodeStatistics) -> Progress {
    let mean = |sum: f64| (statistics.episodes > 0).then(|| sum / statistics.episodes as f64);
    Progress {
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
        kl: None,
        entropy: None,
        learning_rate: 0.0,
        shares: Shares::default(),
    }
}

/// The time of this run, and what went before it.
struct Clock {
    start: Instant,
    secs_before: f64,
    steps_before: u64,
}

impl Clock {
    fn secs(&self) -> f64 {
        self.secs_before + self.start.elapsed().as_secs_f64()
    }

    fn tell(&self, progress: &mut Progress) {
        let elapsed = self.start.elapsed().as_secs_f64();
        progress.wall_clock_secs = self.secs_before + elapsed;
        progress.steps_per_second = (progress.environment_steps - self.steps_before) as f64 / elapsed;
    }
}
