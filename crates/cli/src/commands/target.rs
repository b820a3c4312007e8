use std::path::PathBuf;

use anyhow::Result;
use clap::{Args, Subcommand};

use crate::exit_status::ExitStatus;
use crate::show::output;

/// Write a target file for a robot with a policy of another tool
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  mishandle target init --model robot.xml --policy policy.onnx --out robot.toml
  mishandle target init --model robot.xml --policy policy.onnx --descriptor io.yaml --out robot.toml
  mishandle targets robot.toml                                checks and describes the file

docs/guide/policies.md says what is read.")]
pub struct Arguments {
    #[command(subcommand)]
    pub command: TargetCommand,
}

#[derive(Debug, Subcommand)]
pub enum TargetCommand {
    /// Write a first target file from a model and a policy
    ///
    /// It reads the metadata that mjlab writes into ONNX models, or an IO descriptor of Isaac Lab.
    /// Joints are matched by name. Whatever is not known is a TODO in the file.
    Init(InitArguments),
}

#[derive(Debug, Args)]
pub struct InitArguments {
    /// Model of the robot: MJCF or URDF
    #[arg(long, value_name = "FILE")]
    pub model: PathBuf,
    /// Policy: an ONNX model
    #[arg(long, value_name = "FILE")]
    pub policy: PathBuf,
    /// IO descriptor of Isaac Lab (YAML), instead of the metadata of the policy
    #[arg(long, value_name = "FILE")]
    pub descriptor: Option<PathBuf>,
    /// Target file to create
    #[arg(long, value_name = "FILE")]
    pub out: PathBuf,
    /// Let the model refer to files outside its folder; the target file says so, too
    #[arg(long)]
    pub allow_outside: bool,
    /// Overwrite an existing file
    #[arg(long)]
    pub force: bool,
}

pub fn run(command: &Arguments) -> Result<ExitStatus> {
    match &command.command {
        TargetCommand::Init(arguments) => init(arguments),
    }
}

fn init(command: &InitArguments) -> Result<ExitStatus> {
    let InitArguments { model, policy, descriptor, out, allow_outside, force } = command;
    anyhow::ensure!(
        out.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("toml")),
        "--out is {}; it must end in .toml",
        out.display()
    );
    let inputs = [model, policy].into_iter().chain(descriptor).map(PathBuf::as_path);
    output::refuse_inputs(out, "--out", inputs)?;
    // An existing file is reported before any work.
    drop(output::create(out, *force)?);
    let descriptor = descriptor.as_deref();
    let file = mishandle::resolve::first_target_file(model, policy, descriptor, out, *allow_outside)?;
    output::write_atomically(out, *force, file.text.as_bytes())?;
    for unknown in &file.unknown {
        output::message(&format!("not known: {unknown}"));
    }
    for remark in &file.remarks {
        output::message(&format!("note: {remark}"));
    }
    output::message(&format!("wrote {0}; next: mishandle targets {0}", out.display()));
    Ok(ExitStatus::Done)
}
