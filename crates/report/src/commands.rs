//! Commands that run a simulation again.

use mishandle::replay::replay_command;
use mishandle::resolve::{has_scene, is_python};
use mishandle::results::{Command, Recorded};

use crate::load::RunReport;

/// Returns the commands for a simulation of a run, folded, as HTML.
pub fn details(report: &RunReport, trial: u32, number: u32) -> String {
    let RunReport { header, path, words, .. } = report;
    let kind = &header.target.kind;
    let recorded = Recorded { run: path.clone(), trial, simulation: number, controller: None };
    let explain = words(&Command::Explain(recorded.clone()));
    let replay = words(&replay_command(kind, path.as_ref(), trial, number));
    let mut lines = if is_python(kind) {
        let comment = "# with the same system, formula and space as the run:".to_string();
        vec![explain, comment, replay]
    } else {
        vec![replay, explain]
    };
    if has_scene(kind) {
        lines.push(words(&Command::Render(recorded)));
    }
    format!("<details><summary>Run it again</summary><pre>{}</pre></details>\n", crate::html::lines(&lines))
}
