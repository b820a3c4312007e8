//! A batch of worlds gives the same episodes as the environment, whose physics it replaces.

use std::sync::{Arc, Mutex};

use mishandle_rollout::{
    BatchFactory, BatchStatus, Component, Environment, EnvironmentBatch, EpisodeEnd, Noise, Request, Sample,
    Scenario, ScenarioBatch, Screen, Screening, Seed, Space, Specification, Start, StepStatus, Stream,
};
use mishandle_tasks::{Preset, Reward, TaskBatch, TaskBatches, TaskEnvironment, TaskTarget, tasks};
use mishandle_world::{
    BatchLayout, BatchSpec, CpuDevice, ModelField, Outputs, Readings, WorldBatch, WorldDevice, WorldError,
};

use crate::altered_worlds::{Alteration, AlteredDevice, AlteredWorlds};

fn target(task: &str, noise: Noise) -> TaskTarget {
    let task = mishandle_tasks::task(task).unwrap();
    let component = Component {
        role: "controller".into(),
        name: "expert".into(),
        hash: String::new(),
        file_hash: String::new(),
    };
    TaskTarget::new(task, Preset::Paper, task.expert().unwrap(), vec![component], noise).unwrap()
}

fn specification(task: &str) -> Specification {
    mishandle_tasks::task(task).unwrap().definition().formulas(Preset::Paper).specification().unwrap()
}

fn screening(
    target: &TaskTarget,
    task: &str,
    space: &str,
    device: &dyn WorldDevice,
    rows: &[usize],
) -> Screening {
    screening_of(&specification(task), target, space, device, rows)
}

fn screening_of(
    specification: &Specification,
    target: &TaskTarget,
    space: &str,
    device: &dyn WorldDevice,
    rows: &[usize],
) -> Screening {
    let space = target.target().unwrap().space(space).unwrap();
    let environment = target.environment(&space, specification).unwrap();
    let batches = rows
        .iter()
        .map(|rows| Box::new(TaskBatch::new(&environment, device, *rows).unwrap()) as Box<dyn ScenarioBatch>)
        .collect();
    let rollout = target.system_in(Arc::new(environment), &space, specification).unwrap();
    Screening::new(rollout, batches)
}

#[test]
fn screened_episodes_on_the_cpu_have_the_bits_of_the_system() {
    let noise = Noise { action_std: 0.3, observation_std: 0.0 };
    for task in tasks().iter().map(|task| task.definition().name) {
        if task == "cloth-placing" {
            continue; // It takes ten times as long as the others together; its release is that of the cubes.
        }
        let target = target(task, noise);
        let space = if task == "point-reaching" { "starts+sensing+delay" } else { "starts" };
        let resolved = target.target().unwrap().space(space).unwrap();
        let requests: Vec<Request> =
            (0..11).map(|i| Request::new(resolved.sample(Seed(3), i), Seed(100 + i))).collect();
        let expected = target
            .target()
            .unwrap()
            .system(&resolved, &specification(task))
            .unwrap()
            .rollout(&requests)
            .unwrap();
        // Five and two rows for eleven episodes: rows are used again, and batches differ in size.
        let mut screening = screening(&target, task, space, &CpuDevice, &[5, 2]);
        let found = screening.run(&requests, &|_| true).unwrap();
        for (episode, screened) in expected.iter().zip(found) {
            let screened = screened.unwrap();
            assert_eq!((screened.end, &screened.verdict), (episode.end, &episode.verdict), "{task}");
            assert!(!screened.has_overflowed);
        }
    }
}

/// Worlds whose second row fails in its third step.
#[derive(Clone)]
struct Failing {
    steps: usize,
    status: f64,
}

impl Alteration for Failing {
    fn finish_step(&mut self, worlds: &mut dyn WorldBatch) -> Result<(), WorldError> {
        worlds.finish_step()?;
        self.steps += 1;
        if self.steps == 3 && self.status > 2.0 {
            return Err(WorldError::Device("the device is lost".into()));
        }
        if let (Outputs::Double(outputs), 3) = (worlds.buffers().outputs, self.steps)
            && let Some(status) = outputs.last_mut()
        {
            *status = self.status;
        }
        Ok(())
    }
}

fn failing(status: f64) -> AlteredDevice<Failing> {
    AlteredDevice(Failing { steps: 0, status })
}

#[test]
fn an_overflow_or_a_divergence_ends_its_row_only() {
    let target = target("point-reaching", Noise::default());
    let space = target.target().unwrap().space("starts").unwrap();
    let requests: Vec<Request> = (0..2).map(|i| Request::new(space.sample(Seed(3), i), Seed(i))).collect();
    let ends = |code: f64| {
        let mut screening = screening(&target, "point-reaching", "starts", &failing(code), &[2]);
        let outcomes = screening.run(&requests, &|_| true).unwrap();
        outcomes
            .into_iter()
            .flatten()
            .map(|outcome| (outcome.end, outcome.has_overflowed))
            .collect::<Vec<_>>()
    };
    assert_eq!(ends(1.0), [(EpisodeEnd::Completed, false), (EpisodeEnd::Diverged { step: 3 }, false)]);
    assert_eq!(ends(2.0), [(EpisodeEnd::Completed, false), (EpisodeEnd::Crashed { step: 3 }, true)]);
}

#[test]
fn a_lost_device_is_an_error_of_the_whole_screening() {
    let target = target("point-reaching", Noise::default());
    let space = target.target().unwrap().space("starts").unwrap();
    let requests = [Request::new(space.sample(Seed(3), 0), Seed(1))];
    let mut screening = screening(&target, "point-reaching", "starts", &failing(3.0), &[2]);
    let error = screening.run(&requests, &|_| true).unwrap_err().to_string();
    assert!(error.contains("the device is lost"), "{error}");
}

/// Returns the names of all tasks except those with a cloth, whose steps take ten times as long.
fn rigid_tasks() -> Vec<&'static str> {
    tasks().iter().map(|task| task.definition().name).filter(|name| !name.starts_with("cloth")).collect()
}

/// Axes of times, and times within the first second at which events happen in different control
/// steps.
const EVENT_TIMES: [(&str, [f64; 4]); 3] = [
    ("push_time", [0.05, 0.21, 0.0, 0.3]),
    ("jump_time", [0.1, 0.0, 0.42, 0.25]),
    ("slip_time", [0.0, 0.11, 0.3, 0.07]),
];

/// Returns the environment of a space of a task, and scenarios whose events happen early.
fn environment(task: &str, space: &str) -> (TaskEnvironment, Vec<Scenario>) {
    let target = target(task, Noise::default());
    let space = target.target().unwrap().space(space).unwrap();
    let environment = target.environment(&space, &specification(task)).unwrap();
    let space = environment.space().clone();
    let scenarios = (0..4).map(|row| {
        let mut values = space.sample(Seed(3), row as u64).values().to_vec();
        for (axis, value) in space.axes().iter().zip(&mut values) {
            if let Some((_, times)) = EVENT_TIMES.iter().find(|(name, _)| *name == axis.name) {
                *value = Some(times[row]);
            }
        }
        Scenario::new(values)
    });
    let scenarios = scenarios.collect();
    (environment, scenarios)
}

/// Bits of an observation and of signals, and the status.
type Row = (Vec<u32>, Vec<u64>, BatchStatus);

fn bits(observation: &[f32], signals: &[f64], status: BatchStatus) -> Row {
    let observation = observation.iter().map(|value| value.to_bits()).collect();
    (observation, signals.iter().map(|value| value.to_bits()).collect(), status)
}

/// Returns random actions of one row in one control step. They open and close the gripper.
fn actions(row: usize, step: u64) -> Vec<f64> {
    let mut actions = vec![0.0; 9];
    Seed(row as u64).normals(Stream::Policy, step, &mut actions);
    actions
}

/// Returns the samples of each control step of each row, from the environment's own worker.
fn plain_rows(environment: &TaskEnvironment, scenarios: &[Scenario], steps: u64) -> Vec<Vec<Row>> {
    let mut worker = environment.worker();
    let simulate = |(row, scenario)| {
        let mut state = vec![0.0; environment.state_size()];
        let mut observation = vec![0.0; environment.observation_size()];
        let mut signals = vec![0.0; environment.signals().len()];
        let mut rewards = vec![0.0; environment.reward_terms().len()];
        (0..=steps)
            .map(|step| {
                let sample =
                    Sample { observation: &mut observation, signals: &mut signals, rewards: &mut rewards };
                let status = match step.checked_sub(1) {
                    None => worker.reset(scenario, Seed(row as u64), &mut state, sample),
                    Some(step) => worker.step(&actions(row, step), &mut state, sample),
                };
                bits(&observation, &signals, BatchStatus::Step(status))
            })
            .collect()
    };
    scenarios.iter().enumerate().map(simulate).collect()
}

/// Returns the same from a batch.
fn batch_rows(
    environment: &TaskEnvironment,
    scenarios: &[Scenario],
    steps: u64,
    device: &dyn WorldDevice,
) -> Vec<Vec<Row>> {
    let mut batch = TaskBatch::new(environment, device, scenarios.len()).unwrap();
    let rows = Mutex::new(vec![Vec::new(); scenarios.len()]);
    for step in 0..=steps {
        // All rows are in one group.
        batch.visit(&|_, group| {
            for (row, scenario) in scenarios.iter().enumerate() {
                let mut observation = vec![0.0; environment.observation_size()];
                let mut signals = vec![0.0; environment.signals().len()];
                let status = match step.checked_sub(1) {
                    None => {
                        let mut rewards = vec![0.0; environment.reward_terms().len()];
                        let observation = &mut observation[..];
                        let signals = &mut signals[..];
                        let sample = Sample { observation, signals, rewards: &mut rewards };
                        group.start(row, scenario, Seed(row as u64), sample);
                        BatchStatus::Step(StepStatus::Running)
                    }
                    Some(_) => group.sample(row, &mut observation, &mut signals),
                };
                rows.lock().unwrap()[row].push(bits(&observation, &signals, status));
                group.command(row, &actions(row, step), true);
            }
        });
        batch.start_step().unwrap();
        batch.finish_step().unwrap();
    }
    rows.into_inner().unwrap()
}

#[test]
fn rows_with_changed_constants_and_events_have_the_bits_of_the_environment() {
    for task in rigid_tasks() {
        for space in ["dynamics", "events", "starts+dynamics+events"] {
            let (environment, scenarios) = environment(task, space);
            let expected = plain_rows(&environment, &scenarios, 45);
            let found = batch_rows(&environment, &scenarios, 45, &CpuDevice);
            for (row, (found, expected)) in found.iter().zip(&expected).enumerate() {
                let differing = found.iter().zip(expected).position(|(found, expected)| found != expected);
                assert_eq!(differing, None, "{task}, {space}, row {row}: first control step that differs");
            }
            assert_ne!(expected[0], expected[1], "{task}, {space}");
        }
    }
}

#[test]
fn signals_of_the_manner_have_the_bits_of_the_environment() {
    for (task, touched) in [
        ("cube-stacking", "object_force"),
        ("peg-in-hole", "fixture_force"),
        ("ball-balancing", "arm_object_force"),
    ] {
        for space in ["starts", "starts+dynamics+events"] {
            let (environment, scenarios) = environment(task, space);
            let environment = environment.with_manner();
            let expected = plain_rows(&environment, &scenarios, 60);
            let found = batch_rows(&environment, &scenarios, 60, &CpuDevice);
            for (row, (found, expected)) in found.iter().zip(&expected).enumerate() {
                let differing = found.iter().zip(expected).position(|(found, expected)| found != expected);
                assert_eq!(differing, None, "{task}, {space}, row {row}: first control step that differs");
            }
            let signal = environment.signals().iter().position(|name| name == touched).unwrap();
            let forces = expected.iter().flatten().map(|(_, signals, _)| f64::from_bits(signals[signal]));
            assert!(forces.fold(0.0, f64::max) > 1.0, "{task}, {space}: nothing touches");
        }
    }
}

#[test]
fn screened_episodes_have_the_careful_success_of_the_system() {
    for task in ["ball-balancing", "peg-in-hole"] {
        let target = target(task, Noise { action_std: 0.3, observation_std: 0.0 });
        let space = target.target().unwrap().space("starts").unwrap();
        let formulas = mishandle_tasks::task(task).unwrap().definition().formulas(Preset::Paper);
        let careful = formulas.careful().unwrap().parse().unwrap();
        let specification = Specification { careful: Some(careful), ..specification(task) };
        let requests: Vec<Request> =
            (0..7).map(|i| Request::new(space.sample(Seed(3), i), Seed(100 + i))).collect();
        let mut system = target.target().unwrap().system(&space, &specification).unwrap();
        let expected = system.rollout(&requests).unwrap();
        let mut screening = screening_of(&specification, &target, "starts", &CpuDevice, &[3, 2]);
        let found = screening.run(&requests, &|_| true).unwrap();
        for (episode, screened) in expected.iter().zip(found) {
            assert!(episode.verdict.careful.is_some());
            assert_eq!(screened.unwrap().verdict.careful, episode.verdict.careful, "{task}");
        }
    }
}

/// A part of the inputs that a batch receives.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Input {
    Fields,
    Forces,
    Mocap,
}

/// Worlds that ignore a part of their inputs, with the mocap bodies of their start.
#[derive(Clone)]
struct Ignoring(Input, Vec<f64>);

impl Alteration for Ignoring {
    fn write_states(
        &mut self,
        worlds: &mut dyn WorldBatch,
        rows: &[usize],
        states: &[f64],
    ) -> Result<(), WorldError> {
        self.1 = worlds.buffers().mocap.to_vec();
        worlds.write_states(rows, states)
    }

    fn write_fields(
        &mut self,
        worlds: &mut dyn WorldBatch,
        rows: &[usize],
        values: &[f64],
    ) -> Result<(), WorldError> {
        if self.0 == Input::Fields { Ok(()) } else { worlds.write_fields(rows, values) }
    }

    fn start_step(&mut self, worlds: &mut dyn WorldBatch) -> Result<(), WorldError> {
        match self.0 {
            Input::Fields => {}
            Input::Forces => worlds.buffers().forces.fill(0.0),
            Input::Mocap => worlds.buffers().mocap.copy_from_slice(&self.1),
        }
        worlds.start_step()
    }
}

#[test]
fn rows_of_a_device_that_ignores_constants_slips_pushes_or_jumps_differ() {
    for (task, space, input) in [
        ("ball-balancing", "dynamics", Input::Fields),
        ("cube-stacking", "events", Input::Fields),
        ("ball-pushing", "events", Input::Forces),
        ("peg-in-hole", "events", Input::Mocap),
    ] {
        let (environment, scenarios) = environment(task, space);
        let expected = plain_rows(&environment, &scenarios, 45);
        let device = AlteredDevice(Ignoring(input, Vec::new()));
        assert_ne!(batch_rows(&environment, &scenarios, 45, &device), expected, "{task}, {input:?}");
    }
}

/// A device that keeps the facts of its last batch.
struct Recording(Mutex<Option<BatchSpec>>);

impl WorldDevice for Recording {
    fn engine(&self) -> &'static str {
        "recording"
    }

    fn batch(&self, spec: &BatchSpec) -> Result<Box<dyn WorldBatch>, WorldError> {
        *self.0.lock().unwrap() = Some(spec.clone());
        CpuDevice.batch(spec)
    }
}

#[test]
fn only_axes_of_constants_and_events_vary_the_worlds() {
    let spec = |space: &str| {
        let recording = Recording(Mutex::default());
        TaskBatch::new(&environment("cube-stacking", space).0, &recording, 1).unwrap();
        recording.0.into_inner().unwrap().unwrap()
    };
    for space in ["starts", "starts+sensing+delay", "disturbance"] {
        let spec = spec(space);
        assert!(spec.fields.is_empty() && spec.pushed.is_empty(), "{space}");
    }
    let events = spec("events");
    assert_eq!((events.fields, events.pushed.len()), (vec![ModelField::EqData], 1));
    assert!(spec("dynamics").pushed.is_empty());
}

#[test]
fn only_signals_of_the_manner_are_measured() {
    let task = mishandle_tasks::task("peg-in-hole").unwrap();
    let plain = TaskEnvironment::new(task, Preset::Paper, Reward::Shaped).unwrap();
    let manner = plain.with_manner();
    let layout = |environment: &TaskEnvironment| {
        let recording = Recording(Mutex::default());
        TaskBatch::new(environment, &recording, 1).unwrap();
        let spec = recording.0.into_inner().unwrap().unwrap();
        (spec.probe.is_some(), BatchLayout::new(&spec.model, spec.probe.as_ref()).output_size())
    };
    let (without, former) = layout(&plain);
    let (with, longer) = layout(&manner);
    assert_eq!((without, with, longer - former), (false, true, Readings::SIZE));
}

#[test]
fn screened_episodes_over_all_axes_have_the_verdicts_of_the_system() {
    for task in ["point-reaching", "ball-balancing", "peg-in-hole"] {
        let target = target(task, Noise { action_std: 0.3, observation_std: 0.0 });
        let space = target.target().unwrap().space("all").unwrap();
        let requests: Vec<Request> =
            (0..8).map(|i| Request::new(space.sample(Seed(3), i), Seed(100 + i))).collect();
        let mut system = target.target().unwrap().system(&space, &specification(task)).unwrap();
        let expected = system.rollout(&requests).unwrap();
        // Rows are used again, with other constants.
        let found = screening(&target, task, "all", &CpuDevice, &[3, 2]).run(&requests, &|_| true).unwrap();
        for (episode, screened) in expected.iter().zip(found) {
            let screened = screened.unwrap();
            assert_eq!((screened.end, &screened.verdict), (episode.end, &episode.verdict), "{task}");
        }
    }
}

/// Returns the start of a random scenario in a row.
fn start(space: &Space, row: usize, seed: Seed) -> Start {
    Start { row, scenario: space.sample(seed, 0), seed }
}

/// Steps a batch with random actions from `first` to `last`, and resets a row in every step.
/// Returns all samples.
fn samples(
    batch: &mut dyn EnvironmentBatch,
    space: &Space,
    steps: std::ops::Range<u64>,
) -> Vec<(Vec<f32>, Vec<f64>, Vec<StepStatus>)> {
    let mut actions = vec![0.0; batch.rows() * 9];
    let mut after = |step: u64| {
        Seed(5).normals(Stream::Policy, step, &mut actions);
        batch.step(&actions).unwrap();
        let sample = (batch.observations().to_vec(), batch.rewards().to_vec(), batch.statuses().to_vec());
        let row = step as usize % batch.rows();
        batch.reset(&[start(space, row, Seed(1000 + step))]).unwrap();
        sample
    };
    steps.map(&mut after).collect()
}

#[test]
fn training_environments_on_the_cpu_have_the_bits_of_the_environment() {
    let tasks = rigid_tasks().into_iter();
    for (task, space) in tasks.flat_map(|task| [(task, "starts"), (task, "dynamics+events")]) {
        let environment = Arc::new(environment(task, space).0);
        let factory = TaskBatches::new(environment.clone(), Arc::new(CpuDevice));
        let own = environment.space();
        let starts: Vec<_> = (0..5).map(|row| start(own, row, Seed(10 + row as u64))).collect();
        let mut expected = environment.batch(5).unwrap();
        let mut found = factory.batch(5).unwrap();
        expected.reset(&starts).unwrap();
        found.reset(&starts).unwrap();
        assert_eq!(found.observations(), expected.observations());
        assert_eq!(samples(&mut *found, own, 0..40), samples(&mut *expected, own, 0..40), "{task}, {space}");

        // Restored from their states, as from a checkpoint, they continue to the same bits.
        let mut states = vec![0.0; 5 * factory.spec().state_size];
        found.read_states(&mut states).unwrap();
        let mut restored = factory.batch(5).unwrap();
        restored.write_states(&states, found.observations()).unwrap();
        assert_eq!(restored.observations(), found.observations());
        assert_eq!(
            samples(&mut *restored, own, 40..80),
            samples(&mut *expected, own, 40..80),
            "{task}, {space}"
        );
    }
}

#[test]
fn a_training_environment_with_too_little_memory_diverges() {
    let task = mishandle_tasks::task("point-reaching").unwrap();
    let environment = Arc::new(TaskEnvironment::new(task, Preset::Paper, Reward::Shaped).unwrap());
    let starts = [start(environment.space(), 0, Seed(1)), start(environment.space(), 1, Seed(2))];
    let mut batch = TaskBatches::new(environment, Arc::new(failing(2.0))).batch(2).unwrap();
    batch.reset(&starts).unwrap();
    let statuses: Vec<_> = (0..3)
        .map(|_| {
            batch.step(&[0.0; 18]).unwrap();
            batch.statuses().to_vec()
        })
        .collect();
    use StepStatus::{Diverged, Running};
    assert_eq!(statuses, [[Running, Running], [Running, Running], [Running, Diverged]]);
}

/// Counts the rows that start in each batch.
struct Counting(Arc<Mutex<Vec<usize>>>);

/// The counts, and the index of a batch.
#[derive(Clone)]
struct StartCounter(Arc<Mutex<Vec<usize>>>, usize);

impl WorldDevice for Counting {
    fn engine(&self) -> &'static str {
        "counting"
    }

    fn batch(&self, spec: &BatchSpec) -> Result<Box<dyn WorldBatch>, WorldError> {
        let mut counts = self.0.lock().unwrap();
        counts.push(0);
        let counter = StartCounter(self.0.clone(), counts.len() - 1);
        Ok(Box::new(AlteredWorlds(CpuDevice.batch(spec)?, counter)))
    }
}

impl Alteration for StartCounter {
    fn write_states(
        &mut self,
        worlds: &mut dyn WorldBatch,
        rows: &[usize],
        states: &[f64],
    ) -> Result<(), WorldError> {
        self.0.lock().unwrap()[self.1] += rows.len();
        worlds.write_states(rows, states)
    }
}

#[test]
fn a_screening_forgets_the_simulations_of_an_interrupted_run() {
    let target = target("point-reaching", Noise::default());
    let space = target.target().unwrap().space("starts").unwrap();
    let requests: Vec<Request> = (0..5).map(|i| Request::new(space.sample(Seed(3), i), Seed(i))).collect();
    let new = || screening(&target, "point-reaching", "starts", &CpuDevice, &[2, 1]);
    let expected = new().run(&requests, &|_| true).unwrap();
    let mut screening = new();
    // The first three simulations have ended, and the others have started.
    let interrupted = screening.run(&requests[1..], &|done| done < 3).unwrap();
    assert!(interrupted.iter().any(Option::is_some) && interrupted.iter().any(Option::is_none));
    for count in [5, 0, 2] {
        assert_eq!(screening.run(&requests[..count], &|_| true).unwrap(), expected[..count]);
    }
}

#[test]
fn few_simulations_are_divided_among_the_batches() {
    let target = target("point-reaching", Noise::default());
    let space = target.target().unwrap().space("starts").unwrap();
    let requests: Vec<Request> = (0..5).map(|i| Request::new(space.sample(Seed(3), i), Seed(i))).collect();
    let counts = Arc::default();
    let mut screening =
        screening(&target, "point-reaching", "starts", &Counting(Arc::clone(&counts)), &[8, 8]);
    let outcomes = screening.run(&requests, &|_| true).unwrap();
    assert!(outcomes.iter().all(Option::is_some));
    assert_eq!(*counts.lock().unwrap(), [3, 2]);
}
