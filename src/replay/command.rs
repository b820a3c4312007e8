use std::path::Path;

use mishandle_results::Command;
use mishandle_text::path_text;

use crate::resolve::is_python;

/// Returns what replays a simulation of the run file at `path`.
pub fn replay_command(target_kind: &str, path: &Path, trial: u32, number: u32) -> Command {
    let is_python = is_python(target_kind);
    Command::Replay { run: path_text(path), trial, simulation: number, is_python }
}
