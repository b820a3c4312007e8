//! `mishandle init`: files to start from.

use std::path::PathBuf;

use anyhow::{Context, Result};
use clap::Args;
use clap::builder::PossibleValuesParser;
use mishandle::requirements::{TEMPLATES, template};
use mishandle::resolve::{FirstInputs, first_target_file};
use mishandle::results::ProtocolCheck;
use mishandle_text::shell_path;

use crate::exit_status::ExitStatus;
use crate::show::{escape, output};

/// Write a first target file for a robot, or a first file of requirements, or check the protocol of
/// a simulator
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  mishandle init --model robot.xml --out robot.toml
  mishandle init --model robot.xml --policy policy.onnx --out robot.toml
  mishandle init --model robot.xml --policy policy.onnx --descriptor io.yaml --out robot.toml
  mishandle init --template iso-10218 --out requirements.toml
  mishandle init --check 'python3 my_simulator.py'

A target file comes from the model, and from the metadata that mjlab writes into ONNX models or an
IO descriptor of Isaac Lab, whose joints are matched by name. Otherwise, actions are the controls of
the actuators. It is simulated once before it is written, and whatever is not known is a TODO in it.
docs/guide/policies.md says what is read. --check talks to a simulator as a test suite: description,
bounds of the axes, determinism, seeds, order of the questions, output and end. Exit code 1 means
that it breaks a rule.")]
pub struct Arguments {
    /// Model of the robot: MJCF or URDF
    #[arg(long, value_name = "FILE", required_unless_present_any = ["template", "check"])]
    #[arg(requires = "out")]
    pub model: Option<PathBuf>,
    /// Policy of the robot: an ONNX model, or a Python program; without it, a law holds the start
    #[arg(long, value_name = "FILE", requires = "model")]
    pub policy: Option<PathBuf>,
    /// IO descriptor of Isaac Lab (YAML), instead of the metadata of the policy
    #[arg(long, value_name = "FILE", requires = "model")]
    pub descriptor: Option<PathBuf>,
    /// Let the model refer to files outside its folder; the target file says so, too
    #[arg(long, requires = "model")]
    pub allow_outside: bool,
    /// A file of requirements to start from, which is printed without --out
    #[arg(long, value_name = "NAME", conflicts_with = "model")]
    #[arg(value_parser = PossibleValuesParser::new(TEMPLATES.map(|(name, _)| name)))]
    pub template: Option<String>,
    /// Check the protocol of the simulator of this command
    #[arg(long, value_name = "COMMAND", conflicts_with_all = ["model", "template", "out", "force"])]
    pub check: Option<String>,
    /// File to create
    #[arg(long, value_name = "FILE")]
    pub out: Option<PathBuf>,
    /// Overwrite an existing file
    #[arg(long, requires = "out")]
    pub force: bool,
    /// With --check: print one JSON document to stdout
    #[arg(long, requires = "check")]
    pub json: bool,
}

pub fn run(command: &Arguments) -> Result<ExitStatus> {
    if let Some(program) = &command.check {
        return check(program, command.json);
    }
    let Some(text) = command.template.as_deref().and_then(template) else { return target_file(command) };
    match &command.out {
        None => output::line(text.trim_end())?,
        Some(out) => {
            output::write_atomically(out, command.force, text.as_bytes())?;
            output::message(&format!("wrote {}", out.display()));
        }
    }
    Ok(ExitStatus::Done)
}

fn check(program: &str, as_json: bool) -> Result<ExitStatus> {
    let found = mishandle::resolve::check_protocol(program)?;
    if as_json {
        output::json(&found)?;
    } else {
        output::line(&text(&found))?;
    }
    Ok(if found.passed { ExitStatus::Done } else { ExitStatus::Violated })
}

/// Returns a line for each check, and the times.
fn text(found: &ProtocolCheck) -> String {
    let mut rows = vec![["check", "result", "finding"].map(String::from).to_vec()];
    rows.extend(found.checks.iter().map(|check| {
        let result = if check.passed { "pass" } else { "FAIL" };
        // The standard error of a program has line breaks, which a table has not.
        let finding = escape::text(&check.finding).replace(['\n', '\t'], " ");
        vec![check.check.clone(), result.to_string(), finding]
    }));
    let time = |what: &str, seconds: Option<f64>| {
        let seconds = seconds?;
        let text = if seconds < 1.0 { format!("{:.3} ms", 1e3 * seconds) } else { format!("{seconds:.1} s") };
        Some(format!("{what} {text}"))
    };
    let times = [
        time("start", found.start_seconds),
        time("one simulation", found.simulation_seconds),
        time("one control step", found.step_seconds),
    ];
    let times: Vec<String> = times.into_iter().flatten().collect();
    let times = if times.is_empty() { String::new() } else { format!("\n\ntime: {}", times.join(", ")) };
    format!("{}{times}", output::table_in(&rows, output::width()))
}

/// Writes a first target file.
fn target_file(command: &Arguments) -> Result<ExitStatus> {
    let Arguments { policy, descriptor, allow_outside, force, .. } = command;
    let model = command.model.as_ref().context("give --model FILE")?;
    let out = command.out.as_ref().context("give --out FILE")?;
    anyhow::ensure!(
        out.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("toml")),
        "--out is {}; it must end in .toml",
        out.display()
    );
    let inputs = [model].into_iter().chain(policy).chain(descriptor).map(PathBuf::as_path);
    output::refuse_inputs(out, "--out", inputs)?;
    // An existing file is reported before any work.
    drop(output::create(out, *force)?);
    let inputs = FirstInputs {
        model,
        policy: policy.as_deref(),
        descriptor: descriptor.as_deref(),
        allow_outside: *allow_outside,
    };
    let file = first_target_file(&inputs, out)?;
    output::write_atomically(out, *force, file.text.as_bytes())?;
    for unknown in &file.unknown {
        output::message(&format!("not known: {unknown}"));
    }
    for remark in &file.remarks {
        output::message(&format!("note: {remark}"));
    }
    let name = shell_path(out);
    let next = if file.loads { format!("; next: mishandle run {name}") } else { String::new() };
    output::message(&format!("wrote {name}{next}"));
    Ok(ExitStatus::Done)
}
