//! Which input of a model is the observation, which output the action, and which pairs are the
//! state.
//!
//! The model's metadata has the keys `mishandle.task`, `mishandle.observation`, `mishandle.parts`,
//! `mishandle.images`, `mishandle.history`, `mishandle.padding`, `mishandle.action`,
//! `mishandle.action_interface`, `mishandle.chunk`, `mishandle.state` and `mishandle.layout`. A
//! file `NAME.onnx.json` beside `NAME.onnx` has the same keys without the prefix and replaces them.

use mishandle_controllers::{ActionInterface, Layout};
use rten_onnx::onnx::ModelProto;
use serde::{Deserialize, Serialize};

use super::chunk::Chunk;
use super::history::Padding;
use super::{OnnxDescription, PREFIX, PROVENANCE};
use crate::OnnxProblem;

/// The description of a model's inputs and outputs. Everything is optional.
///
/// # Example
/// ```
/// use mishandle_interchange::Interface;
/// let text = r#"{"task": "ball-balancing", "action": "mean", "state": [["h_in", "h_out"]]}"#;
/// let interface = Interface::from_json(text).unwrap();
/// assert_eq!(interface.action.as_deref(), Some("mean"));
/// assert!(Interface::from_json(r#"{"output": "mean"}"#).is_err());
/// ```
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Interface {
    /// The name of the task; without it, the model is accepted for every task that its shapes fit.
    pub task: Option<String>,
    /// The input for the observation; the first input that is neither a state nor an image by
    /// default.
    pub observation: Option<String>,
    /// The parts of an observation that the policy gets, in their order; all by default.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub parts: Option<Vec<String>>,
    /// Pairs of an input and the camera whose image it gets.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub images: Vec<(String, String)>,
    /// Number of the last observations and images, with the present ones, that inputs of the shape
    /// `[N, k, …]` get; the oldest first.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub history: Option<usize>,
    /// The observations and images before the start of an episode.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub padding: Option<Padding>,
    /// The output with the action. By default, of the outputs that are not a state: the only one,
    /// the one with the name `action` or `actions`, or the only one with the size of an action.
    pub action: Option<String>,
    /// How actions become joint targets; they move the targets directly by default.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub action_interface: Option<ActionInterface>,
    /// Use of the actions of a model that predicts several ahead: its output with the action has
    /// the shape `[N, k, size]`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub chunk: Option<Chunk>,
    /// Pairs of an input and the output that replaces it in the next control step. The initial
    /// value is 0.
    #[serde(default)]
    pub state: Vec<(String, String)>,
    /// The order, names, units and sizes of observations and actions, compared with those of the
    /// task.
    pub layout: Option<Layout>,
}

impl From<Interface> for OnnxDescription {
    fn from(interface: Interface) -> OnnxDescription {
        let Interface { task, parts, layout, action_interface, .. } = interface;
        let of_layout = layout.into_iter().flat_map(|layout| layout.observation);
        let mut parts = parts.unwrap_or_default();
        parts.extend(of_layout.map(|entry| entry.name));
        OnnxDescription { task, parts, action_interface }
    }
}

impl Interface {
    /// Parses the text of a side file.
    ///
    /// # Errors
    /// If the text is not JSON, or a key is unknown.
    pub fn from_json(text: &str) -> Result<Interface, serde_json::Error> {
        serde_json::from_str(text)
    }

    /// Reads the metadata of a model.
    pub(super) fn of_metadata(model: &ModelProto) -> Result<Interface, OnnxProblem> {
        let invalid = |reason: String| OnnxProblem::Interface { place: "its metadata".to_string(), reason };
        let mut interface = Interface::default();
        for property in &model.metadata_props {
            let Some(key) = property.key.as_deref().and_then(|key| key.strip_prefix(PREFIX)) else {
                continue;
            };
            let value = property.value.clone().unwrap_or_default();
            let json = |error: serde_json::Error| invalid(format!("`{PREFIX}{key}`: {error}"));
            match key {
                "task" => interface.task = Some(value),
                "observation" => interface.observation = Some(value),
                "parts" => interface.parts = Some(serde_json::from_str(&value).map_err(json)?),
                "images" => interface.images = serde_json::from_str(&value).map_err(json)?,
                "history" => interface.history = Some(serde_json::from_str(&value).map_err(json)?),
                "padding" => {
                    interface.padding = Some(serde_json::from_value(value.into()).map_err(json)?);
                }
                "action" => interface.action = Some(value),
                "action_interface" => {
                    interface.action_interface = Some(serde_json::from_str(&value).map_err(json)?);
                }
                "chunk" => interface.chunk = Some(serde_json::from_str(&value).map_err(json)?),
                "state" => interface.state = serde_json::from_str(&value).map_err(json)?,
                "layout" => interface.layout = Some(serde_json::from_str(&value).map_err(json)?),
                _ if PROVENANCE.contains(&key) => {}
                _ => {
                    return Err(invalid(format!(
                        "there is no key `{PREFIX}{key}`; known keys: task, observation, parts, images, history, padding, action, action_interface, chunk, state, layout"
                    )));
                }
            }
        }
        Ok(interface)
    }
}
