//! Helpers that run small training runs.

use std::path::Path;
use std::process::{Child, Stdio};
use std::time::{Duration, Instant};

use mishandle::train::Curve;

use crate::bench::{Bench, SMALL};

/// Training with the settings in `ppo.toml`; with `ENDLESS`, tests stop the run.
pub const TRAIN: &str = "train point-reaching --settings ppo.toml --seed 7 --threads 1";
pub const ENDLESS: &str = "--steps 100000000";

pub fn bench() -> Bench {
    let bench = Bench::new();
    bench.write("ppo.toml", SMALL);
    bench
}

pub fn start(bench: &Bench, arguments: &str) -> Child {
    bench.command(arguments).stderr(Stdio::piped()).stdout(Stdio::piped()).spawn().unwrap()
}

#[track_caller]
pub fn wait_until(what: &str, condition: impl Fn() -> bool) {
    let start = Instant::now();
    while !condition() {
        assert!(start.elapsed() < Duration::from_secs(600), "not within ten minutes: {what}");
        std::thread::sleep(Duration::from_millis(5));
    }
}

pub fn curve(bench: &Bench, name: &str) -> Curve {
    Curve::load(&bench.path(name)).unwrap()
}

pub fn count_lines(path: &Path) -> usize {
    std::fs::read_to_string(path).map_or(0, |text| text.lines().count())
}
