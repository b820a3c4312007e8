//! Experts that take over in the middle of an episode of another controller.

use std::path::Path;
use std::sync::Arc;

use mishandle_controllers::{ControllerFile, Fitted};
use mishandle_rollout::{Controller, ControllerWorker, Environment, Noise, Request, Rollout, Seed, System};
use mishandle_tasks::{Preset, Reward, TASKS, TaskEnvironment};

/// When an expert begins.
#[derive(Clone, Copy, Debug)]
enum Begin {
    /// After this number of control steps of the student.
    After(usize),
    /// In each control step.
    Always,
    /// Never: with its first phase, which is 0.
    Never,
}

/// A student, and from some step on the expert.
struct Relay {
    student: Arc<dyn Controller>,
    expert: Arc<dyn Controller>,
    begin: Begin,
}

impl Controller for Relay {
    fn observation_size(&self) -> usize {
        self.expert.observation_size()
    }

    fn action_size(&self) -> usize {
        self.expert.action_size()
    }

    fn state_size(&self) -> usize {
        1 + self.student.state_size() + self.expert.state_size()
    }

    fn worker(&self) -> Box<dyn ControllerWorker> {
        Box::new(RelayWorker {
            student: self.student.worker(),
            expert: self.expert.worker(),
            sizes: [self.student.state_size(), self.observation_size(), self.action_size()],
            state_size: self.state_size(),
            begin: self.begin,
        })
    }
}

struct RelayWorker {
    student: Box<dyn ControllerWorker>,
    expert: Box<dyn ControllerWorker>,
    sizes: [usize; 3],
    state_size: usize,
    begin: Begin,
}

/// Numbers of an expert's state after its phase: the memory of its limiter, and seven velocities.
const LIMITED: usize = 2 + 3 * 7 + 7;

impl ControllerWorker for RelayWorker {
    fn reset(&mut self, state: &mut [f64], seed: Seed) {
        let (steps, rest) = state.split_first_mut().unwrap();
        let (student, expert) = rest.split_at_mut(self.sizes[0]);
        *steps = 0.0;
        self.student.reset(student, seed);
        match self.begin {
            Begin::Never => {
                self.expert.reset(expert, seed);
                let phase = expert.len() - LIMITED;
                expert[..phase].fill(0.0);
            }
            _ => self.expert.reset(expert, seed),
        }
    }

    fn act(&mut self, _rows: usize, observations: &[f32], states: &mut [f64], actions: &mut [f32]) {
        let [student_size, observation_size, action_size] = self.sizes;
        let rows = observations.chunks(observation_size).zip(actions.chunks_mut(action_size));
        for ((observation, action), state) in rows.zip(states.chunks_mut(self.state_size)) {
            let (steps, rest) = state.split_first_mut().unwrap();
            let (student, expert) = rest.split_at_mut(student_size);
            match self.begin {
                Begin::After(count) if *steps < count as f64 => {
                    self.student.act(1, observation, student, action);
                }
                Begin::After(_) | Begin::Never => self.expert.act(1, observation, expert, action),
                Begin::Always => {
                    self.expert.reset(expert, Seed(0));
                    self.expert.act(1, observation, expert, action);
                }
            }
            *steps += 1.0;
        }
    }
}

/// Returns the robustness from reachable starts, a sixth as many of a cloth, which `seed` draws.
/// The student is `ppo`.
fn robustness(task: &str, begin: Begin, starts: usize, seed: Seed) -> Vec<f64> {
    let task = *TASKS.iter().find(|t| t.definition().name == task).unwrap();
    let definition = task.definition();
    let expert = task.expert().unwrap();
    let parts = expert.further_parts();
    let environment = TaskEnvironment::new(task, Preset::Paper, Reward::Original).unwrap();
    let environment = environment.with_further_parts(parts).unwrap();
    let starts = if definition.name.starts_with("cloth") { starts.div_ceil(6) } else { starts };
    let requests: Vec<Request> = (0..)
        .map(|i| (environment.space().sample(seed, i), i))
        .filter(|(start, _)| task.reachable(&start.values().iter().flatten().copied().collect::<Vec<f64>>()))
        .map(|(start, i)| Request::new(start, seed.child(i)))
        .take(starts)
        .collect();
    let file = format!("../../controllers/{}/ppo.safetensors", definition.name);
    let student = Arc::new(ControllerFile::load(Path::new(&file)).unwrap().policy);
    let student = Fitted::of_layout(student, &definition.layout_with(parts), parts);
    let relay = Relay { student, expert, begin };
    let specification = definition.paper.specification().unwrap();
    let mut rollout =
        Rollout::new(Arc::new(environment), Arc::new(relay), specification, Noise::default()).unwrap();
    rollout.rollout(&requests).unwrap().iter().map(|episode| episode.verdict.robustness.unwrap()).collect()
}

/// The tasks whose experts have phases, and how many of the starts succeed at least. In some of
/// ball pushing, the student has already knocked the ball away.
const TASKS_WITH_PHASES: [&str; 5] =
    ["ball-pushing", "cloth-placing", "cube-stacking", "door-opening", "peg-in-hole"];
const SHARE: f64 = 0.9;

/// Returns the number of starts that succeed if it is too small.
fn check(task: &str, begin: Begin, seed: u64) -> Option<String> {
    let found = robustness(task, begin, 20, Seed(seed));
    let successes = found.iter().filter(|rho| **rho > 0.0).count();
    let is_enough = successes as f64 >= SHARE * found.len() as f64;
    (!is_enough).then(|| format!("{task}, {begin:?}: {successes} of {} succeed", found.len()))
}

#[test]
#[ignore = "long"]
fn an_expert_takes_over_from_another_controller() {
    let mut few = Vec::new();
    for task in TASKS_WITH_PHASES {
        for (steps, seed) in [(10, 21), (40, 22), (100, 23)] {
            few.extend(check(task, Begin::After(steps), seed));
        }
    }
    assert!(few.is_empty(), "{few:#?}");
}

/// So what it would do in a state is a function of the state, which a student can learn.
#[test]
fn an_expert_that_forgets_its_phase_at_each_step_succeeds() {
    let few: Vec<String> =
        TASKS_WITH_PHASES.iter().filter_map(|task| check(task, Begin::Always, 24)).collect();
    assert!(few.is_empty(), "{few:#?}");
}

#[test]
fn an_expert_begins_an_episode_in_its_first_phase() {
    for task in TASKS_WITH_PHASES {
        let found = |begin| robustness(task, begin, 12, Seed(21));
        assert_eq!(found(Begin::After(0)), found(Begin::Never), "{task}");
    }
}
