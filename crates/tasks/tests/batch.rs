//! A batch of worlds gives the same episodes as the environment, whose physics it replaces.

#![allow(clippy::unwrap_used)]

use std::sync::Arc;

use mishandle_rollout::{
    Component, Environment, EpisodeEnd, Noise, Request, ScenarioBatch, Screening, Seed, Specification,
};
use mishandle_tasks::{Preset, TaskBatch, TaskTarget, tasks};
use mishandle_world::{Backend, BatchSpec, CpuBackend, WorldBatch, WorldError};

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
    fn batch(&self, spec: &BatchSpec) -> Result<Box<dyn WorldBatch>, WorldError> {
        Ok(Box::new(FaultyWorlds(CpuBackend.batch(spec)?, 0, self.0)))
    }
}

impl WorldBatch for FaultyWorlds {
    fn write_states(&mut self, rows: &[usize], states: &[f64]) -> Result<(), WorldError> {
        self.0.write_states(rows, states)
    }

    fn buffers(&mut self) -> mishandle_world::BatchBuffers<'_> {
        self.0.buffers()
    }

    fn step(&mut self) -> Result<(), WorldError> {
        self.0.step()?;
        self.1 += 1;
        if self.1 == 3 && self.2 > 2.0 {
            return Err(WorldError::Backend("the device is lost".into()));
        }
        let outputs = self.0.buffers().outputs;
        let end = outputs.len() - 1;
        if self.1 == 3 {
            outputs[end] = self.2;
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
