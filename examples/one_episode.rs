//! Runs one episode step by step and prints the joint positions (qpos) of every control step as
//! CSV, for display in MuJoCo.
//!
//! ```text
//! cargo run --release --example one_episode -- ball-balancing ppo 0.45 0.1 > positions.csv
//! ```

#![allow(clippy::print_stdout)]

use mishandle::Plan;
use mishandle::resolve::task_target;
use mishandle::rollout::{Environment, Sample, Scenario, Seed, StepStatus};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [task, controller_name, start @ ..] = arguments.as_slice() else {
        return Err("expected a task, a controller, and a value for each axis of the initial box".into());
    };
    let x0 = start.iter().map(|value| value.parse()).collect::<Result<Vec<f64>, _>>()?;
    let target = task_target(&Plan::new(task, controller_name))?;
    let environment = target.starts();
    let scenario = Scenario::from(x0);
    environment.space().check(&scenario)?;

    // The state of a simulation is a row of numbers. `worker` steps it, and `controller` computes
    // its actions.
    let mut worker = environment.worker();
    let mut controller = target.controller().worker();
    let mut state = vec![0.0; environment.state_size()];
    let mut memory = vec![0.0; target.controller().state_size()];
    let mut observation = vec![0.0; environment.observation_size()];
    let mut signals = vec![0.0; environment.signals().len()];
    let mut rewards = vec![0.0; environment.reward_terms().len()];
    let mut action = vec![0.0_f32; environment.action_size()];

    let sample = Sample { observation: &mut observation, signals: &mut signals, rewards: &mut rewards };
    worker.reset(&scenario, Seed(0), &mut state, sample);
    controller.reset(&mut memory, Seed(0));
    let mut world = environment.model().world();
    for _ in 0..environment.episode_steps() {
        world.set_state(&state);
        let positions: Vec<String> = world.qpos().iter().map(f64::to_string).collect();
        println!("{}", positions.join(","));

        controller.act(1, &observation, &mut memory, &mut action);
        let clipped: Vec<f64> = action.iter().map(|a| f64::from(a.clamp(-1.0, 1.0))).collect();
        let sample = Sample { observation: &mut observation, signals: &mut signals, rewards: &mut rewards };
        if worker.step(&clipped, &mut state, sample) == StepStatus::Diverged {
            return Err("the simulation diverged".into());
        }
    }
    Ok(())
}
