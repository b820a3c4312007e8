//! A control step does not allocate memory.
#![allow(clippy::unwrap_used)]

#[path = "../../stl/tests/allocation_counter/mod.rs"]
mod allocation_counter;

use allocation_counter::ALLOCATIONS;
use mishandle_rollout::{Environment, Sample, Seed};
use mishandle_tasks::{Preset, Reward, TASKS, TaskEnvironment};

#[test]
fn a_control_step_and_its_expert_do_not_allocate() {
    for (task, with_manner) in TASKS.iter().flat_map(|task| [(task, false), (task, true)]) {
        let mut environment = TaskEnvironment::new(*task, Preset::Paper, Reward::Shaped).unwrap();
        if with_manner {
            environment = environment.with_manner();
        }
        let expert = task.expert().unwrap();
        let environment = environment.with_further_parts(expert.further_parts()).unwrap();
        let mut worker = environment.worker();
        let mut controller = expert.worker();
        let mut state = vec![0.0; environment.state_size()];
        let mut memory = vec![0.0; expert.state_size()];
        let mut observation = vec![0.0; environment.observation_size()];
        let mut signals = vec![0.0; environment.signals().len()];
        let mut rewards = vec![0.0; environment.reward_terms().len()];
        let mut output = vec![0.0; 9];
        let mut action = vec![0.0; 9];
        let x0 = environment.space().nominal();
        macro_rules! sample {
            () => {
                Sample { observation: &mut observation, signals: &mut signals, rewards: &mut rewards }
            };
        }
        worker.reset(&x0, Seed(0), &mut state, sample!());
        controller.reset(&mut memory, Seed(0));
        let before = ALLOCATIONS.get();
        for _ in 0..300 {
            controller.act(1, &observation, &mut memory, &mut output);
            action.iter_mut().zip(&output).for_each(|(action, output)| *action = f64::from(*output));
            worker.step(&action, &mut state, sample!());
        }
        assert_eq!(ALLOCATIONS.get() - before, 0, "{}", environment.name());
    }
    // The counter detects an allocation.
    let before = ALLOCATIONS.get();
    drop(std::hint::black_box(vec![1_u8; 100]));
    assert_eq!(ALLOCATIONS.get() - before, 1);
}
