//! A first target file from a model, a policy and its description.

use std::path::{Component, Path, PathBuf};

use mishandle_files::{limits, read_text_bounded};
use mishandle_interchange::{OnnxSummary, OnnxTensor};
use mishandle_robots::{FirstFile, Paths, PolicySizes, RobotError};
use mishandle_robots::{first_file, isaac_facts, mjlab_facts};

use crate::error::{MishandleError, invalid};
use crate::resolve::is_onnx;

/// Names by which exporters call the output with the action.
const ACTION_NAMES: [&str; 2] = ["action", "actions"];

/// Names by which Isaac Lab calls the inputs with the state of a recurrent policy.
const STATES: [&str; 2] = ["h_in", "c_in"];

/// Largest length of the name of a target.
const MAX_NAME: usize = 60;

/// Writes the text of a first target file for the path `out`, from the model of a robot and an ONNX
/// policy with the metadata of mjlab or an IO descriptor of Isaac Lab. With `allow_outside`, the
/// model may refer to files outside its folder. Nothing is written to disk.
///
/// # Errors
/// If a file cannot be read, a description contradicts itself, or the model lacks a joint of the
/// policy.
pub fn first_target_file(
    model: &Path,
    policy: &Path,
    descriptor: Option<&Path>,
    out: &Path,
    allow_outside: bool,
) -> Result<FirstFile, MishandleError> {
    if !is_onnx(policy) {
        return Err(invalid("the policy", policy.display(), "an ONNX model, FILE.onnx"));
    }
    let summary = OnnxSummary::read(policy)?;
    let name_of = |path: &Path| path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let facts = match descriptor {
        Some(path) => {
            let read = |source| RobotError::Read { path: path.to_path_buf(), source };
            let text = read_text_bounded(path, limits::SETTINGS).map_err(read)?;
            isaac_facts(&text, &name_of(path))?
        }
        None => {
            let source = format!("the metadata of {}", name_of(policy));
            mjlab_facts(&summary.metadata, &source)?.unwrap_or_default()
        }
    };
    let paths = Paths {
        model: path_from(out, model),
        policy: path_from(out, policy),
        name: target_name(out),
        allow_outside,
    };
    Ok(first_file(model, &paths, &facts, sizes(&summary))?)
}

/// Returns the numbers of inputs and outputs that the shapes of a model give.
fn sizes(summary: &OnnxSummary) -> PolicySizes {
    let last = |tensor: &OnnxTensor| tensor.shape.last().copied().flatten();
    let is_state = |tensor: &&OnnxTensor| STATES.contains(&tensor.name.as_str());
    let inputs: Vec<&OnnxTensor> = summary.inputs.iter().filter(|input| !is_state(input)).collect();
    let observation = match inputs.as_slice() {
        [input] => last(input),
        _ => None,
    };
    let is_action = |tensor: &&OnnxTensor| ACTION_NAMES.contains(&tensor.name.to_lowercase().as_str());
    let action = match summary.outputs.as_slice() {
        [output] => last(output),
        several => several.iter().find(is_action).and_then(last),
    };
    PolicySizes { observation, action }
}

/// Returns a path as a file at `out` names it: relative to its folder.
fn path_from(out: &Path, file: &Path) -> String {
    let absolute = |path: &Path| path.canonicalize().unwrap_or_else(|_| path.to_path_buf());
    let folder = out.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let folder: PathBuf = absolute(folder);
    let file: PathBuf = absolute(file);
    let common = folder.components().zip(file.components()).take_while(|(a, b)| a == b).count();
    let up = folder.components().skip(common).map(|_| Component::ParentDir);
    let down = file.components().skip(common);
    up.chain(down).collect::<PathBuf>().to_string_lossy().into_owned()
}

/// Returns the name of a target in a file with this path.
fn target_name(out: &Path) -> String {
    let stem = out.file_stem().unwrap_or_default().to_string_lossy();
    let letter = |c: char| if c.is_ascii_alphanumeric() || c == '-' || c == '_' { c } else { '-' };
    let name: String = stem.chars().take(MAX_NAME).map(letter).collect();
    if name.is_empty() { "robot".to_string() } else { name }
}
