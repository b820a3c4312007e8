//! Ctrl-C and SIGTERM: the first asks a command to save what it has and to end, the second ends it at once.

use std::sync::Arc;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicBool, Ordering};

use anyhow::Result;
use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::flag;

/// Exit code of a command that was interrupted: the shells' for Ctrl-C.
pub const EXIT_CODE: u8 = 130;

static ASKED: OnceLock<Arc<AtomicBool>> = OnceLock::new();

/// From here on the first signal ends nothing by itself: the command has to look at [`asked`].
pub fn listen() -> Result<()> {
    let asked = ASKED.get_or_init(Arc::default);
    for signal in [SIGINT, SIGTERM] {
        // In this order: a signal that comes when one has been seen already ends the process.
        flag::register_conditional_shutdown(signal, EXIT_CODE.into(), asked.clone())?;
        flag::register(signal, asked.clone())?;
    }
    Ok(())
}

/// Whether the command has been asked to end.
pub fn asked() -> bool {
    ASKED.get().is_some_and(|asked| asked.load(Ordering::Relaxed))
}
