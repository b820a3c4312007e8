//! Measures the time that each search spends per simulation, without the simulation.
//!
//! `cargo run --release -p mishandle-studies --example proposal_overhead [SEARCH]...`
//!
//! For rounds of 1 and 16 points and 2, 10 and 100 coordinates, it prints the median and the mean
//! over 300 evaluations of the CPU time from the last value of a round to the points of the next
//! round, divided by the points of the round. A search that proposes more points at once, such as
//! an initial design, is charged per point, too. Searches use one thread, so on an idle machine the
//! CPU time is the wall-clock time.

#![allow(clippy::print_stdout)] // the table is the purpose of the program

use std::time::Duration;

use mishandle::search::{
    Coordinate, Observation, SEARCHES, Search, SearchEntry, SearchOptions, SearchSpace, functions,
};
use rustix::time::{ClockId, clock_gettime};

const EVALUATIONS: usize = 300;

fn main() {
    let names: Vec<String> = std::env::args().skip(1).collect();
    println!("milliseconds per simulation, median (mean), {EVALUATIONS} evaluations of a sum of squares");
    println!("{:<24}{:>5}{:>22}{:>22}", "search", "d", "round of 1", "round of 16");
    for entry in
        SEARCHES.iter().filter(|entry| names.is_empty() || names.iter().any(|name| name == entry.name))
    {
        for d in [2, 10, 100] {
            let [one, sixteen] = [1, 16].map(|batch| match overhead(entry, d, batch) {
                Some((median, mean)) => format!("{median:.4} ({mean:.4})"),
                None => "-".to_owned(),
            });
            println!("{:<24}{d:>5}{one:>22}{sixteen:>22}", entry.name);
        }
    }
}

/// Returns median and mean milliseconds per simulation; `None` if the search rejects its options.
fn overhead(entry: &SearchEntry, d: usize, batch: usize) -> Option<(f64, f64)> {
    let has_rounds = (entry.options)().iter().any(|option| option.name == "round-size");
    let mut options = SearchOptions::new();
    if has_rounds {
        options.set("round-size", batch as i64);
    }
    let start = cpu_time();
    let mut search = (entry.make)(&SearchSpace::from(&vec![Coordinate::Continuous; d]), 0, &options).ok()?;
    let mut spent = cpu_time() - start;
    let mut per_simulation = Vec::with_capacity(EVALUATIONS);
    while per_simulation.len() < EVALUATIONS {
        let start = cpu_time();
        let points = search.ask_batch(batch);
        spent += cpu_time() - start;
        if points.is_empty() {
            break;
        }
        let share = spent.as_secs_f64() * 1e3 / points.len() as f64;
        per_simulation.extend(points.iter().map(|_| share));
        spent = report(&mut *search, &points);
    }
    per_simulation.sort_by(f64::total_cmp);
    let n = per_simulation.len();
    Some((*per_simulation.get(n / 2)?, per_simulation.iter().sum::<f64>() / n as f64))
}

/// Returns the CPU time of this thread.
fn cpu_time() -> Duration {
    let now = clock_gettime(ClockId::ThreadCPUTime);
    Duration::new(now.tv_sec.unsigned_abs(), u32::try_from(now.tv_nsec).unwrap_or_default())
}

/// Reports the values of the points, and returns how long the search took.
fn report(search: &mut dyn Search, points: &[Vec<f64>]) -> Duration {
    let mut spent = Duration::ZERO;
    for u in points {
        let observation = Observation::from(functions::sphere(u));
        let start = cpu_time();
        let result = search.tell(u, &observation);
        spent += cpu_time() - start;
        assert!(result.is_ok(), "the search rejects a value at its own point");
    }
    spent
}
