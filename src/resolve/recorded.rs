//! The plan of a run or a counterexample, resolved again.

use mishandle_results::{Choice, Key, Remedy};
use mishandle_store::{ComponentRecord, RunHeader};

use crate::error::{MishandleError, RunError, problem};
use crate::plan::{EngineSettings, Plan};
use crate::resolve::{ResolvedPlan, is_target_file, starts_program};

/// Present paths of the files of a run that were moved.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Moved<'a> {
    /// The controller, or another one to use.
    pub controller: Option<&'a str>,
    /// The target file.
    pub target: Option<&'a str>,
}

impl<'a> From<Option<&'a str>> for Moved<'a> {
    fn from(controller: Option<&'a str>) -> Self {
        Moved { controller, target: None }
    }
}

impl EngineSettings {
    /// Returns the new paths of files that were moved.
    pub fn moved(&self) -> Moved<'_> {
        Moved { controller: self.controller.as_deref(), target: self.target.as_deref() }
    }
}

/// Resolves the plan of a run and checks that the parts of the target are the same as in the run.
///
/// `moved` has the present paths of moved files; an `Option<&str>` is that of the controller.
///
/// # Errors
/// If the plan cannot be resolved any more, or a part of the target has another hash than the
/// run's.
pub fn recorded_plan<'a>(
    header: &RunHeader,
    moved: impl Into<Moved<'a>>,
) -> Result<ResolvedPlan, MishandleError> {
    resolve_recorded(Plan::from_toml(&header.plan)?, &header.components, moved.into())
}

/// Resolves the plan of a run as [`recorded_plan`] does; `None` if that fails or starts a program.
pub fn plan_without_program<'a>(header: &RunHeader, moved: impl Into<Moved<'a>>) -> Option<ResolvedPlan> {
    let moved = moved.into();
    let mut plan = Plan::from_toml(&header.plan).ok()?;
    plan.target = moved.target.map_or(plan.target, str::to_string);
    plan.controller = moved.controller.map_or(plan.controller, str::to_string);
    if starts_program(&plan).ok()? { None } else { recorded_plan(header, moved).ok() }
}

/// Resolves a recorded plan and checks that the target has the recorded components.
pub(crate) fn resolve_recorded(
    mut plan: Plan,
    components: &[ComponentRecord],
    moved: Moved<'_>,
) -> Result<ResolvedPlan, MishandleError> {
    if let Some(target) = moved.target {
        if !is_target_file(&plan.target) {
            let text = "is not a file, so it has no new path";
            return Err(problem(format!("the target of the run, `{}`, {text}", plan.target))
                .with(Remedy::Unset(Key::MOVED_TARGET)));
        }
        plan.target = target.to_string();
    }
    if let Some(controller) = moved.controller {
        plan.controller = controller.to_string();
    }
    let recorded = components.iter().find(|component| component.role == CONTROLLER);
    let name = |recorded: &ComponentRecord| match plan.controller.as_str() {
        "" => recorded.name.clone(),
        given => given.to_string(),
    };
    let with_hint = |error| match (error, recorded) {
        (
            error @ (MishandleError::Controller(_)
            | MishandleError::Interchange(_)
            | MishandleError::UnknownName { kind: "controller", .. }),
            Some(recorded),
        ) if moved.controller.is_none() => {
            let part =
                format!("cannot load the run's controller `{}` (hash {})", name(recorded), recorded.hash);
            error.of(part).with(if_moved(Key::MOVED_CONTROLLER, "the file was moved"))
        }
        (
            MishandleError::UnknownName { kind: "target", name, .. } | MishandleError::NotATarget { name },
            _,
        ) => MishandleError::Run(RunError::ForeignTarget { name }),
        // A changed file can have lost what the plan names.
        (error, _) if is_target_file(&plan.target) => {
            let part = format!("cannot use the target of the run, `{}`", plan.target);
            error
                .of(part)
                .with(if_moved(Key::MOVED_TARGET, "its folder was moved"))
                .with(Remedy::Advice("restore a file that was changed since the run"))
        }
        (error, _) => error,
    };
    let resolved = ResolvedPlan::new(&plan).map_err(with_hint)?;
    let found = &resolved.target.components;
    if components.len() != found.len() {
        let parts = |roles: Vec<&str>| if roles.is_empty() { "none".to_string() } else { roles.join(", ") };
        return Err(RunError::Components {
            target: plan.target,
            recorded: parts(components.iter().map(|component| component.role.as_str()).collect()),
            found: parts(found.iter().map(|component| component.role.as_str()).collect()),
        }
        .into());
    }
    let pairs = components.iter().zip(found);
    let changed: Vec<_> =
        pairs.filter(|(then, now)| (&then.role, &then.hash) != (&now.role, &now.hash)).collect();
    match changed.as_slice() {
        [] => Ok(resolved),
        [(then, now)] if then.role == CONTROLLER => {
            let text = format!(
                "controller `{}` is not the controller of the run: expected hash {}, found {}",
                name(then),
                then.hash,
                now.hash
            );
            Err(problem(text).with(if_moved(Key::MOVED_CONTROLLER, "the file was moved")))
        }
        changed => {
            let part = |(then, now): &(&ComponentRecord, &mishandle_rollout::Component)| {
                let renamed = if then.name == now.name { "" } else { &format!(" (now `{}`)", now.name) };
                format!("the {} `{}`{renamed}", then.role, then.name)
            };
            let parts: Vec<String> = changed.iter().map(part).collect();
            let text = format!(
                "{} changed since the run: restore {}; with the change, make a new run",
                listed(&parts),
                if parts.len() == 1 { "it" } else { "them" }
            );
            let moved = if_moved(Key::MOVED_TARGET, "unchanged files are elsewhere");
            Err(if is_target_file(&plan.target) { problem(text).with(moved) } else { problem(text) })
        }
    }
}

/// Returns the remedy to give the new path of a file.
fn if_moved(key: Key, condition: &str) -> Remedy {
    Remedy::set(key, Choice::FILE).when(condition)
}

/// Joins parts of a sentence: `a`, `a and b`, `a, b and c`.
fn listed(parts: &[String]) -> String {
    match parts {
        [first @ .., last] if !first.is_empty() => format!("{} and {last}", first.join(", ")),
        parts => parts.concat(),
    }
}

/// Role of the component that acts.
const CONTROLLER: &str = "controller";
