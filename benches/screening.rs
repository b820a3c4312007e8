//! Cost of the CPU's part of a screening: observations, policy, noise, signals and formulas. The
//! device takes no physics steps.
//!
//! ```text
//! cargo bench --bench screening -- TASK [ROWS] [EPISODES PER ROW] [SPACE]
//! ```

#![allow(clippy::unwrap_used, clippy::print_stdout)]

use std::time::Instant;

use mishandle::plan::EvaluatePlan;
use mishandle::rollout::{Request, Screen, Seed};
use mishandle::world::{BatchBuffers, BatchSpec, CpuDevice, WorldBatch, WorldDevice, WorldError};
use mishandle::{Plan, ResolvedPlan};

/// Keeps every world at its start.
struct Still;

struct StillWorlds(Box<dyn WorldBatch>);

impl WorldDevice for Still {
    fn engine(&self) -> &'static str {
        "no physics"
    }

    fn batch(&self, spec: &BatchSpec) -> Result<Box<dyn WorldBatch>, WorldError> {
        Ok(Box::new(StillWorlds(CpuDevice.batch(&BatchSpec { fields: Vec::new(), ..spec.clone() })?)))
    }
}

impl WorldBatch for StillWorlds {
    fn write_states(&mut self, rows: &[usize], states: &[f64]) -> Result<(), WorldError> {
        self.0.write_states(rows, states)
    }

    fn write_fields(&mut self, _rows: &[usize], _values: &[f64]) -> Result<(), WorldError> {
        Ok(())
    }

    fn read_states(&mut self, states: &mut [f64]) -> Result<(), WorldError> {
        self.0.read_states(states)
    }

    fn buffers(&mut self) -> BatchBuffers<'_> {
        self.0.buffers()
    }

    fn start_step(&mut self) -> Result<(), WorldError> {
        Ok(())
    }

    fn finish_step(&mut self) -> Result<(), WorldError> {
        Ok(())
    }
}

fn main() {
    let arguments: Vec<String> =
        std::env::args().skip(1).filter(|argument| !argument.starts_with("--")).collect();
    let number =
        |index: usize, default: usize| arguments.get(index).map_or(default, |text| text.parse().unwrap());
    let task = arguments.first().map_or("point-reaching", String::as_str);
    let rows = number(1, 4096);
    let episodes = number(2, 1);
    let evaluate = EvaluatePlan::default();
    let space = arguments.get(3).map_or("starts", String::as_str).to_string();
    let plan = Plan { action_noise: 0.1, seed: 1, space, evaluate: Some(evaluate), ..Plan::new(task, "ppo") };
    let resolved = ResolvedPlan::new(&plan).unwrap();
    let mut screening = mishandle::run::screening(&resolved, &Still, rows).unwrap();
    let requests: Vec<Request> = (0..rows * episodes)
        .map(|index| Request::new(resolved.space.sample(Seed(1), index as u64), Seed(index as u64)))
        .collect();
    let start = Instant::now();
    let outcomes = screening.run(&requests, &|_| true).unwrap();
    let seconds = start.elapsed().as_secs_f64();
    let steps = outcomes.len() * resolved.target.episode_steps;
    let threads = rayon::current_num_threads();
    println!(
        "{task}: {steps} control steps in {seconds:.2} s on {threads} threads, {:.3} µs of one thread per control step",
        1e6 * seconds * threads as f64 / steps as f64
    );
}
