mod export;
mod import;

use std::path::PathBuf;

use anyhow::Result;
use clap::{Args, Subcommand};

use crate::exit_status::ExitStatus;

/// Export a controller as ONNX, or import one from PyTorch
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  mishandle controller export point-reaching/ppo --onnx ppo.onnx
  mishandle controller import model.zip --task point-reaching --out model.safetensors

`mishandle show` says how a controller was trained.")]
pub struct Arguments {
    #[command(subcommand)]
    pub command: ControllerCommand,
}

#[derive(Debug, Subcommand)]
pub enum ControllerCommand {
    /// Write a controller as an ONNX model, with its normalizer and the clipping of observations
    /// and actions
    #[command(after_help = "Examples:
  mishandle controller export point-reaching/ppo --onnx ppo.onnx
  mishandle controller export my_controller.safetensors --onnx my_controller.onnx --json

The model's input `observation` has the shape [N, size], in the units of the task. Its output
`action` is clipped to [-1, 1], as the task does; `unclipped_action` is the controller's own output.
Both are the mean of a stochastic policy. `mishandle evaluate TASK --controller ppo.onnx` runs it.")]
    Export {
        /// Path of a controller, or TASK/NAME for a shipped controller
        #[arg(value_name = "FILE|TASK/NAME")]
        controller: String,
        /// ONNX file to create
        #[arg(long, value_name = "FILE")]
        onnx: PathBuf,
        /// Print one JSON document to stdout
        #[arg(long)]
        json: bool,
    },
    /// Make a controller from the weights of a policy of Stable-Baselines3, skrl or PyTorch
    Import(import::Arguments),
}

pub fn run(command: &Arguments) -> Result<ExitStatus> {
    match &command.command {
        ControllerCommand::Export { controller, onnx, json } => export::run(controller, onnx, *json),
        ControllerCommand::Import(command) => import::run(command),
    }
}
