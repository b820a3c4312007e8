//! The functions as a program in C calls them, with pointers that are null and values that are
//! wrong.
#![allow(unsafe_code)]

use std::ffi::{CStr, CString, c_char};
use std::ptr::{null, null_mut};

use mishandle_monitor::{
    MishandleMonitor, MishandleStatus, MishandleVerdict, mishandle_last_error, mishandle_monitor_bounds,
    mishandle_monitor_create, mishandle_monitor_decided, mishandle_monitor_destroy, mishandle_monitor_push,
    mishandle_monitor_reset, mishandle_monitor_verdict,
};

/// A monitor that is destroyed at the end of the test.
struct Owned(*mut MishandleMonitor);

impl Drop for Owned {
    fn drop(&mut self) {
        // SAFETY: from `mishandle_monitor_create` or null, and destroyed once.
        unsafe { mishandle_monitor_destroy(self.0) };
    }
}

fn last_error() -> String {
    // SAFETY: the text ends with 0, and no error follows while it is read.
    unsafe { CStr::from_ptr(mishandle_last_error()) }.to_str().expect("UTF-8").to_owned()
}

fn create(
    formulas: &[&str],
    signals: &[&str],
    period: f64,
    samples: usize,
) -> Result<Owned, (MishandleStatus, String)> {
    let texts = |of: &[&str]| -> Vec<CString> {
        of.iter().map(|text| CString::new(*text).expect("a text without 0")).collect()
    };
    let formulas = texts(formulas);
    let signals = texts(signals);
    let pointers = |of: &[CString]| -> Vec<*const c_char> { of.iter().map(|text| text.as_ptr()).collect() };
    let formulas = pointers(&formulas);
    let signals = pointers(&signals);
    let mut monitor = null_mut();
    // SAFETY: the pointers are valid for the numbers of elements.
    let status = unsafe {
        mishandle_monitor_create(
            formulas.as_ptr(),
            formulas.len(),
            signals.as_ptr(),
            signals.len(),
            period,
            samples,
            &raw mut monitor,
        )
    };
    assert_eq!(monitor.is_null(), status != MishandleStatus::Ok);
    if status == MishandleStatus::Ok { Ok(Owned(monitor)) } else { Err((status, last_error())) }
}

impl Owned {
    fn push(&self, sample: &[f64]) -> MishandleStatus {
        // SAFETY: the monitor and the slice are valid.
        unsafe { mishandle_monitor_push(self.0, sample.as_ptr(), sample.len()) }
    }

    fn bounds(&self, formula: usize) -> (f64, f64) {
        let mut low = f64::NAN;
        let mut high = f64::NAN;
        // SAFETY: all pointers are valid.
        let status = unsafe { mishandle_monitor_bounds(self.0, formula, &raw mut low, &raw mut high) };
        assert_eq!(status, MishandleStatus::Ok);
        (low, high)
    }

    fn verdict(&self, formula: usize) -> MishandleVerdict {
        let mut verdict = MishandleVerdict::Open;
        // SAFETY: all pointers are valid.
        let status = unsafe { mishandle_monitor_verdict(self.0, formula, &raw mut verdict) };
        assert_eq!(status, MishandleStatus::Ok);
        verdict
    }

    fn decided(&self, formula: usize) -> Option<(usize, f64)> {
        let mut is_decided = false;
        let mut sample = 0;
        let mut robustness = 0.0;
        // SAFETY: all pointers are valid.
        let status = unsafe {
            mishandle_monitor_decided(
                self.0,
                formula,
                &raw mut is_decided,
                &raw mut sample,
                &raw mut robustness,
            )
        };
        assert_eq!(status, MishandleStatus::Ok);
        is_decided.then_some((sample, robustness))
    }
}

const X: &[&str] = &["x"];

#[test]
fn verdicts_come_as_soon_as_they_are_certain_and_reset_forgets() {
    let monitor = create(&["always[0:9](x <= 1)", "eventually[0:1](x >= 3)"], X, 0.0, 0).expect("valid");
    for _ in 0..2 {
        assert_eq!(monitor.push(&[0.5]), MishandleStatus::Ok);
        assert_eq!(monitor.verdict(0), MishandleVerdict::Open);
        assert_eq!(monitor.decided(1), None);
        assert_eq!(monitor.push(&[4.0]), MishandleStatus::Ok);
        assert_eq!(monitor.verdict(0), MishandleVerdict::Violated);
        assert_eq!(monitor.bounds(0), (f64::NEG_INFINITY, -3.0));
        assert_eq!(monitor.verdict(1), MishandleVerdict::Satisfied);
        assert_eq!(monitor.decided(1), Some((0, 1.0)));
        // SAFETY: the monitor is valid.
        assert_eq!(unsafe { mishandle_monitor_reset(monitor.0) }, MishandleStatus::Ok);
    }
}

#[test]
fn null_is_an_error_of_each_function() {
    let monitor = create(&["x <= 1"], X, 0.0, 0).expect("valid");
    let sample = [0.0];
    let text = CString::new("x").expect("a text without 0");
    let texts = [text.as_ptr()];
    let missing = [null::<c_char>()];
    let mut created = null_mut();
    let mut number = 0.0;
    let mut verdict = MishandleVerdict::Open;
    let mut is_decided = false;
    let mut index = 0;
    // SAFETY: each pointer is null or valid.
    let statuses = unsafe {
        [
            mishandle_monitor_create(texts.as_ptr(), 1, texts.as_ptr(), 1, 0.0, 0, null_mut()),
            mishandle_monitor_create(null(), 1, texts.as_ptr(), 1, 0.0, 0, &raw mut created),
            mishandle_monitor_create(texts.as_ptr(), 1, missing.as_ptr(), 1, 0.0, 0, &raw mut created),
            mishandle_monitor_push(null_mut(), sample.as_ptr(), 1),
            mishandle_monitor_push(monitor.0, null(), 1),
            mishandle_monitor_bounds(null_mut(), 0, &raw mut number, &raw mut number),
            mishandle_monitor_bounds(monitor.0, 0, null_mut(), &raw mut number),
            mishandle_monitor_bounds(monitor.0, 0, &raw mut number, null_mut()),
            mishandle_monitor_verdict(null_mut(), 0, &raw mut verdict),
            mishandle_monitor_verdict(monitor.0, 0, null_mut()),
            mishandle_monitor_decided(null_mut(), 0, &raw mut is_decided, &raw mut index, &raw mut number),
            mishandle_monitor_decided(monitor.0, 0, null_mut(), &raw mut index, &raw mut number),
            mishandle_monitor_decided(monitor.0, 0, &raw mut is_decided, null_mut(), &raw mut number),
            mishandle_monitor_decided(monitor.0, 0, &raw mut is_decided, &raw mut index, null_mut()),
            mishandle_monitor_reset(null_mut()),
        ]
    };
    assert_eq!(statuses, [MishandleStatus::NullPointer; 15]);
    // SAFETY: null is ignored.
    unsafe { mishandle_monitor_destroy(null_mut()) };
}

#[test]
fn errors_have_texts_and_the_monitor_stays_usable() {
    let refused = |formula, signals, period| create(&[formula], signals, period, 0).err().expect("an error");
    let (status, text) = refused("always(x <", X, 0.0);
    assert_eq!(status, MishandleStatus::InvalidArgument);
    assert!(text.contains("always(x <"), "{text}");
    assert!(refused("y <= 1", X, 0.0).1.contains('y'));
    assert!(refused("always(1 <= 2)", X, 0.0).1.contains("reads no signal"));
    assert!(refused("X(x <= 1)", &["x", "X"], 0.0).1.contains("backquotes for the signal"));
    assert!(refused("always[0:1s](x <= 1)", X, 0.0).1.contains("period"));
    assert!(refused("x <= 1", X, -1.0).1.contains("-1 s"));
    assert!(refused("x <= 1", X, f64::NAN).1.contains("NaN"));

    let monitor = create(&["x <= 1"], &["x", "unread"], 0.0, 0).expect("valid");
    assert_eq!(monitor.push(&[0.0]), MishandleStatus::InvalidArgument);
    assert_eq!(last_error(), "a sample has 2 values, got 1");
    assert_eq!(monitor.push(&[f64::NAN, 0.0]), MishandleStatus::InvalidSample);
    assert!(last_error().contains("signal x is NaN"));
    assert_eq!(monitor.push(&[0.25, f64::NAN]), MishandleStatus::Ok);
    assert_eq!(monitor.bounds(0), (0.75, 0.75));
    let mut verdict = MishandleVerdict::Open;
    // SAFETY: all pointers are valid.
    let status = unsafe { mishandle_monitor_verdict(monitor.0, 1, &raw mut verdict) };
    assert_eq!(
        (status, last_error().as_str()),
        (MishandleStatus::InvalidArgument, "the monitor has 1 formulas; the index is 1")
    );
}

#[test]
fn a_long_text_is_cut_between_characters() {
    let formula = format!("{} <", "ü".repeat(2000));
    let (_, text) = create(&[formula.as_str()], X, 0.0, 0).err().expect("an error");
    assert!(text.len() < 512 && text.len() > 500, "{}", text.len());
}

#[test]
fn each_thread_has_its_own_text() {
    assert!(create(&["x <= 1"], &[], 0.0, 0).is_err());
    assert!(!last_error().is_empty());
    let other = std::thread::spawn(last_error).join().expect("no panic");
    assert_eq!(other, "");
}
