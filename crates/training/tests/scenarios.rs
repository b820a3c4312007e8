//! Training episodes draw scenarios with the stated shares, and their policy sees and acts exactly
//! as in an evaluation.

use crate::toy;
use std::ops::Range;
use std::sync::{Arc, Mutex};

use crate::function_controller::controller;
use crate::line::Line;
use crate::toy::{Toy, names};
use mishandle_controllers::Policy;
use mishandle_controllers::guard::{Fallback, Guard, Guarded, Meaning, Motion, Switch, Watch};
use mishandle_network::{Activation, Mlp};
use mishandle_rollout::fault::{Channel, FaultSite, Side};
use mishandle_rollout::{
    Axis, AxisKind, AxisValues, BatchFactory, Controller, Disturbance, Effect, Environment, EnvironmentFacts,
    EnvironmentWorker, Noise, Request, Rollout, Sample, Scenario, ScenarioBatches, Seed, Space,
    Specification, StepStatus, Stream, System, TimeProfile, TrainingScenarios, delays,
};
use mishandle_stl::{Formula, Trace};
use mishandle_training::{
    ALGORITHMS, AlgorithmSettings, Boundary, Checkpoint, EpisodeSettings, Episodes, Observer, Origin, Rates,
    ScenarioSettings, TrainingControl, TrainingError, TrainingProgress, Validation,
};

/// Number of control steps of an episode.
const STEPS: usize = 30;

/// Environment with a moving observation of three numbers. Its signals are the two actions that it
/// got, and its reward depends on both and on its initial state.
#[derive(Clone)]
struct Drifter;

fn drifter() -> Arc<Toy<Drifter>> {
    Arc::new(Toy {
        facts: EnvironmentFacts {
            name: "drifter".to_string(),
            space: toy::space(&[("start", -1.0, 1.0)]),
            signals: names(&["first", "second", "reward"]),
            reward_terms: names(&["reward"]).to_vec(),
            observation_size: 3,
            exact_size: 0,
            action_size: 2,
            state_size: 3,
            episode_steps: STEPS,
            action_limit: 1.0,
            control_dt: 0.1,
        },
        worker: Drifter,
    })
}

impl Drifter {
    fn show(state: &[f64], action: &[f64], sample: &mut Sample<'_>) {
        let angle = 0.2 * state[0];
        let shown = [state[1] + angle.sin(), state[2], angle.cos()];
        sample.observation.iter_mut().zip(shown).for_each(|(seen, value)| *seen = value as f32);
        sample.rewards[0] = state[1] * action[0] - action[1] * action[1];
        sample.signals.copy_from_slice(&[action[0], action[1], sample.rewards[0]]);
    }
}

impl EnvironmentWorker for Drifter {
    fn reset(
        &mut self,
        scenario: &Scenario,
        seed: Seed,
        state: &mut [f64],
        mut sample: Sample<'_>,
    ) -> StepStatus {
        assert_eq!(scenario.values().len(), 1, "the environment gets its own axes only");
        let random = seed.uniform(Stream::Reset, 0, 0);
        state.copy_from_slice(&[0.0, scenario.get(0).unwrap(), random]);
        Self::show(state, &[0.0; 2], &mut sample);
        StepStatus::Running
    }

    fn step(&mut self, action: &[f64], state: &mut [f64], mut sample: Sample<'_>) -> StepStatus {
        state[0] += 1.0;
        state[1] = 0.9 * state[1] + 0.1 * action[0];
        state[2] -= 0.05 * action[1];
        Self::show(state, action, &mut sample);
        StepStatus::Running
    }
}

/// The policy of the tests: it reacts to each entry of the observation.
fn act(observation: &[f32]) -> [f32; 2] {
    let [x, y, z] = observation else { panic!("three entries") };
    [0.8 * x - 0.3 * z + 0.1, 1.5 * y * z - 0.2 * x]
}

/// Runs [`act`] and keeps what it saw.
fn recorder(seen: Arc<Mutex<Vec<Vec<f32>>>>) -> Arc<dyn Controller> {
    controller([3, 2, 0], move |observation, _, action| {
        seen.lock().unwrap().push(observation.to_vec());
        action.copy_from_slice(&act(observation));
    })
}

fn site(side: Side, name: &str, entries: usize) -> FaultSite {
    let channel = |entry: usize| Channel { name: format!("e{entry}"), entries: vec![entry] };
    FaultSite {
        side,
        name: name.to_string(),
        number: 0,
        channels: (0..entries).map(channel).collect(),
        ranges: vec![[-1.0, 1.0]; entries],
        has_numbers: true,
        control_dt: 0.1,
        episode_steps: STEPS,
    }
}

/// One or more disturbances of every kind.
fn disturbances(steps: Range<usize>) -> Vec<Disturbance> {
    let offset = |name: &str, kind, bound: f64| Axis::new(kind, name, "", [-bound, bound], Some(0.0));
    let drift = TimeProfile::Linear { before: 0, at: 10, after: 25 };
    let constant = TimeProfile::Constant(0..STEPS);
    let mut all = delays();
    all.extend([
        Disturbance {
            axis: offset("bias", AxisKind::Model, 0.2),
            effect: Effect::Observation { entry: 0, factor: 2.0, profile: constant.clone() },
        },
        Disturbance {
            axis: offset("drift", AxisKind::Input, 0.3),
            effect: Effect::Observation { entry: 1, factor: 1.0, profile: drift },
        },
        Disturbance {
            axis: Axis::new(AxisKind::Model, "noise", "", [0.0, 0.1], Some(0.0)),
            effect: Effect::ObservationNoise { entries: vec![(0, 1.0), (2, 0.5)] },
        },
        Disturbance {
            axis: offset("wind", AxisKind::Input, 0.5),
            effect: Effect::Action { entry: 1, profile: constant },
        },
        Disturbance {
            axis: Axis::new(AxisKind::Noise, "draw", "", [-3.0, 3.0], None),
            effect: Effect::ActionDraw { entry: 0, steps },
        },
    ]);
    all.extend(site(Side::Sensing, "sensor", 3).disturbances());
    all.extend(site(Side::Actuation, "actuator", 2).disturbances());
    all
}

/// All scenarios of the drifter from which a policy can learn.
fn scenarios() -> TrainingScenarios {
    let disturbances = disturbances(5..20);
    let axes = drifter().facts.space.axes().to_vec();
    let mut axes: Vec<Axis> =
        axes.into_iter().chain(disturbances.iter().map(|known| known.axis.clone())).collect();
    let whole = TrainingScenarios {
        space: Space::new("all", axes.clone()).unwrap(),
        disturbances: disturbances.clone(),
        given: Vec::new(),
        mixture: Vec::new(),
    };
    let (axis, allowed) = whole.not_a_number().unwrap();
    let fill = axes.iter_mut().find(|known| known.name == axis.name).unwrap();
    let AxisValues::Categorical(fills) = &fill.values else { panic!("a category") };
    assert_eq!((fill.name.as_str(), &fills[2]), ("sensor_fill", &"nan".to_string()));
    fill.values = AxisValues::Categorical(fills[..2].into());
    (fill.low, fill.high) = allowed.into_inner();
    let scenarios = TrainingScenarios {
        space: Space::new("all", axes).unwrap(),
        disturbances,
        given: Vec::new(),
        mixture: Vec::new(),
    };
    assert!(scenarios.not_a_number().is_none());
    scenarios
}

fn settings(rows: usize, noise: Noise) -> EpisodeSettings {
    EpisodeSettings {
        environments: rows,
        action_noise: noise.action_std,
        observation_noise: noise.observation_std,
        staggered: false,
        ..EpisodeSettings::default()
    }
}

/// Without noise, with noise on actions, and on observations as well.
const NOISES: [Noise; 3] = [
    Noise { action_std: 0.0, observation_std: 0.0 },
    Noise { action_std: 0.4, observation_std: 0.0 },
    Noise { action_std: 0.3, observation_std: 0.2 },
];

fn episodes(scenarios: &TrainingScenarios, shares: &ScenarioSettings, rows: usize, noise: Noise) -> Episodes {
    let batches = ScenarioBatches::new(drifter(), scenarios.clone());
    Episodes::new(&batches, &settings(rows, noise), shares, Seed(3)).unwrap()
}

/// Numbers of the input of a policy that sees two earlier observations and actions.
const INPUTS: usize = 3 + 2 * (3 + 2);

/// Returns a policy that sees two earlier observations and actions, and a policy without a history
/// that gets the whole input as its observation. Some of their actions exceed 1.
fn with_history_and_whole() -> (Policy, Policy) {
    let mut network = Mlp::new(&[INPUTS, 16, 2], Activation::Tanh, Activation::Identity).unwrap();
    let mut index = 0;
    network.initialize_uniform(|| {
        index += 1;
        Seed(7).uniform(Stream::Weights, 0, index)
    });
    network.update(|parameters| parameters.iter_mut().for_each(|parameter| *parameter *= 4.0));
    let mean = [0.1, -0.2, 0.3];
    let variance = [0.25, 1.0, 0.5];
    let whole = |of_observation: [f64; 3], of_action: f64| {
        let past = [&of_observation[..], &[of_action; 2]].concat();
        [&of_observation[..], &past, &past].concat()
    };
    let log_std = vec![0.0; 2];
    let plain = Policy::new(whole(mean, 0.0), whole(variance, 1.0), network.clone(), log_std.clone());
    let policy = Policy::with_history(2, mean.to_vec(), variance.to_vec(), network, Some(log_std));
    (policy.unwrap(), plain.unwrap())
}

fn step_with_history(episodes: &mut Episodes, whole: &Policy) {
    let mut actions = vec![0.0; episodes.rows() * 2];
    whole.worker().act(episodes.rows(), episodes.inputs(), &mut [], &mut actions);
    episodes.step(&actions).unwrap();
}

fn step(episodes: &mut Episodes) {
    let actions: Vec<f32> = episodes.observations().chunks(3).flat_map(act).collect();
    episodes.step(&actions).unwrap();
}

/// Bits of what the policy saw in an evaluation, and of the actions and rewards of each step.
fn evaluated(scenario: Scenario, seed: Seed, noise: Noise) -> (Vec<Vec<u32>>, Vec<[u64; 3]>) {
    let seen = Arc::new(Mutex::new(Vec::new()));
    let steps = evaluated_steps(recorder(seen.clone()), scenario, seed, noise);
    let seen = seen.lock().unwrap().iter().map(|observation| float_bits(observation)).collect();
    (seen, steps)
}

/// Bits of the actions and rewards of each step of an evaluation.
fn evaluated_steps(
    controller: Arc<dyn Controller>,
    scenario: Scenario,
    seed: Seed,
    noise: Noise,
) -> Vec<[u64; 3]> {
    steps_of(&evaluated_trace(controller, scenario, seed, noise))
}

fn steps_of(trace: &Trace) -> Vec<[u64; 3]> {
    (1..trace.len()).map(|sample| [0, 1, 2].map(|signal| trace.column(signal)[sample].to_bits())).collect()
}

fn evaluated_trace(controller: Arc<dyn Controller>, scenario: Scenario, seed: Seed, noise: Noise) -> Trace {
    let scenarios = scenarios();
    let formula = Specification::parse("first < 9", "first < 9", "first < 9", "first < 9").unwrap();
    let rollout = Rollout::new(drifter(), controller, formula, noise).unwrap();
    let mut rollout = rollout.with_disturbances(scenarios.space, &scenarios.disturbances).unwrap();
    let episode = rollout.rollout(&[Request::new(scenario, seed)]).unwrap().remove(0);
    assert_eq!(episode.steps, STEPS, "{:?}", episode.end);
    episode.trace
}

fn float_bits(numbers: &[f32]) -> Vec<u32> {
    numbers.iter().map(|x| x.to_bits()).collect()
}

#[test]
fn the_policy_sees_and_acts_as_in_an_evaluation_of_the_same_scenario_and_seed() {
    let scenarios = scenarios();
    for noise in NOISES {
        let mut episodes = episodes(&scenarios, &ScenarioSettings::default(), 60, noise);
        for episode in 0..2 {
            let mut seen = vec![Vec::new(); 60];
            let mut done = vec![Vec::new(); 60];
            for _ in 0..STEPS {
                let observations = episodes.observations().chunks(3).zip(&mut seen);
                observations.for_each(|(observation, seen)| seen.push(float_bits(observation)));
                step(&mut episodes);
                let steps = episodes.applied_actions().chunks(2).zip(episodes.rewards()).zip(&mut done);
                steps.for_each(|((a, reward), done)| done.push([a[0], a[1], *reward].map(f64::to_bits)));
            }
            assert!(episodes.boundaries().iter().all(|boundary| *boundary == Boundary::Truncated));
            for row in 0..60 {
                let seed = Seed(3).child(row as u64).child(episode);
                let expected = evaluated(scenarios.random(seed, 0), seed, noise);
                assert_eq!((&seen[row], &done[row]), (&expected.0, &expected.1), "row {row}");
            }
        }
    }
}

/// A guard of the drifter, whose policy gets the control back.
fn guard(fallback: Fallback) -> Guard {
    let formula =
        Formula::parse("historically[0:2](x >= -0.1) and (y >= -0.6 or once[0:3](x >= 0.4))").unwrap();
    let names = ["x", "y", "z"].map(String::from);
    let watch = Watch::new(&formula, &names, 0.1, STEPS).unwrap();
    let switch = Switch::new(0.0, Some(0.05), 3).unwrap();
    Guard::new("a guard".to_string(), watch, switch, fallback, false, 3, 2).unwrap()
}

#[test]
fn a_guarded_policy_acts_as_in_an_evaluation_within_delays_faults_and_pauses() {
    let scenarios = scenarios();
    let motion = Motion { meanings: vec![Meaning::Increment, Meaning::Position], limit: 1.0 };
    // A fallback with a state, which starts at each hand-over.
    let other: Arc<dyn Controller> = Arc::new(with_history_and_whole().0);
    for fallback in
        [Fallback::Hold(motion.clone()), Fallback::Retreat(motion, 4), Fallback::Controller(other)]
    {
        let guard = guard(fallback);
        let mut batches = ScenarioBatches::new(drifter(), scenarios.clone());
        batches.supervisor = Some(Arc::new(guard.clone()));
        let rows = 120;
        let noise = NOISES[2];
        let settings = settings(rows, noise);
        let shares = ScenarioSettings::default();
        let mut episodes = Episodes::new(&batches, &settings, &shares, Seed(3)).unwrap();
        let mut guarded = 0;
        let mut replaced = 0;
        let mut returned = 0;
        for episode in 0..2 {
            let mut done = vec![Vec::new(); rows];
            for _ in 0..STEPS {
                step(&mut episodes);
                let steps = episodes.applied_actions().chunks(2).zip(episodes.rewards()).zip(&mut done);
                steps.for_each(|((a, reward), done)| done.push([a[0], a[1], *reward].map(f64::to_bits)));
            }
            for (row, done) in done.iter().enumerate() {
                let seed = Seed(3).child(row as u64).child(episode);
                let controller = recorder(Arc::default());
                let controller = Arc::new(Guarded::new(controller, guard.clone()));
                let trace = evaluated_trace(controller, scenarios.random(seed, 0), seed, noise);
                assert_eq!(*done, steps_of(&trace), "row {row}");
                let active = trace.signal("guard_active").unwrap();
                guarded += active.len() - 1;
                replaced += active.iter().filter(|active| **active == 1.0).count();
                returned += active.windows(2).filter(|pair| pair[0] == 1.0 && pair[1] == 0.0).count();
            }
        }
        assert!(replaced > guarded / 10 && replaced < guarded * 9 / 10, "{replaced} of {guarded}");
        assert!(returned > rows, "{returned}");
    }
}

#[test]
fn a_policy_with_a_history_acts_as_in_an_evaluation_within_delays_faults_and_pauses() {
    let scenarios = scenarios();
    let (policy, whole) = with_history_and_whole();
    let policy: Arc<dyn Controller> = Arc::new(policy);
    for noise in NOISES {
        let episodes = episodes(&scenarios, &ScenarioSettings::default(), 120, noise);
        let mut episodes = episodes.with_history(2);
        for episode in 0..2 {
            let mut done = vec![Vec::new(); 120];
            for _ in 0..STEPS {
                step_with_history(&mut episodes, &whole);
                let steps = episodes.applied_actions().chunks(2).zip(episodes.rewards()).zip(&mut done);
                steps.for_each(|((a, reward), done)| done.push([a[0], a[1], *reward].map(f64::to_bits)));
            }
            let mut pauses = 0;
            let kind = scenarios.space.axes().iter().position(|axis| axis.name == "actuator").unwrap();
            for (row, done) in done.iter().enumerate() {
                let seed = Seed(3).child(row as u64).child(episode);
                let scenario = scenarios.random(seed, 0);
                let AxisValues::Categorical(kinds) = &scenarios.space.axes()[kind].values else { panic!() };
                pauses += usize::from(kinds[scenario.get(kind).unwrap() as usize] == "pause");
                let expected = evaluated_steps(policy.clone(), scenario, seed, noise);
                assert_eq!(*done, expected, "row {row}");
            }
            assert!(pauses >= 5, "{pauses}");
        }
    }
}

#[test]
fn final_observations_and_inputs_are_those_that_the_policy_would_have_seen() {
    let (_, whole) = with_history_and_whole();
    let episodes = episodes(&scenarios(), &ScenarioSettings::default(), 60, NOISES[2]);
    let mut episodes = episodes.with_history(2);
    for time in 1..=2 * STEPS {
        let before = episodes.inputs().to_vec();
        step_with_history(&mut episodes, &whole);
        let ends = time.is_multiple_of(STEPS);
        let same = float_bits(episodes.final_inputs()) == float_bits(episodes.inputs());
        let same_observations =
            float_bits(episodes.final_observations()) == float_bits(episodes.observations());
        assert_eq!((same, same_observations), (!ends, !ends), "{time}");
        let rows = episodes.final_inputs().chunks(INPUTS).zip(before.chunks(INPUTS));
        for ((input, before), observation) in rows.zip(episodes.final_observations().chunks(3)) {
            assert_eq!(input[..3], *observation);
            // A step later the past moves on, or the policy was paused.
            let moved = input[3..6] == before[..3] && input[8..] == before[3..8];
            assert!(moved || input[3..] == before[3..]);
            assert!(input[6..8].iter().all(|action| action.abs() <= 1.0));
        }
        let starts = episodes.inputs().chunks(INPUTS).all(|input| input[3..].iter().all(|x| *x == 0.0));
        assert_eq!(starts, ends, "the history starts with the episode");
    }
}

#[test]
fn a_restored_batch_continues_to_the_same_bits_within_delays_and_faults() {
    let scenarios = scenarios();
    let make = || episodes(&scenarios, &ScenarioSettings::default(), 40, NOISES[2]).with_history(2);
    for pause in [0, 7, 13, 29, 41] {
        let mut whole = make();
        (0..pause).for_each(|_| step(&mut whole));
        let mut checkpoint = Checkpoint::new("ppo", "drifter", 3, "");
        whole.save(&mut checkpoint).unwrap();
        let mut restored = make();
        restored.load(&checkpoint).unwrap();
        for _ in 0..35 {
            assert_eq!(float_bits(restored.inputs()), float_bits(whole.inputs()));
            assert_eq!(float_bits(restored.observations()), float_bits(whole.observations()));
            step(&mut whole);
            step(&mut restored);
            let bits = |x: &Episodes| {
                x.applied_actions().iter().chain(x.rewards()).map(|x| x.to_bits()).collect::<Vec<_>>()
            };
            assert_eq!(bits(&restored), bits(&whole), "{pause}");
        }
    }
}

#[test]
fn nominal_axes_and_nominal_episodes_change_no_bit() {
    let whole = scenarios();
    let fixed = |axis: &Axis| match axis.nominal {
        Some(nominal) if axis.kind != AxisKind::Start => {
            let values = match &axis.values {
                AxisValues::Categorical(names) => AxisValues::Categorical(names[..1].into()),
                other => other.clone(),
            };
            Axis { low: nominal, high: nominal, values, ..axis.clone() }
        }
        _ => axis.clone(),
    };
    let axes = whole.space.axes().iter().filter(|axis| axis.nominal.is_some()).map(fixed).collect();
    let still = TrainingScenarios { space: Space::new("still", axes).unwrap(), ..whole.clone() };
    let nominal = ScenarioSettings { nominal: 1.0, ..ScenarioSettings::default() };
    let plain = TrainingScenarios::of(drifter().facts.space.clone());
    let shares = ScenarioSettings::default();
    let mut all = [
        episodes(&plain, &shares, 20, NOISES[2]),
        episodes(&still, &shares, 20, NOISES[2]),
        episodes(&whole, &nominal, 20, NOISES[2]),
    ];
    for _ in 0..70 {
        all.iter_mut().for_each(step);
        let bits = all.each_ref().map(|x| {
            let seen = x.observations().iter().map(|x| u64::from(x.to_bits()));
            seen.chain(x.rewards().iter().map(|x| x.to_bits())).collect::<Vec<_>>()
        });
        assert!(bits[0] == bits[1] && bits[0] == bits[2]);
    }
}

#[test]
fn shares_are_met_within_binomial_bounds() {
    // The initial state is 0.5 in given scenarios, -1 or 1 at corners and otherwise any other.
    // A bias of 0 is nominal.
    let bias = &disturbances(0..1)[5..6];
    let axes = [drifter().facts.space.axes()[0].clone(), bias[0].axis.clone()];
    let given = [(Some(0.5), 0.1, 3.0), (Some(0.5), -0.1, 1.0)];
    let given = given.map(|(start, bias, weight)| (Scenario::new(vec![start, Some(bias)]), weight));
    let scenarios = TrainingScenarios {
        space: Space::new("two", axes.to_vec()).unwrap(),
        disturbances: bias.to_vec(),
        given: given.to_vec(),
        mixture: Vec::new(),
    };
    let text = "scenarios = { nominal = 0.2, corners = 0.3, file = \"a\", file_share = 0.1 }";
    let shares = AlgorithmSettings::from_toml("ppo", text).unwrap().unwrap();
    let n = 20_000;
    let mut episodes = episodes(&scenarios, shares.scenarios(), n, NOISES[0]);
    let mut checkpoint = Checkpoint::new("ppo", "drifter", 3, "");
    episodes.save(&mut checkpoint).unwrap();
    let drawn: Vec<&[f64]> = checkpoint.f64s("disturbed.scenarios", 2 * n).unwrap().chunks(2).collect();
    let check = |what: &str, share: f64, holds: &dyn Fn(f64, f64) -> bool| {
        let count = drawn.iter().filter(|values| holds(values[0], values[1])).count() as f64;
        // Five standard deviations.
        let bound = 5.0 * (n as f64 * share * (1.0 - share)).sqrt();
        assert!((count - n as f64 * share).abs() < bound, "{what}: {count} of {n}");
    };
    check("nominal", 0.2, &|_, bias| bias == 0.0);
    check("corners", 0.3, &|start, bias| start.abs() == 1.0 && bias.abs() == 0.2);
    check("one corner", 0.075, &|start, bias| start == 1.0 && bias == -0.2);
    check("given", 0.1, &|start, _| start == 0.5);
    check("the first given", 0.075, &|start, bias| start == 0.5 && bias == 0.1);
    check("random", 0.4, &|start, bias| start.abs() < 1.0 && start != 0.5 && bias != 0.0);
    // The scenario of an episode depends on its seed only, not on the number of rows.
    let few = self::episodes(&scenarios, shares.scenarios(), 10, NOISES[0]);
    assert_eq!(few.observations(), &episodes.observations()[..30]);
}

/// Stops after `stop_after` iterations and keeps the checkpoint.
#[derive(Default)]
struct Keeper {
    stop_after: u64,
    checkpoint: Option<Checkpoint>,
    /// Share of the ranges in each iteration.
    shares: Vec<Option<f64>>,
}

impl Observer for Keeper {
    fn validate(&mut self, _policy: &Policy, _episodes: usize) -> Option<Validation> {
        Some(Validation::of_starts(Rates::default()))
    }
    /// Success up to half of the ranges.
    fn validate_part(&mut self, _policy: &Policy, episodes: usize, share: f64) -> Option<Rates> {
        assert_eq!(episodes, 200);
        Some(Rates { success_rate: if share < 0.5 { 0.9 } else { 0.89 }, ..Rates::default() })
    }
    fn iteration_finished(&mut self, progress: &TrainingProgress) -> TrainingControl {
        self.shares.push(progress.scenario_share);
        if progress.iteration == self.stop_after { TrainingControl::Stop } else { TrainingControl::Continue }
    }
    fn save_checkpoint(&mut self, checkpoint: &Checkpoint) {
        self.checkpoint = Some(checkpoint.clone());
    }
}

/// Returns short training settings of an algorithm on all scenarios, and the factory of its
/// environments.
fn training(algorithm: &str, more: &str) -> (AlgorithmSettings, impl BatchFactory + use<>) {
    let own = match algorithm {
        "ppo" => "rollout_steps = 12\nminibatch_size = 48",
        "trpo" => "rollout_steps = 12",
        _ => "steps_per_iteration = 12\nreplay = { warmup_steps = 50, batch_size = 32 }",
    };
    let common = "run.total_steps = 600\nepisodes.environments = 8\npolicy.hidden = [8]\ncritic.hidden = [8]\n\
                  scenarios.space = \"all\"\nscenarios.nominal = 0.2\nscenarios.corners = 0.3\n";
    let settings = AlgorithmSettings::from_toml(algorithm, &format!("{common}{more}{own}")).unwrap().unwrap();
    (settings, ScenarioBatches::new(drifter(), scenarios()))
}

#[test]
fn every_algorithm_trains_on_scenarios_and_resumes_to_the_same_bits() {
    for (algorithm, history, critic) in ALGORITHMS.iter().flat_map(|algorithm| {
        [(0, false), (0, true), (2, true)].map(|(history, critic)| (algorithm.name, history, critic))
    }) {
        let more = format!("policy.history = {history}\ncritic.sees_scenario = {critic}\n");
        let (settings, batches) = training(algorithm, &more);
        let train = |resume: Option<&Checkpoint>, keeper: &mut Keeper| {
            settings.train(&batches, Seed(2), resume.map_or(Origin::New, Origin::Checkpoint), keeper).unwrap()
        };
        let trained = train(None, &mut Keeper::default());
        let mut first = Keeper { stop_after: 3, ..Keeper::default() };
        train(None, &mut first);
        let resumed = train(first.checkpoint.as_ref(), &mut Keeper::default());
        assert_eq!(resumed.last.hash(), trained.last.hash(), "{algorithm}");
        let policy = &trained.last;
        let inputs = 3 + history * 5;
        assert_eq!((policy.history().length(), policy.network().input_size()), (history, inputs));
        assert_eq!(policy.mean().len(), 3);
        // Another table is another training run.
        let mut other = settings.clone();
        other.scenarios_mut().corners = 0.2;
        let error = other.check_resumption(&batches, Seed(2), first.checkpoint.as_ref().unwrap());
        assert!(error.unwrap_err().to_string().contains("scenarios.corners"), "{algorithm}");
    }
}

#[test]
fn only_the_critic_sees_the_scenario() {
    let of_scenario: usize = scenarios()
        .space
        .axes()
        .iter()
        .map(|axis| match axis.values {
            AxisValues::Categorical(_) => axis.levels().unwrap(),
            _ => 1,
        })
        .sum();
    // The observation of the environment, and the scenario.
    let privileged = 3 + of_scenario;
    for algorithm in ALGORITHMS {
        let (plain, batches) = training(algorithm.name, "");
        let (seeing, _) = training(algorithm.name, "critic.sees_scenario = true\n");
        let [plain, seeing] = [plain, seeing].map(|settings| {
            let mut keeper = Keeper::default();
            let trained = settings.train(&batches, Seed(2), Origin::New, &mut keeper).unwrap();
            (trained.last, keeper.checkpoint.unwrap())
        });
        let sizes = |policy: &Policy| (policy.network().sizes().to_vec(), policy.mean().len());
        assert_eq!(sizes(&seeing.0), sizes(&plain.0), "{}", algorithm.name);
        assert_eq!(sizes(&seeing.0).0[0], 3);
        assert_ne!(seeing.0.hash(), plain.0.hash(), "{}: the critic teaches otherwise", algorithm.name);
        // A hidden layer of 8 and one output. Critics of off-policy algorithms see two actions.
        let (name, actions) = match algorithm.name {
            "ppo" | "trpo" => ("critic.parameters", 0),
            "ddpg" => ("critic.parameters", 2),
            _ => ("critic_1.parameters", 2),
        };
        for (checkpoint, more) in [(&plain.1, 0), (&seeing.1, privileged)] {
            let count = (3 + actions + more + 1) * 8 + 9;
            assert!(
                checkpoint.f32s(name, count).is_ok(),
                "{}: {:?}",
                algorithm.name,
                checkpoint.f32s(name, count)
            );
        }
    }
}

#[test]
fn privileged_inputs_are_the_undisturbed_observation_and_the_scaled_scenario() {
    let whole = scenarios();
    // Without disturbances of actions, the state does not depend on what the policy sees.
    let names = ["start", "observation_delay", "bias", "noise", "draw", "sensor_duration", "sensor"];
    let axis = |name: &str| whole.space.axes().iter().find(|axis| axis.name == name).unwrap().clone();
    let space = Space::new("some", names.map(axis).to_vec()).unwrap();
    let (numbers, fault) = space.axes().split_at(6);
    let kinds = fault[0].levels().unwrap();
    let size = 3 + 6 + kinds;
    let scenarios = TrainingScenarios { space: space.clone(), ..whole };
    let nominal = ScenarioSettings { nominal: 1.0, ..ScenarioSettings::default() };
    let mut disturbed = episodes(&scenarios, &ScenarioSettings::default(), 30, NOISES[0]).with_privileged();
    let mut still = episodes(&scenarios, &nominal, 30, NOISES[0]).with_privileged();
    assert_eq!((disturbed.privileged_size(), still.privileged_size()), (size, size));
    let observation =
        |inputs: &[f32]| inputs.chunks(size).flat_map(|row| &row[..3]).copied().collect::<Vec<_>>();
    let mut differing = 0;
    let mut failing = 0;
    for step in 0..2 * STEPS {
        assert_eq!(observation(disturbed.privileged()), still.observations());
        differing += usize::from(disturbed.observations() != still.observations());
        let before = disturbed.privileged().to_vec();
        for (row, inputs) in before.chunks(size).enumerate() {
            let seed = Seed(3).child(row as u64).child((step / STEPS) as u64);
            let drawn = scenarios.random(seed, 0);
            for ((axis, value), input) in numbers.iter().zip(drawn.values()).zip(&inputs[3..9]) {
                let share = (value.unwrap() - axis.low) / (axis.high - axis.low);
                assert!((f64::from(*input) - (2.0 * share - 1.0)).abs() < 1e-6, "{}: {input}", axis.name);
            }
            let expected = (0..kinds).map(|kind| f32::from(drawn.get(6) == Some(kind as f64)));
            failing += usize::from(drawn.get(6) != Some(0.0));
            assert_eq!(inputs[9..], expected.collect::<Vec<f32>>());
        }
        let actions: Vec<f32> = still.observations().chunks(3).flat_map(act).collect();
        disturbed.step(&actions).unwrap();
        still.step(&actions).unwrap();
        assert_eq!(disturbed.privileged_before(), before);
        assert_eq!(observation(disturbed.final_privileged()), still.final_observations());
        let scenario =
            |inputs: &[f32]| inputs.chunks(size).flat_map(|row| &row[3..]).copied().collect::<Vec<_>>();
        assert_eq!(scenario(disturbed.final_privileged()), scenario(&before));
    }
    assert!(differing > STEPS && failing > STEPS);
}

#[test]
fn environments_without_the_scenarios_of_the_settings_are_an_error() {
    let text = "scenarios = { space = \"delay\" }";
    let settings = AlgorithmSettings::from_toml("ppo", text).unwrap().unwrap();
    let error = settings.train(&Line::new(0.0), Seed(2), Origin::New, &mut Keeper::default()).unwrap_err();
    assert!(matches!(error, TrainingError::OtherScenarios { .. }), "{error}");
    let found = drifter().space().name().to_string();
    assert!(error.to_string().contains(&format!("`{found}`")), "{error}");
    // The name of the space fits, but the environments draw from it as a whole.
    let name = Line::new(0.0).spec().space.name().to_string();
    let text = format!("scenarios = {{ space = {{ {name} = 1 }} }}");
    let settings = AlgorithmSettings::from_toml("ppo", &text).unwrap().unwrap();
    let error = settings.train(&Line::new(0.0), Seed(2), Origin::New, &mut Keeper::default()).unwrap_err();
    let text = error.to_string();
    assert!(text.contains("a mixture of spaces") && text.contains("one space"), "{error}");
}

#[test]
fn environments_without_a_reward_term_of_the_settings_are_an_error() {
    let settings = AlgorithmSettings::from_toml("ppo", "rewards.speed = 0.5").unwrap().unwrap();
    let error = settings.train(&Line::new(0.0), Seed(2), Origin::New, &mut Keeper::default()).unwrap_err();
    assert!(matches!(error, TrainingError::MissingRewardTerm { term: "speed", weight: 0.5 }), "{error}");
}

#[test]
fn a_curriculum_grows_with_success_and_is_resumed() {
    let curriculum =
        "run.validation_interval = 1\nscenarios.curriculum = { start = 0.1, step = 0.2, threshold = 0.9 }\n";
    for algorithm in ALGORITHMS {
        let (settings, batches) =
            training(algorithm.name, &format!("{curriculum}critic.sees_scenario = true\n"));
        let train = |resume: Option<&Checkpoint>, stop_after: u64| {
            let mut keeper = Keeper { stop_after, ..Keeper::default() };
            (
                settings
                    .train(&batches, Seed(2), resume.map_or(Origin::New, Origin::Checkpoint), &mut keeper)
                    .unwrap()
                    .last
                    .hash(),
                keeper,
            )
        };
        let (whole, all) = train(None, 0);
        // 0.1 + 2 · 0.2 has a success rate below the threshold.
        let expected = [0.1, 0.1 + 0.2, 0.1 + 2.0 * 0.2, 0.1 + 2.0 * 0.2].map(Some);
        assert_eq!(all.shares[..4], expected, "{}", algorithm.name);
        assert_eq!(all.shares.last(), expected.last());
        for stop in [1, 2, 4] {
            let (_, first) = train(None, stop);
            let (resumed, rest) = train(first.checkpoint.as_ref(), 0);
            assert_eq!(resumed, whole, "{}, {stop}", algorithm.name);
            assert_eq!(rest.shares, all.shares[stop as usize..]);
        }
        let (plain, _) = training(algorithm.name, "critic.sees_scenario = true\n");
        let mut keeper = Keeper::default();
        assert_ne!(plain.train(&batches, Seed(2), Origin::New, &mut keeper).unwrap().last.hash(), whole);
        assert!(keeper.shares.iter().all(Option::is_none));
    }
}

#[test]
fn episodes_draw_from_the_share_at_their_start() {
    let scenarios = scenarios();
    let bias = scenarios.space.axes().iter().position(|axis| axis.name == "bias").unwrap();
    let axes = scenarios.space.dimension();
    let text = "scenarios.curriculum = { start = 0.25, step = 0.25, threshold = 0.9 }";
    let shares = AlgorithmSettings::from_toml("ppo", text).unwrap().unwrap();
    let mut episodes = episodes(&scenarios, shares.scenarios(), 200, NOISES[0]);
    let largest = |episodes: &mut Episodes| {
        let mut checkpoint = Checkpoint::new("ppo", "drifter", 3, "");
        episodes.save(&mut checkpoint).unwrap();
        let drawn = checkpoint.f64s("disturbed.scenarios", 200 * axes).unwrap().chunks(axes);
        drawn.map(|values| values[bias].abs()).fold(0.0, f64::max)
    };
    // The bias is up to 0.2.
    let first = largest(&mut episodes);
    assert!(first > 0.04 && first <= 0.05, "{first}");
    episodes.set_scenario_share(1.0);
    (1..STEPS).for_each(|_| step(&mut episodes));
    assert_eq!(largest(&mut episodes), first, "running episodes keep their scenarios");
    step(&mut episodes);
    let second = largest(&mut episodes);
    assert!(second > 0.19, "{second}");
}
