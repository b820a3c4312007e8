//! The contract of faults on every task: what the controller sees and what the robot gets, for each
//! kind of fault.

use std::sync::{Arc, Mutex};

use mishandle_controllers::ControllerFile;
use mishandle_rollout::fault::{FaultSite, LifeCycle, Side};
use mishandle_rollout::{
    Axis, AxisValues, Component, Controller, Environment, EnvironmentFacts, EnvironmentWorker, Episode,
    EpisodeEnd, Noise, Request, Sample, Scenario, Seed, Space, StepStatus, System,
};
use mishandle_tasks::{CONTROL_DT, Preset, TASKS, Task, TaskEnvironment, TaskTarget};

use crate::function_controller::controller;

/// Numbers of each control step.
type Log<T> = Arc<Mutex<Vec<Vec<T>>>>;

/// The command of a call to an entry: below 1.
fn command(call: f64, entry: usize) -> f32 {
    (0.8 * (0.05 * call + entry as f64).sin()) as f32
}

/// Returns a controller that remembers what it sees, and whose actions depend on the number of its
/// calls only, so that the episode is the same whatever it sees.
fn observer(observation_size: usize, action_size: usize, seen: Log<f32>) -> Arc<dyn Controller> {
    controller([observation_size, action_size, 1], move |observation, state, action| {
        seen.lock().unwrap().push(observation.to_vec());
        action.iter_mut().enumerate().for_each(|(entry, action)| *action = command(state[0], entry));
        state[0] += 1.0;
    })
}

/// An environment that remembers its actions.
struct Robot {
    environment: TaskEnvironment,
    facts: EnvironmentFacts,
    got: Log<f64>,
}

impl Environment for Robot {
    fn facts(&self) -> &EnvironmentFacts {
        &self.facts
    }

    fn worker(&self) -> Box<dyn EnvironmentWorker> {
        Box::new(RobotWorker { worker: self.environment.worker(), got: Arc::clone(&self.got) })
    }
}

struct RobotWorker {
    worker: Box<dyn EnvironmentWorker>,
    got: Log<f64>,
}

impl EnvironmentWorker for RobotWorker {
    fn reset(
        &mut self,
        scenario: &Scenario,
        seed: Seed,
        state: &mut [f64],
        sample: Sample<'_>,
    ) -> StepStatus {
        self.worker.reset(scenario, seed, state, sample)
    }

    fn step(&mut self, action: &[f64], state: &mut [f64], sample: Sample<'_>) -> StepStatus {
        self.got.lock().unwrap().push(action.to_vec());
        self.worker.step(action, state, sample)
    }
}

/// Control steps of the episodes here, which contain the life cycle.
const STEPS: usize = 60;

const ONSET: f64 = 0.3;
const DURATION: f64 = 0.25;
const RECOVERY: f64 = 0.2;

/// A task with the observer, in a space.
struct Stage {
    space: Space,
    sites: [FaultSite; 2],
    system: Box<dyn System>,
    seen: Log<f32>,
    got: Log<f64>,
}

impl Stage {
    fn new(task: &'static dyn Task, spaces: &str) -> Stage {
        let definition = task.definition();
        let seen = Log::default();
        let sites = definition.fault_sites();
        let sizes = (sites[0].ranges.len(), sites[1].ranges.len());
        let component = Component {
            role: "controller".into(),
            name: "observer".into(),
            hash: "-".into(),
            file_hash: String::new(),
        };
        let controller = observer(sizes.0, sizes.1, Arc::clone(&seen));
        let noise = Noise::default();
        let target = TaskTarget::new(task, Preset::Paper, controller, vec![component], noise).unwrap();
        let space = target.target().unwrap().space(spaces).unwrap();
        let specification = definition.paper.specification().unwrap();
        let environment = target.environment(&space, &specification).unwrap();
        let got = Log::default();
        let facts = EnvironmentFacts { episode_steps: STEPS, ..environment.facts().clone() };
        let robot = Robot { environment, facts, got: Arc::clone(&got) };
        let system = target.system_in(Arc::new(robot), &space, &specification).unwrap();
        Stage { space, sites, system: Box::new(system), seen, got }
    }

    fn number(&self, name: &str, text: &str) -> f64 {
        let axis = self.space.axes().iter().find(|axis| axis.name == name).unwrap();
        match &axis.values {
            AxisValues::Categorical(names) => names.iter().position(|known| known == text).unwrap() as f64,
            _ => text.parse().unwrap(),
        }
    }

    fn scenario(&self, values: &[(String, String)]) -> Scenario {
        let value = |axis: &Axis| {
            let set = values.iter().find(|(name, _)| *name == axis.name);
            set.map_or(axis.nominal, |(name, text)| Some(self.number(name, text)))
        };
        let scenario = Scenario::new(self.space.axes().iter().map(value).collect());
        assert!(self.space.ineffective(&scenario).is_empty(), "{values:?}");
        scenario
    }

    fn run(&mut self, scenario: Scenario) -> (Episode, Vec<Vec<f32>>, Vec<Vec<f64>>) {
        self.seen.lock().unwrap().clear();
        self.got.lock().unwrap().clear();
        let episode = self.system.rollout(&[Request::new(scenario, Seed(3))]).unwrap().remove(0);
        let seen = self.seen.lock().unwrap().clone();
        let got = self.got.lock().unwrap().clone();
        (episode, seen, got)
    }
}

/// The values of a fault of a kind with its whole life cycle, on channel `channel`.
fn fault(side: Side, kind: &str, channel: &str) -> Vec<(String, String)> {
    let name = if side == Side::Sensing { "sensor_fault" } else { "actuator_fault" };
    let description = side.kinds().iter().find(|known| known.name == kind).unwrap();
    let all = [
        ("channel", channel),
        ("partner", "next"),
        ("recovery", "0.2"),
        ("fill", "zero"),
        ("offset", "0.25"),
        ("level", "0.5"),
        ("quantum", "0.05"),
        ("probability", "1"),
        ("burst", "2"),
        ("loss", "0.75"),
        ("limit", "0.1"),
        ("lateness", "4"),
    ];
    let parameters: Vec<String> = description.parameters.iter().map(|p| p.suffix().to_string()).collect();
    let own = all.iter().filter(|(suffix, _)| parameters.contains(&format!("_{suffix}")));
    let mut values: Vec<(String, String)> =
        own.map(|(suffix, value)| (format!("{name}_{suffix}"), (*value).to_string())).collect();
    values.push((name.to_string(), kind.to_string()));
    values.push((format!("{name}_onset"), ONSET.to_string()));
    values.push((format!("{name}_duration"), DURATION.to_string()));
    values
}

/// Checks that two logs differ on the entries of a channel only, and only in the life cycle.
fn check_life_cycle<T: Copy + Into<f64>>(
    healthy: &[Vec<T>],
    faulty: &[Vec<T>],
    entries: &[usize],
    recovers: bool,
    has_effect: bool,
    context: &str,
) {
    let recovery = if recovers { RECOVERY } else { 0.0 };
    let life = LifeCycle::from_seconds(ONSET, DURATION, recovery, CONTROL_DT);
    assert_eq!((life.onset, life.duration), (18, 15), "0.3 s and 0.25 s of 1/60 s");
    assert_eq!(healthy.len(), faulty.len());
    let mut has_differed = false;
    for (step, (before, after)) in healthy.iter().zip(faulty).enumerate() {
        for entry in 0..before.len() {
            let before: f64 = before[entry].into();
            let after: f64 = after[entry].into();
            let is_same = before.to_bits() == after.to_bits();
            let may_differ = life.share(step) > 0.0 && entries.contains(&entry);
            assert!(is_same || may_differ, "{context}: entry {entry} in control step {step}");
            has_differed |= !is_same;
        }
    }
    assert!(has_differed || !has_effect, "{context}: no effect");
}

#[test]
fn the_controller_sees_each_sensor_fault_on_its_channel_in_its_life_cycle_only() {
    for task in TASKS {
        let mut stage = Stage::new(*task, "starts+faults-sensing");
        let nominal = stage.scenario(&[]);
        let (healthy, seen, _) = stage.run(nominal);
        let count = stage.sites[0].ranges.len();
        let mut channels: Vec<(String, Vec<usize>)> =
            stage.sites[0].channels.iter().map(|c| (c.name.clone(), c.entries.clone())).collect();
        channels.insert(0, ("all".to_string(), (0..count).collect()));
        let last = channels.last().unwrap().clone();
        for kind in &Side::Sensing.kinds()[1..] {
            for (channel, entries) in [&channels[0], &channels[1], &last] {
                // Two channels are exchanged.
                let touched = if kind.name == "swap" { (0..count).collect() } else { entries.clone() };
                let touched: Vec<usize> = touched;
                let context = format!("{}: {} of {channel}", task.definition().name, kind.name);
                let mut values = fault(Side::Sensing, kind.name, channel);
                if channel == "all" {
                    values.retain(|(axis, _)| !axis.ends_with("_partner"));
                }
                let scenario = stage.scenario(&values);
                let (episode, faulty, _) = stage.run(scenario);
                // An object at rest stays the same if it is frozen, and its velocity is 0 without a
                // fault.
                let moves = seen[18..36]
                    .iter()
                    .any(|row| touched.iter().any(|entry| row[*entry] != seen[17][*entry]));
                check_life_cycle(&seen, &faulty, &touched, kind.recovers(), moves, &context);
                assert_eq!(episode.trace, healthy.trace, "{context}: signals are those of the environment");
                check_range(&stage.sites[0], &seen, &faulty, kind.name == "swap", &context);
            }
        }
    }
}

/// Checks that a fault leaves each number within the hull of its true values in the episode, the
/// range of its sensor, 0, and half of the half range around them.
fn check_range(site: &FaultSite, healthy: &[Vec<f32>], faulty: &[Vec<f32>], is_swap: bool, context: &str) {
    for row in faulty {
        for (entry, value) in row.iter().enumerate() {
            let [low, high] = site.ranges[entry];
            // A swap shows the values of another entry.
            let entries = if is_swap { 0..row.len() } else { entry..entry + 1 };
            let values = healthy.iter().flat_map(|row| &row[entries.clone()]);
            let largest = values.fold(0.0_f32, |largest, x| largest.max(x.abs()));
            let bound = f64::from(largest).max(high) + 0.25 * (high - low);
            assert!(f64::from(value.abs()) <= bound, "{context}: {value} of entry {entry}");
        }
    }
}

#[test]
fn the_robot_gets_each_actuator_fault_on_its_channel_in_its_life_cycle_only() {
    for task in TASKS {
        let mut stage = Stage::new(*task, "starts+faults-actuation");
        let nominal = stage.scenario(&[]);
        let (_, _, commands) = stage.run(nominal);
        for (step, row) in commands.iter().enumerate() {
            let expected: Vec<f64> = (0..row.len()).map(|entry| command(step as f64, entry).into()).collect();
            assert_eq!(row, &expected, "the commands are those of the controller");
        }
        for kind in &Side::Actuation.kinds()[1..] {
            for channel in ["all", "joint3"] {
                let context = format!("{}: {} of {channel}", task.definition().name, kind.name);
                let has_channel = kind.parameters.iter().any(|parameter| parameter.suffix() == "_channel");
                let entries: Vec<usize> =
                    if channel == "joint3" && has_channel { vec![2] } else { (0..9).collect() };
                let scenario = stage.scenario(&fault(Side::Actuation, kind.name, channel));
                let (_, _, got) = stage.run(scenario);
                if kind.name != "pause" {
                    check_life_cycle(&commands, &got, &entries, kind.recovers(), true, &context);
                }
                assert!(got.iter().flatten().all(|action| action.abs() <= 1.0), "{context}: out of range");
            }
        }
    }
}

#[test]
fn a_paused_controller_holds_its_action_and_continues_where_it_was() {
    let mut stage = Stage::new(TASKS[0], "starts+faults-actuation");
    let scenario = stage.scenario(&fault(Side::Actuation, "pause", "all"));
    let (_, _, got) = stage.run(scenario);
    for (step, row) in got.iter().enumerate() {
        // Control steps 18 to 32 repeat the action of step 17. Its next call is number 18.
        let call = if step < 18 {
            step
        } else if step < 33 {
            17
        } else {
            step - 15
        };
        let expected: Vec<f64> = (0..row.len()).map(|entry| command(call as f64, entry).into()).collect();
        assert_eq!(row, &expected, "control step {step}");
    }
}

#[test]
fn a_nominal_fault_of_every_kind_has_the_bits_of_an_undisturbed_episode() {
    for task in TASKS {
        let mut plain = Stage::new(*task, "starts");
        let nominal = plain.space.nominal();
        let (undisturbed, ..) = plain.run(nominal);
        let mut stage = Stage::new(*task, "starts+timing+faults-sensing+faults-actuation");
        let magnitudes = ["offset", "quantum", "probability", "loss", "lateness", "limit"];
        for side in [Side::Sensing, Side::Actuation] {
            for kind in side.kinds() {
                // Less than half a control step, then a duration without magnitude.
                for is_short in [true, false] {
                    let name = if side == Side::Sensing { "sensor_fault" } else { "actuator_fault" };
                    let has_magnitude =
                        kind.parameters.iter().any(|p| magnitudes.contains(&&p.suffix()[1..]));
                    if kind.name == "none" || (!is_short && !has_magnitude) {
                        continue;
                    }
                    let mut values = fault(side, kind.name, "all");
                    for (axis, value) in &mut values {
                        let suffix = axis.trim_start_matches(name).trim_start_matches('_').to_string();
                        if is_short && suffix == "duration" {
                            *value = "0.008".to_string();
                        } else if !is_short && magnitudes.contains(&suffix.as_str()) {
                            *value = if suffix == "limit" { "1" } else { "0" }.to_string();
                        }
                    }
                    let scenario = stage.scenario(&values);
                    let (episode, ..) = stage.run(scenario);
                    let context = format!("{}: {values:?}", task.definition().name);
                    assert_eq!(episode.trace, undisturbed.trace, "{context}");
                    assert_eq!(
                        episode.total_reward.to_bits(),
                        undisturbed.total_reward.to_bits(),
                        "{context}"
                    );
                    assert_eq!(episode.verdict, undisturbed.verdict, "{context}");
                }
            }
        }
    }
}

#[test]
fn a_policy_that_sees_nan_ends_as_an_invalid_action_without_a_verdict() {
    let lost = [("", "dropout"), ("_channel", "all"), ("_fill", "nan"), ("_duration", "0.5")];
    let lost = lost.map(|(suffix, value)| (format!("sensor_fault{suffix}"), value.to_string()));
    for task in TASKS {
        let name = task.definition().name;
        let mut stage = Stage::new(*task, "starts+faults-sensing");
        let scenario = stage.scenario(&lost);
        let (_, seen, _) = stage.run(scenario.clone());
        assert!(seen[0].iter().all(|value| value.is_nan()), "{name}: {:?}", seen[0]);
        // A network passes NaN on.
        let component = Component {
            role: "controller".into(),
            name: "ppo".into(),
            hash: "-".into(),
            file_hash: String::new(),
        };
        let folder = task.definition().variant_of.unwrap_or(name);
        let path = format!("{}/../../controllers/{folder}/ppo.safetensors", env!("CARGO_MANIFEST_DIR"));
        let policy = Arc::new(ControllerFile::load(path.as_ref()).unwrap().policy);
        let target =
            TaskTarget::new(*task, Preset::Paper, policy, vec![component], Noise::default()).unwrap();
        let target = target.target().unwrap();
        let specification = task.definition().paper.specification().unwrap();
        let mut system = target.system(&stage.space, &specification).unwrap();
        let episode = system.rollout(&[Request::new(scenario, Seed(1))]).unwrap().remove(0);
        assert!(
            matches!(episode.end, EpisodeEnd::InvalidAction { step: 1, .. }),
            "{name}: {:?}",
            episode.end
        );
        assert_eq!(episode.robustness(), None, "{name}");
    }
}
