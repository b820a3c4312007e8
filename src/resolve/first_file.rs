//! A first target file from a model, a policy and its description.

use std::path::{Component, Path, PathBuf};

use mishandle_files::{limits, read_text_bounded};
use mishandle_interchange::{OnnxSummary, OnnxTensor};
use mishandle_robots::{FirstFile, FirstPolicy, Measured, Paths, PolicyFacts, PolicySizes, RobotError};
use mishandle_robots::{first_file, isaac_facts, mjlab_facts};
use mishandle_rollout::{Request, Seed};

use crate::error::{MishandleError, invalid};
use crate::plan::Plan;
use crate::resolve::{ResolvedPlan, is_onnx};

/// Names by which exporters call the output with the action.
const ACTION_NAMES: [&str; 2] = ["action", "actions"];

/// Names by which Isaac Lab calls the inputs with the state of a recurrent policy.
const STATES: [&str; 2] = ["h_in", "c_in"];

/// Largest length of the name of a target.
const MAX_NAME: usize = 60;

/// Number of nominal simulations from which the bounds of the formulas follow, if they are random.
const SIMULATIONS: u64 = 20;

/// Spaces whose axes a first target file has from the beginning.
const SPACES: [&str; 3] = ["scenarios", "delay", "sensing"];

/// The files of a first target file.
#[derive(Clone, Copy, Debug)]
pub struct FirstInputs<'a> {
    /// Model of the robot: MJCF or URDF.
    pub model: &'a Path,
    /// An ONNX policy, or a Python program that answers as one.
    pub policy: Option<&'a Path>,
    /// IO descriptor of Isaac Lab, instead of the metadata of the policy.
    pub descriptor: Option<&'a Path>,
    /// Whether the model may refer to files outside its folder.
    pub allow_outside: bool,
}

/// Returns the text of a first target file for the path `out`, from the model of a robot and a
/// policy with the metadata of mjlab or an IO descriptor of Isaac Lab. A model alone gets a law
/// that holds its start. The file is loaded and its nominal scenario simulated, from a draft beside
/// `out`; the bounds of the formulas follow from that. If that is not possible, a remark says why.
///
/// # Errors
/// If a file cannot be read, a description contradicts itself, or the model lacks a joint of the
/// policy.
pub fn first_target_file(inputs: &FirstInputs<'_>, out: &Path) -> Result<FirstFile, MishandleError> {
    let name_of = |path: &Path| path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let is_program = |path: &&Path| path.extension().is_some_and(|extension| extension == "py");
    let program = inputs.policy.filter(is_program);
    let onnx = inputs.policy.filter(|_| program.is_none());
    if let Some(policy) = onnx.filter(|policy| !is_onnx(policy)) {
        let expected = "an ONNX model, FILE.onnx, or a Python program, FILE.py";
        return Err(invalid("the policy", policy.display(), expected));
    }
    if let Some(program) = program {
        std::fs::metadata(program).map_err(MishandleError::file(program))?;
    }
    let summary = onnx.map(OnnxSummary::read).transpose()?;
    let facts = match (inputs.descriptor, onnx.zip(summary.as_ref())) {
        (Some(path), _) => {
            let read = |source| RobotError::Read { path: path.to_path_buf(), source };
            let text = read_text_bounded(path, limits::SETTINGS).map_err(read)?;
            isaac_facts(&text, &name_of(path))?
        }
        (None, Some((policy, summary))) => {
            let source = format!("the metadata of {}", name_of(policy));
            mjlab_facts(&summary.metadata, &source)?.unwrap_or_default()
        }
        (None, None) => PolicyFacts::default(),
    };
    let policy = match (onnx, program) {
        (Some(policy), _) => FirstPolicy::Onnx(path_from(out, policy)),
        (None, Some(program)) => FirstPolicy::Program(vec!["python3".to_string(), path_from(out, program)]),
        (None, None) => FirstPolicy::Law,
    };
    let paths = Paths {
        model: path_from(out, inputs.model),
        policy,
        name: target_name(out),
        allow_outside: inputs.allow_outside,
    };
    let sizes = summary.as_ref().map(sizes).unwrap_or_default();
    let file = |measured: Option<&Measured>| first_file(inputs.model, &paths, &facts, sizes, measured);
    let draft = file(None)?;
    let loaded = with_draft(out, &draft.text, measured).and_then(|found| {
        let written = file(Some(&found)).map_err(|error| error.to_string())?;
        with_draft(out, &written.text, |path| ResolvedPlan::new(&Plan::new(path, "")).map(drop))?;
        Ok(written)
    });
    Ok(loaded.unwrap_or_else(|error| {
        let remark = format!("the file does not load yet: {error}");
        FirstFile { remarks: draft.remarks.into_iter().chain([remark]).collect(), loads: false, ..draft }
    }))
}

/// Does `work` with a file of this text beside `out`, which is removed. An error names `out`.
fn with_draft<T>(
    out: &Path,
    text: &str,
    work: impl FnOnce(&str) -> Result<T, MishandleError>,
) -> Result<T, String> {
    let folder = out.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let file = tempfile::Builder::new().prefix(".draft-").suffix(".toml").tempfile_in(folder);
    let file = file.map_err(|error| error.to_string())?;
    std::fs::write(file.path(), text).map_err(|error| error.to_string())?;
    let draft = file.path().to_string_lossy();
    let named = |said: String| said.replace(&*draft, &out.to_string_lossy());
    work(&draft).map_err(|error| named(format!("{error}")))
}

/// Simulates the nominal scenario of a draft. Returns bounds that its two signals keep with a
/// margin, and the axes that it and every robot has.
fn measured(draft: &str) -> Result<Measured, MishandleError> {
    let resolved = ResolvedPlan::new(&Plan::new(draft, ""))?;
    let target = &resolved.target;
    let repeats = if target.depends_on_seed { SIMULATIONS } else { 1 };
    let nominal = |seed| Request::new(resolved.space.nominal(), Seed(seed));
    let requests: Vec<Request> = (0..repeats).map(nominal).collect();
    let episodes = resolved.system()?.rollout(&requests)?;
    let bound = |index: usize| {
        let values = episodes.iter().flat_map(|episode| episode.trace.column(index)).copied();
        let is_lower = target.formulas.get(index).is_some_and(|formula| formula.text.contains(">="));
        if is_lower {
            let least = values.fold(f64::INFINITY, f64::min);
            least - 0.3 * least.abs()
        } else {
            1.5 * values.fold(0.0, f64::max)
        }
    };
    let bounds = [0, 1].map(|index| two_digits(bound(index)));
    let mut axes: Vec<String> = Vec::new();
    for axis in
        SPACES.iter().filter_map(|name| target.space(name).ok()).flat_map(|space| space.axes().to_vec())
    {
        if !axes.contains(&axis.name) {
            axes.push(axis.name);
        }
    }
    Ok(Measured { bounds, axes })
}

/// Rounds away from zero to two significant digits. `None` if the signal is 0 all the time.
fn two_digits(bound: f64) -> Option<f64> {
    if bound == 0.0 || !bound.is_finite() {
        return None;
    }
    let digit = 10_f64.powf(bound.abs().log10().floor() - 1.0);
    let rounded = (bound / digit).abs().ceil() * digit * bound.signum();
    format!("{rounded:.1e}").parse().ok()
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
