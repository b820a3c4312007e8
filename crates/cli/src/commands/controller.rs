mod export;
mod import;

use std::path::{Path, PathBuf};

use anyhow::{Result, bail, ensure};
use clap::Args;
use mishandle::plan::ImportSettings;
use mishandle::resolve::is_onnx;

use crate::exit_status::ExitStatus;
use crate::flags;

/// Export a controller as ONNX, or import one from PyTorch
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  mishandle controller point-reaching/ppo --out ppo.onnx
  mishandle controller sac.zip --task point-reaching --out a.safetensors
  mishandle controller sac.zip --task point-reaching --out a.safetensors -k import.normalizer=n.json
  mishandle controller agent.pt --task point-reaching --out a.safetensors -k import.activation=elu

The ONNX model has the normalizer and the clipping of observations and actions. Its input
`observation` has the shape [N, size], in the units of the task. Its output `action` is clipped to
[-1, 1], as the task does; `unclipped_action` is the controller's own output. Both are the mean of a
stochastic policy. `mishandle evaluate TASK --controller ppo.onnx` runs it.

A policy to import is a model of Stable-Baselines3 (PPO, A2C, SAC, TD3, DDPG), a checkpoint of skrl,
or a state dictionary written by `torch.save(model.state_dict(), FILE)`. It must be a multi-layer
perceptron that acts as a controller can; other policies are refused with the reason and run as
ONNX. Weights and texts are read: nothing in the file is unpickled or executed. docs/guide/import.md
shows how to write the statistics of a VecNormalize. `mishandle show` says how a controller was
trained.")]
pub struct Arguments {
    /// Path of a controller, or TASK/NAME for a shipped controller; to import: a model or
    /// checkpoint (.zip, .pt, .pth)
    #[arg(value_name = "FILE|TASK/NAME")]
    pub controller: String,
    /// Task of a policy to import; `mishandle list tasks` lists them
    #[arg(long, value_name = "TASK")]
    pub task: Option<String>,
    /// File to create: an ONNX model (.onnx), or the controller of an imported policy
    /// (.safetensors)
    #[arg(long, value_name = "FILE")]
    pub out: PathBuf,
    /// Print one JSON document to stdout
    #[arg(long)]
    pub json: bool,
    #[command(flatten)]
    pub keys: flags::SettingKeys,
}

pub fn run(command: &Arguments) -> Result<ExitStatus> {
    let settings = command.keys.settings("controller")?.import;
    let out = command.out.as_path();
    let is_import = out.extension().is_some_and(|found| found == "safetensors");
    ensure!(
        is_import || is_onnx(out),
        "expected a path that ends in .onnx or .safetensors, found: {}",
        out.display()
    );
    match (&command.task, is_import) {
        (Some(task), true) => import::run(Path::new(&command.controller), task, out, &settings, command.json),
        (None, true) => bail!("--task is missing: an imported policy does not say its task"),
        (Some(_), false) => bail!("--task is for a policy to import; a controller knows its task"),
        (None, false) => {
            ensure!(
                settings == ImportSettings::default(),
                "the keys of import are for a policy to import; leave them out"
            );
            export::run(&command.controller, out, command.json)
        }
    }
}
