//! `mishandle evidence --verify`: checks somebody else's folder of evidence.

use std::path::Path;

use anyhow::Result;
use mishandle_evidence::{Signers, Verification, random_seed};

use crate::exit_status::ExitStatus;
use crate::run;
use crate::show::progress::Bar;
use crate::show::{evidence, output};
use crate::words::shell_command;

pub fn run(folder: &Path, signers: Signers, share: f64, seed: Option<u64>, json: bool) -> Result<ExitStatus> {
    let bar = Bar::new(0, "replays");
    run::stop_on_signals(&bar)?;
    let seed = seed.unwrap_or_else(random_seed);
    let request = Verification { folder, signers, share, seed, words: shell_command };
    let found = mishandle_evidence::verify(&request, |done, total| {
        bar.set_length(total);
        bar.set_position(done);
        run::control_flow()
    })?;
    bar.clear();
    if json {
        output::json(&found)?;
    } else {
        output::line(&evidence::verification_text(&found))?;
    }
    for run in &found.runs {
        run::report_build_differences("made", &run.build_differences);
    }
    match found.signature.as_str() {
        "valid" => output::message(
            "nobody vouches for the key: name the keys that you trust with --allowed-signers or --public-key",
        ),
        "missing" => output::message(
            "the folder is not signed: whoever wrote it could have changed everything but what was replayed",
        ),
        _ => {}
    }
    if !found.is_complete {
        output::message("interrupted: not all was verified");
        return Ok(ExitStatus::Interrupted);
    }
    Ok(if found.is_verified { ExitStatus::Done } else { ExitStatus::Violated })
}
