use std::io::Write;

use anyhow::{Context, Result};
use mishandle::interchange::ImportOptions;
use mishandle::plural;
use serde_json::json;

use crate::ExitStatus;
use crate::args::ImportController;
use crate::output;

pub fn run(command: &ImportController) -> Result<ExitStatus> {
    let activation = command.activation.as_deref().map(str::parse).transpose().context("--activation")?;
    let output_activation =
        command.output_activation.as_deref().map(str::parse).transpose().context("--output-activation")?;
    let normalizer = command.normalizer.as_deref().map(mishandle::read_normalizer).transpose()?;
    let options = ImportOptions { activation, output_activation, normalizer };
    let file = mishandle::import_controller(&command.file, &command.task, &options)?;
    output::write_new(&command.out, |out| Ok(out.write_all(&file.to_bytes())?))?;
    let network = file.policy.network();
    let (hidden, last) = (network.hidden_activation().to_string(), network.output_activation().to_string());
    let layers = network.sizes().len() - 1;
    let norm = if network.has_layer_norm() { ", layer normalization" } else { "" };
    output::message(&format!(
        "wrote {}: {}, {}; activations {hidden} and {last}{norm}",
        command.out.display(),
        file.header.training.command,
        plural(layers, "layer"),
    ));
    if command.json {
        output::json(json!({
            "file": command.out.display().to_string(),
            "task": file.header.task,
            "source": file.header.training.command,
            "sizes": network.sizes(),
            "hidden_activation": hidden,
            "output_activation": last,
            "layer_norm": network.has_layer_norm(),
            "normalized": command.normalizer.is_some() || file.policy.observation_clip().is_some(),
            "observation_clip": file.policy.observation_clip(),
            "controller_hash": file.policy.hash(),
        }))?;
    }
    Ok(ExitStatus::Done)
}
