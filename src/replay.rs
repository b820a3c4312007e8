use mishandle_rollout::{Episode, System};
use mishandle_store::{RunFile, RunHeader, Simulation};

use crate::record;
use crate::{MishandleError, Plan, ResolvedPlan, build};

/// A recorded simulation that was run again.
pub struct ReplayResult {
    /// What was recorded.
    pub recorded: Simulation,
    /// What happened now.
    pub episode: Episode,
    /// In what the two differ; nothing if they are the same to the bit.
    pub differences: Vec<String>,
    /// How this program and its target differ from those that made the record; then the bits may differ, too.
    pub other_build: Vec<String>,
}

/// Runs simulation `number` of trial `trial` of a run again and compares it with its record, bit for bit. `controller`
/// says where the run's controller is now, if it has moved.
///
/// # Errors
/// If the run has no such simulation, its plan cannot be carried out any more, or its controller is another one now.
pub fn replay(
    run: &RunFile,
    trial: u32,
    number: u32,
    controller: Option<&str>,
) -> Result<ReplayResult, MishandleError> {
    let resolved = recorded_plan(run.header(), controller)?;
    let mut system = resolved.system()?;
    replay_in(run, trial, number, &resolved, &mut *system)
}

/// As [`replay`], in a system of the run's target.
pub(crate) fn replay_in(
    run: &RunFile,
    trial: u32,
    number: u32,
    resolved: &ResolvedPlan,
    system: &mut dyn System,
) -> Result<ReplayResult, MishandleError> {
    let recorded = run.simulation(trial, number)?;
    let mut episodes = system.rollout(&[record::request(&recorded, resolved.stored_subformulas > 0)])?;
    let episode = episodes.pop().ok_or(MishandleError::NoEpisode)?;
    let again = record::record(&episode, resolved.stored_subformulas);
    Ok(ReplayResult {
        differences: differences(&recorded, &again),
        other_build: other_build(run.header(), resolved),
        recorded,
        episode,
    })
}

/// The simulation that a person most wants to see again: the first counterexample, else the one with the least
/// robustness; `trial` and `number` restrict the choice. `None` if the run has none such.
///
/// # Errors
/// If the run has no such trial, or cannot be read.
pub fn choose(
    run: &RunFile,
    trial: Option<u32>,
    number: Option<u32>,
) -> Result<Option<(u32, u32)>, MishandleError> {
    if let Some(trial) = trial {
        run.trial(trial)?;
    }
    if let Some(number) = number {
        return Ok(Some((trial.unwrap_or(1), number)));
    }
    let mut least: Option<Simulation> = None;
    for simulation in run.simulations() {
        let simulation = simulation?;
        if trial.is_some_and(|trial| trial != simulation.trial) {
            continue;
        }
        let Some(rho) = simulation.robustness else { continue };
        if rho < 0.0 {
            return Ok(Some((simulation.trial, simulation.number)));
        }
        if least.as_ref().and_then(|least| least.robustness).is_none_or(|least| rho < least) {
            least = Some(simulation);
        }
    }
    Ok(least.map(|simulation| (simulation.trial, simulation.number)))
}

fn differences(recorded: &Simulation, again: &Simulation) -> Vec<String> {
    let bits = |value: Option<f64>| value.map(f64::to_bits);
    let mut differences = Vec::new();
    if recorded.end != again.end || recorded.steps != again.steps {
        differences.push(format!(
            "it ended {:?} after {} control steps, now {:?} after {}",
            recorded.end, recorded.steps, again.end, again.steps
        ));
    }
    if bits(recorded.robustness) != bits(again.robustness) {
        differences.push(format!("its robustness was {:?}, now {:?}", recorded.robustness, again.robustness));
    }
    if recorded.trace_digest != again.trace_digest {
        differences.push("its trace has other bits".to_string());
    }
    differences
}

/// The plan of a run, resolved, with the very controller that the run was made with: the one that the plan names, or the
/// file `controller`, if that has moved.
///
/// # Errors
/// If the plan cannot be carried out any more, or the controller acts otherwise than the run's.
pub fn recorded_plan(header: &RunHeader, controller: Option<&str>) -> Result<ResolvedPlan, MishandleError> {
    let mut plan = Plan::from_toml(&header.plan)?;
    if let Some(controller) = controller {
        plan.controller = controller.to_string();
    }
    let recorded = header.components.iter().find(|component| component.role == "controller");
    let lost = |error| match (error, recorded) {
        (
            error @ (MishandleError::Controller(_) | MishandleError::Name { kind: "controller", .. }),
            Some(recorded),
        ) if controller.is_none() => MishandleError::LostController {
            controller: plan.controller.clone(),
            hash: recorded.hash.clone(),
            source: Box::new(error),
        },
        (error, _) => error,
    };
    let resolved = ResolvedPlan::new(&plan).map_err(lost)?;
    let found = &resolved.target.components;
    for (then, now) in header.components.iter().zip(found) {
        if then.hash != now.hash {
            return Err(MishandleError::OtherController {
                controller: plan.controller,
                recorded: then.hash.clone(),
                found: now.hash.clone(),
            });
        }
    }
    if header.components.len() != found.len() {
        let parts = |roles: Vec<&str>| if roles.is_empty() { "none".to_string() } else { roles.join(", ") };
        return Err(MishandleError::OtherParts {
            target: plan.target,
            recorded: parts(header.components.iter().map(|component| component.role.as_str()).collect()),
            found: parts(found.iter().map(|component| component.role.as_str()).collect()),
        });
    }
    Ok(resolved)
}

/// How this program and its target differ from those that made a run, part by part.
pub fn other_build(header: &RunHeader, resolved: &ResolvedPlan) -> Vec<String> {
    let (then, now) = (&header.build, build());
    let mut parts = vec![
        ("program", then.program_version.as_str(), now.program_version.as_str()),
        ("commit", &then.git_commit, &now.git_commit),
        ("compiler", &then.rustc, &now.rustc),
        ("platform", &then.target, &now.target),
        ("architecture", &then.architecture, &now.architecture),
    ];
    for (name, now) in &resolved.target.versions {
        let then =
            header.versions.iter().find(|(known, _)| known == name).map_or("none", |(_, version)| version);
        parts.push((name.as_str(), then, now.as_str()));
    }
    // Runs of an earlier format have no hash of their target.
    if !header.target.hash.is_empty() {
        parts.push(("hash of the target", &header.target.hash, &resolved.target.identity.hash));
    }
    parts
        .iter()
        .filter(|(_, then, now)| then != now)
        .map(|(part, then, now)| format!("{part} {then}, now {now}"))
        .collect()
}
