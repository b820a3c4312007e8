//! Time of tasks as target files, relative to the built-in tasks, in one run.
//!
//! `cargo bench --bench robot_files`

#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "a measurement")]

#[path = "../tests/tasks_as_files/mod.rs"]
mod both;

use std::time::Instant;

const ROUNDS: usize = 6;

fn main() {
    for task in ["point-reaching", "ball-balancing"] {
        let targets = both::targets(task);
        let mut best = [f64::INFINITY; 2];
        for _ in 0..ROUNDS {
            for (target, best) in targets.iter().zip(&mut best) {
                let start = Instant::now();
                both::simulate(target, 64);
                *best = best.min(start.elapsed().as_secs_f64());
            }
        }
        let [built_in, file] = best;
        println!("{task}: built in {built_in:.3} s, as a file {file:.3} s, ratio {:.3}", file / built_in);
    }
}
