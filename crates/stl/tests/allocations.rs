//! Evaluating a trace with a used monitor does not allocate. Counting allocations requires a global allocator and
//! therefore `unsafe`; it counts and forwards every call to the system allocator. The file contains one test only, so
//! that no other test allocates at the same time.
#![allow(clippy::unwrap_used)] // clippy's setting for tests does not cover helper functions
#![allow(unsafe_code)]

use mishandle_stl::{Clock, Formula, Monitor, Trace};
use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::sync::Arc;

struct Counting;

thread_local! {
    static ALLOCATIONS: Cell<usize> = const { Cell::new(0) };
}

// SAFETY: every call is forwarded to the system allocator unchanged.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        ALLOCATIONS.set(ALLOCATIONS.get() + 1);
        // SAFETY: the caller fulfills the contract of `alloc`.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: the caller fulfills the contract of `dealloc`.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static COUNTING: Counting = Counting;

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
        monitor.subformula_minima(&trace).unwrap();
        let before = ALLOCATIONS.get();
        for samples in [301, 1, 150, 301] {
            fill(&mut trace, samples);
            monitor.robustness_signal(&trace).unwrap();
            monitor.robustness(&trace).unwrap();
            monitor.subformula_minima(&trace).unwrap();
        }
        assert_eq!(ALLOCATIONS.get() - before, 0, "{text}");
    }
    // The counter works.
    let before = ALLOCATIONS.get();
    drop(std::hint::black_box(vec![0_u8; 16]));
    assert_eq!(ALLOCATIONS.get() - before, 1);
}
