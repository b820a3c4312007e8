//! PPO learns, and its results do not depend on threads or interruptions.

#![allow(clippy::unwrap_used, reason = "helpers of tests")]
use std::sync::Arc;

use mishandle_controllers::Policy;
use mishandle_rollout::{Axis, Controller, Environment, InitialBox, Sample, Seed, Status, Stream, Worker};
use mishandle_training::ppo::{PpoConfig, train};
use mishandle_training::{Checkpoint, Flow, Observer, Progress, Trained, TrainingError, Validation};

/// A point on a line that has to go to a goal: x moves by a tenth of the action, which is clipped to [-1, 1].
///
/// The reward is 1 - |x - goal|; the point is lost beyond ±1.5. Every start has a random push at each step of up to
/// `wind`, drawn from the simulation's seed.
struct Line {
    initial_box: InitialBox,
    signals: Arc<[String]>,
    reward_terms: Vec<String>,
    wind: f64,
}

impl Line {
    fn new(wind: f64) -> Arc<Line> {
        let axis = |name: &str| Axis { name: name.into(), unit: "m".into(), low: -1.0, high: 1.0 };
        Arc::new(Line {
            initial_box: InitialBox::new(vec![axis("start"), axis("goal")]).unwrap(),
            signals: Arc::from(["distance".to_string()]),
            reward_terms: vec!["there".to_string(), "far".to_string()],
            wind,
        })
    }
}

impl Environment for Line {
    fn name(&self) -> &str {
        "line"
    }
    fn initial_box(&self) -> &InitialBox {
        &self.initial_box
    }
    fn signals(&self) -> &Arc<[String]> {
        &self.signals
    }
    fn reward_terms(&self) -> &[String] {
        &self.reward_terms
    }
    fn observation_size(&self) -> usize {
        2
    }
    fn action_size(&self) -> usize {
        1
    }
    fn state_size(&self) -> usize {
        5
    }
    fn control_dt(&self) -> f64 {
        0.1
    }
    fn episode_steps(&self) -> usize {
        40
    }
    fn worker(&self) -> Box<dyn Worker> {
        Box::new(LineWorker { wind: self.wind })
    }
}

struct LineWorker {
    wind: f64,
}

impl LineWorker {
    fn show(state: &[f64], sample: &mut Sample<'_>) {
        sample.observation.copy_from_slice(&[state[0] as f32, state[1] as f32]);
        sample.signals[0] = (state[0] - state[1]).abs();
    }
}

impl Worker for LineWorker {
    fn reset(&mut self, x0: &[f64], seed: Seed, state: &mut [f64], mut sample: Sample<'_>) {
        let (low, high) = (f64::from(seed.0 as u32), f64::from((seed.0 >> 32) as u32));
        state.copy_from_slice(&[x0[0], x0[1], 0.0, low, high]);
        Self::show(state, &mut sample);
        sample.rewards.fill(0.0);
    }

    fn step(&mut self, action: &[f64], state: &mut [f64], mut sample: Sample<'_>) -> Status {
        let seed = Seed(state[3] as u64 | (state[4] as u64) << 32);
        let wind = self.wind * (2.0 * seed.uniform(Stream::Push, state[2] as u64, 0) - 1.0);
        state[2] += 1.0;
        state[0] += 0.1 * action[0].clamp(-1.0, 1.0) + wind;
        Self::show(state, &mut sample);
        sample.rewards.copy_from_slice(&[1.0, -sample.signals[0]]);
        // Now and then numbers run wild, as they do in physics.
        if seed.uniform(Stream::Push, state[2] as u64, 1) < 0.001 {
            state[0] = f64::NAN;
            sample.observation.fill(f32::NAN);
            sample.rewards.fill(f64::NAN);
            return Status::Diverged;
        }
        if state[0].abs() > 1.5 { Status::Terminated } else { Status::Running }
    }
}

/// Validates by the mean reward, keeps checkpoints, and stops after an iteration if it is told to.
#[derive(Default)]
struct Watch {
    stop_after: Option<u64>,
    /// Iteration after which a checkpoint is asked for, besides those that the settings say.
    save_after: Option<u64>,
    checkpoint: Option<Checkpoint>,
    first_checkpoint: Option<Checkpoint>,
    told: Vec<Progress>,
}

impl Observer for Watch {
    fn validate(&mut self, policy: &Policy, episodes: usize) -> Option<Validation> {
        let mean_return = mean_return(policy, episodes);
        let success_rate = (mean_return / 40.0).clamp(0.0, 1.0);
        Some(Validation { success_rate, strict_success_rate: 0.0, mean_return })
    }
    fn progress(&mut self, progress: &Progress) -> Flow {
        self.told.push(progress.clone());
        match Some(progress.iteration) {
            now if now == self.stop_after => Flow::Stop,
            now if now == self.save_after => Flow::Save,
            _ => Flow::Continue,
        }
    }
    fn checkpoint(&mut self, checkpoint: &Checkpoint) {
        self.first_checkpoint.get_or_insert_with(|| checkpoint.clone());
        self.checkpoint = Some(checkpoint.clone());
    }
}

/// Mean return on the windless line from starts of its own, by hand: no batch, no training code.
fn mean_return(controller: &dyn Controller, episodes: usize) -> f64 {
    let line = Line::new(0.0);
    let mut actor = controller.actor();
    let mut sum = 0.0;
    for index in 0..episodes as u64 {
        let x0 = line.initial_box.sample(Seed(99), index);
        let (mut x, goal) = (x0[0], x0[1]);
        for _ in 0..40 {
            let mut action = [0.0];
            actor.act(1, &[x as f32, goal as f32], &mut [], &mut action);
            x += 0.1 * f64::from(action[0]).clamp(-1.0, 1.0);
            sum += 1.0 - (x - goal).abs();
        }
    }
    sum / episodes as f64
}

/// The best return there is from the same starts: straight to the goal at full speed.
fn best_return(episodes: usize) -> f64 {
    let line = Line::new(0.0);
    let mut sum = 0.0;
    for index in 0..episodes as u64 {
        let x0 = line.initial_box.sample(Seed(99), index);
        let mut distance = (x0[0] - x0[1]).abs();
        for _ in 0..40 {
            distance = (distance - 0.1).max(0.0);
            sum += 1.0 - distance;
        }
    }
    sum / episodes as f64
}

fn settings(text: &str) -> PpoConfig {
    let common = "environments = 48\nrollout_steps = 16\nminibatch_rows = 300\npolicy_hidden = [16]\n\
                  value_hidden = [16]\nvalidation_episodes = 10\n";
    PpoConfig { validation_every: 2, ..PpoConfig::from_toml(&format!("{common}{text}")).unwrap() }
}

fn run(threads: usize, config: &PpoConfig, resume: Option<&Checkpoint>, watch: &mut Watch) -> Trained {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
    pool.install(|| train(Line::new(0.05), config, Seed(5), resume, watch)).unwrap()
}

/// All that a run tells, but for times.
fn facts(watch: &Watch) -> Vec<String> {
    let fact = |p: &Progress| {
        format!(
            "{} {} {:?} {:?} {:?} {:?} {:?} {} {} {}",
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
    watch.told.iter().map(fact).collect()
}

#[test]
fn the_line_is_learned() {
    let config = settings("total_steps = 120_000\ngamma = 0.9\nepisode_steps = 20");
    let trained = run(2, &config, None, &mut Watch::default());
    let (found, best) = (mean_return(&trained.last, 500), best_return(500));
    assert!(found > 0.98 * best, "mean return {found}, the best there is {best}");
    // Standing still gets two thirds: the mean of |x - goal| over the box is 2/3.
    assert!(best > 35.0, "{best}");
}

#[test]
fn threads_change_no_bit() {
    let config = settings("total_steps = 4_000\naction_noise = 0.2");
    let (mut one, mut many) = (Watch::default(), Watch::default());
    let trained = run(1, &config, None, &mut one);
    for threads in [2, 4] {
        many = Watch::default();
        let again = run(threads, &config, None, &mut many);
        assert_eq!(trained.last.hash(), again.last.hash(), "{threads} threads");
        assert_eq!(trained.best.hash(), again.best.hash(), "{threads} threads");
        assert_eq!(facts(&one), facts(&many), "{threads} threads");
    }
    assert_eq!(many.told.len(), 6);
}

#[test]
fn a_resumed_training_goes_on_to_the_same_bits() {
    let config = settings("total_steps = 4_600\nlearning_rate_schedule = \"linear\"");
    let mut whole = Watch::default();
    let trained = run(2, &config, None, &mut whole);
    assert_eq!(whole.told.len(), 6);

    let mut first = Watch { stop_after: Some(3), ..Watch::default() };
    run(2, &config, None, &mut first);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("line.checkpoint");
    first.checkpoint.unwrap().save(&path).unwrap();
    let mut second = Watch::default();
    let resumed = run(3, &config, Some(&Checkpoint::load(&path).unwrap()), &mut second);

    assert_eq!(resumed.last.hash(), trained.last.hash());
    assert_eq!(resumed.best.hash(), trained.best.hash());
    assert_eq!(resumed.environment_steps, trained.environment_steps);
    assert_eq!(facts(&second), facts(&whole)[3..]);
}

#[test]
fn a_checkpoint_asked_for_between_the_regular_ones_changes_nothing_and_can_be_resumed() {
    let config = settings("total_steps = 4_600");
    assert!(config.checkpoint_every > 6, "the settings ask for none before the end");
    let trained = run(2, &config, None, &mut Watch::default());
    let mut saving = Watch { save_after: Some(2), ..Watch::default() };
    assert_eq!(run(2, &config, None, &mut saving).last.hash(), trained.last.hash());
    let mut rest = Watch::default();
    let resumed = run(2, &config, saving.first_checkpoint.as_ref(), &mut rest);
    assert_eq!(rest.told[0].iteration, 3);
    assert_eq!(resumed.last.hash(), trained.last.hash());
}

#[test]
fn a_finished_training_resumed_gives_its_controller() {
    let config = settings("total_steps = 1_000");
    let mut watch = Watch::default();
    let trained = run(1, &config, None, &mut watch);
    let mut nothing = Watch::default();
    let resumed = run(1, &config, watch.checkpoint.as_ref(), &mut nothing);
    assert_eq!(resumed.last.hash(), trained.last.hash());
    assert!(nothing.told.is_empty());
}

#[test]
fn seeds_differ() {
    let config = settings("total_steps = 1_000");
    let hash = |seed| {
        let trained = train(Line::new(0.0), &config, Seed(seed), None, &mut Watch::default());
        trained.unwrap().last.hash()
    };
    assert_ne!(hash(1), hash(2));
    assert_eq!(hash(1), hash(1));
}

#[test]
fn training_ends_when_it_is_good_enough() {
    let config = settings("total_steps = 1_000_000\nstop_success = 0.1\nstop_validations = 2");
    let mut watch = Watch::default();
    let trained = run(2, &config, None, &mut watch);
    assert!(trained.reached);
    assert_eq!(watch.told.len(), 4);
}

#[test]
fn a_checkpoint_of_another_training_is_refused() {
    let config = settings("total_steps = 1_000");
    let mut watch = Watch::default();
    run(1, &config, None, &mut watch);
    let checkpoint = watch.checkpoint.unwrap();
    let refusal = |config: &PpoConfig, seed| {
        train(Line::new(0.0), config, Seed(seed), Some(&checkpoint), &mut Watch::default())
            .unwrap_err()
            .to_string()
    };
    assert_eq!(refusal(&config, 6), "the checkpoint's seed is 5, this training's is 6");
    let wider = PpoConfig { environments: 64, ..config.clone() };
    let told = refusal(&wider, 5);
    // Only what differs is told.
    assert_eq!(told, "the checkpoint's settings is environments = 48, this training's is environments = 64");
    let longer = PpoConfig { total_steps: 2_000, ..config.clone() };
    let resumed = train(Line::new(0.0), &longer, Seed(5), Some(&checkpoint), &mut Watch::default());
    assert!(resumed.is_ok(), "only the number of steps may differ");
}

#[test]
fn weights_that_run_wild_end_the_training_with_an_error() {
    let config =
        settings("learning_rate = 1e30\nlearning_rate_schedule = \"constant\"\ntotal_steps = 100_000");
    let error = train(Line::new(0.0), &config, Seed(1), None, &mut Watch::default()).unwrap_err();
    assert!(matches!(error, TrainingError::NotFinite { .. } | TrainingError::Network(_)), "{error}");
}
