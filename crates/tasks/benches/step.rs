//! Measures the time of a control step and of its `mj_step` calls alone.
//!
//! `cargo bench -p mishandle-tasks --bench step` measures all tasks, `-- point-reaching` the named
//! ones.
//!
//! The actions come from the expert. They are recorded first, so that the time of the expert does
//! not count; a separate column shows it. Times are the minimum of many repetitions of an episode
//! on one thread. The ratios come from interleaved runs and are more reliable than the times.

#![allow(clippy::print_stdout)]

use std::hint::black_box;
use std::time::{Duration, Instant};

use mishandle_rollout::{Environment, EnvironmentWorker, Sample, Seed, SpecificationMonitor};
use mishandle_stl::{Formula, Trace};
use mishandle_tasks::{EPISODE_STEPS, JOINTS, Panda, Preset, Reward, TASKS, Task, TaskEnvironment};

const REPETITIONS: usize = 30;

fn main() {
    println!(
        "{:<20} {:>10} {:>10} {:>7} {:>8} {:>8} {:>12} {:>11}",
        "task", "step", "bare", "ratio", "physics", "manner", "steps/s/core", "expert"
    );
    let names: Vec<String> = std::env::args().skip(1).filter(|word| !word.starts_with('-')).collect();
    let is_selected =
        |task: &&&dyn Task| names.is_empty() || names.iter().any(|n| n == task.definition().name);
    for task in TASKS.iter().filter(is_selected) {
        let mut episode = Episode::record(*task, false);
        let mut with_manner = Episode::record(*task, true);
        let mut whole = Duration::MAX;
        let mut bare = Duration::MAX;
        let mut manner = Duration::MAX;
        for _ in 0..REPETITIONS {
            whole = whole.min(time(|| episode.whole()));
            manner = manner.min(time(|| with_manner.whole()));
            bare = bare.min(time(|| episode.bare()));
        }
        let step = whole.as_secs_f64() / EPISODE_STEPS as f64;
        println!(
            "{:<20} {:>7.2} us {:>7.2} us {:>7.3} {:>6.1} % {:>+6.1} % {:>12.0} {:>8.2} us",
            task.definition().name,
            1e6 * step,
            1e6 * bare.as_secs_f64() / EPISODE_STEPS as f64,
            whole.as_secs_f64() / bare.as_secs_f64(),
            100.0 * bare.as_secs_f64() / whole.as_secs_f64(),
            100.0 * (manner.as_secs_f64() / whole.as_secs_f64() - 1.0),
            1.0 / step,
            1e6 * episode.expert.as_secs_f64() / EPISODE_STEPS as f64,
        );
    }
    println!(
        "\nstep: physics, observation, reward, signals, and the four formulas at the end of the episode\n\
         bare: the same mj_step calls with the same controls alone; physics: fraction of the step\n\
         manner: what the signals of the manner and the formula `careful` add to the step"
    );
}

fn time(run: impl FnOnce()) -> Duration {
    let start = Instant::now();
    run();
    start.elapsed()
}

/// A recorded episode of a task's expert for repeated runs.
struct Episode {
    environment: TaskEnvironment,
    worker: Box<dyn EnvironmentWorker>,
    monitor: SpecificationMonitor,
    trace: Trace,
    start: Vec<f64>,
    state: Vec<f64>,
    actions: Vec<[f64; JOINTS]>,
    /// Joint targets of every control step, and whether the hand still holds the object.
    targets: Vec<([f64; JOINTS], bool)>,
    controls: Vec<([f64; JOINTS], bool)>,
    world: mishandle_world::World,
    observation: Vec<f32>,
    signals: Vec<f64>,
    rewards: Vec<f64>,
    expert: Duration,
}

impl Episode {
    /// Records an episode, with the signals of the manner and the formula `careful` or without
    /// them.
    fn record(task: &dyn Task, with_manner: bool) -> Episode {
        let mut environment =
            TaskEnvironment::new(task, Preset::Paper, Reward::Shaped).expect("the task is valid");
        let expert = task.expert().expect("the task has an expert");
        environment = environment.with_further_parts(expert.further_parts()).expect("they are the task's");
        let formulas = task.definition().paper;
        let mut specification = formulas.specification().expect("the formulas parse");
        if with_manner {
            environment = environment.with_manner();
            specification.careful =
                formulas.careful().map(|text| Formula::parse(&text).expect("the formula parses"));
        }
        let monitor =
            SpecificationMonitor::new(&specification, environment.signals(), environment.control_dt());
        let mut episode = Episode {
            worker: environment.worker(),
            monitor: monitor.expect("the formulas fit the signals"),
            trace: Trace::with_capacity(environment.signals().clone(), EPISODE_STEPS + 1),
            start: vec![0.0; environment.state_size()],
            state: vec![0.0; environment.state_size()],
            actions: Vec::new(),
            targets: Vec::new(),
            controls: Vec::new(),
            world: environment.model().world(),
            observation: vec![0.0; environment.observation_size()],
            signals: vec![0.0; environment.signals().len()],
            rewards: vec![0.0; environment.reward_terms().len()],
            expert: Duration::ZERO,
            environment,
        };
        episode.record_actions(task);
        episode.record_controls();
        episode
    }

    fn record_actions(&mut self, task: &dyn Task) {
        let expert = task.expert().expect("the task has an expert");
        let mut controller = expert.worker();
        let mut memory = vec![0.0; expert.state_size()];
        let mut output = [0.0_f32; JOINTS];
        let x0 = self.environment.space().at(&vec![0.4; self.environment.space().dimension()]);
        let sample = Sample {
            observation: &mut self.observation,
            signals: &mut self.signals,
            rewards: &mut self.rewards,
        };
        self.worker.reset(&x0, Seed(0), &mut self.start, sample);
        self.state.copy_from_slice(&self.start);
        controller.reset(&mut memory, Seed(0));
        for _ in 0..EPISODE_STEPS {
            let start = Instant::now();
            controller.act(1, &self.observation, &mut memory, &mut output);
            self.expert += start.elapsed();
            let action = output.map(f64::from);
            self.actions.push(action);
            let sample = Sample {
                observation: &mut self.observation,
                signals: &mut self.signals,
                rewards: &mut self.rewards,
            };
            self.worker.step(&action, &mut self.state, sample);
            self.world.set_state(&self.state);
            let holds = self.world.rows().active.iter().all(|on| *on);
            let mut targets = [0.0; JOINTS];
            targets.copy_from_slice(&self.state[self.environment.model().state_size()..][..JOINTS]);
            self.targets.push((targets, holds));
        }
    }

    /// Records the controls of every physics step.
    fn record_controls(&mut self) {
        let model = self.environment.model();
        let panda = Panda::new(model).expect("the robot is in the model");
        let physics = &self.start[..model.state_size()];
        self.world.set_state(physics);
        for (targets, holds) in &self.targets {
            if !holds {
                self.world.switch_all(false);
            }
            for _ in 0..self.environment.definition().n_substeps {
                panda.step(targets, &mut self.world);
                let mut controls = [0.0; JOINTS];
                controls.copy_from_slice(self.world.ctrl());
                self.controls.push((controls, *holds));
            }
        }
        // The comparison is valid only if both runs end in the same state.
        let mut end = vec![0.0; physics.len()];
        self.world.read_state(&mut end);
        assert_eq!(end, self.state[..physics.len()]);
    }

    fn whole(&mut self) {
        self.state.copy_from_slice(&self.start);
        self.trace.clear();
        self.trace.push(&self.signals);
        for action in &self.actions {
            let sample = Sample {
                observation: &mut self.observation,
                signals: &mut self.signals,
                rewards: &mut self.rewards,
            };
            self.worker.step(action, &mut self.state, sample);
            self.trace.push(&self.signals);
        }
        black_box(self.monitor.verdict(&self.trace, self.trace.len()).expect("the trace is finite"));
    }

    fn bare(&mut self) {
        self.world.set_state(&self.start);
        for (controls, holds) in &self.controls {
            if !holds {
                self.world.switch_all(false);
            }
            self.world.ctrl_mut().copy_from_slice(controls);
            self.world.step();
        }
        black_box(self.world.qpos());
    }
}
