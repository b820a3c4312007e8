//! No function allocates after the creation of a monitor.
#![allow(unsafe_code)]

#[path = "../../stl/tests/allocation_counter/mod.rs"]
mod allocation_counter;

use std::ptr::null_mut;

use allocation_counter::ALLOCATIONS;
use mishandle_monitor::{
    MishandleStatus, MishandleVerdict, mishandle_monitor_bounds, mishandle_monitor_create,
    mishandle_monitor_decided, mishandle_monitor_destroy, mishandle_monitor_push, mishandle_monitor_reset,
    mishandle_monitor_verdict,
};

#[test]
fn nothing_is_allocated_after_the_creation() {
    let formulas = [
        c"always[0:100](x <= 1)".as_ptr(),
        c"eventually[0:300](x <= 0.5 and eventually[5:20](y > 0))".as_ptr(),
        c"always((x > 2) -> (y >= 0 until[0:40] x <= 1))".as_ptr(),
        c"historically[0:50](y >= 0) and once(x > 0)".as_ptr(),
    ];
    let signals = [c"x".as_ptr(), c"y".as_ptr()];
    let mut monitor = null_mut();
    // SAFETY: all pointers are valid, for the stated numbers of elements.
    unsafe {
        let status =
            mishandle_monitor_create(formulas.as_ptr(), 4, signals.as_ptr(), 2, 0.0, 0, &raw mut monitor);
        assert_eq!(status, MishandleStatus::Ok);
        let before = ALLOCATIONS.get();
        for round in 0..2 {
            for step in 0..2000 {
                let angle = f64::from(step) * 0.1;
                let sample = [angle.sin(), angle.cos()];
                assert_eq!(mishandle_monitor_push(monitor, sample.as_ptr(), 2), MishandleStatus::Ok);
                // Errors do not allocate either.
                let wrong = [f64::NAN, 0.0];
                assert_eq!(
                    mishandle_monitor_push(monitor, wrong.as_ptr(), 2),
                    MishandleStatus::InvalidSample
                );
                for formula in 0..4 {
                    let mut low = 0.0;
                    let mut high = 0.0;
                    let mut verdict = MishandleVerdict::Open;
                    let mut is_decided = false;
                    let mut sample = 0;
                    mishandle_monitor_bounds(monitor, formula, &raw mut low, &raw mut high);
                    mishandle_monitor_verdict(monitor, formula, &raw mut verdict);
                    mishandle_monitor_decided(
                        monitor,
                        formula,
                        &raw mut is_decided,
                        &raw mut sample,
                        &raw mut low,
                    );
                }
            }
            assert_eq!(ALLOCATIONS.get() - before, 0, "round {round}");
            mishandle_monitor_reset(monitor);
        }
        assert_eq!(ALLOCATIONS.get() - before, 0);
        mishandle_monitor_destroy(monitor);
    }
}
