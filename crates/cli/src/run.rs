//! Parts of running a command that several commands share: threads and signals, the files that it
//! opens, questions.

pub mod answers;
pub mod browser;
pub mod check_reports;
pub mod counterexample;
mod file;
pub mod first_look;
pub mod formula_context;
pub mod grid;
pub mod log_question;
pub mod logs;
pub mod pages;
pub mod path_kind;
pub mod question;
pub mod sample_size;

use anyhow::Result;
use mishandle_text::plural;

pub use crate::exit_status::ExitStatus;
use crate::interrupt;
pub use crate::interrupt::control_flow;
use crate::show::output;
use crate::show::progress::Bar;
pub use file::{create, differences_text, name, open, read, report_build_differences, report_interruption};

/// Sets the size of rayon's global thread pool.
pub fn set_threads(threads: Option<usize>) -> Result<()> {
    if let Some(threads) = threads {
        let cores = std::thread::available_parallelism().map_or(usize::MAX, usize::from);
        if threads > cores {
            output::message(&format!(
                "warning: --threads {threads} is more than the {}, which makes nothing faster",
                plural(cores, "core")
            ));
        }
        rayon::ThreadPoolBuilder::new().num_threads(threads).build_global()?;
    }
    Ok(())
}

/// Reports an interrupted command that writes no run file: what is kept, and what is lost.
pub fn report_loss(simulations: u64, kept_and_lost: &str) {
    output::message(&format!("interrupted after {}: {kept_and_lost}", plural(simulations, "simulation")));
}

/// Makes signals end the run after the current batch. The first signal prints a message
/// immediately.
pub fn stop_on_signals(bar: &Bar) -> Result<()> {
    let announced = bar.line();
    let cleared = bar.line();
    let announce = move || {
        announced.suspend(|| {
            output::message("finishing the running simulations; press Ctrl-C again to stop immediately");
        });
    };
    interrupt::listen(announce, move || cleared.finish_and_clear())
}
