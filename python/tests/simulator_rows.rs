//! Writes the results of simulations under fixed actions, for comparison with the Python package:
//! observations, reward terms and signals after the reset and after every control step, as bytes.
//!
//! `simulator_rows TASK ROWS SEED STEPS`

use std::io::{Write, stdout};
use std::sync::Arc;

use mishandle::rollout::{CpuBatch, Environment, Seed};
use mishandle::tasks::{Preset, Reward, TaskEnvironment};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let number = |i: usize| arguments[i].parse::<usize>();
    let rows = number(1)?;
    let seed = number(2)?;
    let steps = number(3)?;
    let task = mishandle::resolve::task(&arguments[0])?;
    let environment = Arc::new(TaskEnvironment::new(task, Preset::Paper, Reward::Shaped)?);
    let size = environment.action_size();
    let mut batch = CpuBatch::new(environment.clone(), rows);
    let mut bytes = Vec::new();
    let mut write = |batch: &CpuBatch<TaskEnvironment>| {
        bytes.extend(batch.observations().iter().flat_map(|number| number.to_le_bytes()));
        bytes.extend(batch.rewards().iter().flat_map(|number| number.to_le_bytes()));
        bytes.extend(batch.signals().iter().flat_map(|number| number.to_le_bytes()));
    };
    batch.reset(|row| {
        let seed = Seed((seed + row) as u64);
        Some((environment.space().sample(seed, 0), seed))
    });
    write(&batch);
    for step in 0..steps {
        // From -1.25 to 1.25 in steps of an eighth, which is exact; the environment gets actions
        // from -1 to 1.
        let action = |i: usize| (((step * 5 + i * 7) % 21) as f64 / 8.0 - 1.25).clamp(-1.0, 1.0);
        batch.step(&(0..rows * size).map(action).collect::<Vec<f64>>());
        write(&batch);
    }
    Ok(stdout().write_all(&bytes)?)
}
