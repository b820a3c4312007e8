use std::path::PathBuf;
use std::time::Instant;

use anyhow::{Context, Result, bail};
use clap::Args;
use mishandle_text::{path_text, shell_quote};

use crate::exit_status::ExitStatus;
use crate::show::output;

/// Find a failure of a shipped controller in seconds, and show it on a page
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  mishandle demo

The demo runs two commands, which it prints. Its files go to the folder runs, or to a temporary
folder where runs cannot be written. Exit code 0 means that the failure was found and the page is
written.")]
pub struct Arguments {}

/// The question: a delay breaks a controller that is perfect without it.
const QUESTION: [&str; 6] = ["falsify", "ball-balancing", "--controller", "ppo", "--space", "delay"];
/// Reason for the question. The figure is in controllers/README.md.
const WHY: &str = "The shipped controller `ppo` balances the ball from all of 1,000 random starts. Its observations and actions \
                   arrive at once there. What if they arrive up to 3 control steps (50 ms) late?";

/// Folder of the files, and their name without a number.
const FOLDER: &str = "runs";
const NAME: &str = "demo";

/// Runs the demo. `run` runs a command by its words.
pub fn run(_: &Arguments, run: impl Fn(&[&str]) -> Result<ExitStatus>) -> Result<ExitStatus> {
    let started = Instant::now();
    let file = file()?;
    let run = |words: &[&str]| {
        let typed: Vec<_> = words.iter().map(|word| shell_quote(word)).collect();
        output::message("");
        output::message(&format!("$ mishandle {}", typed.join(" ")));
        run(words)
    };
    output::message(WHY);
    match run(&[&QUESTION[..], &["--out", &file]].concat())? {
        ExitStatus::Violated => {}
        ExitStatus::Interrupted => return Ok(ExitStatus::Interrupted),
        ExitStatus::Done => bail!("the controller did not fail, as it does in every build that was tested"),
    }
    let status = run(&["report", &file, "--open"])?;
    if status == ExitStatus::Done {
        output::message(&format!("The demo took {:.1} s", started.elapsed().as_secs_f64()));
    }
    Ok(status)
}

/// Returns a name for the run file. No file has it, and none has the name of its page.
fn file() -> Result<String> {
    let folder = folder()?;
    let named = |number: u32| {
        let number = if number == 1 { String::new() } else { format!("-{number}") };
        ["sqlite", "html"].map(|end| folder.join(format!("{NAME}{number}.{end}")))
    };
    let is_free = |files: &[PathBuf; 2]| files.iter().all(|file| file.symlink_metadata().is_err());
    let [file, _] = (1..).map(named).find(is_free).context("all names are taken")?;
    Ok(path_text(&file))
}

/// Returns a folder that can be written.
fn folder() -> Result<PathBuf> {
    let folder = PathBuf::from(FOLDER);
    let tried = std::fs::create_dir_all(&folder).and_then(|()| tempfile::tempfile_in(&folder));
    let Err(error) = tried else { return Ok(folder) };
    let folder = tempfile::Builder::new().prefix("mishandle-demo-").tempdir();
    let folder = folder.context("neither this folder nor a temporary one can be written")?.keep();
    output::message(&format!(
        "the files go to {}, because {FOLDER} cannot be written here: {error}",
        folder.display()
    ));
    Ok(folder)
}
