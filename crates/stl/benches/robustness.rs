//! Time to compute the robustness signal of the tasks' specifications and of nested formulas,
//! compared with RTAMT.
//!
//! RTAMT runs in the virtual environment that `cargo xtask golden rtamt` creates, or in the Python
//! interpreter in `MISHANDLE_PYTHON`. Without either, only our own times are printed. Times are the
//! minimum of several runs, without parsing.
#![allow(clippy::print_stdout)]

use mishandle_stl::{Clock, Formula, Monitor, Trace};
use std::io::Write;
use std::process::{Command, Stdio};
use std::sync::Arc;
use std::time::{Duration, Instant};

const FORMULAS: [(&str, &str); 14] = [
    ("completion", "always[0:4](a <= 0.1)"),
    ("bar", "always[0:30](a <= 0.3)"),
    ("point reaching", "always[50:300](a <= 0.12)"),
    ("cube stacking", "eventually[0:300](a <= 0.024 and b > 0)"),
    ("peg in hole", "always[250:300](a <= 0.12)"),
    ("ball balancing", "always[50:200](a <= 0.25)"),
    ("ball catching", "always[50:300](a <= 0.1)"),
    ("ball pushing", "eventually[0:300](a <= 0.3)"),
    ("door opening", "eventually[0:300](b >= 20)"),
    ("cloth placing", "eventually[0:300](a <= 0.25)"),
    (
        "strict stacking",
        "eventually[0:270](always[0:30](a <= 0.024 and b >= 0.045 and b <= 0.055 and c <= 0.05))",
    ),
    ("nested", "always[0:100](eventually[0:50](a <= 0.1))"),
    ("nested until", "always[0:100]((a > 0) until[0:50] (b > 0))"),
    ("nested past", "always[0:100](a > 0 -> once[0:50]((b > 0) since[10:20] (c > 0)))"),
];

const SAMPLES: [usize; 4] = [300, 3_000, 30_000, 300_000];

/// RTAMT is skipped if it is expected to take longer than this, given its time on the next shorter
/// trace.
const RTAMT_LIMIT_SECS: f64 = 20.0;

/// Reads formula, samples and repetitions from each line; prints the minimum time in seconds.
const RTAMT: &str = r#"
import json, logging, sys, time
logging.disable(logging.WARNING)
import rtamt
for line in sys.stdin:
    text, columns, repetitions = json.loads(line)
    least = float("inf")
    for _ in range(repetitions):
        spec = rtamt.StlDiscreteTimeOfflineSpecification()
        for name in columns:
            spec.declare_var(name, "float")
        spec.spec = text
        spec.parse()
        dataset = {name: list(values) for name, values in columns.items()}
        dataset["time"] = list(range(len(columns["a"])))
        begin = time.perf_counter()
        spec.evaluate(dataset)
        least = min(least, time.perf_counter() - begin)
    print(least, flush=True)
"#;

/// Returns noisy waves within [-1, 1], the same on every run.
fn trace(samples: usize) -> Trace {
    let names: Arc<[String]> = ["a", "b", "c"].map(String::from).into();
    let mut trace = Trace::with_capacity(names, samples);
    let mut state = 1_u64;
    let mut noise = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 40) as f64 / (1_u64 << 25) as f64 - 0.25
    };
    for step in 0..samples {
        let wave = |period: f64| 0.7 * (step as f64 / period).sin();
        trace.push(&[wave(40.0) + noise(), wave(70.0) + noise(), wave(110.0) + noise()]);
    }
    trace
}

/// Returns the minimum time of one evaluation in seconds.
fn ours(formula: &str, trace: &Trace) -> f64 {
    let formula = Formula::parse(formula).expect("the formulas above are formulas");
    let mut monitor = Monitor::new(&formula, trace.names(), Clock::steps(1.0)).expect("of these signals");
    let mut measure = |times: usize| {
        let begin = Instant::now();
        for _ in 0..times {
            std::hint::black_box(monitor.robustness_signal(std::hint::black_box(trace)))
                .expect("finite samples");
        }
        begin.elapsed()
    };
    measure(2);
    let mut times = 1;
    while measure(times) < Duration::from_millis(2) {
        times *= 2;
    }
    (0..10).map(|_| measure(times).as_secs_f64() / times as f64).fold(f64::INFINITY, f64::min)
}

/// Returns RTAMT's minimum time in seconds with this Python interpreter; `None` if it does not run.
fn rtamt(python: &str, formula: &str, trace: &Trace, repetitions: usize) -> Option<f64> {
    let column = |(i, name): (usize, &String)| (name.clone(), trace.column(i).into());
    let columns: serde_json::Map<_, _> = trace.names().iter().enumerate().map(column).collect();
    let request = serde_json::json!([formula, columns, repetitions]).to_string();
    let mut child =
        Command::new(python).args(["-c", RTAMT]).stdin(Stdio::piped()).stdout(Stdio::piped()).spawn().ok()?;
    child.stdin.take()?.write_all(request.as_bytes()).ok()?;
    let answer = child.wait_with_output().ok()?;
    String::from_utf8(answer.stdout).ok()?.trim().parse().ok()
}

/// Returns a Python interpreter with RTAMT.
fn python() -> Option<String> {
    let created = concat!(env!("CARGO_MANIFEST_DIR"), "/../../target/golden-venv/stl-rtamt/bin/python");
    let found = || std::path::Path::new(created).exists().then(|| created.to_string());
    std::env::var("MISHANDLE_PYTHON").ok().or_else(found)
}

fn main() {
    // `cargo test --benches` only checks that the benchmark runs.
    let is_test = !std::env::args().any(|argument| argument == "--bench");
    let python = python().filter(|_| !is_test);
    if python.is_none() {
        println!("RTAMT is skipped; create its environment with `cargo xtask golden rtamt`\n");
    }
    println!(
        "{:<16} {:>8} {:>12} {:>12} {:>12} {:>9}",
        "formula", "samples", "ours", "per sample", "RTAMT", "ratio"
    );
    for (name, formula) in FORMULAS {
        let mut expected_secs = 0.0;
        for samples in &SAMPLES[..if is_test { 1 } else { SAMPLES.len() }] {
            let trace = trace(*samples);
            let own = ours(formula, &trace);
            let theirs = match &python {
                Some(python) if expected_secs <= RTAMT_LIMIT_SECS => {
                    let repetitions = if expected_secs < 1.0 { 3 } else { 1 };
                    rtamt(python, formula, &trace, repetitions)
                }
                _ => None,
            };
            expected_secs = theirs.map_or(f64::INFINITY, |theirs| 10.0 * theirs);
            let skipped = || "skipped".to_owned();
            println!(
                "{name:<16} {samples:>8} {:>9.2} us {:>9.2} ns {:>12} {:>9}",
                own * 1e6,
                own * 1e9 / *samples as f64,
                theirs.map_or_else(skipped, |theirs| format!("{:.2} ms", theirs * 1e3)),
                theirs.map_or_else(skipped, |theirs| format!("{:.0}", theirs / own)),
            );
        }
        println!("{:<16} {formula}", "");
    }
}
