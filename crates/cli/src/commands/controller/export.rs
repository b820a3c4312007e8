use std::io::Write;
use std::path::Path;

use anyhow::Result;
use mishandle::VERSION;
use mishandle::interchange::onnx_bytes;
use serde_json::json;

use crate::exit_status::ExitStatus;
use crate::show::output;

pub fn run(controller: &str, onnx: &Path, json: bool) -> Result<ExitStatus> {
    let file = mishandle::find_controller(controller)?.controller()?;
    output::write_new(onnx, |out| Ok(out.write_all(&onnx_bytes(&file, VERSION))?))?;
    output::message(&format!("wrote {}", onnx.display()));
    if json {
        let layout = &file.header.layout;
        output::json(json!({
            "file": onnx.display().to_string(),
            "task": file.header.task,
            "algorithm": file.header.algorithm,
            "controller_hash": file.policy.hash(),
            "observation_size": layout.observation_size(),
            "action_size": layout.action_size(),
        }))?;
    }
    Ok(ExitStatus::Done)
}
