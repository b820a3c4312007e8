//! Training on scenarios: the policy sees and acts as in an evaluation, on the CPU and through the
//! interface of other engines, and a run that is resumed has the same bits.

use std::path::Path;
use std::sync::{Arc, Mutex};

use mishandle::MishandleError;
use mishandle::controllers::Policy;
use mishandle::plan::{AxisSetting, TrainPlan};
use mishandle::run::Device;
use mishandle::tasks::{Preset, Reward, TaskBatches, TaskEnvironment};
use mishandle::train::{Curve, TrainReport};
use mishandle::training::{Boundary, EpisodeSettings, Episodes, ScenarioSettings, SpaceSetting};
use mishandle_network::{Activation, Mlp};
use mishandle_rollout::{
    Axis, AxisValues, BatchFactory, Controller, Environment, EnvironmentFacts, EnvironmentWorker, Noise,
    Request, Rollout, Sample, Scenario, ScenarioBatches, Seed, Space, StepStatus, Stream, System,
    TrainingScenarios, named_space,
};
use mishandle_world::CpuDevice;

use crate::function_controller::controller;
use crate::silent::Silent;

fn act(observation: &[f32], actions: &mut [f32]) {
    for (index, action) in actions.iter_mut().enumerate() {
        let waves = observation.iter().zip(1..).map(|(x, k)| (x * (k + index) as f32).sin());
        *action = 0.7 * waves.sum::<f32>().sin();
    }
}

fn bits(numbers: &[f32]) -> Vec<u32> {
    numbers.iter().map(|x| x.to_bits()).collect()
}

/// Returns a policy that reacts to each entry of the observation, and keeps what it saw.
fn recorder(
    observation_size: usize,
    action_size: usize,
    seen: Arc<Mutex<Vec<Vec<u32>>>>,
) -> Arc<dyn Controller> {
    controller([observation_size, action_size, 0], move |observation, _, actions| {
        seen.lock().unwrap().push(bits(observation));
        act(observation, actions);
    })
}

/// Actions and reward of each control step.
type Steps = Arc<Mutex<Vec<(Vec<u64>, u64)>>>;

fn step_bits(actions: &[f64], reward: f64) -> (Vec<u64>, u64) {
    (actions.iter().map(|x| x.to_bits()).collect(), reward.to_bits())
}

/// A task that keeps the actions that it gets, and its rewards.
struct Watched(Arc<TaskEnvironment>, Steps);

impl Environment for Watched {
    fn facts(&self) -> &EnvironmentFacts {
        self.0.facts()
    }
    fn worker(&self) -> Box<dyn EnvironmentWorker> {
        Box::new(WatchedWorker(self.0.worker(), self.1.clone()))
    }
}

struct WatchedWorker(Box<dyn EnvironmentWorker>, Steps);

impl EnvironmentWorker for WatchedWorker {
    fn reset(
        &mut self,
        scenario: &Scenario,
        seed: Seed,
        state: &mut [f64],
        sample: Sample<'_>,
    ) -> StepStatus {
        self.0.reset(scenario, seed, state, sample)
    }

    fn step(&mut self, action: &[f64], state: &mut [f64], sample: Sample<'_>) -> StepStatus {
        let Sample { observation, signals, rewards } = sample;
        let inner = Sample { observation, signals, rewards: &mut *rewards };
        let status = self.0.step(action, state, inner);
        self.1.lock().unwrap().push(step_bits(action, rewards.iter().sum()));
        status
    }
}

/// All axes of a task, without faults that show NaN.
fn scenarios_of(environment: &TaskEnvironment) -> TrainingScenarios {
    let disturbances = environment.disturbances(true);
    let (axes, spaces) = environment.axes_and_spaces(&disturbances, &[]).unwrap();
    let all = named_space("all", &axes, &spaces).unwrap();
    let whole = TrainingScenarios {
        space: all,
        disturbances: disturbances.clone(),
        given: Vec::new(),
        mixture: Vec::new(),
    };
    let (fill, allowed) = whole.not_a_number().unwrap();
    let (low, high) = allowed.into_inner();
    let narrow = |axis: &Axis| match &axis.values {
        AxisValues::Categorical(names) if axis.name == fill.name => {
            Axis { low, high, values: AxisValues::Categorical(names[..2].into()), ..axis.clone() }
        }
        _ => axis.clone(),
    };
    let axes = whole.space.axes().iter().map(narrow).collect();
    TrainingScenarios {
        space: Space::new("all", axes).unwrap(),
        disturbances,
        given: Vec::new(),
        mixture: Vec::new(),
    }
}

#[test]
fn training_episodes_have_the_bits_of_evaluated_ones_under_every_kind_of_axis() {
    const ROWS: usize = 6;
    for task in ["point-reaching", "ball-balancing", "cube-stacking"] {
        let task = mishandle::tasks::task(task).unwrap();
        let starts = TaskEnvironment::new(task, Preset::Paper, Reward::Shaped).unwrap();
        let scenarios = scenarios_of(&starts);
        let environment = Arc::new(starts.with_scene_axes(&scenarios.space).unwrap());
        let settings =
            EpisodeSettings { environments: ROWS, action_noise: 0.2, ..EpisodeSettings::default() };
        let settings = EpisodeSettings { staggered: false, ..settings };
        let on_cpu: Arc<dyn BatchFactory> = Arc::new(environment.clone());
        let on_device: Arc<dyn BatchFactory> =
            Arc::new(TaskBatches::new(environment.clone(), Arc::new(CpuDevice)));
        let sizes = (environment.observation_size(), environment.action_size());
        let specification = task.definition().formulas(Preset::Paper).specification().unwrap();
        for batches in [on_cpu, on_device] {
            let batches = ScenarioBatches::new(batches, scenarios.clone());
            let mut episodes =
                Episodes::new(&batches, &settings, &ScenarioSettings::default(), Seed(8)).unwrap();
            let mut seen = vec![Vec::new(); ROWS];
            let mut steps = vec![Vec::new(); ROWS];
            let mut actions = vec![0.0; ROWS * sizes.1];
            let mut running = [true; ROWS];
            for _ in 0..environment.episode_steps() {
                let rows = episodes.observations().chunks(sizes.0).zip(actions.chunks_mut(sizes.1));
                for (row, (observation, action)) in rows.enumerate() {
                    act(observation, action);
                    if running[row] {
                        seen[row].push(bits(observation));
                    }
                }
                episodes.step(&actions).unwrap();
                for row in 0..ROWS {
                    if !running[row] {
                        continue;
                    }
                    let applied = &episodes.applied_actions()[row * sizes.1..][..sizes.1];
                    steps[row].push(step_bits(applied, episodes.rewards()[row]));
                    running[row] = episodes.boundaries()[row] == Boundary::Running;
                }
            }
            for row in 0..ROWS {
                let seed = Seed(8).child(row as u64).child(0);
                let expected = Arc::default();
                let recorder = recorder(sizes.0, sizes.1, Arc::clone(&expected));
                let watched = Steps::default();
                let spied = Arc::new(Watched(environment.clone(), watched.clone()));
                let noise = Noise { action_std: 0.2, observation_std: 0.0 };
                let rollout = Rollout::new(spied, recorder, specification.clone(), noise).unwrap();
                let mut rollout =
                    rollout.with_disturbances(scenarios.space.clone(), &scenarios.disturbances).unwrap();
                let request = Request::new(scenarios.random(seed, 0), seed);
                let episode = rollout.rollout(&[request]).unwrap().remove(0);
                let count = steps[row].len();
                let task = environment.name();
                assert!(count >= 10 && episode.steps >= count, "{task} {row}: {count}");
                assert_eq!(seen[row], expected.lock().unwrap()[..count], "{task} {row}");
                assert_eq!(steps[row], watched.lock().unwrap()[..count], "{task} {row}");
            }
        }
    }
}

/// Returns a policy that sees two earlier observations and actions, and a policy without a history
/// that gets the whole input as its observation.
fn with_history_and_whole(observations: usize, actions: usize) -> (Policy, Policy) {
    let inputs = observations + 2 * (observations + actions);
    let mut network = Mlp::new(&[inputs, 16, actions], Activation::Tanh, Activation::Identity).unwrap();
    let mut index = 0;
    network.initialize_uniform(|| {
        index += 1;
        Seed(7).uniform(Stream::Weights, 0, index)
    });
    // Some actions exceed 1.
    network.update(|parameters| parameters.iter_mut().for_each(|parameter| *parameter *= 4.0));
    let plain = Policy::new(vec![0.0; inputs], vec![1.0; inputs], network.clone(), vec![0.0; actions]);
    let mean = vec![0.0; observations];
    let variance = vec![1.0; observations];
    let policy = Policy::with_history(2, mean, variance, network, Some(vec![0.0; actions]));
    (policy.unwrap(), plain.unwrap())
}

#[test]
fn training_sees_the_history_of_an_evaluation_with_late_actions() {
    const ROWS: usize = 4;
    let task = mishandle::tasks::task("point-reaching").unwrap();
    let environment = TaskEnvironment::new(task, Preset::Paper, Reward::Shaped).unwrap();
    let disturbances = environment.disturbances(true);
    let (axes, spaces) = environment.axes_and_spaces(&disturbances, &[]).unwrap();
    let delay = named_space("starts+delay", &axes, &spaces).unwrap();
    // Actions are two control steps late.
    let late = |axis: &Axis| match axis.name.as_str() {
        "action_delay" => Axis { low: 2.0, high: 2.0, ..axis.clone() },
        _ => axis.clone(),
    };
    let axes: Vec<Axis> = delay.axes().iter().map(late).collect();
    assert!(axes.iter().any(|axis| axis.name == "action_delay"));
    let scenarios = TrainingScenarios {
        space: Space::new("late", axes).unwrap(),
        disturbances,
        given: Vec::new(),
        mixture: Vec::new(),
    };
    let environment = Arc::new(environment.with_scene_axes(&scenarios.space).unwrap());
    let sizes = (environment.observation_size(), environment.action_size());
    let specification = task.definition().formulas(Preset::Paper).specification().unwrap();
    let settings = EpisodeSettings { environments: ROWS, staggered: false, ..EpisodeSettings::default() };
    let (policy, whole) = with_history_and_whole(sizes.0, sizes.1);
    let batches: Arc<dyn BatchFactory> = Arc::new(environment.clone());
    let batches = ScenarioBatches::new(batches, scenarios.clone());
    let episodes = Episodes::new(&batches, &settings, &ScenarioSettings::default(), Seed(8)).unwrap();
    let mut episodes = episodes.with_history(2);
    let mut steps = vec![Vec::new(); ROWS];
    let mut worker = whole.worker();
    let mut actions = vec![0.0; ROWS * sizes.1];
    for _ in 0..environment.episode_steps() {
        worker.act(ROWS, episodes.inputs(), &mut [], &mut actions);
        episodes.step(&actions).unwrap();
        for (row, steps) in steps.iter_mut().enumerate() {
            let applied = &episodes.applied_actions()[row * sizes.1..][..sizes.1];
            steps.push(step_bits(applied, episodes.rewards()[row]));
        }
    }
    assert!(actions.iter().any(|action| action.abs() > 1.0), "{actions:?}");
    for (row, steps) in steps.iter().enumerate() {
        let seed = Seed(8).child(row as u64).child(0);
        let watched = Steps::default();
        let spied = Arc::new(Watched(environment.clone(), watched.clone()));
        let noise = Noise { action_std: 0.0, observation_std: 0.0 };
        let rollout = Rollout::new(spied, Arc::new(policy.clone()), specification.clone(), noise).unwrap();
        let mut rollout =
            rollout.with_disturbances(scenarios.space.clone(), &scenarios.disturbances).unwrap();
        rollout.rollout(&[Request::new(scenarios.random(seed, 0), seed)]).unwrap();
        assert_eq!(*steps, *watched.lock().unwrap(), "{row}");
    }
}

const SETTINGS: &str = "
rollout_steps = 16
minibatch_size = 64
policy.hidden = [8]
critic.hidden = [8]
run.validation_interval = 1
run.total_steps = 256
run.validation_episodes = 4
episodes.environments = 8
scenarios.nominal = 0.25
scenarios.corners = 0.25
";

fn plan(folder: &Path, name: &str, device: &str) -> TrainPlan {
    let settings = folder.join("settings.toml");
    std::fs::write(&settings, SETTINGS).unwrap();
    TrainPlan {
        task: "ball-balancing".to_string(),
        algorithm: "ppo".to_string(),
        reward: "shaped".to_string(),
        device: device.to_string(),
        settings: Some(settings),
        space: Some("delay+dynamics+sensing+faults-sensing".to_string()),
        axes: [("action_delay".to_string(), AxisSetting::Range([0.0, 2.0]))].into(),
        seed: 4,
        out: folder.join(format!("{name}.safetensors")),
        csv: Some(folder.join(format!("{name}.csv"))),
        ..TrainPlan::default()
    }
}

fn train(plan: &TrainPlan) -> Result<TrainReport, Box<MishandleError>> {
    let device = Device { worlds: Arc::new(CpuDevice), networks: None };
    mishandle::train::train(plan, Some(&device), &mut Silent).map_err(Box::new)
}

#[test]
fn a_run_on_scenarios_reports_them_apart_resumes_to_the_same_bits_and_records_its_table() {
    let folder = tempfile::tempdir().unwrap();
    let whole = train(&plan(folder.path(), "whole", "cpu")).unwrap();
    let other_engine = train(&plan(folder.path(), "engine", "gpu")).unwrap();
    assert_eq!(whole.result.last.hash(), other_engine.result.last.hash());

    let half = TrainPlan { steps: Some(128), ..plan(folder.path(), "half", "cpu") };
    train(&half).unwrap();
    let rest = TrainPlan { steps: None, resume: true, ..half };
    assert_eq!(train(&rest).unwrap().result.last.hash(), whole.result.last.hash());
    // Other scenarios are another training run.
    let other = TrainPlan { space: Some("delay".to_string()), ..rest };
    assert!(train(&other).unwrap_err().to_string().contains("scenarios.space"), "the setting is named");

    let curve = Curve::load(&folder.path().join("whole.csv")).unwrap();
    let validation = curve.rows[0].validation.unwrap();
    assert!(validation.space.is_some() && validation.corners.is_some());
    let recorded = whole.settings.scenarios();
    let space = SpaceSetting::One("delay+dynamics+sensing+faults-sensing".to_string());
    assert_eq!(recorded.space, Some(space));
    assert_eq!(recorded.axes["action_delay"], AxisSetting::Range([0.0, 2.0]));
    assert_eq!(recorded.axes["sensor_fault_fill"], AxisSetting::Range([0.0, 1.0]), "without NaN");
    let command = plan(folder.path(), "whole", "cpu").command();
    let flags = "--space delay+dynamics+sensing+faults-sensing --axis action_delay=0:2 --seed 4";
    assert!(command.ends_with(flags), "{command}");
}

#[test]
fn a_curriculum_grows_over_validations_and_resumes_to_the_same_bits() {
    let folder = tempfile::tempdir().unwrap();
    let plan = |name: &str, curriculum: &str| {
        let plan = plan(folder.path(), name, "cpu");
        let settings = folder.path().join(format!("{name}.toml"));
        std::fs::write(&settings, format!("{SETTINGS}scenarios.curriculum = {curriculum}")).unwrap();
        TrainPlan { settings: Some(settings), ..plan }
    };
    // Every success rate reaches a threshold of 0: two iterations of 128 steps, two validations.
    let curriculum = "{ start = 0.25, step = 0.5, threshold = 0 }";
    let whole = train(&plan("whole", curriculum)).unwrap();
    let half = TrainPlan { steps: Some(128), ..plan("half", curriculum) };
    train(&half).unwrap();
    let rest = TrainPlan { steps: None, resume: true, ..half };
    assert_eq!(train(&rest).unwrap().result.last.hash(), whole.result.last.hash());
    for name in ["whole", "half"] {
        let curve = Curve::load(&folder.path().join(format!("{name}.csv"))).unwrap();
        let shares: Vec<Option<f64>> = curve.rows.iter().map(|row| row.scenario_share).collect();
        assert_eq!(shares, [Some(0.25), Some(0.75)]);
        for row in &curve.rows {
            let validation = row.validation.unwrap();
            assert_eq!(validation.part.map(|part| part.share), row.scenario_share);
            assert!(validation.space.is_some(), "of the whole space");
        }
    }
    // Another curriculum is another training run, and has other weights.
    let other = train(&plan("other", "{ start = 0.5, step = 0.5, threshold = 0 }")).unwrap();
    assert_ne!(other.result.last.hash(), whole.result.last.hash());
    let alone = TrainPlan { space: None, axes: Default::default(), ..plan("alone", curriculum) };
    let error = train(&alone).unwrap_err().to_string();
    assert!(error.contains("whose range can grow"), "{error}");
}
