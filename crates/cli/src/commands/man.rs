use std::io::Write;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use clap::Args;
use clap_mangen::Man;
use mishandle::files::write_atomically;

use crate::exit_status::ExitStatus;
use crate::show::output;

/// Print the manual page, or write the pages of all commands to a folder
#[derive(Debug, Args)]
#[command(hide = true)]
#[command(after_help = "Examples:
  mishandle man | man -l -
  mishandle man ~/.local/share/man/man1")]
pub struct Arguments {
    /// Folder for mishandle.1 and one page per command; existing pages are replaced
    #[arg(value_name = "DIR")]
    pub folder: Option<PathBuf>,
}

pub fn run(command: &Arguments, program: fn() -> clap::Command) -> Result<ExitStatus> {
    let mut program = program();
    program.build();
    match &command.folder {
        Some(folder) => write_all(program, folder)?,
        None => std::io::stdout().lock().write_all(&page(program)?)?,
    }
    Ok(ExitStatus::Done)
}

/// Writes `mishandle.1` and one page per command, such as `mishandle-evaluate.1`.
fn write_all(program: clap::Command, folder: &Path) -> Result<()> {
    std::fs::create_dir_all(folder)
        .with_context(|| format!("cannot create the folder {}", folder.display()))?;
    let name = program.get_name().to_string();
    let commands: Vec<clap::Command> = program
        .get_subcommands()
        .filter(|command| command.get_name() != "help")
        .map(|command| command.clone().name(format!("{name}-{}", command.get_name()).leak() as &str))
        .collect();
    let mut count = 0;
    for command in std::iter::once(program).chain(commands) {
        let path = folder.join(format!("{}.1", command.get_name()));
        write_atomically(&path, &page(command)?).with_context(|| path.display().to_string())?;
        count += 1;
    }
    output::message(&format!("wrote {count} pages to {}", folder.display()));
    Ok(())
}

fn page(command: clap::Command) -> Result<Vec<u8>> {
    let mut text = Vec::new();
    Man::new(command).render(&mut text)?;
    Ok(text)
}
