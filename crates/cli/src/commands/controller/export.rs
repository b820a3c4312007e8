use std::io::Write;
use std::path::Path;

use anyhow::Result;
use mishandle::build::VERSION;
use mishandle::interchange::onnx_bytes;
use mishandle::results::ControllerExport;

use crate::exit_status::ExitStatus;
use crate::show::output;

pub fn run(controller: &str, onnx: &Path, json: bool) -> Result<ExitStatus> {
    let file = mishandle::resolve::find_controller(controller)?.controller()?;
    output::write_new(onnx, |out| Ok(out.write_all(&onnx_bytes(&file, VERSION))?))?;
    output::message(&format!("wrote {}", onnx.display()));
    if json {
        let layout = &file.header.layout;
        output::json(&ControllerExport {
            file: onnx.display().to_string(),
            task: file.header.task.clone(),
            algorithm: file.header.algorithm.clone(),
            controller_hash: file.hash(),
            observation_size: layout.observation_size() as u64,
            action_size: layout.action_size() as u64,
        })?;
    }
    Ok(ExitStatus::Done)
}
