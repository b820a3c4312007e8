//! Commands that run a simulation again.

use mishandle::replay::replay_command;
use mishandle::resolve::{has_scene, is_python};
use mishandle_text::shell_quote;

use crate::load::RunReport;

/// Returns the commands for a simulation of a run, folded, as HTML.
pub fn details(report: &RunReport, trial: u32, number: u32) -> String {
    let run = shell_quote(&report.path);
    let at = format!("--trial {trial} --simulation {number}");
    let explain = format!("mishandle explain {run} {at}");
    let replay = replay_command(&report.header.target.kind, report.path.as_ref(), trial, number);
    let mut lines = if is_python(&report.header.target.kind) {
        let comment = "# in Python, with the same system, formula and space as the run:".to_string();
        vec![explain, comment, replay]
    } else {
        vec![replay, explain]
    };
    if has_scene(&report.header.target.kind) {
        lines.push(format!("mishandle render --run {run} {at} --out failure.mp4"));
    }
    format!("<details><summary>Run it again</summary><pre>{}</pre></details>\n", crate::html::lines(&lines))
}
