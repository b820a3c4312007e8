use std::fs;
use std::path::Path;
use std::process::Command;

use anyhow::{Context, Error, Result, bail, ensure};
use mishandle::picture::{RecordedScene, recorded_scene};
use mishandle::plan::Settings;
use mishandle::world::MUJOCO_VERSION;
use mishandle_text::plural;

use super::Arguments;
use crate::exit_status::ExitStatus;
use crate::run;
use crate::run::path_kind::PathKind;
use crate::show::{output, simulation};

/// Script that shows a folder with model and states in MuJoCo's viewer.
const SCRIPT: &str = include_str!("viewer.py");

/// Exit code of the script if the package `mujoco` is missing.
const NO_PACKAGE: i32 = 3;

/// Opens a recorded simulation in MuJoCo's own viewer.
pub fn run(command: &Arguments, kind: &PathKind, settings: &Settings) -> Result<ExitStatus> {
    let path = Path::new(&command.target);
    ensure!(
        matches!(kind, PathKind::Run | PathKind::Counterexample),
        "--view opens a simulation of a run file or an exported counterexample, and {} is neither",
        path.display()
    );
    let python = settings.render.python.as_str();
    let folder = tempfile::tempdir().context("cannot create a temporary folder for the viewer")?;
    // Fails before the simulation if there is no viewer.
    let status = start(python, folder.path(), &["-c", "import mujoco.viewer"])?;
    ensure!(status.is_some_and(|code| code == 0), "{}", missing(python));
    let scene = recorded_scene(path, command.trial, command.simulation, settings.engine.moved(), false)?;
    run::report_build_differences("made", &scene.build_differences);
    ensure!(scene.differences.is_empty(), "{}", run::differences_text(&scene.differences));
    write(folder.path(), &scene)?;
    let steps = scene.episodes.first().map_or(0, |episode| episode.episode.steps);
    output::message(&format!(
        "{}: {}; space pauses, Ctrl-Q closes",
        simulation::name(scene.place.0, None, scene.place.1),
        plural(steps, "control step")
    ));
    let speed = command.speed.unwrap_or(1.0).to_string();
    match start(python, folder.path(), &["viewer.py", ".", &speed])? {
        Some(0) => Ok(ExitStatus::Done),
        Some(NO_PACKAGE) => bail!("{}", missing(python)),
        _ => bail!("the viewer failed; it needs a display, which a picture does not"),
    }
}

fn missing(python: &str) -> String {
    format!(
        "the viewer is that of the Python package `mujoco`, which `{python}` cannot import; install it with: {python} -m pip \
         install mujoco=={MUJOCO_VERSION}, or name another interpreter with -k render.python=PROGRAM"
    )
}

/// Runs Python in a folder of our own, because it imports modules from the working directory, and
/// returns its exit code.
fn start(python: &str, folder: &Path, arguments: &[&str]) -> Result<Option<i32>> {
    let program = if python.contains('/') {
        std::path::absolute(python).context("cannot find the interpreter")?
    } else {
        python.into()
    };
    let mut process = Command::new(program);
    process.args(arguments).current_dir(folder);
    if arguments.first() == Some(&"-c") {
        process.stderr(std::process::Stdio::null());
    }
    let status = process.status().map_err(|error| match error.kind() {
        std::io::ErrorKind::NotFound => Error::msg(missing(python)),
        _ => Error::new(error).context(format!("cannot run `{python}`")),
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
