//! Tests episodes of an environment in closed form: their contents, and their independence of
//! batches and threads.

#![allow(clippy::unwrap_used)]

mod function_controller;

use std::sync::{Arc, Mutex};

use function_controller::controller;
use mishandle_rollout::fault::{Channel, FaultSite, Side};
use mishandle_rollout::{
    Axis, AxisKind, AxisValues, Controller, CpuBatch, Disturbance, Effect, Environment, EnvironmentFacts,
    EnvironmentWorker, Episode, EpisodeEnd, Noise, Request, Rollout, RolloutError, Sample, Samples, Scenario,
    Seed, Space, Specification, StepStatus, Stream, System, TimeProfile,
};

/// A point on a line that each action moves. Its initial position has a random offset of up to
/// 0.01.
struct Line {
    facts: EnvironmentFacts,
    /// Position beyond which the simulation diverges.
    divergence_limit: f64,
    /// Lowest position from which an episode can start.
    lowest_start: f64,
    /// Replaces values of the sample at a position.
    corrupt: Corrupt,
    /// Actions that the environment received.
    received: Arc<Mutex<Vec<f64>>>,
}

type Corrupt = fn(f64, &mut Sample<'_>);

impl Line {
    fn new(divergence_limit: f64) -> Line {
        Line {
            facts: EnvironmentFacts {
                name: "line".to_string(),
                space: Space::new("starts", vec![Axis::start("x", "m", -1.0, 1.0)]).unwrap(),
                signals: Arc::from(["x".to_string()]),
                reward_terms: vec!["near".to_string()],
                observation_size: 1,
                exact_size: 0,
                action_size: 1,
                action_limit: 1.0,
                state_size: 1,
                control_dt: 0.1,
                episode_steps: 20,
            },
            divergence_limit,
            lowest_start: f64::NEG_INFINITY,
            corrupt: |_, _| {},
            received: Arc::default(),
        }
    }
}

impl Environment for Line {
    fn facts(&self) -> &EnvironmentFacts {
        &self.facts
    }
    fn worker(&self) -> Box<dyn EnvironmentWorker> {
        Box::new(LineWorker {
            divergence_limit: self.divergence_limit,
            lowest_start: self.lowest_start,
            corrupt: self.corrupt,
            received: self.received.clone(),
        })
    }
}

struct LineWorker {
    divergence_limit: f64,
    lowest_start: f64,
    corrupt: Corrupt,
    received: Arc<Mutex<Vec<f64>>>,
}

impl LineWorker {
    fn write_sample(&self, x: f64, sample: &mut Sample<'_>) {
        sample.observation[0] = x as f32;
        sample.signals[0] = x;
        sample.rewards[0] = -x.abs();
        (self.corrupt)(x, sample);
    }
}

impl EnvironmentWorker for LineWorker {
    fn reset(
        &mut self,
        scenario: &Scenario,
        seed: Seed,
        state: &mut [f64],
        mut sample: Sample<'_>,
    ) -> StepStatus {
        state[0] = scenario.get(0).unwrap() + 0.01 * seed.uniform(Stream::Reset, 0, 0);
        self.write_sample(state[0], &mut sample);
        match state[0] {
            x if x > self.divergence_limit => StepStatus::Diverged,
            x if x < self.lowest_start => StepStatus::InvalidStart,
            _ => StepStatus::Running,
        }
    }

    fn step(&mut self, action: &[f64], state: &mut [f64], mut sample: Sample<'_>) -> StepStatus {
        self.received.lock().unwrap().push(action[0]);
        state[0] += 0.1 * action[0];
        self.write_sample(state[0], &mut sample);
        if state[0] > self.divergence_limit { StepStatus::Diverged } else { StepStatus::Running }
    }
}

/// Multiplies the position by a gain, and adds a thousandth of the number of the control step.
fn amplify(gain: f32, observation: &[f32], state: &mut [f64], action: &mut [f32]) {
    action[0] = gain * observation[0] + 0.001 * state[0] as f32;
    state[0] += 1.0;
}

fn amplifier(gain: f32, inputs: usize) -> Arc<dyn Controller> {
    controller([inputs, 1, 1], move |observation, state, action| amplify(gain, observation, state, action))
}

fn specification() -> Specification {
    Specification::parse("always[0:20](x <= 2)", "eventually[0:20](x < 0.1)", "x <= 0.5", "x < 0.3").unwrap()
}

fn rollout(line: Line, gain: f32, noise: Noise) -> Rollout {
    Rollout::new(Arc::new(line), amplifier(gain, 1), specification(), noise).unwrap()
}

fn requests(n: u64) -> Vec<Request> {
    (0..n).map(|i| Request::new([0.1 * i as f64 - 1.0], Seed(5).child(i))).collect()
}

const NOISE: Noise = Noise { action_std: 0.3, observation_std: 0.1 };

#[test]
fn an_episode_contains_every_sample_and_its_verdict() {
    let request = Request::new([0.8], Seed(1));
    let mut system = rollout(Line::new(9.0), -1.0, Noise::default());
    let episode = system.rollout(&[request]).unwrap().remove(0);
    assert_eq!((episode.steps, episode.end), (20, EpisodeEnd::Completed));
    let start = 0.8 + 0.01 * Seed(1).uniform(Stream::Reset, 0, 0);
    assert_eq!(episode.trace.column(0)[0], start);
    // x decreases by a tenth of itself per step, except for the 0.001 per step that the controller
    // adds.
    let second = start + 0.1 * f64::from(-(start as f32));
    assert_eq!(episode.trace.column(0)[1], second);
    assert_eq!(episode.verdict.success, Some(2.0 - start));
    let dangerous = episode.trace.column(0)[1..].iter().filter(|x| **x > 0.5).count();
    assert_eq!(episode.verdict.dangerous_steps, Some(dangerous));
    let rewards: f64 = episode.trace.column(0)[1..].iter().map(|x| -x.abs()).sum();
    assert!((episode.total_reward - rewards).abs() < 1e-12);
}

#[test]
fn the_bits_of_an_episode_depend_on_neither_batch_nor_threads() {
    let run = |threads: usize, requests: &[Request]| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| rollout(Line::new(9.0), 0.3, NOISE).rollout(requests).unwrap())
    };
    let all = requests(21);
    let together = run(2, &all);
    assert_eq!(together, run(1, &all));
    assert_eq!(together, run(5, &all));
    for (request, episode) in all.iter().zip(&together) {
        assert_eq!(run(1, std::slice::from_ref(request)), std::slice::from_ref(episode));
    }
}

#[test]
fn actions_are_clipped_before_noise_and_not_after() {
    // With a gain of 1000 every clipped action is -1 or 1.
    let quiet = Line::new(1e9);
    let received = quiet.received.clone();
    let request = Request::new([0.5], Seed(3));
    rollout(quiet, 1000.0, Noise::default()).rollout(std::slice::from_ref(&request)).unwrap();
    assert!(received.lock().unwrap().iter().all(|action| *action == 1.0));

    let noisy = Line::new(1e9);
    let received = noisy.received.clone();
    let noise = Noise { action_std: 0.5, observation_std: 0.0 };
    rollout(noisy, 1000.0, noise).rollout(std::slice::from_ref(&request)).unwrap();
    for (step, action) in received.lock().unwrap().iter().enumerate() {
        let mut draw = [0.0];
        Seed(3).normals(Stream::ActionNoise, step as u64, &mut draw);
        assert_eq!(*action, 1.0 + 0.5 * draw[0], "at step {step}");
    }
    assert!(received.lock().unwrap().iter().any(|action| *action > 1.0));
}

#[test]
fn a_diverged_simulation_is_undecided_and_does_not_affect_others() {
    let mut system = rollout(Line::new(1.2), 1.0, Noise::default());
    let episodes = system.rollout(&requests(21)).unwrap();
    let mut diverged = 0;
    let mut completed = 0;
    for episode in &episodes {
        match episode.end {
            EpisodeEnd::Diverged { step } => {
                diverged += 1;
                assert_eq!(episode.trace.len(), step, "the trace ends with the last finite sample");
                assert_eq!(episode.verdict, mishandle_rollout::Verdict::default());
            }
            _ => {
                completed += 1;
                assert_eq!(episode.steps, 20);
            }
        }
    }
    assert!(diverged > 0 && completed > 0);
}

#[test]
fn an_episode_that_cannot_start_has_no_verdict_and_does_not_affect_others() {
    let limited = Line { lowest_start: -0.35, ..Line::new(0.85) };
    let episodes = rollout(limited, -1.0, NOISE).rollout(&requests(21)).unwrap();
    let free = rollout(Line::new(9.0), -1.0, NOISE).rollout(&requests(21)).unwrap();
    for (episode, free) in episodes.iter().zip(&free) {
        let expected = match free.trace.column(0)[0] {
            x if x < -0.35 => EpisodeEnd::InvalidScenario,
            x if x > 0.85 => EpisodeEnd::Diverged { step: 0 },
            _ => {
                assert_eq!(episode, free);
                continue;
            }
        };
        assert_eq!((episode.end, episode.steps, episode.trace.len()), (expected, 0, 0));
        assert_eq!((episode.robustness(), episode.is_violated(), episode.is_success()), (None, false, false));
    }
    let count = |end: EpisodeEnd| episodes.iter().filter(|episode| episode.end == end).count();
    assert_eq!((count(EpisodeEnd::InvalidScenario), count(EpisodeEnd::Diverged { step: 0 })), (7, 2));
}

/// Runs requests to the end and with a stop threshold. The requirement is `formula`, and positions
/// are random walks.
fn whole_and_stopped(formula: &str, threshold: f64) -> Vec<(Episode, Episode)> {
    let specification = Specification::parse(formula, "x < 9", "x < 9", "x < 9").unwrap();
    let parts = (Arc::new(Line::new(9.0)), amplifier(-1.0, 1));
    let mut system = Rollout::new(parts.0, parts.1, specification, NOISE).unwrap();
    let stopping: Vec<Request> = requests(21)
        .into_iter()
        .map(|request| Request { stop_threshold: Some(threshold), ..request })
        .collect();
    let whole = system.rollout(&requests(21)).unwrap();
    whole.into_iter().zip(system.rollout(&stopping).unwrap()).collect()
}

#[test]
fn a_stopped_episode_is_the_start_of_the_whole_and_bounds_its_robustness() {
    let mut stopped = 0;
    for (whole, early) in whole_and_stopped("eventually[0:20](x >= 0)", 0.1) {
        let samples = early.trace.len();
        assert_eq!(early.trace.column(0), &whole.trace.column(0)[..samples]);
        let rho = whole.verdict.robustness.unwrap();
        let bound = early.verdict.robustness.unwrap();
        match early.end {
            EpisodeEnd::Stopped { step } => {
                stopped += 1;
                assert_eq!((step, early.steps, samples), (10, 10, 11), "bounds are checked every 10 steps");
                assert!(0.1 < bound && bound <= rho, "{bound} {rho}");
            }
            _ => assert_eq!((early.steps, bound), (20, rho)),
        }
        let highest = whole.trace.column(0)[..11].iter().copied().fold(f64::MIN, f64::max);
        assert_eq!(early.steps == 10, highest > 0.1);
    }
    assert!((1..21).contains(&stopped), "{stopped}");
}

#[test]
fn an_episode_stops_with_the_exact_robustness_when_the_trace_determines_it() {
    for (whole, early) in whole_and_stopped("always[0:8](x <= 0.5)", f64::INFINITY) {
        assert_eq!(early.end, EpisodeEnd::Stopped { step: 10 });
        assert_eq!(early.verdict.robustness, whole.verdict.robustness);
    }
}

#[test]
fn mismatched_parts_are_errors() {
    let two = amplifier(1.0, 2);
    let result = Rollout::new(Arc::new(Line::new(9.0)), two, specification(), Noise::default());
    assert!(matches!(result.err(), Some(RolloutError::Layout { found_observation: 2, .. })));

    let noise = Noise { action_std: f64::NAN, observation_std: 0.0 };
    let controller = amplifier(1.0, 1);
    let result = Rollout::new(Arc::new(Line::new(9.0)), controller.clone(), specification(), noise);
    assert!(matches!(result.err(), Some(RolloutError::Noise { .. })));

    let unknown = Specification::parse("y < 1", "x < 1", "x < 1", "x < 1").unwrap();
    let result = Rollout::new(Arc::new(Line::new(9.0)), controller, unknown, Noise::default());
    assert!(matches!(result.err(), Some(RolloutError::Monitor { .. })));

    let mut system = rollout(Line::new(9.0), 1.0, Noise::default());
    let request = |x0: Vec<f64>| vec![Request::new(x0, Seed(0))];
    assert!(matches!(
        system.rollout(&request(vec![])),
        Err(RolloutError::Dimension { expected: 1, found: 0, .. })
    ));
    assert!(matches!(system.rollout(&request(vec![f64::NAN])), Err(RolloutError::NotFinite { .. })));
}

/// Runs simulations of a line, with the starts -1, -0.9, ... 1, on which some values are not finite
/// beyond x = 1.
fn rollout_with(corrupt: Corrupt) -> Vec<Episode> {
    let line = Line { corrupt, ..Line::new(9.0) };
    rollout(line, 1.0, Noise::default()).rollout(&requests(21)).unwrap()
}

/// Checks that each episode with an invalid end has the trace of the undisturbed episode up to that
/// end and no verdict, and that all others are undisturbed. `samples` returns the length of the
/// trace for an invalid end.
fn check_invalid_rows(episodes: &[Episode], samples: fn(EpisodeEnd) -> Option<usize>) {
    let undisturbed = rollout_with(|_, _| {});
    let mut invalid = 0;
    for (episode, undisturbed) in episodes.iter().zip(&undisturbed) {
        match samples(episode.end) {
            Some(samples) => {
                invalid += 1;
                assert!(episode.end.is_invalid());
                assert_eq!(episode.trace.column(0), &undisturbed.trace.column(0)[..samples]);
                assert_eq!(episode.steps, samples.saturating_sub(1));
                assert_eq!(episode.verdict, mishandle_rollout::Verdict::default());
                assert_eq!(episode.robustness(), None);
                assert!(episode.total_reward.is_finite());
            }
            None => assert_eq!(episode, undisturbed),
        }
    }
    assert!(invalid > 0 && invalid < episodes.len());
}

#[test]
fn a_nan_action_ends_its_simulation_and_does_not_affect_others() {
    // A NaN observation is an invalid observation, so this controller fails by itself.
    let nan_beyond_1 = controller([1; 3], |observation, state, action| {
        amplify(1.0, observation, state, action);
        if observation[0] > 1.0 {
            action[0] = f32::NAN;
        }
    });
    let mut system =
        Rollout::new(Arc::new(Line::new(9.0)), nan_beyond_1, specification(), Noise::default()).unwrap();
    let episodes = system.rollout(&requests(21)).unwrap();
    // The action of control step k is computed from sample k - 1.
    check_invalid_rows(&episodes, |end| match end {
        EpisodeEnd::InvalidAction { step, index: 0 } => Some(step),
        _ => None,
    });
    // The last start is about 1.0, so its first action can be invalid.
    assert!(episodes.iter().any(|episode| matches!(episode.end, EpisodeEnd::InvalidAction { step: 1, .. })));
}

#[test]
fn an_infinite_observation_ends_its_simulation_and_does_not_affect_others() {
    let corrupt: Corrupt = |x, sample| {
        if x > 1.0 {
            sample.observation[0] = f32::INFINITY;
        }
    };
    check_invalid_rows(&rollout_with(corrupt), |end| match end {
        EpisodeEnd::InvalidObservation { step, index: 0 } => Some(step + 1),
        _ => None,
    });
}

#[test]
fn a_nan_reward_ends_its_simulation_and_does_not_affect_others() {
    let corrupt: Corrupt = |x, sample| {
        if x > 1.0 {
            sample.rewards[0] = f64::NAN;
        }
    };
    check_invalid_rows(&rollout_with(corrupt), |end| match end {
        EpisodeEnd::InvalidReward { step, index: 0 } => Some(step),
        _ => None,
    });
}

#[test]
fn a_nan_signal_ends_its_simulation_and_does_not_affect_others() {
    let corrupt: Corrupt = |x, sample| {
        if x > 1.0 {
            sample.signals[0] = f64::NAN;
        }
    };
    let episodes = rollout_with(corrupt);
    check_invalid_rows(&episodes, |end| match end {
        EpisodeEnd::InvalidSignal { step, index: 0 } => Some(step),
        _ => None,
    });
}

#[test]
fn noise_beyond_the_maximum_is_an_error() {
    let check = |action_std, observation_std| Noise { action_std, observation_std }.check();
    assert!(check(Noise::MAX_STD, Noise::MAX_STD).is_ok());
    for std in [10.1, 1e308, f64::INFINITY, f64::NAN, -0.1] {
        assert!(matches!(check(std, 0.0), Err(RolloutError::Noise { what: "action noise", .. })), "{std}");
        assert!(
            matches!(check(0.0, std), Err(RolloutError::Noise { what: "observation noise", .. })),
            "{std}"
        );
    }
}

#[test]
fn a_batch_has_the_same_bits_on_any_number_of_threads_and_after_a_restored_state() {
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let mut batch = CpuBatch::new(Arc::new(Line::new(9.0)), 13);
            batch.reset(|row| Some(([0.1 * row as f64 - 0.6].into(), Seed(2).child(row as u64))));
            let actions: Vec<f64> = (0..13).map(|row| (row as f64).sin()).collect();
            let mut snapshot = [0.0];
            for step in 0..10 {
                if step == 5 {
                    batch.read_state(4, &mut snapshot);
                }
                batch.step(&actions);
            }
            let end = batch.signals().to_vec();
            batch.write_state(4, &snapshot);
            (0..5).for_each(|_| batch.step(&actions));
            assert_eq!(batch.signals()[4], end[4]);
            end
        })
    };
    let one = run(1);
    assert_eq!(one, run(2));
    assert_eq!(one, run(7));
}

#[test]
fn a_batch_writes_the_same_bits_into_buffers_of_the_caller() {
    let line = Arc::new(Line::new(9.0));
    let mut own = CpuBatch::new(line.clone(), 3);
    let mut other = CpuBatch::new(line.clone(), 3);
    let mut observations = vec![0.0; 3 * line.observation_size()];
    let mut signals = vec![0.0; 3 * line.signals().len()];
    let mut rewards = vec![0.0; 3 * line.reward_terms().len()];
    let start = |row: usize| Some(([0.1 * row as f64].into(), Seed(5).child(row as u64)));
    let only_row_1 = |row: usize| (row == 1).then(|| ([0.3].into(), Seed(6)));
    for step in 0..4 {
        let samples =
            Samples { observations: &mut observations, signals: &mut signals, rewards: &mut rewards };
        match step {
            0 => (own.reset(start), other.reset_into(start, samples)),
            2 => (own.reset(only_row_1), other.reset_into(only_row_1, samples)),
            _ => (own.step(&[0.1, -0.2, 0.3]), other.step_into(&[0.1, -0.2, 0.3], samples)),
        };
        assert_eq!(own.observations(), observations);
        assert_eq!(own.signals(), signals);
        assert_eq!(own.rewards(), rewards);
        assert_eq!(own.statuses(), other.statuses());
    }
    assert!(observations.iter().all(|value| *value != 0.0));
    let short = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| {
        let samples =
            Samples { observations: &mut observations[1..], signals: &mut signals, rewards: &mut rewards };
        other.step_into(&[0.1, -0.2, 0.3], samples);
    }));
    assert!(short.is_err(), "rows of a buffer that is too short would be left out silently");
}

/// Runs an episode of a line with one disturbance.
fn disturbed(effect: Effect, value: Option<f64>, gain: f32, noise: Noise) -> Episode {
    let nominal = if matches!(effect, Effect::ActionDraw { .. }) { None } else { Some(0.0) };
    let kind = if nominal.is_none() { AxisKind::Noise } else { AxisKind::Input };
    let axis = Axis::new(kind, "d", "", [-3.0, 3.0], nominal);
    let line = Line::new(1e9);
    // The axis of the disturbance comes first, so that the test covers the lookup of axes by name.
    let space = Space::new("s", vec![axis.clone(), line.space().axes()[0].clone()]).unwrap();
    let mut system =
        rollout(line, gain, noise).with_disturbances(space, &[Disturbance { axis, effect }]).unwrap();
    let request = Request::new(Scenario::new(vec![value, Some(0.5)]), Seed(3));
    system.rollout(&[request]).unwrap().remove(0)
}

fn positions(episode: &Episode) -> Vec<f64> {
    episode.trace.column(0).to_vec()
}

#[test]
fn a_nominal_disturbance_changes_no_bit() {
    let undisturbed = rollout(Line::new(1e9), -0.4, NOISE).rollout(&[Request::new([0.5], Seed(3))]).unwrap();
    let whole = TimeProfile::Constant(0..20);
    for effect in [
        Effect::Observation { entry: 0, factor: 1.0, profile: whole.clone() },
        Effect::Action { entry: 0, profile: whole },
        Effect::ObservationNoise { entries: vec![(0, 1.0)] },
        Effect::ObservationDelay,
        Effect::ActionDelay,
        Effect::ActionDraw { entry: 0, steps: 0..20 },
    ] {
        let nominal = if matches!(effect, Effect::ActionDraw { .. }) { None } else { Some(0.0) };
        let episode = disturbed(effect.clone(), nominal, -0.4, NOISE);
        assert_eq!(positions(&episode), positions(&undisturbed[0]), "{effect:?}");
    }
}

#[test]
fn an_offset_of_the_action_moves_the_point_by_its_integral() {
    // With a gain of 0 the action is 0.001 per step, so it is not clipped.
    let effect = Effect::Action { entry: 0, profile: TimeProfile::Constant(5..9) };
    let with = disturbed(effect.clone(), Some(0.25), 0.0, Noise::default());
    let without = disturbed(effect, Some(0.0), 0.0, Noise::default());
    for (step, (a, b)) in positions(&with).iter().zip(positions(&without)).enumerate() {
        // Four control steps move the point by 0.1 * 0.25 each, the first from sample 5 to
        // sample 6.
        let expected = 0.1 * 0.25 * step.saturating_sub(5).min(4) as f64;
        assert!((a - b - expected).abs() < 1e-12, "at sample {step}: {}", a - b);
    }
}

#[test]
fn an_observation_bias_affects_the_controller_but_not_the_trace() {
    let effect = Effect::Observation { entry: 0, factor: 1.0, profile: TimeProfile::Constant(0..20) };
    let with = disturbed(effect.clone(), Some(0.5), -0.1, Noise::default());
    let without = disturbed(effect, Some(0.0), -0.1, Noise::default());
    let with = positions(&with);
    let without = positions(&without);
    assert_eq!(with[0], without[0]);
    // The action is lower by 0.1 times the bias, and the point moves by a tenth of the action.
    assert!((without[1] - with[1] - 0.1 * 0.1 * 0.5).abs() < 1e-8);
}

#[test]
fn sensor_noise_has_the_deviation_of_its_axis_and_another_draw_in_each_step() {
    // Without a gain but with one of -0.1 on the noisy observation, the point moves by a tenth of
    // the action.
    let noise = |value| {
        let effect = Effect::ObservationNoise { entries: vec![(0, 2.0)] };
        positions(&disturbed(effect, Some(value), -0.1, Noise::default()))
    };
    let without = noise(0.0);
    let with = noise(0.5);
    let mut draws = [0.0];
    Seed(3).normals(Stream::SensorNoise, 0, &mut draws);
    // Value 0.5 times the factor 2 is a standard deviation of 1.
    assert!((with[1] - without[1] + 0.1 * 0.1 * draws[0]).abs() < 1e-8);
    let moves: Vec<f64> = with.windows(2).map(|pair| pair[1] - pair[0]).collect();
    assert!(moves.windows(2).all(|pair| pair[0] != pair[1]), "the draws differ: {moves:?}");
}

#[test]
fn a_repeated_observation_has_the_noise_of_its_measurement() {
    let noise = Noise { action_std: 0.0, observation_std: 0.1 };
    let late = positions(&disturbed(Effect::ObservationPeriod, Some(3.0), -0.1, noise));
    // The point moves by a tenth of the action, which has 0.001 per call besides the observation.
    let seen: Vec<f64> = late
        .windows(2)
        .enumerate()
        .map(|(step, pair)| (10.0 * (pair[1] - pair[0]) - 0.001 * step as f64) / -0.1)
        .collect();
    for (first, three) in (0..).step_by(3).zip(seen.chunks_exact(3)) {
        assert!(three.iter().all(|x| (x - three[0]).abs() < 1e-5), "from control step {first}: {three:?}");
    }
    assert!(seen.windows(4).all(|four| (four[3] - four[0]).abs() > 1e-5), "other draws: {seen:?}");
}

#[test]
fn an_action_delay_applies_to_its_own_row() {
    let run = |delay: f64| {
        let axis = Axis::new(AxisKind::Model, "delay", "control steps", [0.0, 3.0], Some(0.0))
            .with_values(AxisValues::Integer);
        let line = Line::new(1e9);
        let space = Space::new("s", vec![line.space().axes()[0].clone(), axis.clone()]).unwrap();
        let effect = Effect::ActionDelay;
        let mut system = rollout(line, -1.0, Noise::default())
            .with_disturbances(space, &[Disturbance { axis, effect }])
            .unwrap();
        let request = |delay| Request::new([0.5, delay], Seed(3));
        let others = [request(3.0), request(delay), request(1.0)];
        positions(&system.rollout(&others).unwrap()[1])
    };
    let prompt = run(0.0);
    let late = run(2.0);
    assert_eq!(late[..3], [late[0]; 3], "the first two actions are 0");
    // The first action arrives in the third control step and has the same effect as without a
    // delay.
    assert_eq!(late[3] - late[2], prompt[1] - prompt[0]);
}

/// A system of a line with faults of its observation and its action. A control step takes 0.1 s.
fn with_faults(line: Line, gain: f32, noise: Noise) -> Rollout {
    let site = |side, name: &str| FaultSite {
        side,
        name: name.to_string(),
        number: 0,
        channels: vec![Channel { name: "x".to_string(), entries: vec![0] }],
        ranges: vec![[-1.0, 1.0]],
        has_numbers: true,
        control_dt: line.control_dt(),
        episode_steps: line.episode_steps(),
    };
    let mut disturbances = site(Side::Sensing, "sensor").disturbances();
    disturbances.extend(site(Side::Actuation, "actuator").disturbances());
    let axes = line.space().axes().iter().chain(disturbances.iter().map(|d| &d.axis));
    let space = Space::new("s", axes.cloned().collect()).unwrap();
    rollout(line, gain, noise).with_disturbances(space, &disturbances).unwrap()
}

/// A request with a fault of a kind for control steps 4 to 7.
fn faulty(system: &Rollout, side: Side, kind: &str, more: &[(&str, f64)]) -> Request {
    let name = if side == Side::Sensing { "sensor" } else { "actuator" };
    let number = side.kinds().iter().position(|known| known.name == kind).unwrap() as f64;
    let life = [("", number), ("_onset", 0.4), ("_duration", 0.4)];
    let values: Vec<(String, f64)> =
        life.iter().chain(more).map(|(suffix, value)| (format!("{name}{suffix}"), *value)).collect();
    let value = |axis: &Axis| {
        let set = values.iter().find(|(name, _)| *name == axis.name);
        set.map_or(axis.nominal, |(_, value)| Some(*value))
    };
    let scenario = Scenario::new(system.space().axes().iter().map(value).collect());
    assert!(system.space().ineffective(&scenario).is_empty());
    Request::new(scenario, Seed(3))
}

#[test]
fn a_paused_controller_in_a_batch_keeps_its_state_and_the_others_theirs() {
    let mut system = with_faults(Line::new(1e9), 0.0, Noise::default());
    let healthy = Request::new(system.space().nominal(), Seed(3));
    let paused = faulty(&system, Side::Actuation, "pause", &[]);
    let episodes = system.rollout(&[healthy.clone(), paused.clone(), healthy]).unwrap();
    // The action of call k is 0.001 k, and moves the point by a tenth.
    let moves = |episode: &Episode| -> Vec<f64> {
        positions(episode).windows(2).map(|pair| ((pair[1] - pair[0]) * 1e4).round()).collect()
    };
    let calls: Vec<f64> = (0..20).map(f64::from).collect();
    assert_eq!((moves(&episodes[0]), moves(&episodes[2])), (calls.clone(), calls));
    let expected = [0, 1, 2, 3, 3, 3, 3, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15].map(f64::from);
    assert_eq!(moves(&episodes[1]), expected);
    let alone = system.rollout(&[paused]).unwrap().remove(0);
    assert_eq!(positions(&alone), positions(&episodes[1]));
}

#[test]
fn faults_come_after_noise_so_that_controller_and_environment_get_what_they_state() {
    let line = Line::new(1e9);
    let received = Arc::clone(&line.received);
    let mut system = with_faults(line, 1.0, NOISE);
    // A sensor that is stuck at 0.5: the controller answers 0.5, and its noise is held, too.
    let stuck = faulty(&system, Side::Sensing, "stuck", &[("_level", 0.5)]);
    received.lock().unwrap().clear();
    system.rollout(&[stuck]).unwrap();
    let noise = |step: u64| {
        let mut draws = [0.0];
        Seed(3).normals(Stream::ActionNoise, step, &mut draws);
        NOISE.action_std * draws[0]
    };
    for step in 4..8 {
        // The controller adds 0.001 per call.
        let expected = 0.5 + 0.001 * step as f64 + noise(step as u64);
        let found = received.lock().unwrap()[step];
        assert!((found - expected).abs() < 1e-6, "control step {step}: {found}, not {expected}");
    }
    let limited = faulty(&system, Side::Actuation, "saturation", &[("_limit", 0.05)]);
    received.lock().unwrap().clear();
    system.rollout(&[limited]).unwrap();
    let actions = received.lock().unwrap().clone();
    assert!(actions[4..8].iter().all(|action| action.abs() <= 0.05 + 1e-9), "{actions:?}");
    assert!(actions.iter().any(|action| action.abs() > 0.05));
}

#[test]
fn nan_of_a_fault_reaches_the_controller_and_its_nan_is_an_invalid_action() {
    let mut system = with_faults(Line::new(1e9), 1.0, Noise::default());
    let lost = faulty(&system, Side::Sensing, "dropout", &[("_fill", 2.0)]);
    let healthy = Request::new(system.space().nominal(), Seed(3));
    let episodes = system.rollout(&[lost, healthy]).unwrap();
    assert_eq!(episodes[0].end, EpisodeEnd::InvalidAction { step: 5, index: 0 });
    assert_eq!((episodes[0].robustness(), episodes[0].steps), (None, 4));
    assert_eq!(episodes[1].end, EpisodeEnd::Completed);
}
