mod verify;

use std::path::PathBuf;

use anyhow::Result;
use clap::{Args, Subcommand};
use mishandle_evidence::{Collection, EvidenceError, Key, NAMESPACE, SUMS};
use mishandle_text::{path_text, shell_quote};

use crate::exit_status::ExitStatus;
use crate::show::{escape, evidence, output};
use crate::{flags, interrupt, run};

/// Put runs, pages, hashes and a signature into a folder that others can verify
#[derive(Debug, Args)]
#[command(args_conflicts_with_subcommands = true, subcommand_negates_reqs = true)]
#[command(after_help = "Examples:
  mishandle evidence runs/RUN.sqlite --out evidence
  mishandle evidence runs/A.sqlite runs/B.sqlite --out evidence --key ~/.ssh/id_ed25519
  mishandle evidence checked --out evidence         the folder of `mishandle check`, whole
  mishandle evidence verify evidence --allowed-signers signers.txt --replay 0.05

The folder has the run files, a page about each, the files of their targets and controllers, a
manifest (program, machine, plans), and SHA256SUMS with the hashes of all. The signature of
SHA256SUMS is one of `ssh-keygen -Y`, so OpenSSH alone can verify it. Signing and checking need
ssh-keygen. docs/guide/evidence.md says how to verify a folder with and without this program.")]
pub struct Arguments {
    #[command(subcommand)]
    pub command: Option<EvidenceCommand>,
    /// Run files, and folders of `mishandle check`
    #[arg(value_name = "RUN", required = true)]
    pub runs: Vec<PathBuf>,
    /// Folder to create
    #[arg(long, value_name = "DIR", required = true)]
    pub out: Option<PathBuf>,
    /// Replace DIR if it is a folder of evidence
    #[arg(long)]
    pub force: bool,
    /// Key of ssh-keygen that signs; one with a passphrase must be in an ssh-agent [default: no
    /// signature]
    #[arg(long, value_name = "FILE")]
    pub key: Option<PathBuf>,
    /// Print one JSON document to stdout
    #[arg(long)]
    pub json: bool,
    #[command(flatten)]
    pub keys: flags::SettingKeys,
}

#[derive(Debug, Subcommand)]
pub enum EvidenceCommand {
    /// Check signature, hashes and run files of a folder, and replay a random share of it
    Verify(verify::Arguments),
}

pub fn run(command: &Arguments) -> Result<ExitStatus> {
    if let Some(EvidenceCommand::Verify(command)) = &command.command {
        return verify::run(command);
    }
    let Some(out) = command.out.as_deref() else { return Ok(ExitStatus::Done) };
    let key = command.key.as_deref().map(Key::new).transpose()?;
    let settings = command.keys.settings("evidence")?;
    let moved = settings.engine.moved();
    let collection = Collection { runs: &command.runs, out, force: command.force, moved, key: key.as_ref() };
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
    let name = shell_quote(&path_text(out));
    if key.is_none() {
        output::message(&format!(
            "not signed: hashes alone show accidents, not forgery; sign with --key, or with: ssh-keygen -Y sign -f KEY -n \
             {NAMESPACE} {}",
            shell_quote(&path_text(&out.join(SUMS)))
        ));
    }
    output::message(&format!("Verify with: mishandle evidence verify {name}"));
    Ok(ExitStatus::Done)
}
