//! Full traces: joint positions and velocities, actions and contact forces, in addition to the
//! signals.

use std::sync::Arc;

use mishandle_rollout::{Episode, System};
use mishandle_store::TraceColumn;

use crate::error::{Compared, MishandleError, RunError};
use crate::picture::recording::{Recording, RecordingEnvironment};
use crate::resolve::{ResolvedPlan, scene_target};

/// Simulates an episode of a target with a scene again and returns what its trace does not contain,
/// one value per sample.
///
/// The columns are `q_NAME` and `dq_NAME` (position and velocity of each joint; of a free body,
/// position and linear velocity in world axes, the quaternion, and the angular velocity in body
/// axes), `action_NAME` (the action of each joint of a task, or each action of a target file by its
/// number, as it was applied in the control step from this sample to the next, after noise and
/// disturbances; missing at the last sample), `contact_A_B` (norm of the net contact force between
/// two parts of the scene, N), `contact_largest` (largest force at a single contact point, N), and
/// the signals on request that `episode` does not have.
///
/// For a target file, each body is a part, and before the actions are `control_NAME` and
/// `force_NAME` of each actuator (N or N m; the force that it would have in this state), and
/// `x_NAME`, `y_NAME` and `z_NAME` of each body.
///
/// # Errors
/// If the target has no scene, or the simulation gives other signals than `episode` has.
pub fn full_trace(resolved: &ResolvedPlan, episode: &Episode) -> Result<Vec<TraceColumn>, MishandleError> {
    let target = scene_target(resolved)?;
    let environment = target.environment(&resolved.space, &resolved.specification, true)?;
    let (recorder, recording) = RecordingEnvironment::new(environment.clone());
    let mut system = target.system_in(Arc::new(recorder), &resolved.space, &resolved.specification)?;
    let again = system.rollout(std::slice::from_ref(&episode.request))?.pop();
    let again = again.ok_or(MishandleError::Run(RunError::NoEpisode))?;
    // The signals on request stand between others.
    let recorded = episode.trace.names();
    let bits = |episode: &Episode| -> Vec<Option<Vec<u64>>> {
        let bits = |values: &[f64]| values.iter().map(|value| value.to_bits()).collect();
        recorded.iter().map(|name| episode.trace.signal(name).map(bits)).collect()
    };
    if bits(&again) != bits(episode) {
        return Err(MishandleError::differs(Compared::Plan, vec!["trace of the full recording".into()]));
    }
    let Recording { states, actions, .. } = recording.only();
    let mut full_state = environment.full_state()?;
    let mut columns: Vec<TraceColumn> = full_state
        .columns()
        .into_iter()
        .map(|(name, unit)| TraceColumn { name, unit: unit.to_string(), values: Vec::new() })
        .collect();
    let mut values = Vec::new();
    for state in &states {
        values.clear();
        full_state.measure(state, &mut values);
        columns.iter_mut().zip(&values).for_each(|(column, value)| column.values.push(Some(*value)));
    }
    let action = |index: usize| TraceColumn {
        name: format!("action_{}", target.action_name(index)),
        unit: String::new(),
        values: (0..states.len()).map(|sample| Some(*actions.get(sample)?.get(index)?)).collect(),
    };
    let contacts = columns.iter().position(|column| column.name.starts_with("contact_"));
    let contacts = contacts.unwrap_or(columns.len());
    columns.splice(contacts..contacts, (0..environment.action_size()).map(action));
    let names = again.trace.names().iter().enumerate().filter(|(_, name)| !recorded.contains(name));
    let unit = |name: &str| {
        let signal = resolved.target.signals_on_request.iter().find(|signal| signal.name == name);
        signal.map_or(String::new(), |signal| signal.unit.clone())
    };
    columns.extend(names.map(|(index, name)| TraceColumn {
        name: name.clone(),
        unit: unit(name),
        values: again.trace.column(index).iter().copied().map(Some).collect(),
    }));
    Ok(columns)
}
