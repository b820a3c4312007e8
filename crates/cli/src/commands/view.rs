use std::fs;
use std::path::Path;
use std::process::Command;

use anyhow::{Context, Error, Result, bail, ensure};
use clap::Args;
use mishandle::picture::{RecordedScene, recorded_scene};
use mishandle::world::MUJOCO_VERSION;
use mishandle_text::plural;

use crate::exit_status::ExitStatus;
use crate::flags::{self, numbers};
use crate::run;
use crate::show::{output, simulation};

/// Script that shows a folder with model and states in MuJoCo's viewer.
const SCRIPT: &str = include_str!("view/viewer.py");

/// Exit code of the script if the package `mujoco` is missing.
const NO_PACKAGE: i32 = 3;

/// Speeds of a playback.
const SPEED: &str = "a number from 0.01 to 100, such as 0.25";

/// Open a recorded simulation in MuJoCo's own viewer
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  mishandle view runs/RUN.sqlite                                  the first counterexample
  mishandle view runs/RUN.sqlite --trial 2 --simulation 17 --speed 0.25
  mishandle view failure.json                                     an exported counterexample

The simulation runs again and must be bit-identical to its record. Then its states play in a loop:
space pauses, the arrows left and right go one control step back and forth, Ctrl-Q closes. The
viewer is that of the Python package `mujoco`, which must be installed and needs a display.")]
pub struct Arguments {
    #[command(flatten)]
    pub recorded: flags::Recorded,
    /// Speed of the playback relative to the simulation
    #[arg(long, value_name = "FACTOR", default_value = "1", allow_negative_numbers = true)]
    #[arg(value_parser = numbers::number(SPEED, |speed| (0.01..=100.0).contains(&speed)))]
    pub speed: f64,
    /// Python interpreter with the package `mujoco`
    #[arg(long, value_name = "PROGRAM", default_value = "python3")]
    pub python: String,
}

pub fn run(command: &Arguments) -> Result<ExitStatus> {
    let recorded = &command.recorded;
    let engine = recorded.engine("view")?;
    if flags::is_file(&recorded.file) {
        flags::check_flags(recorded.trial, recorded.simulation)?;
    }
    let folder = tempfile::tempdir().context("cannot create a temporary folder for the viewer")?;
    // Fails before the simulation if there is no viewer.
    let status = python(command, folder.path(), &["-c", "import mujoco.viewer"])?;
    ensure!(status.is_some_and(|code| code == 0), "{}", missing(&command.python));
    let choice = (recorded.trial, recorded.simulation);
    let scene = recorded_scene(&recorded.file, choice, engine.moved(), false)?;
    run::report_build_differences("made", &scene.build_differences);
    ensure!(scene.differences.is_empty(), "{}", run::differences_text(&scene.differences));
    write(folder.path(), &scene)?;
    let steps = scene.episodes.first().map_or(0, |episode| episode.episode.steps);
    output::message(&format!(
        "{}: {}; space pauses, Ctrl-Q closes",
        simulation::name(scene.place.0, None, scene.place.1),
        plural(steps, "control step")
    ));
    match python(command, folder.path(), &["viewer.py", ".", &command.speed.to_string()])? {
        Some(0) => Ok(ExitStatus::Done),
        Some(NO_PACKAGE) => bail!("{}", missing(&command.python)),
        _ => bail!("the viewer failed; it needs a display, which `render` does not"),
    }
}

fn missing(python: &str) -> String {
    format!(
        "the viewer is that of the Python package `mujoco`, which `{python}` cannot import; install it with: {python} -m pip \
         install mujoco=={MUJOCO_VERSION}, or name another interpreter with --python"
    )
}

/// Runs Python in a folder of our own, because it imports modules from the working directory, and
/// returns its exit code.
fn python(command: &Arguments, folder: &Path, arguments: &[&str]) -> Result<Option<i32>> {
    let program = if command.python.contains('/') {
        std::path::absolute(&command.python).context("cannot find the interpreter")?
    } else {
        command.python.clone().into()
    };
    let mut process = Command::new(program);
    process.args(arguments).current_dir(folder);
    if arguments.first() == Some(&"-c") {
        process.stderr(std::process::Stdio::null());
    }
    let status = process.status().map_err(|error| match error.kind() {
        std::io::ErrorKind::NotFound => Error::msg(missing(&command.python)),
        _ => Error::new(error).context(format!("cannot run `{}`", command.python)),
    })?;
    Ok(status.code())
}

/// Writes model, files and states as the script reads them.
fn write(folder: &Path, scene: &RecordedScene) -> Result<()> {
    let put = |name: &str, bytes: &[u8]| {
        fs::write(folder.join(name), bytes).with_context(|| format!("cannot write {name} for the viewer"))
    };
    put("viewer.py", SCRIPT.as_bytes())?;
    put("model.xml", scene.model.document.as_bytes())?;
    let names: Vec<&String> = scene.model.assets.keys().collect();
    for (index, bytes) in scene.model.assets.values().enumerate() {
        put(&format!("asset-{index}"), bytes)?;
    }
    let states = scene.episodes.first().map_or(&[][..], |episode| &episode.states);
    let numbers = states.iter().flatten().flat_map(|value| value.to_le_bytes());
    put("states.f64", &numbers.collect::<Vec<u8>>())?;
    let facts = serde_json::json!({
        "assets": names,
        "rows": states.len(),
        "control_dt": scene.resolved.target.control_dt,
    });
    put("scene.json", facts.to_string().as_bytes())
}
