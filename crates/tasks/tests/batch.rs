//! A batch of worlds gives the same episodes as the environment, whose physics it replaces.

#![allow(clippy::unwrap_used)]

use std::sync::Arc;

use mishandle_rollout::{
    BatchFactory, Component, Environment, EnvironmentBatch, EpisodeEnd, Noise, Request, ScenarioBatch,
    Screening, Seed, Specification, StepStatus, Stream,
};
use mishandle_tasks::{Preset, Reward, TaskBatch, TaskBatches, TaskEnvironment, TaskTarget, tasks};
use mishandle_world::{Backend, BatchSpec, CpuBackend, Outputs, WorldBatch, WorldError};

fn target(task: &str, noise: Noise) -> TaskTarget {
    let task = mishandle_tasks::task(task).unwrap();
    let component = Component {
        role: "controller".into(),
        name: "expert".into(),
        hash: String::new(),
        file_hash: String::new(),
    };
    TaskTarget::new(task, Preset::Paper, (task.expert().unwrap(), component), noise).unwrap()
}

fn specification(task: &str) -> Specification {
    mishandle_tasks::task(task).unwrap().definition().formulas(Preset::Paper).specification().unwrap()
}

fn screening(
    target: &TaskTarget,
    task: &str,
    space: &str,
    backend: &dyn Backend,
    rows: &[usize],
) -> Screening {
    let space = target.target().unwrap().space(space).unwrap();
    let environment = target.environment(&space).unwrap();
    let batches = rows
        .iter()
        .map(|rows| Box::new(TaskBatch::new(&environment, backend, *rows).unwrap()) as Box<dyn ScenarioBatch>)
        .collect();
    let rollout = target.system_in(Arc::new(environment), &space, &specification(task)).unwrap();
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
        let mut screening = screening(&target, task, space, &CpuBackend, &[5, 2]);
        let found = screening.run(&requests, &|_| true).unwrap();
        for (episode, screened) in expected.iter().zip(found) {
            let screened = screened.unwrap();
            assert_eq!((screened.end, &screened.verdict), (episode.end, &episode.verdict), "{task}");
            assert!(!screened.has_overflowed);
        }
    }
}

/// A backend whose second row fails in its third step.
struct Faulty(f64);

struct FaultyWorlds(Box<dyn WorldBatch>, usize, f64);

impl Backend for Faulty {
    fn engine(&self) -> &'static str {
        "faulty"
    }

    fn batch(&self, spec: &BatchSpec) -> Result<Box<dyn WorldBatch>, WorldError> {
        Ok(Box::new(FaultyWorlds(CpuBackend.batch(spec)?, 0, self.0)))
    }
}

impl WorldBatch for FaultyWorlds {
    fn write_states(&mut self, rows: &[usize], states: &[f64]) -> Result<(), WorldError> {
        self.0.write_states(rows, states)
    }

    fn read_states(&mut self, states: &mut [f64]) -> Result<(), WorldError> {
        self.0.read_states(states)
    }

    fn buffers(&mut self) -> mishandle_world::BatchBuffers<'_> {
        self.0.buffers()
    }

    fn start_step(&mut self) -> Result<(), WorldError> {
        self.0.start_step()
    }

    fn finish_step(&mut self) -> Result<(), WorldError> {
        self.0.finish_step()?;
        self.1 += 1;
        if self.1 == 3 && self.2 > 2.0 {
            return Err(WorldError::Backend("the device is lost".into()));
        }
        if let (Outputs::Double(outputs), 3) = (self.0.buffers().outputs, self.1)
            && let Some(status) = outputs.last_mut()
        {
            *status = self.2;
        }
        Ok(())
    }
}

#[test]
fn an_overflow_or_a_divergence_ends_its_row_only() {
    let target = target("point-reaching", Noise::default());
    let space = target.target().unwrap().space("starts").unwrap();
    let requests: Vec<Request> = (0..2).map(|i| Request::new(space.sample(Seed(3), i), Seed(i))).collect();
    let ends = |code: f64| {
        let mut screening = screening(&target, "point-reaching", "starts", &Faulty(code), &[2]);
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
    let mut screening = screening(&target, "point-reaching", "starts", &Faulty(3.0), &[2]);
    let error = screening.run(&requests, &|_| true).unwrap_err().to_string();
    assert!(error.contains("the device is lost"), "{error}");
}

#[test]
fn a_space_that_changes_the_model_is_an_error_with_a_way_out() {
    let target = target("point-reaching", Noise::default());
    let space = target.target().unwrap().space("dynamics").unwrap();
    let environment = target.environment(&space).unwrap();
    let error = TaskBatch::new(&environment, &CpuBackend, 2).err().unwrap().to_string();
    assert!(error.contains("dynamics") && error.contains("--backend cpu"), "{error}");
    assert_eq!(environment.name(), "point-reaching");
}

/// Steps a batch with random actions from `first` to `last`, and resets a row in every step. Returns all samples.
fn samples(
    batch: &mut dyn EnvironmentBatch,
    steps: std::ops::Range<u64>,
) -> Vec<(Vec<f32>, Vec<f64>, Vec<StepStatus>)> {
    let mut actions = vec![0.0; batch.rows() * 9];
    let mut after = |step: u64| {
        Seed(5).normals(Stream::Policy, step, &mut actions);
        batch.step(&actions).unwrap();
        let sample = (batch.observations().to_vec(), batch.rewards().to_vec(), batch.statuses().to_vec());
        batch.reset(&[(step as usize % batch.rows(), Seed(1000 + step))]).unwrap();
        sample
    };
    steps.map(&mut after).collect()
}

#[test]
fn training_environments_on_the_cpu_have_the_bits_of_the_environment() {
    for task in tasks() {
        if task.definition().name.starts_with("cloth") {
            continue; // Its steps take ten times as long as those of the others.
        }
        let environment = Arc::new(TaskEnvironment::new(task, Preset::Paper, Reward::Shaped).unwrap());
        let factory = TaskBatches::new(environment.clone(), Arc::new(CpuBackend));
        let starts: Vec<_> = (0..5).map(|row| (row, Seed(10 + row as u64))).collect();
        let mut expected = environment.batch(5).unwrap();
        let mut found = factory.batch(5).unwrap();
        expected.reset(&starts).unwrap();
        found.reset(&starts).unwrap();
        assert_eq!(found.observations(), expected.observations());
        assert_eq!(samples(&mut *found, 0..40), samples(&mut *expected, 0..40), "{}", task.definition().name);

        // Restored from their states, as from a checkpoint, they continue to the same bits.
        let mut states = vec![0.0; 5 * factory.spec().state_size];
        found.read_states(&mut states).unwrap();
        let mut restored = factory.batch(5).unwrap();
        restored.write_states(&states, found.observations()).unwrap();
        assert_eq!(restored.observations(), found.observations());
        assert_eq!(
            samples(&mut *restored, 40..80),
            samples(&mut *expected, 40..80),
            "{}",
            task.definition().name
        );
    }
}

#[test]
fn a_training_environment_with_too_little_memory_diverges() {
    let task = mishandle_tasks::task("point-reaching").unwrap();
    let environment = Arc::new(TaskEnvironment::new(task, Preset::Paper, Reward::Shaped).unwrap());
    let mut batch = TaskBatches::new(environment, Arc::new(Faulty(2.0))).batch(2).unwrap();
    batch.reset(&[(0, Seed(1)), (1, Seed(2))]).unwrap();
    let statuses: Vec<_> = (0..3)
        .map(|_| {
            batch.step(&[0.0; 18]).unwrap();
            batch.statuses().to_vec()
        })
        .collect();
    use StepStatus::{Diverged, Running};
    assert_eq!(statuses, [[Running, Running], [Running, Running], [Running, Diverged]]);
}
