//! Time to compute the robustness in dense time, compared with RTAMT's dense-time offline monitor
//! in the Python interpreter in `MISHANDLE_PYTHON`; without it, only our own times are printed.
//! Times are the minimum of three runs, or of one run of RTAMT, without parsing.
#![allow(clippy::print_stdout)]

use mishandle_stl::{DenseMonitor, DenseSignal, Formula, Interpolation, TimeUnit};
use std::process::Command;
use std::time::Instant;

const FORMULAS: [&str; 5] = [
    "always[0:10](x <= 0.9)",
    "eventually[1:500](x >= 0.95)",
    "(x >= -0.5) until[0:10] (x >= 0.9)",
    "(x >= -0.9) since (x >= 0.9)",
    "always[0:20](eventually[0:5](x >= 0.5) or x <= -0.5)",
];

/// Prints the time of RTAMT for a formula and values that hold, 0.1 s apart.
const RTAMT: &str = r#"
import logging, sys, time
logging.disable(logging.WARNING)
import rtamt
spec = rtamt.StlDenseTimeOfflineSpecification()
spec.declare_var("x", "float")
spec.spec = sys.argv[1]
spec.parse()
samples = [[i / 10, float(value)] for i, value in enumerate(open(sys.argv[2]).read().split())]
begin = time.perf_counter()
result = spec.evaluate(["x", samples])
print(time.perf_counter() - begin, result[0][1])
"#;

/// RTAMT is not run with more samples; it takes quadratic time.
const RTAMT_SAMPLES: usize = 30_000;

fn values(n: usize) -> Vec<f64> {
    let mut state = 1_u64;
    let mut next = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        ((state >> 33) % 2001) as f64 / 1000.0 - 1.0
    };
    (0..n).map(|_| next()).collect()
}

/// Returns the time and the first value of RTAMT.
fn rtamt(text: &str, values: &[f64]) -> Option<(f64, f64)> {
    let python = std::env::var_os("MISHANDLE_PYTHON")?;
    let path = std::env::temp_dir().join(format!("mishandle-dense-{}", std::process::id()));
    std::fs::write(&path, values.iter().map(f64::to_string).collect::<Vec<_>>().join(" ")).ok()?;
    let output = Command::new(python).args(["-c", RTAMT, text]).arg(&path).output().ok()?;
    let _ = std::fs::remove_file(&path);
    let text = String::from_utf8(output.stdout).ok()?;
    let mut numbers = text.split_whitespace().map(str::parse);
    Some((numbers.next()?.ok()?, numbers.next()?.ok()?))
}

fn main() {
    println!("{:<55} {:>9} {:>12} {:>12} {:>12}", "formula", "samples", "hold", "linear", "RTAMT");
    for text in FORMULAS {
        for n in [1_000, 10_000, 30_000, 100_000, 1_000_000] {
            let values = values(n);
            let times: Vec<f64> = (0..n).map(|i| i as f64 / 10.0).collect();
            let formula = Formula::parse(text).expect("a formula of this file");
            let monitor = DenseMonitor::new(&formula, &["x".to_owned()], Some(TimeUnit::Seconds));
            let monitor = monitor.expect("a formula of this file");
            let measure = |interpolation| {
                let signal = DenseSignal::new("x", times.clone(), values.clone(), interpolation);
                let signals = [signal.expect("increasing times")];
                let run = |_| {
                    let begin = Instant::now();
                    let first = monitor.robustness_signal(&signals).expect("a value").first();
                    (begin.elapsed().as_secs_f64(), first)
                };
                (0..3).map(run).min_by(|a, b| a.0.total_cmp(&b.0)).expect("three runs")
            };
            let (hold, first) = measure(Interpolation::Hold);
            let (linear, _) = measure(Interpolation::Linear);
            let in_ms = |secs: f64| format!("{:.3} ms", 1e3 * secs);
            let found = (n <= RTAMT_SAMPLES).then(|| rtamt(text, &values)).flatten();
            if let Some((_, value)) = found {
                assert_eq!(first, Some(value), "{text}");
            }
            let ratio = found.map(|(secs, _)| format!("{} ({:.0} times hold)", in_ms(secs), secs / hold));
            let rtamt = ratio.unwrap_or_default();
            println!("{text:<55} {n:>9} {:>12} {:>12} {rtamt:>12}", in_ms(hold), in_ms(linear));
        }
    }
}
