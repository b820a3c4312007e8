//! `mishandle evidence verify`: checks somebody else's folder of evidence.

use std::path::PathBuf;

use anyhow::Result;
use clap::Args;
use mishandle_evidence::{Signers, Verification, random_seed};

use crate::exit_status::ExitStatus;
use crate::flags::{self, numbers};
use crate::run;
use crate::show::progress::Bar;
use crate::show::{evidence, output};

#[derive(Debug, Args)]
#[command(after_help = "Examples:
  mishandle evidence verify evidence
  mishandle evidence verify evidence --public-key alice.pub --replay 1
  mishandle evidence verify evidence --allowed-signers signers.txt --json

A file of allowed signers has a line `NAME KEY` for each key, as for ssh-keygen -Y verify. The check
needs no network, writes nothing, and starts no program but ssh-keygen, for the signature. A replay
takes the time of the simulation.

Exit code 0 means that all agrees, 1 that something differs, that the signature does not count, or
that not all can be verified (systems in Python, programs, time limits, runs that are not finished,
a signature without ssh-keygen), 2 that the folder or FILE cannot be read. --replay 0 asks for no
replay, so none can be missing.")]
pub struct Arguments {
    /// Folder of `mishandle evidence`
    #[arg(value_name = "DIR")]
    pub folder: PathBuf,
    /// File of keys whose signatures count, in the format of ssh-keygen [default: any key]
    #[arg(long, value_name = "FILE", conflicts_with = "public_key")]
    pub allowed_signers: Option<PathBuf>,
    /// Public key whose signature counts, such as id_ed25519.pub [default: any key]
    #[arg(long, value_name = "FILE")]
    pub public_key: Option<PathBuf>,
    /// Share of the simulations of each run to replay, at least one; 0 replays none
    #[arg(long, value_name = "SHARE", default_value = "0.05", allow_negative_numbers = true, value_parser = numbers::number("a number from 0 to 1", |share| (0.0..=1.0).contains(&share)))]
    pub replay: f64,
    /// Seed that chooses the simulations [default: a random one, which is printed]
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = numbers::integer::<u64>(flags::SEEDS))]
    pub seed: Option<u64>,
    /// Print one JSON document to stdout
    #[arg(long)]
    pub json: bool,
}

pub fn run(command: &Arguments) -> Result<ExitStatus> {
    let signers = match (&command.public_key, &command.allowed_signers) {
        (Some(path), _) => Signers::Key(path.clone()),
        (None, Some(path)) => Signers::Allowed(path.clone()),
        (None, None) => Signers::Unknown,
    };
    let bar = Bar::new(0, "replays");
    run::stop_on_signals(&bar)?;
    let seed = command.seed.unwrap_or_else(random_seed);
    let request = Verification { folder: &command.folder, signers, share: command.replay, seed };
    let found = mishandle_evidence::verify(&request, |done, total| {
        bar.set_length(total);
        bar.set_position(done);
        run::control_flow()
    })?;
    bar.clear();
    if command.json {
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
