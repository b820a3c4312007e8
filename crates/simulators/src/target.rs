//! A simulator as a target.

use std::sync::Arc;

use mishandle_rollout::{
    Axis, AxisKind, Component, ControlLoop, Controller, Disturbance, Identity, LoopSpaces, Noise,
    RolloutError, Space, Specification, System, Target, distinct,
};

use crate::simulator::Simulator;
use crate::system::{Controlled, ProcessSystem};

/// Kind of the targets that are programs.
pub const KIND: &str = "process";

/// Role of the component that is the program.
pub const SIMULATOR: &str = "simulator";

/// A controller, and its identity.
pub type IdentifiedController = (Arc<dyn Controller>, Vec<Component>);

/// Returns the target of a simulator, with the controller that acts in it if it has a policy.
///
/// # Errors
/// If the controller does not fit, or an axis has the name of a disturbance that every simulator
/// with a policy has.
pub fn target(
    simulator: Arc<Simulator>,
    controller: Option<IdentifiedController>,
    noise: Noise,
) -> Result<Target, RolloutError> {
    noise.check()?;
    let description = simulator.description().clone();
    let disturbances: Vec<Disturbance> =
        description.policy.as_ref().map_or(Vec::new(), ControlLoop::disturbances);
    let axes = distinct(description.axes.iter().chain(disturbances.iter().map(|d| &d.axis)));
    let hidden = disturbances.iter().find(|d| description.axes.iter().any(|own| own.name == d.axis.name));
    if let Some(hidden) = hidden {
        let what =
            "every simulator with a policy has this axis already; give the one of the simulator another name";
        return Err(RolloutError::Axis { axis: hidden.axis.name.clone(), what });
    }
    let spaces = spaces(&description.spaces, &description.axes, &disturbances)?;
    let random = disturbances.iter().filter(|d| d.effect.is_random()).map(|d| d.axis.name.clone()).collect();
    let own = Component {
        role: SIMULATOR.to_string(),
        name: description.name.clone(),
        hash: simulator.hash().to_string(),
        file_hash: String::new(),
    };
    let (controller, components) = controller.unzip();
    let components = components.unwrap_or_default();
    let controller_hash =
        if controller.is_some() { Component::joint_hash(&components) } else { String::new() };
    let content = format!("{}\n{controller_hash}\n{noise:?}", simulator.hash());
    let controller_signals = controller.as_ref().map_or(Vec::new(), |own| own.signals().to_vec());
    let controlled = controller.map(|controller| Controlled { controller, noise, disturbances });
    let has_noise = controlled.is_some() && (noise.action_std > 0.0 || noise.observation_std > 0.0);
    Ok(Target {
        identity: Identity::new(KIND, &description.name, &content),
        components: components.into_iter().chain([own]).collect(),
        axes,
        spaces,
        signals: description.signals,
        signals_on_request: Vec::new(),
        controller_signals,
        formulas: description.formulas,
        control_dt: description.control_dt,
        episode_steps: description.steps,
        is_deterministic: description.is_deterministic,
        can_fail: true,
        depends_on_seed: description.depends_on_seed || !description.is_deterministic || has_noise,
        random_axes: random,
        versions: description.versions,
        reachable: None,
        factory: Arc::new(move |space: &Space, specification: &Specification| {
            let system = ProcessSystem::new(simulator.clone(), controlled.clone(), space, specification)?;
            Ok(Box::new(system) as Box<dyn System>)
        }),
        solver_variants: Vec::new(),
    })
}

/// Returns the spaces of the simulator, then the space `disturbance` of all that can disturb it,
/// and those of the loop with its policy.
fn spaces(own: &[Space], axes: &[Axis], disturbances: &[Disturbance]) -> Result<Vec<Space>, RolloutError> {
    let LoopSpaces { timing_and_sensing, steady, faults } = LoopSpaces::new(disturbances);
    let of_model = axes.iter().filter(|axis| matches!(axis.kind, AxisKind::Model | AxisKind::Event));
    let mut spaces = own.to_vec();
    let disturbance = ("disturbance".to_string(), distinct(steady.iter().chain(of_model)));
    for (name, axes) in timing_and_sensing.into_iter().chain([disturbance]).chain(faults) {
        if !axes.is_empty() && own.iter().all(|space| space.name() != name) {
            spaces.push(Space::new(&name, axes)?);
        }
    }
    Ok(spaces)
}
