use std::io::Write;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use clap::Args;
use mishandle::interchange::{ImportOptions, Normalization};
use mishandle::results::ControllerImport;
use mishandle_text::plural;

use crate::exit_status::ExitStatus;
use crate::show::output;

#[derive(Debug, Args)]
#[command(after_help = "Examples:
  mishandle controller import model.zip --task point-reaching --out a.safetensors
  mishandle controller import model.zip --task point-reaching --out a.safetensors \\
      --normalizer n.json
  mishandle controller import agent.pt --task point-reaching --out a.safetensors --activation elu

FILE is a model of Stable-Baselines3 (PPO, A2C, SAC, TD3, DDPG), a checkpoint of skrl, or a state
dictionary written by `torch.save(model.state_dict(), FILE)`. Its policy must be a multi-layer
perceptron that acts as a controller can; other policies are refused with the reason and run as
ONNX. Weights and texts are read: nothing in the file is unpickled or executed. docs/guide/import.md
shows how to write the statistics of a VecNormalize.")]
pub struct Arguments {
    /// Model or checkpoint: .zip, .pt or .pth
    pub file: PathBuf,
    /// Task of the controller; `mishandle list tasks` lists them
    #[arg(long)]
    pub task: String,
    /// Controller file to create
    #[arg(long, value_name = "FILE")]
    pub out: PathBuf,
    /// Activation of the hidden layers: elu, relu, tanh, silu, gelu, leaky_relu or identity
    /// [default: that of the file, if it says so]
    #[arg(long, value_name = "NAME")]
    pub activation: Option<String>,
    /// Activation of the last layer, by the same names [default: that of the algorithm, if the file
    /// shows it]
    #[arg(long, value_name = "NAME")]
    pub output_activation: Option<String>,
    /// JSON file with the statistics that normalize observations (mean, variance, epsilon, clip),
    /// or `none` if observations were not normalized [default: the statistics in the file]
    #[arg(long, value_name = "FILE|none")]
    pub normalizer: Option<PathBuf>,
    /// Print one JSON document to stdout
    #[arg(long)]
    pub json: bool,
}

pub fn run(command: &Arguments) -> Result<ExitStatus> {
    let activation = command.activation.as_deref().map(str::parse).transpose().context("--activation")?;
    let output_activation =
        command.output_activation.as_deref().map(str::parse).transpose().context("--output-activation")?;
    let normalizer = match command.normalizer.as_deref() {
        None => Normalization::OfFile,
        Some(path) if path == Path::new("none") => Normalization::Nothing,
        Some(path) => Normalization::Given(mishandle::resolve::read_normalizer(path)?),
    };
    let options = ImportOptions { activation, output_activation, normalizer };
    let is_given = matches!(options.normalizer, Normalization::Given(_));
    let file = mishandle::resolve::import_controller(&command.file, &command.task, &options)?;
    let is_normalized = is_given || file.policy.observation_clip().is_some();
    output::write_new(&command.out, |out| Ok(out.write_all(&file.to_bytes())?))?;
    let network = file.policy.network();
    let hidden = network.hidden_activation().to_string();
    let last = network.output_activation().to_string();
    let layers = network.sizes().len() - 1;
    let norm = if network.has_layer_norm() { ", layer normalization" } else { "" };
    let normalized = if is_normalized { "normalized" } else { "not normalized" };
    output::message(&format!(
        "wrote {}: {}, {}; activations {hidden} and {last}{norm}; observations are {normalized}",
        command.out.display(),
        file.header.training.command,
        plural(layers, "layer"),
    ));
    if command.json {
        output::json(&ControllerImport {
            file: command.out.display().to_string(),
            task: file.header.task.clone(),
            source: file.header.training.command.clone(),
            sizes: network.sizes().iter().map(|size| *size as u64).collect(),
            hidden_activation: hidden,
            output_activation: last,
            layer_norm: network.has_layer_norm(),
            normalized: is_normalized,
            observation_clip: file.policy.observation_clip(),
            controller_hash: file.policy.hash(),
        })?;
    }
    Ok(ExitStatus::Done)
}
