//! Test harness for all algorithms: training on a toy environment, determinism, resumption.

use mishandle_controllers::Policy;
use mishandle_rollout::{Controller, Environment, Seed};
use mishandle_training::{
    AlgorithmSettings, Checkpoint, Observer, Origin, Rates, TrainingControl, TrainingProgress,
    TrainingResult, Validation,
};

use crate::line::Line;

/// Validates by the mean return, and records progress and checkpoints.
#[derive(Default)]
pub struct RecordingObserver {
    /// Iteration after which training stops.
    pub stop_after: Option<u64>,
    /// Iteration after which an additional checkpoint is requested.
    pub save_after: Option<u64>,
    pub checkpoint: Option<Checkpoint>,
    pub first_checkpoint: Option<Checkpoint>,
    pub progress: Vec<TrainingProgress>,
}

impl Observer for RecordingObserver {
    fn validate(&mut self, policy: &Policy, episodes: usize) -> Option<Validation> {
        let mean_return = mean_return(policy, episodes);
        let success_rate = (mean_return / 40.0).clamp(0.0, 1.0);
        Some(Validation::of_starts(Rates { success_rate, strict_success_rate: 0.0, mean_return }))
    }
    fn iteration_finished(&mut self, progress: &TrainingProgress) -> TrainingControl {
        self.progress.push(progress.clone());
        match Some(progress.iteration) {
            iteration if iteration == self.stop_after => TrainingControl::Stop,
            iteration if iteration == self.save_after => TrainingControl::SaveCheckpoint,
            _ => TrainingControl::Continue,
        }
    }
    fn save_checkpoint(&mut self, checkpoint: &Checkpoint) {
        self.first_checkpoint.get_or_insert_with(|| checkpoint.clone());
        self.checkpoint = Some(checkpoint.clone());
    }
}

/// Trains on the line environment with disturbances.
pub fn run(
    threads: usize,
    settings: &AlgorithmSettings,
    origin: Origin<'_>,
    observer: &mut RecordingObserver,
) -> TrainingResult {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
    pool.install(|| settings.train(&Line::new(0.05), Seed(5), origin, observer)).unwrap()
}

/// Checks that training produces the same bits on 1, 2 and 4 threads; returns the number of
/// iterations.
#[track_caller]
pub fn check_threads(settings: &AlgorithmSettings) -> usize {
    let mut one = RecordingObserver::default();
    let trained = run(1, settings, Origin::New, &mut one);
    for threads in [2, 4] {
        let mut many = RecordingObserver::default();
        let again = run(threads, settings, Origin::New, &mut many);
        assert_eq!(trained.last.hash(), again.last.hash(), "{}, {threads} threads", settings.algorithm());
        assert_eq!(trained.best.hash(), again.best.hash(), "{}, {threads} threads", settings.algorithm());
        assert_eq!(facts(&one), facts(&many), "{}, {threads} threads", settings.algorithm());
    }
    one.progress.len()
}

/// Checks that training produces the same bits if it is stopped after `stops` iterations and
/// resumed; returns the number of iterations.
#[track_caller]
pub fn check_resumption(settings: &AlgorithmSettings, stops: &[u64]) -> usize {
    let mut whole = RecordingObserver::default();
    let trained = run(2, settings, Origin::New, &mut whole);
    for stop in stops {
        let mut first = RecordingObserver { stop_after: Some(*stop), ..RecordingObserver::default() };
        run(2, settings, Origin::New, &mut first);
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("line.checkpoint");
        first.checkpoint.unwrap().save(&path).unwrap();
        let mut second = RecordingObserver::default();
        let resumed = run(3, settings, Origin::Checkpoint(&Checkpoint::load(&path).unwrap()), &mut second);
        assert_eq!(resumed.last.hash(), trained.last.hash(), "{}", settings.algorithm());
        assert_eq!(resumed.best.hash(), trained.best.hash(), "{}", settings.algorithm());
        assert_eq!(resumed.environment_steps, trained.environment_steps);
        assert_eq!(facts(&second), facts(&whole)[*stop as usize..], "{}", settings.algorithm());
    }
    whole.progress.len()
}

/// Returns the mean return on the line without disturbances, computed without batches and training
/// code.
pub fn mean_return(controller: &dyn Controller, episodes: usize) -> f64 {
    let line = Line::new(0.0);
    let mut actor = controller.worker();
    let mut state = vec![0.0; controller.state_size()];
    let mut sum = 0.0;
    for index in 0..episodes as u64 {
        let scenario = line.space().sample(Seed(99), index);
        let mut x = scenario.get(0).unwrap();
        let goal = scenario.get(1).unwrap();
        actor.reset(&mut state, Seed(index));
        for _ in 0..40 {
            let mut action = [0.0];
            actor.act(1, &[x as f32, goal as f32], &mut state, &mut action);
            x += 0.1 * f64::from(action[0]).clamp(-1.0, 1.0);
            sum += 1.0 - (x - goal).abs();
        }
    }
    sum / episodes as f64
}

/// Returns the mean return of the optimal policy from the same initial states: straight to the goal
/// at full speed.
pub fn best_return(episodes: usize) -> f64 {
    let line = Line::new(0.0);
    let mut sum = 0.0;
    for index in 0..episodes as u64 {
        let scenario = line.space().sample(Seed(99), index);
        let mut distance = (scenario.get(0).unwrap() - scenario.get(1).unwrap()).abs();
        for _ in 0..40 {
            distance = (distance - 0.1).max(0.0);
            sum += 1.0 - distance;
        }
    }
    sum / episodes as f64
}

/// Returns the progress without times, as text.
fn facts(observer: &RecordingObserver) -> Vec<String> {
    let fact = |p: &TrainingProgress| {
        format!(
            "{} {} {:?} {:?} {:?} {:?} {:?} {:?} {:?} {}",
            p.iteration,
            p.environment_steps,
            p.mean_return,
            p.mean_episode_steps,
            p.terminated_rate,
            p.reward_terms,
            p.validation,
            p.kl,
            p.entropy,
            p.learning_rate
        )
    };
    observer.progress.iter().map(fact).collect()
}
