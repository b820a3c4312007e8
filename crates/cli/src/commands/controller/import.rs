use std::io::Write;
use std::path::Path;

use anyhow::Result;
use mishandle::plan::ImportSettings;
use mishandle::results::ControllerImport;
use mishandle_text::plural;

use crate::exit_status::ExitStatus;
use crate::show::output;

pub fn run(file: &Path, task: &str, out: &Path, settings: &ImportSettings, json: bool) -> Result<ExitStatus> {
    let file = mishandle::resolve::import_controller(file, task, settings)?;
    let normalizer = settings.normalizer.as_deref();
    let is_given = normalizer.is_some_and(|path| path != ImportSettings::NO_NORMALIZER);
    let is_normalized = is_given || file.policy.observation_clip().is_some();
    output::write_new(out, |out| Ok(out.write_all(&file.to_bytes())?))?;
    let network = file.policy.network();
    let hidden = network.hidden_activation().to_string();
    let last = network.output_activation().to_string();
    let layers = network.sizes().len() - 1;
    let norm = if network.has_layer_norm() { ", layer normalization" } else { "" };
    let normalized = if is_normalized { "normalized" } else { "not normalized" };
    output::message(&format!(
        "wrote {}: {}, {}; activations {hidden} and {last}{norm}; observations are {normalized}",
        out.display(),
        file.header.training.command,
        plural(layers, "layer"),
    ));
    if json {
        output::json(&ControllerImport {
            file: out.display().to_string(),
            task: file.header.task.clone(),
            source: file.header.training.command.clone(),
            sizes: network.sizes().iter().map(|size| *size as u64).collect(),
            hidden_activation: hidden,
            output_activation: last,
            layer_norm: network.has_layer_norm(),
            normalized: is_normalized,
            observation_clip: file.policy.observation_clip(),
            controller_hash: file.hash(),
        })?;
    }
    Ok(ExitStatus::Done)
}
