//! Guards of plans: formula, thresholds and fallback.

use std::sync::Arc;

use mishandle_controllers::guard::{Fallback, Guard, GuardError, Guarded, Meaning, Motion, Switch, Watch};
use mishandle_controllers::{Entry, Fitted, Layout, bytes_hash};
use mishandle_results::{GuardFacts, Number};
use mishandle_rollout::{Component, Controller};
use mishandle_stl::{Formula, MonitorError};
use mishandle_store::RunHeader;
use mishandle_tasks::Definition;

use crate::error::{MishandleError, invalid, problem};
use crate::plan::{GuardPlan, Plan};
use crate::resolve::policy::Identified;

/// Fallback that stays where it is.
const HOLD: &str = "hold";

/// Fallback that takes back the last actions.
const RETREAT: &str = "retreat";

/// Largest number of characters of a formula that names the guard as a component.
const NAME: usize = 200;

/// Longest time of a guard, s.
const MAX_TIME: f64 = 3600.0;

/// Longest motion that a retreat takes back, s.
const MAX_RETREAT: f64 = 60.0;

/// The loop that a guard is in.
pub(crate) struct GuardedLoop {
    /// The layout of the controller.
    pub layout: Layout,
    /// The task, whose further parts of the observation a fallback may read, too.
    pub task: Option<&'static Definition>,
    /// Names of the target's signals, for privileged guards.
    pub signals: Vec<String>,
    /// Duration of a control step, s.
    pub control_dt: f64,
    pub episode_steps: usize,
    pub action_limit: f64,
    /// Meanings of the numbers of an action, if the target knows them.
    pub meanings: Option<Vec<Meaning>>,
}

/// Returns the names of the numbers of an observation: those of parts with one number, otherwise
/// with their index from 1 on, as axes of sensor errors have them.
pub(crate) fn quantities(layout: &Layout) -> Vec<String> {
    let numbers = |Entry { name, size, .. }: &Entry| -> Vec<String> {
        match size {
            1 => vec![name.clone()],
            _ => (1..=*size).map(|number| format!("{name}_{number}")).collect(),
        }
    };
    layout.observation.iter().flat_map(numbers).collect()
}

/// Guards the controller of a plan, if the plan has a guard. `load` loads a controller by its name
/// or path.
pub(crate) fn guarded(
    plan: &Plan,
    unguarded: Identified,
    mut guarded_loop: GuardedLoop,
    load: impl FnOnce(&str) -> Result<Identified, MishandleError>,
) -> Result<Identified, MishandleError> {
    let Some(settings) = &plan.guard else { return Ok(unguarded) };
    let (controller, mut components) = unguarded;
    let (guard, parts) = guard(settings, &mut guarded_loop, load)?;
    components.extend(parts);
    let controller = guarded_loop.select(controller);
    Ok((Arc::new(Guarded::new(controller, guard)), components))
}

impl GuardedLoop {
    /// Adds the further parts of the observation that a controller reads.
    fn add_parts_of(&mut self, controller: &dyn Controller) {
        if let Some(task) = self.task {
            let own = task.further_parts_of(&self.layout);
            self.layout = task.layout_with(&[&own, controller.further_parts()].concat());
        }
    }

    /// Returns a controller that gets the observation of the loop.
    fn select(&self, controller: Arc<dyn Controller>) -> Arc<dyn Controller> {
        let further_parts = self.task.map_or_else(Vec::new, |task| task.further_parts_of(&self.layout));
        Fitted::of_layout(controller, &self.layout, &further_parts)
    }
}

/// Makes the guard of a loop, with its components: the guard itself, and a fallback that is a
/// controller.
pub(crate) fn guard(
    settings: &GuardPlan,
    guarded_loop: &mut GuardedLoop,
    load: impl FnOnce(&str) -> Result<Identified, MishandleError>,
) -> Result<(Guard, Vec<Component>), MishandleError> {
    let GuardedLoop { control_dt, episode_steps, .. } = *guarded_loop;
    if settings.fallback.trim().is_empty() {
        return Err(missing("fallback", "`hold`, `retreat`, or a controller such as `expert`"));
    }
    let retreat = steps("retreat", settings.retreat, MAX_RETREAT, control_dt)?;
    let (fallback, component) = match settings.fallback.as_str() {
        HOLD => (Fallback::Hold(motion(settings, guarded_loop)?), None),
        RETREAT => (Fallback::Retreat(motion(settings, guarded_loop)?, retreat), None),
        name => {
            let (controller, mut components) = load(name).map_err(|mut source| {
                if let MishandleError::UnknownName { known, .. } = &mut source {
                    known.extend([HOLD, RETREAT].map(String::from));
                }
                source.of(format!("the fallback of the guard, `{name}`"))
            })?;
            if !controller.sees().is_empty() {
                return Err(invalid("the fallback", name, "a controller that sees no images"));
            }
            let component = (!components.is_empty()).then(|| components.swap_remove(0));
            guarded_loop.add_parts_of(&*controller);
            (Fallback::Controller(guarded_loop.select(controller)), component)
        }
    };
    let names =
        if settings.privileged { guarded_loop.signals.clone() } else { quantities(&guarded_loop.layout) };
    let (watch, switch) = monitor(settings, &names, control_dt, episode_steps)?;
    let own = GuardPlan {
        // The fallback has a component of its own, which does not depend on its path.
        fallback: if component.is_some() { String::new() } else { settings.fallback.clone() },
        ..settings.clone()
    };
    let own = Component {
        role: if settings.privileged { "privileged guard" } else { "guard" }.to_string(),
        // The plan has all of it.
        name: settings.formula.chars().take(NAME).collect(),
        hash: bytes_hash(own.to_toml().as_bytes()),
        file_hash: String::new(),
    };
    let fallback_of = |component| Component { role: "fallback".to_string(), ..component };
    let observation_size = guarded_loop.layout.observation_size();
    let action_size = guarded_loop.layout.action_size();
    let components: Vec<Component> = std::iter::once(own).chain(component.map(fallback_of)).collect();
    let identity = Component::joint_hash(&components);
    let guard =
        Guard::new(identity, watch, switch, fallback, settings.privileged, observation_size, action_size)?;
    Ok((guard, components))
}

/// Makes the monitor of a guard over quantities with these names, sampled with the period
/// `control_dt` (s).
///
/// # Errors
/// If the formula or a number is wrong.
pub fn monitor(
    settings: &GuardPlan,
    names: &[String],
    control_dt: f64,
    episode_steps: usize,
) -> Result<(Watch, Switch), MishandleError> {
    if settings.formula.trim().is_empty() {
        return Err(missing("formula", "a formula over quantities that the controller sees"));
    }
    let formula = Formula::parse(&settings.formula).map_err(|source| {
        mishandle_rollout::RolloutError::Parse { formula: settings.formula.clone(), source }
    })?;
    let watch = Watch::new(&formula, names, control_dt, episode_steps).map_err(|error| match error {
        GuardError::Formula { problem: MonitorError::UnknownSignal { signal, known, .. }, .. } => {
            let kind = if settings.privileged { "signal" } else { "quantity of the observation" };
            MishandleError::UnknownName { kind, name: signal, known }
        }
        error => error.into(),
    })?;
    let dwell = steps("dwell", settings.dwell, MAX_TIME, control_dt)?;
    let switch = Switch::new(settings.threshold, settings.return_threshold, dwell)?;
    if switch.has_way_back() && !watch.is_past() {
        return Err(GuardError::NoWayBack { formula: settings.formula.clone() }.into());
    }
    Ok((watch, switch))
}

/// Returns the guard under which a policy trains.
///
/// # Errors
/// As for the guard of a plan, and if it is privileged: training episodes have no signals.
pub(crate) fn training_guard(
    settings: &GuardPlan,
    mut guarded_loop: GuardedLoop,
    load: impl FnOnce(&str) -> Result<Identified, MishandleError>,
) -> Result<Guard, MishandleError> {
    if settings.privileged {
        Err(invalid(
            "`privileged` of the guard",
            "true",
            "false, because training computes no signals of the target",
        ))
    } else {
        let layout = guarded_loop.layout.clone();
        let (guard, _) = guard(settings, &mut guarded_loop, load)?;
        if guarded_loop.layout == layout {
            return Ok(guard);
        }
        let parts: Vec<&str> = guarded_loop.layout.observation[layout.observation.len()..]
            .iter()
            .map(|entry| entry.name.as_str())
            .collect();
        Err(invalid(
            "the fallback of the guard",
            &settings.fallback,
            format!(
                "one that reads only what the policy reads; or let the policy read {}, too, with `episodes.further_parts` of the training settings",
                parts.join(", ")
            ),
        ))
    }
}

/// Returns the guard of a plan as a result.
pub(crate) fn guard_facts(guard: &GuardPlan) -> GuardFacts {
    GuardFacts {
        // On one line.
        formula: guard.formula.split_whitespace().collect::<Vec<_>>().join(" "),
        threshold: Number(guard.threshold),
        return_threshold: guard.return_threshold,
        dwell: guard.dwell,
        fallback: guard.fallback.clone(),
        privileged: guard.privileged,
    }
}

/// Returns the guard of a recorded run as a result; `None` without one.
pub fn recorded_guard(header: &RunHeader) -> Option<GuardFacts> {
    Plan::from_toml(&header.plan).ok()?.guard.as_ref().map(guard_facts)
}

/// Returns a time in control steps, rounded up.
fn steps(key: &'static str, secs: f64, most: f64, control_dt: f64) -> Result<usize, MishandleError> {
    if (0.0..=most).contains(&secs) {
        // A time that is a whole number of steps up to rounding counts as that number.
        Ok((secs / control_dt - 1e-6).ceil().max(0.0) as usize)
    } else {
        Err(GuardError::Number {
            key,
            value: secs,
            expected: "seconds from 0 on, at most an hour; 60 for `retreat`",
        }
        .into())
    }
}

/// Returns what the actions mean to a fallback that stops.
fn motion(settings: &GuardPlan, guarded_loop: &GuardedLoop) -> Result<Motion, MishandleError> {
    let limit = guarded_loop.action_limit;
    let size = guarded_loop.layout.action_size();
    let stated = match settings.actions.as_deref() {
        None => None,
        Some("increments") => Some(vec![Meaning::Increment; size]),
        Some("positions") => Some(vec![Meaning::Position; size]),
        Some(other) => {
            return Err(invalid(
                "`actions` of the guard",
                other,
                "`increments`, whose 0 is rest, or `positions`, whose last one is rest",
            ));
        }
    };
    match (&guarded_loop.meanings, stated) {
        (Some(_), Some(_)) => Err(invalid(
            "`actions` of the guard",
            settings.actions.clone().unwrap_or_default(),
            "left out: a task knows what its actions mean",
        )),
        (Some(meanings), None) => Ok(Motion { meanings: meanings.clone(), limit }),
        (None, Some(meanings)) => Ok(Motion { meanings, limit }),
        (None, None) => Err(missing(
            "actions",
            "`increments` (0 is rest) or `positions` (the last one is rest), because the target does not say what its \
             actions mean and the fallback must stop",
        )),
    }
}

fn missing(key: &'static str, expected: &'static str) -> MishandleError {
    problem(format!("the guard has no `{key}`; expected {expected}"))
}
