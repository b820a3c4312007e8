//! Target and settings of a resolved plan, as text and as JSON.

use mishandle::ResolvedPlan;
use serde_json::{Value, json};

use super::escape;
use super::scenario::{axes, axis_text};

/// Returns a one-line description of target and settings.
pub fn heading(resolved: &ResolvedPlan) -> String {
    let ResolvedPlan { plan, space, .. } = resolved;
    let mut text = plan.target.clone();
    if !plan.controller.is_empty() {
        text.push_str(&format!(
            ", controller {}, task preset {}",
            escape::name(&plan.controller),
            plan.preset
        ));
    }
    if plan.space != "starts" {
        text.push_str(&format!(", space {} ({})", plan.space, axes(space.free_dimension())));
    }
    for axis in space.axes().iter().filter(|axis| plan.axes.contains_key(&axis.name)) {
        text.push_str(&match axis.is_fixed() {
            true => format!(", {}", axis_text(axis, Some(axis.low))),
            false => {
                let unit = if axis.unit.is_empty() { String::new() } else { format!(" {}", axis.unit) };
                format!(", {} from {} to {}{unit}", axis.name, axis.low, axis.high)
            }
        });
    }
    if plan.action_noise > 0.0 {
        text.push_str(&format!(", action noise {}", plan.action_noise));
    }
    if plan.observation_noise > 0.0 {
        text.push_str(&format!(", observation noise {}", plan.observation_noise));
    }
    if plan.stochastic {
        text.push_str(", sampled actions");
    }
    text
}

/// Returns the keys that the JSON documents of `evaluate` and `falsify` share.
pub fn document(resolved: &ResolvedPlan, path: &str) -> Value {
    let ResolvedPlan { plan, target, space, .. } = resolved;
    let controller = target.components.first();
    json!({
        "run": path,
        "target": plan.target,
        "task": plan.target,
        "target_kind": target.identity.kind,
        "target_hash": target.identity.hash,
        "preset": controller.is_some().then_some(&plan.preset),
        "controller": controller.map(|controller| &controller.name),
        "controller_hash": controller.map(|controller| &controller.hash),
        "stochastic": plan.stochastic,
        "action_noise": plan.action_noise,
        "observation_noise": plan.observation_noise,
        "seed": plan.seed.to_string(),
        "space": plan.space,
        "axes": space.axes().iter().map(|axis| &axis.name).collect::<Vec<_>>(),
    })
}

/// Returns the keys that describe target and plan.
pub fn document_without_run(resolved: &ResolvedPlan) -> Value {
    let mut document = document(resolved, "");
    if let Some(keys) = document.as_object_mut() {
        keys.remove("run");
    }
    document
}
