//! Evaluating a trace with a used monitor does not allocate, and monitors take as much memory as
//! documented.
#![allow(clippy::unwrap_used)] // clippy's setting for tests does not cover helper functions

mod allocation_counter;

use allocation_counter::{ALLOCATIONS, LIVE, PEAK};
use mishandle_stl::{Clock, Formula, Monitor, OnlineMonitor, Trace};
use std::sync::Arc;

fn fill(trace: &mut Trace, samples: usize) {
    trace.clear();
    for step in 0..samples {
        let angle = step as f64 * 0.1;
        trace.push(&[angle.sin(), angle.cos()]);
    }
}

#[test]
fn a_used_monitor_does_not_allocate() {
    let formulas = [
        "always[0:30](a <= 0.3)",
        "always[0:200](eventually[3:90](a <= b))",
        "(a > 0) until[5:50] (b > 0) and a since[2:9] b or once b release historically[0:3] a",
        "a unless[1:99] b iff abs(a) * 2 - b / 3 xor rise(a) -> next fall(b)",
        "a",
        "always true",
    ];
    let names: Arc<[String]> = ["a", "b"].map(String::from).into();
    let mut trace = Trace::with_capacity(Arc::clone(&names), 301);
    for text in formulas {
        let mut monitor = Monitor::new(&Formula::parse(text).unwrap(), &names, Clock::steps(1.0)).unwrap();
        fill(&mut trace, 301);
        monitor.robustness_signal(&trace).unwrap();
        let before = ALLOCATIONS.get();
        for samples in [301, 1, 150, 301] {
            fill(&mut trace, samples);
            monitor.robustness_signal(&trace).unwrap();
            monitor.robustness(&trace).unwrap();
        }
        assert_eq!(ALLOCATIONS.get() - before, 0, "{text}");
    }
    // The counter works.
    let before = ALLOCATIONS.get();
    drop(std::hint::black_box(vec![0_u8; 16]));
    assert_eq!(ALLOCATIONS.get() - before, 1);
}

fn online(text: &str, samples: Option<usize>) -> OnlineMonitor {
    let names = ["a", "b", "c"].map(String::from);
    let formula = Formula::parse(text).unwrap();
    OnlineMonitor::new(&[formula], &names, Clock::steps(1.0), samples).unwrap()
}

/// Pushes samples and asks every question after each; returns the number of allocations.
fn allocations(monitor: &mut OnlineMonitor, samples: usize, every: usize) -> usize {
    let before = ALLOCATIONS.get();
    for step in 0..samples {
        let angle = step as f64 * 0.1;
        monitor.push(&[angle.sin(), angle.cos(), (angle * 0.1).sin()]).unwrap();
        monitor.decided(0);
        if step % every == 0 {
            std::hint::black_box(monitor.bounds(0));
        }
    }
    ALLOCATIONS.get() - before
}

#[test]
fn an_online_monitor_does_not_allocate_after_new() {
    let formulas = [
        // Those of the tasks.
        "always[50:300](a <= 0.12)",
        "eventually[0:300](a <= 0.024 and b > 0)",
        "eventually[0:270](always[0:30](a <= 0.024 and b >= 0.045 and b <= 0.055 and c <= 0.05))",
        "always[0:299](a > 0.5 and next(a <= 0.5) implies b <= 0.1)",
        "always[50:300](a <= 0.2 and b > 0) and always[200:300](a <= 0.1)",
        // Nested windows.
        "always[0:250](a > 0.5 implies eventually[0:50](b > 0))",
        "always[0:20](eventually[3:30](always[1:40](a <= b)))",
        "always[0:200]((a > -2) until[5:50] (b > 0))",
        "((a > 0) unless[2:30] (b > 0)) release[1:60] (eventually[0:9](c > 0) iff once[2:7](b > 0))",
        "always[0:300](a > 0 implies once[0:50](eventually[4:8](b > 0)))",
        "eventually[2:90](historically[3:70]((b > 0) since[10:20] (next(c > 0))))",
        "always[3:9](rise(eventually[0:5](a > 0)) xor fall(s_prev(b > 0)))",
        // Without an end.
        "always(a <= 0.9) and eventually(b > 0.5)",
        "(a > -2) until (b > 0.99)",
        "always(once(a > 0) or b > 0)",
        "always(a > 0.5 implies eventually[0:50](b > 0))",
        "always[0:80]((b > 0) since[7:inf] (c > 0))",
    ];
    for text in formulas {
        for stated in [None, Some(400)] {
            let mut monitor = online(text, stated);
            assert_eq!(allocations(&mut monitor, 1000, 1), 0, "{text} of {stated:?}");
            let before = ALLOCATIONS.get();
            monitor.reset();
            assert_eq!(ALLOCATIONS.get() - before, 0, "{text}");
            assert_eq!(allocations(&mut monitor, 1000, 1), 0, "{text} of {stated:?} after a reset");
        }
    }
}

#[test]
fn an_online_monitor_of_65536_samples_does_not_allocate_after_new() {
    for text in [
        "always[0:65536](a <= 0.12)",
        "(a > -2) until[1:65536] (b > 2)",
        "always[0:32768](eventually[0:32768](a > 0) or b > 0)",
        "always[0:30000]((a > -2) until[5:35000] (b > 0))",
        "eventually[0:30000](historically[3:35000](eventually[0:500](c > 0)))",
    ] {
        assert_eq!(allocations(&mut online(text, None), 70_000, 4_999), 0, "{text}");
    }
}

/// A window that no trace fills takes memory for the samples pushed only.
#[test]
fn a_window_of_2_to_the_43_samples_allocates_nothing_in_new() {
    for text in [
        "always[0:{}](a <= 0.12)",
        "(a > -2) until[1:{}] (b > 2)",
        "(a > -2) since[1:{}] (b > 2)",
        "once[{}:{}](a > 0)",
        "always[0:9](eventually[0:{}](a > 0))",
        "always[0:{}](b > 0 implies (a > 0) unless[3:{}] (b > 0))",
    ] {
        let peak = |bound: &str| {
            let before = LIVE.get();
            PEAK.set(before);
            drop(online(&text.replace("{}", bound), None));
            PEAK.get() - before
        };
        let huge = peak("8796093022208");
        let short = peak("100");
        assert!(huge < short + 50_000, "{text}: {huge} bytes, {short} with a short window");
        let mut monitor = online(&text.replace("{}", "8796093022208"), None);
        assert!(allocations(&mut monitor, 300, 7) > 0, "{text} grows with the samples");
    }
}

/// Number of samples of the tests of memory: a power of two, so that vectors that double have no
/// spare capacity.
const SAMPLES: usize = 1 << 17;

/// Memory that does not depend on the number of samples, bytes: the formula and buffers for tiles.
const FIXED: f64 = 400e3;

/// Returns the peak memory of `evaluate`, in numbers of 8 bytes per sample.
fn numbers_per_sample(evaluate: impl FnOnce()) -> f64 {
    let before = LIVE.get();
    PEAK.set(before);
    evaluate();
    ((PEAK.get() - before) as f64 - FIXED) / (8 * SAMPLES) as f64
}

#[test]
fn a_monitor_takes_at_most_67_numbers_per_sample() {
    let names: Arc<[String]> = ["a", "b"].map(String::from).into();
    let mut trace = Trace::with_capacity(Arc::clone(&names), SAMPLES);
    fill(&mut trace, SAMPLES);
    // 64 operands wait for the last one, which needs most scratch values.
    let deepest = format!("(a unless[65535:131070] {}{}", "(once a unless[65535:131070] ".repeat(62), "b");
    let text = format!("{deepest}{}", ")".repeat(63));
    let found = numbers_per_sample(|| {
        let formula = Formula::parse(&text).unwrap();
        let mut monitor = Monitor::new(&formula, &names, Clock::steps(1.0)).unwrap();
        assert_eq!(monitor.robustness_signal(&trace).unwrap().len(), SAMPLES);
    });
    assert!(found > 60.0 && found <= 67.0, "{found} numbers per sample");
}

/// A chunk has 65,536 samples, of which few operands and a result are kept at a time.
#[test]
fn a_diagnosis_takes_memory_for_windows_inside_windows_only() {
    let names: Arc<[String]> = ["a", "b"].map(String::from).into();
    let peak = |text: &str, samples: usize| {
        let mut trace = Trace::with_capacity(Arc::clone(&names), samples);
        fill(&mut trace, samples);
        let formula = Formula::parse(text).unwrap();
        let before = LIVE.get();
        PEAK.set(before);
        formula.diagnose(&trace, &Clock::steps(1.0)).unwrap();
        PEAK.get() - before
    };
    for text in [
        "always(a <= 1 and b <= 1)",
        "always[0:1e9](a <= 1 and b <= 1)",
        "(a <= 2) until (b >= 2)",
        "always(a <= 0.3 implies eventually[0:20](b >= 0.1))",
        "eventually(always[3:30](a <= 0.1)) and not ((a <= 2) unless (once[0:9](b >= 2)))",
    ] {
        let short = peak(text, 200_000);
        let long = peak(text, 2_000_000);
        assert!(short < 4_000_000 && long < short + 100_000, "{text}: {short} bytes, then {long}");
    }
    // The suffixes of all samples.
    let all = "always(a <= 0.3 implies eventually(b >= 0.1))";
    assert!(peak(all, 2_000_000) > 16_000_000);
}
