//! Physics engines besides MuJoCo C. They propose scenarios; MuJoCo C gives every verdict.

use std::sync::Arc;

use mishandle_network::NetworkDevice;
use mishandle_rollout::Screening;
use mishandle_world::WorldDevice;

use crate::error::MishandleError;
use crate::plan::Plan;
use crate::resolve::{ResolvedPlan, scene_target};

/// A device besides the CPU, which a front end that has one passes to the questions.
#[derive(Clone)]
pub struct Device {
    /// Worlds that propose simulations, and in which policies train.
    pub worlds: Arc<dyn WorldDevice>,
    /// Networks for the learner of [`train`](crate::train::train()). Without them, the CPU computes
    /// the networks.
    pub networks: Option<Arc<dyn NetworkDevice>>,
}

/// Makes the screening of a plan's simulations on a device, in two batches of half of `rows` worlds
/// each: while the engine steps one of them, the CPU computes the samples and actions of the other.
///
/// # Errors
/// If the target has no scene, or the device cannot simulate it.
pub fn screening(
    resolved: &ResolvedPlan,
    device: &dyn WorldDevice,
    rows: usize,
) -> Result<Screening, MishandleError> {
    let target = scene_target(resolved)?;
    let Plan { risk, evaluate, falsify, .. } = &resolved.plan;
    let simulations = [
        risk.as_ref().map(|table| table.simulations as usize),
        evaluate.as_ref().map(|table| table.episodes as usize),
        falsify.as_ref().map(|table| table.trials as usize * table.budget as usize),
    ];
    // More worlds than simulations would be idle.
    let rows = rows.min(simulations.into_iter().flatten().max().unwrap_or(rows)).max(1);
    let halves = [rows.div_ceil(2), rows / 2];
    let space = &resolved.space;
    let specification = &resolved.specification;
    let batches =
        target.batches(space, specification, device, halves.into_iter().filter(|rows| *rows > 0))?;
    let environment = target.environment(space, specification, false)?;
    let rollout = target.system_in(environment, space, specification)?;
    Ok(Screening::new(rollout, batches))
}
