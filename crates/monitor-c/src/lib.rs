//! Online monitors of signal temporal logic for programs in C and C++.
//!
//! `include/mishandle_monitor.h` is the interface, which cbindgen writes from this file; the
//! comments of the functions are those of the header. No panic leaves a function, and a null
//! pointer is an error. `unsafe` code reads and writes what pointers of the caller name, and
//! nothing else.
#![allow(unsafe_code)]

mod message;

use std::ffi::{CStr, c_char};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::{ptr, slice};

use mishandle_stl::{Clock, Formula, OnlineMonitor};

use message::{fail, last_message};

/// Result of a function.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MishandleStatus {
    /// No error.
    Ok = 0,
    /// A pointer is null.
    NullPointer = 1,
    /// A formula, name, period, index or number of values is invalid.
    InvalidArgument = 2,
    /// A value is NaN or infinite, in a signal that a formula reads, or arithmetic of a formula has
    /// no value. The sample does not count, and another can take its place. If the arithmetic is on
    /// values of temporal operators, the monitor needs a reset.
    InvalidSample = 3,
    /// A defect of the library. The monitor can only be destroyed.
    Panic = 4,
}

/// Verdict on a formula at the first sample.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MishandleVerdict {
    /// It depends on the samples that follow.
    Open = 0,
    /// Satisfied, whatever follows.
    Satisfied = 1,
    /// Violated, whatever follows.
    Violated = 2,
}

/// A monitor of some formulas over the same signals.
pub struct MishandleMonitor {
    monitor: OnlineMonitor,
    formulas: usize,
    signals: Vec<Signal>,
    is_broken: bool,
}

struct Signal {
    name: String,
    is_read: bool,
}

/// Creates a monitor.
///
/// `formulas` and `signals` are arrays of texts in UTF-8, which end with 0. A sample has one value
/// for each signal, in the order of `signals`. `period` is the time between two samples in seconds,
/// or 0 if no bound of a formula has a unit. `samples` is the number of samples of the whole trace,
/// or 0 if it is unknown. On success, `*monitor` is a monitor for mishandle_monitor_destroy,
/// otherwise null.
///
/// # Safety
/// The pointers are null or valid for the stated numbers of elements.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn mishandle_monitor_create(
    formulas: *const *const c_char,
    formula_count: usize,
    signals: *const *const c_char,
    signal_count: usize,
    period: f64,
    samples: usize,
    monitor: *mut *mut MishandleMonitor,
) -> MishandleStatus {
    guarded(|| {
        if monitor.is_null() {
            return Err(null("monitor"));
        }
        // SAFETY: not null, and valid by the contract of the function.
        unsafe { monitor.write(ptr::null_mut()) };
        // SAFETY: null or valid by the contract of the function.
        let (formulas, names) = unsafe {
            (texts(formulas, formula_count, "formulas")?, texts(signals, signal_count, "signals")?)
        };
        let created = Box::new(create(&formulas, names, period, samples)?);
        // SAFETY: as above.
        unsafe { monitor.write(Box::into_raw(created)) };
        Ok(())
    })
}

fn create(
    texts: &[String],
    names: Vec<String>,
    period: f64,
    samples: usize,
) -> Result<MishandleMonitor, MishandleStatus> {
    let mut formulas = Vec::with_capacity(texts.len());
    for text in texts {
        let parsed =
            Formula::parse(text).map_err(|error| invalid(format_args!("formula `{text}`: {error}")))?;
        parsed.check_names(&names).map_err(|error| invalid(format_args!("{error}")))?;
        formulas.push(parsed);
    }
    let clock = match period {
        0.0 => Clock::unknown(),
        seconds if seconds.is_finite() && seconds.is_sign_positive() => Clock::steps(seconds),
        other => {
            return Err(invalid(format_args!(
                "the period is {other} s; it must be positive and finite, or 0"
            )));
        }
    };
    let monitor = OnlineMonitor::new(&formulas, &names, clock, (samples > 0).then_some(samples))
        .map_err(|error| invalid(format_args!("{error}")))?;
    let is_read = |name: &String| formulas.iter().any(|formula| formula.signals().contains(&name.as_str()));
    let signals = names.into_iter().map(|name| Signal { is_read: is_read(&name), name }).collect();
    Ok(MishandleMonitor { monitor, formulas: formulas.len(), signals, is_broken: false })
}

/// Adds a sample: `count` values, one for each signal.
///
/// # Safety
/// `monitor` is null or from mishandle_monitor_create and not destroyed; `values` is null or valid
/// for `count` numbers.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn mishandle_monitor_push(
    monitor: *mut MishandleMonitor,
    values: *const f64,
    count: usize,
) -> MishandleStatus {
    // SAFETY: the contract of this function is that of `with`.
    unsafe {
        with(monitor, |monitor| {
            if values.is_null() {
                return Err(null("values"));
            }
            // Only a number that is right bounds what is read behind the pointer.
            let expected = monitor.signals.len();
            if count != expected {
                return Err(invalid(format_args!("a sample has {expected} values, got {count}")));
            }
            let values = slice::from_raw_parts(values, count);
            for (signal, value) in monitor.signals.iter().zip(values) {
                if signal.is_read && !value.is_finite() {
                    let text =
                        format_args!("the signal {} is {value}; every value must be finite", signal.name);
                    return Err(fail(MishandleStatus::InvalidSample, text));
                }
            }
            monitor
                .monitor
                .push(values)
                .map_err(|error| fail(MishandleStatus::InvalidSample, format_args!("{error}")))
        })
    }
}

/// Returns the least and the greatest robustness of a formula at the first sample, over all
/// continuations of the samples so far. `formula` is its index, from 0.
///
/// # Safety
/// `monitor` as for mishandle_monitor_push; the other pointers are null or valid.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn mishandle_monitor_bounds(
    monitor: *mut MishandleMonitor,
    formula: usize,
    low: *mut f64,
    high: *mut f64,
) -> MishandleStatus {
    // SAFETY: the contract of this function is that of `with` and `put`.
    unsafe {
        with(monitor, |monitor| {
            let bounds = monitor.monitor.bounds(monitor.index(formula)?);
            put(low, bounds.low, "low")?;
            put(high, bounds.high, "high")
        })
    }
}

/// Returns the verdict on a formula at the first sample.
///
/// # Safety
/// As for mishandle_monitor_bounds.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn mishandle_monitor_verdict(
    monitor: *mut MishandleMonitor,
    formula: usize,
    verdict: *mut MishandleVerdict,
) -> MishandleStatus {
    // SAFETY: the contract of this function is that of `with` and `put`.
    unsafe {
        with(monitor, |monitor| {
            let found = match monitor.monitor.verdict(monitor.index(formula)?) {
                None => MishandleVerdict::Open,
                Some(true) => MishandleVerdict::Satisfied,
                Some(false) => MishandleVerdict::Violated,
            };
            put(verdict, found, "verdict")
        })
    }
}

/// Returns whether the last sample decided the robustness of a formula at a sample, which sample
/// that is, and the robustness. Without a decision, `*sample` and `*robustness` stay as they are.
///
/// # Safety
/// As for mishandle_monitor_bounds.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn mishandle_monitor_decided(
    monitor: *mut MishandleMonitor,
    formula: usize,
    is_decided: *mut bool,
    sample: *mut usize,
    robustness: *mut f64,
) -> MishandleStatus {
    // SAFETY: the contract of this function is that of `with` and `put`.
    unsafe {
        with(monitor, |monitor| {
            let found = monitor.monitor.decided(monitor.index(formula)?);
            if sample.is_null() || robustness.is_null() {
                return Err(null("sample or robustness"));
            }
            put(is_decided, found.is_some(), "is_decided")?;
            if let Some((index, value)) = found {
                put(sample, index, "sample")?;
                put(robustness, value, "robustness")?;
            }
            Ok(())
        })
    }
}

/// Forgets all samples and keeps the memory.
///
/// # Safety
/// As for mishandle_monitor_push.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn mishandle_monitor_reset(monitor: *mut MishandleMonitor) -> MishandleStatus {
    // SAFETY: the contract of this function is that of `with`.
    unsafe {
        with(monitor, |monitor| {
            monitor.monitor.reset();
            Ok(())
        })
    }
}

/// Frees a monitor. Null is ignored.
///
/// # Safety
/// `monitor` is null or from mishandle_monitor_create, and nothing uses it afterwards.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn mishandle_monitor_destroy(monitor: *mut MishandleMonitor) {
    if !monitor.is_null() {
        guarded(|| {
            // SAFETY: made by `Box::into_raw`, and destroyed once, by the contract.
            drop(unsafe { Box::from_raw(monitor) });
            Ok(())
        });
    }
}

/// Returns the text of the last error of this thread, which is empty before the first one. It is
/// valid until the next error of the thread, and is cut after 511 bytes.
#[unsafe(no_mangle)]
pub extern "C" fn mishandle_last_error() -> *const c_char {
    last_message()
}

impl MishandleMonitor {
    fn index(&self, formula: usize) -> Result<usize, MishandleStatus> {
        if formula < self.formulas {
            return Ok(formula);
        }
        Err(invalid(format_args!("the monitor has {} formulas; the index is {formula}", self.formulas)))
    }
}

/// Calls a function with a monitor.
///
/// # Safety
/// `monitor` is null, or valid and used by nothing else.
unsafe fn with(
    monitor: *mut MishandleMonitor,
    action: impl FnOnce(&mut MishandleMonitor) -> Result<(), MishandleStatus>,
) -> MishandleStatus {
    // SAFETY: null or valid by the contract.
    let Some(monitor) = (unsafe { monitor.as_mut() }) else { return null("monitor") };
    if monitor.is_broken {
        return fail(
            MishandleStatus::Panic,
            format_args!("the monitor failed before, by a defect of the library"),
        );
    }
    let status = guarded(|| action(monitor));
    monitor.is_broken = status == MishandleStatus::Panic;
    status
}

/// Calls a function and turns a panic into a status.
fn guarded(action: impl FnOnce() -> Result<(), MishandleStatus>) -> MishandleStatus {
    match catch_unwind(AssertUnwindSafe(action)) {
        Ok(Ok(())) => MishandleStatus::Ok,
        Ok(Err(status)) => status,
        Err(_) => fail(MishandleStatus::Panic, format_args!("a defect of the library; please report it")),
    }
}

/// Copies an array of texts.
///
/// # Safety
/// `pointers` is null or valid for `count` pointers, each null or to a text that ends with 0.
unsafe fn texts(
    pointers: *const *const c_char,
    count: usize,
    name: &str,
) -> Result<Vec<String>, MishandleStatus> {
    if count == 0 {
        return Ok(Vec::new());
    }
    if pointers.is_null() {
        return Err(null(name));
    }
    // SAFETY: not null, and valid by the contract.
    let pointers = unsafe { slice::from_raw_parts(pointers, count) };
    let mut found = Vec::with_capacity(count);
    for pointer in pointers {
        if pointer.is_null() {
            return Err(null(name));
        }
        // SAFETY: not null, and ends with 0 by the contract.
        let text = unsafe { CStr::from_ptr(*pointer) };
        let text = text.to_str().map_err(|_| invalid(format_args!("{name} has a text that is not UTF-8")))?;
        found.push(text.to_owned());
    }
    Ok(found)
}

/// Writes a result.
///
/// # Safety
/// `target` is null or valid.
unsafe fn put<T>(target: *mut T, value: T, name: &str) -> Result<(), MishandleStatus> {
    if target.is_null() {
        return Err(null(name));
    }
    // SAFETY: not null, and valid by the contract.
    unsafe { target.write(value) };
    Ok(())
}

fn null(name: &str) -> MishandleStatus {
    fail(MishandleStatus::NullPointer, format_args!("{name} is null"))
}

fn invalid(text: std::fmt::Arguments<'_>) -> MishandleStatus {
    fail(MishandleStatus::InvalidArgument, text)
}

// A monitor may move between threads, as the header says.
const _: () = {
    const fn moves<T: Send>() {}
    moves::<MishandleMonitor>();
};
