//! Signals that interrupt a command: SIGINT (Ctrl-C), SIGTERM, and SIGHUP when the terminal closes.

use std::ops::ControlFlow;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use anyhow::Result;
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM, SIGXFSZ};
use signal_hook::iterator::Signals;
use signal_hook::low_level::exit;

/// Exit code of an interrupted command, the same as a shell's after Ctrl-C.
pub const EXIT_CODE: u8 = 130;

static REQUESTED: AtomicBool = AtomicBool::new(false);

/// Makes a write beyond the limit of `ulimit -f` an error. By default, the signal SIGXFSZ ends the
/// program without a message.
pub fn report_file_size_limits() {
    // Without the handler, the program ends as by default.
    let _ = signal_hook::flag::register(SIGXFSZ, Arc::new(AtomicBool::new(false)));
}

/// Installs the signal handlers.
///
/// The first signal calls `announce` and makes [`requested`] return true; the command must check
/// that. A second signal calls `clear` and ends the program immediately. A second SIGHUP is
/// ignored, because the shell and the system often both send one.
pub fn listen(announce: impl Fn() + Send + 'static, clear: impl Fn() + Send + 'static) -> Result<()> {
    let mut signals = Signals::new([SIGINT, SIGTERM])?;
    if !ignores_sighup() {
        signals.add_signal(SIGHUP)?;
    }
    std::thread::spawn(move || {
        for signal in signals.forever() {
            match (requested(), signal) {
                (true, SIGHUP) => {}
                (true, _) => {
                    clear();
                    exit(EXIT_CODE.into());
                }
                (false, _) => {
                    // In this order, so that the announcement precedes the command's final
                    // messages.
                    announce();
                    REQUESTED.store(true, Ordering::Relaxed);
                }
            }
        }
    });
    Ok(())
}

/// Returns whether SIGHUP is ignored, as under `nohup`. Works on Linux only; elsewhere it returns
/// false.
fn ignores_sighup() -> bool {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let ignored = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    let ignored = ignored.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok());
    ignored.is_some_and(|mask| mask >> (SIGHUP - 1) & 1 == 1)
}

/// Returns whether a signal has requested an interruption.
pub fn requested() -> bool {
    REQUESTED.load(Ordering::Relaxed)
}

/// Returns whether to continue after a batch.
pub fn control_flow() -> ControlFlow<()> {
    if requested() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
}
