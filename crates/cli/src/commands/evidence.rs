mod verify;

use std::path::PathBuf;

use anyhow::{Result, ensure};
use clap::Args;
use mishandle::plan::{EngineSettings, EvidenceSettings};
use mishandle_evidence::{Collection, EvidenceError, Key, NAMESPACE, SUMS, Signers};
use mishandle_text::shell_path;

use crate::exit_status::ExitStatus;
use crate::flags::{self, numbers};
use crate::show::{escape, evidence, output};
use crate::words::shell_command;
use crate::{interrupt, run};

/// Put runs, pages, hashes and a signature into a folder that others can verify
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  mishandle evidence runs/RUN.sqlite --out evidence
  mishandle evidence runs/A.sqlite runs/B.sqlite --out evidence --key ~/.ssh/id_ed25519
  mishandle evidence checked --out evidence         the folder of `mishandle check`, whole
  mishandle evidence --verify evidence --allowed-signers signers.txt
  mishandle evidence --verify evidence --public-key alice.pub -k evidence.replay=1

The folder has the run files, a page about each, the files of their targets and controllers, a
manifest (program, machine, plans), and SHA256SUMS with the hashes of all. The signature of
SHA256SUMS is one of `ssh-keygen -Y`, so OpenSSH alone can verify it. Signing and checking need
ssh-keygen. docs/guide/evidence.md says how to verify a folder with and without this program.

--verify checks somebody else's folder. A file of allowed signers has a line `NAME KEY` for each
key, as for ssh-keygen -Y verify. The check needs no network, writes nothing, and starts no program
but ssh-keygen, for the signature. A replay takes the time of the simulation. Exit code 0 means that
all agrees, 1 that something differs, that the signature does not count, or that not all can be
verified (systems in Python, programs, time limits, runs that are not finished, pages of another
build, a signature without ssh-keygen), 2 that the folder or FILE cannot be read. -k
evidence.replay=0 replays nothing: no run is then missing, but each counterexample of a check is not
verified.")]
pub struct Arguments {
    /// Run files, and folders of `mishandle check`
    #[arg(value_name = "RUN", required_unless_present = "verify")]
    pub runs: Vec<PathBuf>,
    /// Folder to create
    #[arg(long, value_name = "DIR", required_unless_present = "verify")]
    pub out: Option<PathBuf>,
    /// Replace DIR if it is a folder of evidence
    #[arg(long)]
    pub force: bool,
    /// Key of ssh-keygen that signs; one with a passphrase must be in an ssh-agent [default: no
    /// signature]
    #[arg(long, value_name = "FILE")]
    pub key: Option<PathBuf>,
    /// Check signature, hashes and run files of this folder, and replay a random share of it
    #[arg(long, value_name = "DIR", conflicts_with_all = ["runs", "out", "force", "key"])]
    pub verify: Option<PathBuf>,
    /// File of keys whose signatures count, in the format of ssh-keygen [default: any key]
    #[arg(long, value_name = "FILE", requires = "verify", conflicts_with = "public_key")]
    pub allowed_signers: Option<PathBuf>,
    /// Public key whose signature counts, such as id_ed25519.pub [default: any key]
    #[arg(long, value_name = "FILE", requires = "verify")]
    pub public_key: Option<PathBuf>,
    /// Seed that chooses the simulations to replay [default: a random one, which is printed]
    #[arg(long, value_name = "N", requires = "verify", allow_negative_numbers = true, value_parser = numbers::integer::<u64>(flags::SEEDS))]
    pub seed: Option<u64>,
    /// Print one JSON document to stdout
    #[arg(long)]
    pub json: bool,
    #[command(flatten)]
    pub keys: flags::SettingKeys,
}

pub fn run(command: &Arguments) -> Result<ExitStatus> {
    let settings = command.keys.settings("evidence")?;
    if let Some(folder) = &command.verify {
        ensure!(
            settings.engine == EngineSettings::default(),
            "--verify reads no key of engine; leave it out"
        );
        let signers = match (&command.public_key, &command.allowed_signers) {
            (Some(path), _) => Signers::Key(path.clone()),
            (None, Some(path)) => Signers::Allowed(path.clone()),
            (None, None) => Signers::Unknown,
        };
        return verify::run(folder, signers, settings.evidence.replay, command.seed, command.json);
    }
    let Some(out) = command.out.as_deref() else { return Ok(ExitStatus::Done) };
    ensure!(
        settings.evidence == EvidenceSettings::default(),
        "the keys of evidence are for --verify; leave them out"
    );
    let key = command.key.as_deref().map(Key::new).transpose()?;
    let moved = settings.engine.moved();
    let collection = Collection {
        runs: &command.runs,
        out,
        force: command.force,
        moved,
        key: key.as_ref(),
        words: shell_command,
    };
    interrupt::listen(|| {}, || {})?;
    let found = match mishandle_evidence::write(&collection, run::control_flow) {
        Err(EvidenceError::Interrupted) => {
            output::message("interrupted: no folder was written");
            return Ok(ExitStatus::Interrupted);
        }
        found => found?,
    };
    if command.json {
        output::json(&found)?;
    } else {
        output::line(&evidence::text(&found))?;
    }
    for run in &found.runs {
        if let Some(why) = &run.not_replayable {
            let file = escape::name(&run.file);
            output::message(&format!(
                "warning: {file} cannot be replayed from the folder alone: {}",
                escape::name(why)
            ));
        }
    }
    let name = shell_path(out);
    if key.is_none() {
        output::message(&format!(
            "not signed: hashes alone show accidents, not forgery; sign with --key, or with: ssh-keygen -Y sign -f KEY -n \
             {NAMESPACE} {}",
            shell_path(&out.join(SUMS))
        ));
    }
    output::message(&format!("Verify with: mishandle evidence --verify {name}"));
    Ok(ExitStatus::Done)
}
