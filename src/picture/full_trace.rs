//! Full traces: joint positions and velocities, actions and contact forces, in addition to the
//! signals.

use std::sync::Arc;

use mishandle_rollout::{Episode, System};
use mishandle_store::TraceColumn;
use mishandle_tasks::{JOINT_NAMES, MANNER};

use crate::error::MishandleError;
use crate::picture::trajectory::{Recording, RecordingEnvironment};
use crate::resolve::{ResolvedPlan, task_target};

/// Simulates an episode of a task again and returns what its trace does not contain, one value per
/// sample.
///
/// The columns are `q_NAME` and `dq_NAME` (position and velocity of each joint; of a free body,
/// position and linear velocity in world axes, the quaternion, and the angular velocity in body
/// axes), `action_NAME` (the action of each joint as it was applied in the control step from this
/// sample to the next, after noise and disturbances; missing at the last sample), `contact_A_B`
/// (norm of the net contact force between two parts of the scene, N), `contact_largest` (largest
/// force at a single contact point, N), and the signals of the manner that `episode` does not have.
///
/// # Errors
/// If the target is not a task, or the simulation gives other signals than `episode` has.
pub fn full_trace(resolved: &ResolvedPlan, episode: &Episode) -> Result<Vec<TraceColumn>, MishandleError> {
    if mishandle_tasks::task(&resolved.plan.target).is_none() {
        return Err(MishandleError::InvalidValue {
            what: "the target of a full recording",
            value: resolved.plan.target.clone(),
            expected: "a task, because other targets have no joints and contacts",
        });
    }
    let target = task_target(&resolved.plan)?;
    let environment = target.environment(&resolved.space, &resolved.specification)?;
    let environment = Arc::new(environment.with_manner());
    let (recorder, recording) = RecordingEnvironment::new(environment.clone());
    let mut system = target.system_in(Arc::new(recorder), &resolved.space, &resolved.specification)?;
    let again = system.rollout(std::slice::from_ref(&episode.request))?.pop();
    let again = again.ok_or(MishandleError::NoEpisode)?;
    // The signals of the manner come last.
    let recorded = episode.trace.names().len();
    let bits = |episode: &Episode| -> Vec<Vec<u64>> {
        let column = |i| episode.trace.column(i).iter().map(|value| value.to_bits()).collect();
        (0..recorded).map(column).collect()
    };
    if bits(&again) != bits(episode) {
        return Err(MishandleError::RunMismatch { differences: vec!["trace of the full recording".into()] });
    }
    let Recording { states, actions } = recording.take();
    let scene_error =
        |source| mishandle_tasks::TaskError::Scene { task: environment.definition().name, source };
    let mut full_state = environment.full_state().map_err(scene_error)?;
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
    let action = |(joint, name): (usize, &&str)| TraceColumn {
        name: format!("action_{name}"),
        unit: String::new(),
        values: (0..states.len()).map(|sample| Some(*actions.get(sample)?.get(joint)?)).collect(),
    };
    let contacts = columns.iter().position(|column| column.name.starts_with("contact_"));
    let contacts = contacts.unwrap_or(columns.len());
    columns.splice(contacts..contacts, JOINT_NAMES.iter().enumerate().map(action));
    let names = again.trace.names().iter().enumerate().skip(recorded);
    columns.extend(names.map(|(index, name)| TraceColumn {
        name: name.clone(),
        unit: MANNER.iter().find(|signal| signal.name == name).map_or("", |signal| signal.unit).to_string(),
        values: again.trace.column(index).iter().copied().map(Some).collect(),
    }));
    Ok(columns)
}
