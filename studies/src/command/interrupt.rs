//! Ctrl-C and SIGTERM: the first one ends jobs after an iteration or a batch, the second one ends
//! the program.
//!
//! SIGHUP keeps its default: under `nohup` it is ignored, and otherwise a training run loses at
//! most the minute since its last checkpoint.

use std::sync::atomic::{AtomicBool, Ordering};

use anyhow::Result;
use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::iterator::Signals;
use signal_hook::low_level::exit;

use super::message;

/// Exit code of an interrupted command, the same as a shell's after Ctrl-C.
pub const EXIT_CODE: u8 = 130;

static REQUESTED: AtomicBool = AtomicBool::new(false);

/// Installs the signal handlers.
pub fn listen() -> Result<()> {
    let mut signals = Signals::new([SIGINT, SIGTERM])?;
    std::thread::spawn(move || {
        for _ in signals.forever() {
            if requested() {
                exit(EXIT_CODE.into());
            }
            message("saving finished work; press Ctrl-C again to end at once");
            REQUESTED.store(true, Ordering::Relaxed);
        }
    });
    Ok(())
}

/// Returns whether a signal has requested an interruption.
pub fn requested() -> bool {
    REQUESTED.load(Ordering::Relaxed)
}
