//! Tests simulations whose disturbances an adversary decides while they run.

use std::sync::Arc;

use mishandle_rollout::{
    AdversaryEnvironment, Axis, AxisKind, BatchFactory, Controller, ControllerWorker, Disturbance, Effect,
    Environment, EnvironmentWorker, Episode, EpisodeEnd, Noise, Rollout, Sample, Scenario, Seed, Space,
    Specification, Start, StepStatus, System, TimeProfile, delays,
};
use mishandle_stl::Formula;

/// A mass on a line with position and velocity, on which each action is a force, and which a push
/// accelerates in one control step. It diverges beyond the position 3, and an episode has 24 steps.
struct Mass {
    space: Space,
    has_push: bool,
    signals: Arc<[String]>,
}

impl Mass {
    fn new() -> Mass {
        let event = |name: &str, high| Axis::new(AxisKind::Event, name, "", [0.0, high], Some(0.0));
        let axes = vec![Axis::start("x", "m", -4.0, 1.0), event("push_time", 1.7), event("push", 0.5)];
        let space = Space::new("starts", axes).unwrap();
        Mass { space, has_push: true, signals: Arc::from(["x".to_string()]) }
    }
}

impl Environment for Mass {
    fn name(&self) -> &str {
        "mass"
    }
    fn space(&self) -> &Space {
        &self.space
    }
    fn signals(&self) -> &Arc<[String]> {
        &self.signals
    }
    fn reward_terms(&self) -> &[String] {
        &[]
    }
    fn observation_size(&self) -> usize {
        2
    }
    fn action_size(&self) -> usize {
        1
    }
    fn action_limit(&self) -> f64 {
        1.0
    }
    fn state_size(&self) -> usize {
        5
    }
    fn control_dt(&self) -> f64 {
        0.1
    }
    fn events(&self) -> Vec<Vec<usize>> {
        if self.has_push { vec![vec![1, 2]] } else { vec![] }
    }
    fn episode_steps(&self) -> usize {
        24
    }
    fn worker(&self) -> Box<dyn EnvironmentWorker> {
        Box::new(MassWorker)
    }
}

struct MassWorker;

impl EnvironmentWorker for MassWorker {
    fn set_event(&mut self, axis: usize, value: f64, state: &mut [f64]) {
        state[2 + axis] = value;
    }

    fn reset(&mut self, scenario: &Scenario, _: Seed, state: &mut [f64], sample: Sample<'_>) -> StepStatus {
        let [x, time, push] = [0, 1, 2].map(|axis| scenario.get(axis).unwrap());
        state.copy_from_slice(&[x, 0.0, 0.0, time, push]);
        sample.observation.copy_from_slice(&[state[0] as f32, 0.0]);
        sample.signals[0] = state[0];
        if state[0] < -3.0 { StepStatus::InvalidStart } else { StepStatus::Running }
    }

    fn step(&mut self, action: &[f64], state: &mut [f64], sample: Sample<'_>) -> StepStatus {
        if (state[3] / 0.1).floor() == state[2] {
            state[1] += state[4];
        }
        state[2] += 1.0;
        state[1] += action[0];
        state[0] += 0.1 * state[1];
        sample.observation.copy_from_slice(&[state[0] as f32, state[1] as f32]);
        sample.signals[0] = state[0];
        if state[0] > 3.0 { StepStatus::Diverged } else { StepStatus::Running }
    }
}

/// Pulls the mass to 0, with a memory: a share of the sum of the positions that it saw.
struct Pull;

impl Controller for Pull {
    fn observation_size(&self) -> usize {
        2
    }
    fn action_size(&self) -> usize {
        1
    }
    fn state_size(&self) -> usize {
        1
    }
    fn worker(&self) -> Box<dyn ControllerWorker> {
        Box::new(PullWorker)
    }
}

struct PullWorker;

impl ControllerWorker for PullWorker {
    fn reset(&mut self, state: &mut [f64], _: Seed) {
        state[0] = 0.0;
    }

    fn act(&mut self, rows: usize, observations: &[f32], states: &mut [f64], actions: &mut [f32]) {
        for row in 0..rows {
            states[row] += f64::from(observations[2 * row]);
            actions[row] =
                -0.5 * observations[2 * row] - 0.4 * observations[2 * row + 1] - 0.01 * states[row] as f32;
        }
    }
}

/// Returns the disturbances of the mass: a force in each third of an episode, a drift of the
/// observed position with knots at 0, 12 and 24, a bias of the observed velocity, and delays.
fn disturbances() -> Vec<Disturbance> {
    let axis = |name: &str, size: f64| Axis::new(AxisKind::Input, name, "", [-size, 3.0 * size], Some(0.0));
    let mut all = delays();
    all.extend((0..3).map(|third| Disturbance {
        axis: axis(&format!("force_{third}"), 0.3),
        effect: Effect::Action { entry: 0, profile: TimeProfile::Constant(8 * third..8 * third + 8) },
    }));
    let knots = [(0, 0, 12), (0, 12, 24), (12, 24, 24)];
    all.extend(knots.iter().map(|(before, at, after)| Disturbance {
        axis: axis(&format!("drift_{at}"), 0.2),
        effect: Effect::Observation {
            entry: 0,
            factor: 1.0,
            profile: TimeProfile::Linear { before: *before, at: *at, after: *after },
        },
    }));
    let profile = TimeProfile::Constant(0..24);
    let effect = Effect::Observation { entry: 1, factor: 2.0, profile };
    all.push(Disturbance { axis: axis("bias", 0.1), effect });
    all
}

const REQUIREMENT: &str = "always[0:24](x <= 2.5)";

fn system(noise: Noise) -> Rollout {
    let specification = Specification::new(Formula::parse(REQUIREMENT).unwrap());
    let rollout = Rollout::new(Arc::new(Mass::new()), Arc::new(Pull), specification, noise).unwrap();
    let disturbances = disturbances();
    let axes = disturbances.iter().map(|d| d.axis.clone()).chain(Mass::new().space.axes().to_vec());
    let space = Space::new("s", axes.collect()).unwrap();
    rollout.with_disturbances(space, &disturbances).unwrap()
}

const NOISE: Noise = Noise { action_std: 0.05, observation_std: 0.02 };

/// Rows of the batch, and decisions of an episode: at the begin of each third for forces, in the
/// step after a knot for the next one, whose weight is 0 at the knot before it, and every 0.5 s,
/// which are 5 steps, for the push, which begins until 1.7 s.
const ROWS: usize = 21;
const DECISIONS: [usize; 8] = [0, 1, 5, 8, 10, 13, 15, 16];

/// Channel that asks for the push.
const TRIGGER: usize = 3;

/// An adversary in the tests: its action from decision, row, channel and observation.
type Act = dyn Fn(usize, usize, usize, &[f32]) -> f64;

/// Runs `generations` episodes in each row. Returns the simulations, and the first running
/// robustness and the sum of the rewards of each.
fn run(environment: &AdversaryEnvironment, generations: usize, act: &Act) -> (Vec<Episode>, Vec<[f64; 2]>) {
    let spec = environment.spec();
    assert_eq!(environment.decisions(), DECISIONS.len());
    let mut batch = environment.batch(ROWS).unwrap();
    let (mut episodes, mut returns) = (Vec::new(), Vec::new());
    for generation in 0..generations {
        let starts: Vec<Start> = (0..ROWS)
            .map(|row| {
                let seed = Seed(7).child((generation * ROWS + row) as u64);
                Start { row, scenario: environment.scenarios().random(seed, 0), seed }
            })
            .collect();
        batch.reset(&starts).unwrap();
        let robustness =
            |observations: &[f32], row: usize| f64::from(observations[(row + 1) * spec.observation_size - 2]);
        let mut own: Vec<[f64; 2]> =
            (0..ROWS).map(|row| [robustness(batch.observations(), row), 0.0]).collect();
        for decision in 0..DECISIONS.len() {
            let rows = batch.observations().chunks(spec.observation_size).enumerate();
            let actions: Vec<f64> = rows
                .flat_map(|(row, seen)| (0..spec.action_size).map(move |at| act(decision, row, at, seen)))
                .collect();
            batch.step(&actions).unwrap();
            own.iter_mut().zip(batch.rewards()).for_each(|(own, reward)| own[1] += reward);
        }
        episodes.extend(environment.take_finished());
        returns.extend(own);
    }
    (episodes, returns)
}

/// An adversary that reacts: it pushes along the velocity, and lies about the position.
fn react(decision: usize, row: usize, channel: usize, seen: &[f32]) -> f64 {
    let spread = ((decision * 31 + row * 17 + channel * 7) % 11) as f64 / 5.0 - 1.0;
    (spread + f64::from(seen[1])).clamp(-1.0, 1.0)
}

#[test]
fn the_scenario_of_a_simulation_replays_it_to_the_bit_without_the_adversary() {
    let system = system(NOISE);
    let (episodes, _) = run(&system.adversary().unwrap(), 3, &react);
    assert_eq!(episodes.len(), 3 * ROWS);
    let ends: Vec<EpisodeEnd> = episodes.iter().map(|episode| episode.end).collect();
    for expected in [
        |end: &EpisodeEnd| *end == EpisodeEnd::Completed,
        |end: &EpisodeEnd| *end == EpisodeEnd::InvalidScenario,
        |end: &EpisodeEnd| matches!(end, EpisodeEnd::Diverged { .. }),
    ] {
        assert!(ends.iter().any(expected), "the test has no such end: {ends:?}");
    }
    let requests: Vec<_> = episodes.iter().map(|episode| episode.request.clone()).collect();
    let mut system = system;
    let again = system.rollout(&requests).unwrap();
    for (episode, again) in episodes.iter().zip(&again) {
        assert_eq!(episode, again);
    }
    let numbers: Vec<u32> = requests.iter().map(|request| request.number).collect();
    assert_eq!(numbers, (1..=3 * ROWS as u32).collect::<Vec<_>>());
}

#[test]
fn a_simulation_that_may_stop_early_replays_to_the_bit() {
    let mut system = system(NOISE);
    let environment = system.adversary().unwrap().of_trial(4, u32::MAX).with_stop_threshold(Some(0.0));
    let (episodes, _) = run(&environment, 2, &react);
    assert!(episodes.iter().all(|episode| episode.request.trial == 4));
    let requests: Vec<_> = episodes.iter().map(|episode| episode.request.clone()).collect();
    assert_eq!(system.rollout(&requests).unwrap(), episodes);
}

#[test]
fn the_return_is_the_first_running_robustness_minus_the_robustness() {
    // Around -0.5, where the offsets are 0: stronger ones make most simulations diverge.
    let gentle = |decision: usize, row: usize, channel: usize, seen: &[f32]| {
        0.3 * react(decision, row, channel, seen) - 0.5
    };
    let (episodes, returns) = run(&system(NOISE).adversary().unwrap(), 2, &gentle);
    let mut checked = 0;
    for (episode, [first, sum]) in episodes.iter().zip(returns) {
        let Some(robustness) = episode.robustness() else { continue };
        // Of `always(x <= 2.5)`, the first one is that of the start.
        assert!((first - (2.5 - episode.trace.column(0)[0])).abs() < 1e-6);
        assert!((sum - (first - robustness)).abs() < 1e-6, "{sum} {first} {robustness}");
        checked += 1;
    }
    assert!(checked > ROWS / 2);
}

#[test]
fn a_decision_changes_nothing_before_it() {
    let environment = || system(NOISE).adversary().unwrap();
    let calm = |channel| if channel == TRIGGER { -1.0 } else { 0.1 };
    let act = move |_: usize, _: usize, channel: usize, _: &[f32]| calm(channel);
    let (undisturbed, _) = run(&environment(), 1, &act);
    for (late, begin) in DECISIONS.into_iter().enumerate() {
        let push = move |decision: usize, _: usize, channel: usize, _: &[f32]| match decision == late {
            true => 1.0,
            false => calm(channel),
        };
        let (pushed, _) = run(&environment(), 1, &push);
        let mut differ = 0;
        for (calm, pushed) in undisturbed.iter().zip(&pushed).filter(|(calm, _)| calm.trace.len() > begin) {
            let [calm, pushed] = [calm, pushed].map(|episode| episode.trace.column(0).to_vec());
            assert_eq!(calm[..=begin], pushed[..=begin], "decision {late}");
            differ += usize::from(calm != pushed);
        }
        // The push has to begin within the bounds of its time, up to 1.7 s.
        assert_eq!(differ > 0, begin != 20, "decision {late}");
    }
}

#[test]
fn simulations_depend_on_neither_threads_nor_the_other_rows() {
    let with = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| run(&system(NOISE).adversary().unwrap(), 2, &react))
    };
    assert_eq!(with(1), with(3));
}

#[test]
fn rows_beyond_the_budget_simulate_nothing() {
    let environment = system(NOISE).adversary().unwrap().of_trial(1, ROWS as u32 + 5);
    let (episodes, returns) = run(&environment, 2, &react);
    let (all, _) = run(&system(NOISE).adversary().unwrap(), 2, &react);
    assert_eq!(episodes, all[..ROWS + 5]);
    assert!(returns[ROWS + 5..].iter().all(|[_, sum]| *sum == 0.0));
}

#[test]
fn the_adversary_decides_offsets_and_events_only() {
    let system = system(Noise::default());
    let environment = system.adversary().unwrap();
    let names = |axes: &[Axis]| axes.iter().map(|axis| axis.name.clone()).collect::<Vec<_>>();
    let decided: Vec<String> =
        environment.decided_axes().iter().map(|axis| system.space().axes()[*axis].name.clone()).collect();
    let offsets = ["force_0", "force_1", "force_2", "drift_0", "drift_12", "drift_24", "bias"];
    assert_eq!(decided, [&offsets[..], &["push_time", "push"]].concat());
    let others: Vec<String> = delays().iter().map(|d| d.axis.name.clone()).chain(["x".to_string()]).collect();
    assert_eq!(names(environment.spec().space.axes()), others);
    // The force, a knot of the drift, the bias, whether to push, and how hard.
    assert_eq!(environment.spec().action_size, 5);
    let specification = Specification::new(Formula::parse(REQUIREMENT).unwrap());
    let mut mass = Mass::new();
    mass.space = Space::new("starts", mass.space.axes()[..1].to_vec()).unwrap();
    mass.has_push = false;
    let alone = Rollout::new(Arc::new(mass), Arc::new(Pull), specification, Noise::default()).unwrap();
    let error = alone.adversary().err().unwrap().to_string();
    assert!(error.contains("disturbance"), "{error}");
}
