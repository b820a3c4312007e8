//! States of the tasks' experts.

use mishandle_rollout::{Environment, Sample, Seed};
use mishandle_tasks::{EPISODE_STEPS, JOINTS, Preset, Reward, Task, TaskEnvironment, compose};
use mishandle_world::Model;

/// Returns the model of a task's pictures and the states of an episode of its expert, which starts
/// at a place of the initial box (0.5 is its center).
pub fn expert_states(task: &dyn Task, place: f64) -> (Model, Vec<Vec<f64>>) {
    let environment = TaskEnvironment::new(task, Preset::Paper, Reward::Shaped).expect("the task is valid");
    let model = Model::from_xml(&compose(task).expect("the scene compiles")).expect("the scene compiles");
    let expert = task.expert().expect("the task has an expert");
    let environment = environment.with_further_parts(expert.further_parts()).expect("they are the task's");
    let mut worker = environment.worker();
    let mut controller = expert.worker();
    let mut memory = vec![0.0; expert.state_size()];
    let mut output = [0.0_f32; JOINTS];
    let mut state = vec![0.0; environment.state_size()];
    let mut observation = vec![0.0; environment.observation_size()];
    let mut signals = vec![0.0; environment.signals().len()];
    let mut rewards = vec![0.0; environment.reward_terms().len()];
    let x0 = environment.space().at(&vec![place; environment.space().dimension()]);
    let mut states = Vec::new();
    let sample = Sample { observation: &mut observation, signals: &mut signals, rewards: &mut rewards };
    worker.reset(&x0, Seed(0), &mut state, sample);
    controller.reset(&mut memory, Seed(0));
    for _ in 0..EPISODE_STEPS {
        states.push(state.clone());
        controller.act(1, &observation, &mut memory, &mut output);
        let sample = Sample { observation: &mut observation, signals: &mut signals, rewards: &mut rewards };
        worker.step(&output.map(f64::from), &mut state, sample);
    }
    states.push(state);
    (model, states)
}
