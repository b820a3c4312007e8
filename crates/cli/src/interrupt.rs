//! Ctrl-C and SIGTERM: the first asks a command to save what it has and to end, the second ends it at once.

use std::sync::atomic::{AtomicBool, Ordering};

use anyhow::Result;
use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::iterator::Signals;
use signal_hook::low_level::exit;

/// Exit code of a command that was interrupted: the shells' for Ctrl-C.
pub const EXIT_CODE: u8 = 130;

static ASKED: AtomicBool = AtomicBool::new(false);

/// From here on the first signal ends nothing by itself: it makes `announce` run, and the command has to look at
/// [`asked`].
pub fn listen(announce: impl Fn() + Send + 'static) -> Result<()> {
    let mut signals = Signals::new([SIGINT, SIGTERM])?;
    std::thread::spawn(move || {
        for _ in signals.forever() {
            if asked() {
                exit(EXIT_CODE.into());
            }
            // In this order: what the command says when it ends comes after.
            announce();
            ASKED.store(true, Ordering::Relaxed);
        }
    });
    Ok(())
}

/// Whether the command has been asked to end.
pub fn asked() -> bool {
    ASKED.load(Ordering::Relaxed)
}
