//! The plan of a run or a counterexample, resolved again.

use mishandle_store::{ComponentRecord, RunHeader};

use crate::error::MishandleError;
use crate::plan::Plan;
use crate::resolve::ResolvedPlan;

/// Resolves the plan of a run and checks that the controller is the same as in the run.
///
/// `controller` is the present path of the controller, if the file was moved.
///
/// # Errors
/// If the plan cannot be resolved any more, or the controller has another hash than the run's.
pub fn recorded_plan(header: &RunHeader, controller: Option<&str>) -> Result<ResolvedPlan, MishandleError> {
    resolve_recorded(Plan::from_toml(&header.plan)?, &header.components, controller)
}

/// Resolves a recorded plan and checks that the target has the recorded components.
pub(crate) fn resolve_recorded(
    mut plan: Plan,
    components: &[ComponentRecord],
    controller: Option<&str>,
) -> Result<ResolvedPlan, MishandleError> {
    if let Some(controller) = controller {
        plan.controller = controller.to_string();
    }
    let recorded = components.iter().find(|component| component.role == "controller");
    let with_hint = |error| match (error, recorded) {
        (
            error @ (MishandleError::Controller(_) | MishandleError::UnknownName { kind: "controller", .. }),
            Some(recorded),
        ) if controller.is_none() => MishandleError::MissingController {
            controller: plan.controller.clone(),
            hash: recorded.hash.clone(),
            source: Box::new(error),
        },
        (MishandleError::UnknownName { kind: "target", name, .. }, _) => {
            MishandleError::ForeignTarget { name }
        }
        (error, _) => error,
    };
    let resolved = ResolvedPlan::new(&plan).map_err(with_hint)?;
    let found = &resolved.target.components;
    for (then, now) in components.iter().zip(found) {
        if then.hash != now.hash {
            return Err(MishandleError::ControllerMismatch {
                controller: plan.controller,
                recorded: then.hash.clone(),
                found: now.hash.clone(),
            });
        }
    }
    if components.len() != found.len() {
        let parts = |roles: Vec<&str>| if roles.is_empty() { "none".to_string() } else { roles.join(", ") };
        return Err(MishandleError::ComponentMismatch {
            target: plan.target,
            recorded: parts(components.iter().map(|component| component.role.as_str()).collect()),
            found: parts(found.iter().map(|component| component.role.as_str()).collect()),
        });
    }
    Ok(resolved)
}
