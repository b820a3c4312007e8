//! Guards of plans: formula, thresholds and fallback.

use mishandle_controllers::guard::{Fallback, Guard, GuardError, Guarded, Meaning, Motion, Switch, Watch};
use mishandle_controllers::{Entry, Layout, bytes_hash};
use mishandle_results::{GuardFacts, Number};
use mishandle_rollout::Component;
use mishandle_stl::{Formula, MonitorError};
use mishandle_store::RunHeader;
use std::sync::Arc;

use crate::error::MishandleError;
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
    pub layout: Layout,
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
    (controller, mut components): Identified,
    guarded_loop: &GuardedLoop,
    load: impl FnOnce(&str) -> Result<Identified, MishandleError>,
) -> Result<Identified, MishandleError> {
    let Some(settings) = &plan.guard else { return Ok((controller, components)) };
    let (guard, parts) = guard(settings, guarded_loop, load)?;
    components.extend(parts);
    Ok((Arc::new(Guarded::new(controller, guard)), components))
}

/// Makes the guard of a loop, with its components: the guard itself, and a fallback that is a
/// controller.
pub(crate) fn guard(
    settings: &GuardPlan,
    guarded_loop: &GuardedLoop,
    load: impl FnOnce(&str) -> Result<Identified, MishandleError>,
) -> Result<(Guard, Vec<Component>), MishandleError> {
    let GuardedLoop { layout, control_dt, episode_steps, .. } = guarded_loop;
    let control_dt = *control_dt;
    let episode_steps = *episode_steps;
    if settings.fallback.trim().is_empty() {
        return Err(missing("fallback", "`hold`, `retreat`, or a controller such as `expert`"));
    }
    let names = if settings.privileged { guarded_loop.signals.clone() } else { quantities(layout) };
    let (watch, switch) = monitor(settings, &names, control_dt, episode_steps)?;
    let retreat = steps("retreat", settings.retreat, MAX_RETREAT, control_dt)?;
    let motion = || motion(settings, guarded_loop);
    let (fallback, component) = match settings.fallback.as_str() {
        HOLD => (Fallback::Hold(motion()?), None),
        RETREAT => (Fallback::Retreat(motion()?, retreat), None),
        name => {
            let (controller, mut components) = load(name).map_err(|mut source| {
                if let MishandleError::UnknownName { known, .. } = &mut source {
                    known.extend([HOLD, RETREAT].map(String::from));
                }
                MishandleError::Fallback { fallback: name.to_string(), source: Box::new(source) }
            })?;
            if !controller.sees().is_empty() {
                return Err(MishandleError::InvalidValue {
                    what: "the fallback",
                    value: name.to_string(),
                    expected: "a controller that sees no images",
                });
            }
            let component = (!components.is_empty()).then(|| components.swap_remove(0));
            (Fallback::Controller(controller), component)
        }
    };
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
    let observation_size = layout.observation_size();
    let action_size = layout.action_size();
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
    guarded_loop: &GuardedLoop,
    load: impl FnOnce(&str) -> Result<Identified, MishandleError>,
) -> Result<Guard, MishandleError> {
    if settings.privileged {
        Err(MishandleError::InvalidValue {
            what: "`privileged` of the guard",
            value: "true".to_string(),
            expected: "false, because training computes no signals of the target",
        })
    } else {
        Ok(guard(settings, guarded_loop, load)?.0)
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
            return Err(MishandleError::InvalidValue {
                what: "`actions` of the guard",
                value: other.to_string(),
                expected: "`increments`, whose 0 is rest, or `positions`, whose last one is rest",
            });
        }
    };
    match (&guarded_loop.meanings, stated) {
        (Some(_), Some(_)) => Err(MishandleError::InvalidValue {
            what: "`actions` of the guard",
            value: settings.actions.clone().unwrap_or_default(),
            expected: "left out: a task knows what its actions mean",
        }),
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
    MishandleError::GuardKey { key, expected }
}
