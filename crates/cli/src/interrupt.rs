//! Signals that ask a command to save what it has and to end: Ctrl-C, SIGTERM, and SIGHUP, when its terminal goes.

use std::sync::atomic::{AtomicBool, Ordering};

use anyhow::Result;
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use signal_hook::iterator::Signals;
use signal_hook::low_level::exit;

/// Exit code of a command that was interrupted: the shells' for Ctrl-C.
pub const EXIT_CODE: u8 = 130;

static ASKED: AtomicBool = AtomicBool::new(false);

/// From here on the first signal ends nothing by itself: it makes `announce` run, and the command has to look at
/// [`asked`]. The second ends the command at once, after `clear`, unless it is SIGHUP: that comes from the shell and from
/// the system, so often twice.
pub fn listen(announce: impl Fn() + Send + 'static, clear: impl Fn() + Send + 'static) -> Result<()> {
    let mut signals = Signals::new([SIGINT, SIGTERM])?;
    if !outlives_its_terminal() {
        signals.add_signal(SIGHUP)?;
    }
    std::thread::spawn(move || {
        for signal in signals.forever() {
            match (asked(), signal) {
                (true, SIGHUP) => {}
                (true, _) => {
                    clear();
                    exit(EXIT_CODE.into());
                }
                (false, _) => {
                    // In this order: what the command says when it ends comes after.
                    announce();
                    ASKED.store(true, Ordering::Relaxed);
                }
            }
        }
    });
    Ok(())
}

/// Whether SIGHUP was set to be ignored, as `nohup` does. Only Linux tells.
fn outlives_its_terminal() -> bool {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let ignored = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    let ignored = ignored.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok());
    ignored.is_some_and(|mask| mask >> (SIGHUP - 1) & 1 == 1)
}

/// Whether the command has been asked to end.
pub fn asked() -> bool {
    ASKED.load(Ordering::Relaxed)
}
