//! Prints the control steps per second of the Rust core, for comparison with the Python package:
//! environments stepped together under zero actions, for two seconds after a first step.
//!
//! `core_throughput TASK ROWS THREADS`

use std::io::{Write, stdout};
use std::sync::Arc;
use std::time::{Duration, Instant};

use mishandle::rollout::{CpuBatch, Environment, Seed};
use mishandle::tasks::{Preset, Reward, TaskEnvironment};

const DURATION: Duration = Duration::from_secs(2);

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [task, rows, threads] = &arguments[..] else {
        return Err("expected TASK ROWS THREADS".into());
    };
    let rows: usize = rows.parse()?;
    rayon::ThreadPoolBuilder::new().num_threads(threads.parse()?).build_global()?;
    let environment =
        Arc::new(TaskEnvironment::new(mishandle::resolve::task(task)?, Preset::Paper, Reward::Shaped)?);
    let actions = vec![0.0; rows * environment.action_size()];
    let mut batch = CpuBatch::new(environment.clone(), rows);
    batch.reset(|row| {
        let seed = Seed(row as u64);
        Some((environment.space().sample(seed, 0), seed))
    });
    batch.step(&actions);
    let started = Instant::now();
    let mut steps = 0;
    while started.elapsed() < DURATION {
        batch.step(&actions);
        steps += rows;
    }
    Ok(writeln!(stdout(), "{}", steps as f64 / started.elapsed().as_secs_f64())?)
}
