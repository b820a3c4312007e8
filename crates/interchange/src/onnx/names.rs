//! The values that a control step reads and writes: which output is the action.

use std::collections::{HashMap, HashSet};

use rten::Value;
use rten_onnx::onnx::{GraphProto, ModelProto, ValueInfoProto};
use rten_tensor::Layout;

use super::interface::Interface;
use super::policy::{Expected, wrong_shape};
use crate::OnnxProblem;

/// Largest number of tensors of the state.
const MAX_STATES: usize = 100;

/// Largest number of images.
const MAX_IMAGES: usize = 4;

/// Names by which exporters call the output with the action.
const ACTION_NAMES: [&str; 2] = ["action", "actions"];

/// The names of the values that a control step reads and writes.
pub(super) struct Names {
    /// `None` if the policy gets images only.
    pub observation: Option<String>,
    /// Pairs of an input and a camera.
    pub images: Vec<(String, String)>,
    /// Number of the last observations and images that an input may get.
    pub history: Option<usize>,
    /// The outputs that may be the action: the one that the description names, or all that are not
    /// a state.
    pub actions: Vec<String>,
    /// Whether an action is a chunk of several ahead.
    pub is_chunk: bool,
    pub states: Vec<(String, String)>,
}

impl Names {
    pub(super) fn new(proto: &ModelProto, interface: &Interface) -> Result<Names, OnnxProblem> {
        let invalid = |reason: String| OnnxProblem::Interface { place: "by name".to_string(), reason };
        let empty = GraphProto::default();
        let graph = proto.graph.as_ref().unwrap_or(&empty);
        let name = |value: &ValueInfoProto| value.name.clone().unwrap_or_default();
        // Old models list their weights as inputs, too.
        let weights: HashSet<&str> =
            graph.initializer.iter().filter_map(|tensor| tensor.name.as_deref()).collect();
        let inputs: Vec<String> =
            graph.input.iter().map(name).filter(|name| !weights.contains(name.as_str())).collect();
        let outputs: Vec<String> = graph.output.iter().map(name).collect();
        if interface.state.len() > MAX_STATES {
            let found = interface.state.len();
            return Err(invalid(format!("the state has {found} tensors; the limit is {MAX_STATES}")));
        }
        let states =
            if interface.state.is_empty() { recurrent(&inputs, &outputs) } else { interface.state.clone() };
        if interface.history == Some(0) {
            return Err(invalid("`history` is 0; expected the number of observations, at least 1".into()));
        }
        let images = interface.images.clone();
        if images.len() > MAX_IMAGES {
            return Err(invalid(format!("{} inputs are images; the limit is {MAX_IMAGES}", images.len())));
        }
        let free = inputs.iter().find(|name| states.iter().chain(&images).all(|(input, _)| input != *name));
        let observation = interface.observation.clone().or_else(|| free.cloned());
        let free = outputs.iter().filter(|name| states.iter().all(|(_, output)| output != *name));
        let actions = interface.action.clone().map_or_else(|| free.cloned().collect(), |action| vec![action]);
        if observation.is_none() && images.is_empty() || actions.is_empty() {
            return Err(invalid(
                "the model needs an input for the observation or an image, and an output for the action"
                    .into(),
            ));
        }
        let read: Vec<&String> =
            observation.iter().chain(states.iter().chain(&images).map(|(input, _)| input)).collect();
        let written: Vec<&String> = actions.iter().chain(states.iter().map(|(_, o)| o)).collect();
        for (kind, used, known) in [("input", &read, &inputs), ("output", &written, &outputs)] {
            if let Some(missing) = used.iter().find(|name| !known.contains(name)) {
                let known = known.join(", ");
                return Err(invalid(format!("the model has no {kind} `{missing}`; its {kind}s: {known}")));
            }
        }
        if let Some(unused) = inputs.iter().find(|name| !read.contains(name)) {
            return Err(invalid(format!(
                "nothing says what the input `{unused}` is; name the observation, the pairs of inputs and outputs of the \
                 state, and those of inputs and cameras, in the metadata or in a side file (docs/guide/onnx.md); a task has one vector of observations, so join \
                 the inputs of a dictionary in the model"
            )));
        }
        if read.iter().collect::<HashSet<_>>().len() != read.len() {
            return Err(invalid("an input has two roles".into()));
        }
        Ok(Names {
            observation,
            images,
            history: interface.history,
            actions,
            is_chunk: interface.chunk.is_some(),
            states,
        })
    }

    /// Returns the number of actions and their size of a value that can be the action.
    fn action_shape(&self, value: &Value) -> Option<[usize; 2]> {
        match float_shape(value).as_deref() {
            _ if self.is_chunk => chunk_shape(value),
            Some([1, size] | [size]) => Some([1, *size]),
            _ => None,
        }
    }

    /// Returns the output with the action: the one that the description names, the only one, the
    /// one with such a name, or the only one with such a size. Without a size, every vector fits.
    pub(super) fn action(
        &self,
        values: &HashMap<String, Value>,
        size: Option<usize>,
    ) -> Result<&str, OnnxProblem> {
        let missing = self.actions.iter().chain(self.states.iter().map(|(_, output)| output));
        if let Some(missing) = missing.into_iter().find(|name| !values.contains_key(*name)) {
            return Err(OnnxProblem::Format { reason: format!("no operator writes the output `{missing}`") });
        }
        let all: Vec<&String> = self.actions.iter().collect();
        let named: Vec<&String> =
            self.actions.iter().filter(|name| ACTION_NAMES.contains(&name.to_lowercase().as_str())).collect();
        let fits = |name: &&String| {
            let found = values.get(*name).and_then(|value| self.action_shape(value));
            found.is_some_and(|[_, found]| size.is_none_or(|size| size == found))
        };
        let fitting: Vec<&String> = self.actions.iter().filter(fits).collect();
        match (&all[..], &named[..], &fitting[..]) {
            ([action], _, _) | (_, [action], _) | (_, _, [action]) => Ok(action),
            (_, _, fitting) => {
                let found = if fitting.is_empty() { "none" } else { "several" };
                let are = match (self.is_chunk, size) {
                    (false, None) => "are vectors".to_string(),
                    (false, Some(size)) => format!("have {size} numbers"),
                    (true, size) => {
                        format!(
                            "are chunks [N, k, {}]",
                            size.map_or("SIZE".to_string(), |size| size.to_string())
                        )
                    }
                };
                Err(OnnxProblem::Interface {
                    place: "its outputs".to_string(),
                    reason: format!(
                        "nothing says which output is the action: {}; {found} of them {are}; name it by \
                         `action` in the metadata or in a side file (docs/guide/onnx.md), or by \
                         `output = \"NAME\"` in [policy] of a target file",
                        self.actions.join(", ")
                    ),
                })
            }
        }
    }
}

/// Returns the pairs of inputs and outputs that Isaac Lab's exporter of recurrent policies names.
fn recurrent(inputs: &[String], outputs: &[String]) -> Vec<(String, String)> {
    let pairs = [("h_in", "h_out"), ("c_in", "c_out")];
    let has = |names: &[String], name: &str| names.iter().any(|known| known == name);
    let is_there = |(input, output): &(&str, &str)| has(inputs, input) && has(outputs, output);
    let owned = |(input, output): (&str, &str)| (input.to_string(), output.to_string());
    pairs.into_iter().filter(is_there).map(owned).collect()
}

/// Returns the number of actions of a chunk and the size of an action, after a check of the shapes
/// of the action and of the state after a control step.
pub(super) fn check_outputs(
    names: &Names,
    values: &HashMap<String, Value>,
    action: &str,
    states: &[(Vec<usize>, &(String, String))],
    expected: Option<Expected<'_>>,
) -> Result<[usize; 2], OnnxProblem> {
    let fits = |shape: &[usize; 2]| expected.is_none_or(|expected| expected.sizes.1 == shape[1]);
    let shape = values.get(action).and_then(|value| names.action_shape(value)).filter(fits);
    let Some(shape) = shape else {
        let found = values.get(action).map_or("of no tensor".to_string(), type_text);
        let is_chunk = |value: &Value| chunk_shape(value).filter(fits).is_some();
        if names.is_chunk || values.get(action).is_some_and(is_chunk) {
            let reason = if names.is_chunk {
                format!("the output `{action}` has the shape {found}; expected [N, k, SIZE], k actions ahead")
            } else {
                format!(
                    "the output `{action}` has the shape {found}, several actions ahead, and nothing says which are \
                     played; add the key `chunk`, such as {{\"execute\": 1}} or {{\"ensemble\": 0.01}} (docs/guide/onnx.md)"
                )
            };
            return Err(OnnxProblem::Interface { place: "its chunk".to_string(), reason });
        }
        return Err(wrong_shape(expected, "action", action.to_string(), found));
    };
    for (shape, (input, output)) in states {
        let found = values.get(output).and_then(float_shape);
        if found.as_ref() != Some(shape) {
            let found = values.get(output).map_or("no tensor".to_string(), type_text);
            return Err(OnnxProblem::Interface {
                place: "its state".to_string(),
                reason: format!(
                    "the output `{output}` has the shape {found}, but the input `{input}` has {shape:?}"
                ),
            });
        }
    }
    Ok(shape)
}

/// Returns the shape of a value that can be several actions ahead.
fn chunk_shape(value: &Value) -> Option<[usize; 2]> {
    match float_shape(value).as_deref() {
        Some([1, length, size]) => Some([*length, *size]),
        _ => None,
    }
}

/// Returns the shape of a value, and that its numbers are integers if they are.
fn type_text(value: &Value) -> String {
    let integers = if float_shape(value).is_some() { "" } else { " of integers" };
    format!("{:?}{integers}", value.shape().to_vec())
}

fn float_shape(value: &Value) -> Option<Vec<usize>> {
    matches!(value, Value::FloatTensor(_)).then(|| value.shape().to_vec())
}
