//! The metadata that mjlab's exporter writes into an ONNX model: keys without a prefix, lists as
//! text with commas, lists inside of them with semicolons, three decimals.

use crate::error::RobotError;
use crate::init::facts::{ActionKind, PartFacts, PolicyFacts, Tool, check_length, wrong};

/// Returns the facts of the metadata of a model; `None` if mjlab did not write it.
///
/// # Errors
/// If a value is not a list of numbers, or two lists have different lengths.
pub fn mjlab_facts(metadata: &[(String, String)], source: &str) -> Result<Option<PolicyFacts>, RobotError> {
    let get = |key: &str| metadata.iter().find(|(known, _)| known == key).map(|(_, value)| value.as_str());
    let Some(joints) = get("joint_names") else { return Ok(None) };
    let joints = names(joints);
    let numbers = |key: &str| match get(key) {
        None => Ok(None),
        Some(text) => numbers(text)
            .map(Some)
            .ok_or_else(|| wrong(source, format!("`{key}` is not a list of numbers: {text}"))),
    };
    let default = numbers("default_joint_pos")?.unwrap_or_default();
    if !default.is_empty() {
        check_length(source, "default_joint_pos", default.len(), joints.len())?;
    }
    let gains = match [numbers("joint_stiffness")?, numbers("joint_damping")?] {
        [Some(stiffness), Some(damping)] => {
            check_length(source, "joint_damping", damping.len(), stiffness.len())?;
            Some([stiffness, damping])
        }
        _ => None,
    };
    let mut remarks = Vec::new();
    let part_names = names(get("observation_names").unwrap_or_default());
    // Nothing for an entry that is not a list of numbers.
    let lists = |key: &str| -> Vec<Option<Vec<f64>>> {
        get(key).unwrap_or_default().split(',').map(|entry| list(entry, ';')).collect()
    };
    let scales = lists("observation_terms_scale");
    let clips = lists("observation_terms_clip");
    let histories = lists("observation_terms_history_length");
    let part = |(index, name): (usize, String)| {
        let entry = |lists: &[Option<Vec<f64>>]| lists.get(index).cloned().unwrap_or(Some(Vec::new()));
        let scale = entry(&scales);
        let clip = entry(&clips);
        let history = entry(&histories);
        let is_unclear = scale.is_none() || clip.is_none() || history.is_none();
        let scale = scale.unwrap_or_default();
        let clip = match clip.unwrap_or_default().as_slice() {
            [low, high] if low.is_finite() || high.is_finite() => Some([*low, *high]),
            _ => None,
        };
        let history = history.unwrap_or_default().first().copied().unwrap_or(0.0) as usize;
        PartFacts {
            is_unclear,
            is_relative: name.starts_with("joint_").then_some(true),
            name,
            scale: if scale.iter().all(|factor| *factor == 1.0) { Vec::new() } else { scale },
            clip,
            history,
            ..PartFacts::default()
        }
    };
    let parts = part_names.into_iter().enumerate().map(part).collect();
    let commands = names(get("command_names").unwrap_or_default());
    if commands.len() > 1 {
        remarks.push(format!("the policy has several commands: {}", commands.join(", ")));
    }
    let gains_only = gains.as_ref().map(|[stiffness, _]| stiffness.len());
    Ok(Some(PolicyFacts {
        source: source.to_string(),
        tool: Tool::Mjlab,
        // The exporter does not say which of the joints have actuators, unless all have.
        joints: if gains_only.is_none_or(|count| count == joints.len()) {
            joints.clone()
        } else {
            Vec::new()
        },
        default: joints.iter().cloned().zip(default).collect(),
        observed_joints: joints,
        scale: numbers("action_scale")?.unwrap_or_default(),
        gains,
        action: ActionKind::Position,
        parts,
        is_rounded: true,
        remarks,
        ..PolicyFacts::default()
    }))
}

fn names(text: &str) -> Vec<String> {
    text.split(',').map(str::trim).filter(|name| !name.is_empty()).map(String::from).collect()
}

fn numbers(text: &str) -> Option<Vec<f64>> {
    list(text, ',').filter(|numbers| numbers.iter().all(|number| number.is_finite()))
}

fn list(text: &str, separator: char) -> Option<Vec<f64>> {
    let text = text.trim();
    if text.is_empty() {
        Some(Vec::new())
    } else {
        text.split(separator).map(|number| number.trim().parse().ok()).collect()
    }
}
