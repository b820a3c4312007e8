//! Time per sample and operator of an online monitor, on the tasks' formulas and on nested ones,
//! and time and memory of a stream of 10^7 samples.
#![allow(clippy::print_stdout)]

use mishandle_stl::{Clock, Formula, OnlineMonitor};
use std::hint::black_box;
use std::time::Instant;

const FORMULAS: [(&str, &str); 21] = [
    ("point reaching", "always[50:300](a <= 0.12)"),
    ("point reaching, strict", "always[150:300](a <= 0.03)"),
    ("cube stacking", "eventually[0:300](a <= 0.024 and b > 0)"),
    (
        "cube stacking, strict",
        "eventually[0:270](always[0:30](a <= 0.024 and b >= 0.045 and b <= 0.055 and c <= 0.05))",
    ),
    ("cube stacking, careful", "always[0:299](a > 0.5 and next(a <= 0.5) implies b <= 0.1)"),
    ("peg in hole", "always[250:300](a <= 0.12)"),
    ("ball balancing, strict", "always[50:300](a <= 0.2 and b > 0) and always[200:300](a <= 0.1)"),
    ("ball catching, strict", "always[100:300](a <= 0.04 and b >= 0 and b <= 0.1)"),
    ("door opening", "eventually[0:300](b >= 20)"),
    ("door opening, strict", "eventually[0:270](always[0:30](b >= 45))"),
    ("completion", "always[0:4](a <= 0.1)"),
    ("response", "always[0:250](a > 0.5 implies eventually[0:50](b > 0))"),
    ("nested", "always[0:10000](eventually[0:5000](a <= 0.1))"),
    ("until", "(a > -2) until[0:300] (b > 0.9)"),
    ("nested until", "always[0:200]((a > -2) until[0:50] (b > 0))"),
    ("past", "always[0:300](a > 0 implies once[0:50](b > 0))"),
    ("since", "always[0:300]((b > 0) since[10:20] (c > 0))"),
    ("unbounded", "always(a <= 0.9)"),
    ("unbounded until", "(a > -2) until (b > 0.99)"),
    ("unbounded past", "always(once(a > 0) or b > 0)"),
    ("unbounded response", "always(a > 0.5 implies eventually[0:50](b > 0))"),
];

/// Noisy waves within [-1, 1], the same on every run.
struct Waves {
    step: usize,
    state: u64,
}

impl Waves {
    const START: Waves = Waves { step: 0, state: 1 };

    fn sample(&mut self) -> [f64; 3] {
        let mut noise = || {
            self.state =
                self.state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (self.state >> 40) as f64 / (1_u64 << 25) as f64 - 0.25
        };
        let wave = |period: f64| 0.7 * (self.step as f64 / period).sin();
        let sample = [wave(40.0) + noise(), wave(70.0) + noise(), wave(110.0) + noise()];
        self.step += 1;
        sample
    }
}

fn monitor(text: &str, samples: Option<usize>) -> OnlineMonitor {
    let formula = Formula::parse(text).expect("the formulas above are formulas");
    let names = ["a", "b", "c"].map(String::from);
    OnlineMonitor::new(&[formula], &names, Clock::steps(1.0), samples).expect("of these signals")
}

/// Returns the time of a sample in nanoseconds: the least of several runs.
fn nanoseconds(monitor: &mut OnlineMonitor, samples: &[[f64; 3]], has_bounds: bool) -> f64 {
    let mut run = || {
        monitor.reset();
        let begin = Instant::now();
        for sample in samples {
            monitor.push(black_box(sample)).expect("a finite sample");
            if has_bounds {
                black_box(monitor.bounds(0));
            } else {
                black_box(monitor.decided(0));
            }
        }
        begin.elapsed().as_secs_f64() * 1e9 / samples.len() as f64
    };
    (0..20).map(|_| run()).fold(f64::INFINITY, f64::min)
}

/// Returns the peak memory of this process in MiB.
fn peak_mib() -> f64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
    line.and_then(|line| line.split_whitespace().next()?.parse::<f64>().ok()).unwrap_or(f64::NAN) / 1024.0
}

fn main() {
    // `cargo test --benches` only checks that the benchmark runs.
    let is_test = !std::env::args().any(|argument| argument == "--bench");
    println!(
        "ns per sample, and per sample and operator: with the bounds after each sample up to the horizon, and with the \
         decided values only\n"
    );
    println!(
        "{:<24} {:>9} {:>8} {:>9} {:>9} {:>9}",
        "formula", "operators", "bounds", "each", "decided", "each"
    );
    for (name, text) in FORMULAS {
        let mut monitor = monitor(text, None);
        let (needed, is_unbounded) = monitor.needed_samples(0);
        let samples = if is_unbounded { 3000 } else { needed };
        let mut waves = Waves::START;
        let samples: Vec<[f64; 3]> = (0..samples).map(|_| waves.sample()).collect();
        let operators = monitor.operators() as f64;
        let bounds = nanoseconds(&mut monitor, &samples, true);
        let decided = nanoseconds(&mut monitor, &samples, false);
        println!(
            "{name:<24} {operators:>9} {bounds:>8.0} {:>9.0} {decided:>9.0} {:>9.0}",
            bounds / operators,
            decided / operators
        );
        println!("{:<24} {text}", "");
    }
    let length = if is_test { 1000 } else { 10_000_000 };
    println!(
        "\na stream of {length} samples with its bounds and decided values: seconds, and MiB more than before"
    );
    for text in [
        "always[50:300](a <= 0.12)",
        "always[0:100000](eventually[0:50000](a > 0.9))",
        "always(a <= 2)",
        "(a > -2) until[0:100000] (b > 0.99)",
        "always(a > 0.5 implies once[0:1000](b > 0))",
    ] {
        let before = peak_mib();
        let mut monitor = monitor(text, None);
        let mut waves = Waves::START;
        let begin = Instant::now();
        for _ in 0..length {
            monitor.push(&waves.sample()).expect("a finite sample");
            black_box((monitor.bounds(0), monitor.decided(0)));
        }
        println!("{:>8.2} {:>8.1} {text}", begin.elapsed().as_secs_f64(), peak_mib() - before);
    }
}
