//! Measures the overhead of a falsification per simulation, for every search, on a system in closed
//! form.
//!
//! `cargo bench -p mishandle-falsification [-- SIMULATIONS]` runs a million simulations by default.
//! The memory column is the peak of the process so far.
#![allow(clippy::print_stdout, reason = "a benchmark prints")]

use std::error::Error;
use std::ops::ControlFlow;
use std::time::Instant;

use mishandle_falsification::{Falsification, FalsificationError, FalsificationSettings};
use mishandle_rollout::{Axis, DEFAULT_BATCH_SIZE, Request, Seed, Space, System};
use mishandle_search::{Coordinate, SEARCHES, SearchOptions, SearchSpace};
use mishandle_toys::{FunctionSystem, SimulatedEnd};

const AXES: usize = 6;
const BUDGET: u32 = 300;

fn main() -> Result<(), Box<dyn Error>> {
    let argument = std::env::args().find_map(|word| word.parse().ok());
    let simulations: u32 = argument.unwrap_or(1_000_000);
    let axis = |i: usize| Axis::start(&format!("x{i}"), "m", -1.0, 1.0);
    let space = Space::new("starts", (0..AXES).map(axis).collect())?;
    let system = || {
        FunctionSystem::new(space.clone(), |request| {
            SimulatedEnd::Robustness(
                0.01 + request.scenario.values().iter().flatten().map(|x| x * x).sum::<f64>(),
            )
        })
    };

    let bare = bare(&mut system(), simulations)?;
    println!("{:<16} {:>11} {:>14} {:>12}", "", "simulations", "us/simulation", "peak MiB");
    println!("{:<16} {simulations:>11} {bare:>14.3} {:>12}", "system alone", peak_memory());
    for search in SEARCHES {
        let settings = FalsificationSettings {
            trials: simulations / BUDGET,
            budget: BUDGET,
            ..FalsificationSettings::default()
        };
        let make = |seed| {
            (search.make)(
                &SearchSpace::from(&[Coordinate::Continuous; AXES]),
                seed,
                &SearchOptions::default(),
            )
        };
        let mut falsification = Falsification::new(settings, &space, make)?;
        let start = Instant::now();
        let outcome =
            falsification.run(&mut system(), |_| Ok::<_, FalsificationError>(ControlFlow::Continue(())))?;
        let each = 1e6 * start.elapsed().as_secs_f64() / outcome.simulations as f64;
        println!("{:<16} {:>11} {each:>14.3} {:>12}", search.name, outcome.simulations, peak_memory());
    }
    Ok(())
}

/// Returns the time of a simulation without a search, µs.
fn bare(system: &mut FunctionSystem, simulations: u32) -> Result<f64, Box<dyn Error>> {
    let batch: Vec<Request> =
        (0..DEFAULT_BATCH_SIZE as u64).map(|i| Request::new([0.1; AXES], Seed(i))).collect();
    let start = Instant::now();
    for _ in 0..simulations as usize / batch.len() {
        std::hint::black_box(system.rollout(&batch)?);
    }
    Ok(1e6 * start.elapsed().as_secs_f64() / f64::from(simulations))
}

/// Returns the peak memory of the process in MiB, or `unknown` if the operating system does not
/// report it.
fn peak_memory() -> String {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
    let kib = line.and_then(|line| line.split_whitespace().next()?.parse::<f64>().ok());
    kib.map_or("unknown".to_string(), |kib| format!("{:.1}", kib / 1024.0))
}
