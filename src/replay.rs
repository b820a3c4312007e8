use std::sync::Arc;

use mishandle_rollout::{Environment, Episode, Request, System};
use mishandle_store::{RunFile, RunHeader, Simulation, SimulationRecord};

use mishandle_tasks::TaskEnvironment;

use crate::record::{self, Place};
use crate::{MishandleError, Plan, Subject, build};

/// A recorded simulation that was run again.
pub struct Replayed {
    /// What was recorded.
    pub recorded: Simulation,
    /// What happened now.
    pub episode: Episode,
    /// In what the two differ; nothing if they are the same to the bit.
    pub differences: Vec<String>,
    /// How this program differs from the one that made the record; then the bits may differ, too.
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
) -> Result<Replayed, MishandleError> {
    replay_in(run, trial, number, controller, |environment| environment)
}

/// As [`replay`], in what `wrapped` makes of the environment.
pub(crate) fn replay_in(
    run: &RunFile,
    trial: u32,
    number: u32,
    controller: Option<&str>,
    wrapped: impl FnOnce(Arc<TaskEnvironment>) -> Arc<dyn Environment>,
) -> Result<Replayed, MishandleError> {
    let SimulationRecord { simulation: recorded, .. } = run.simulation(trial, number)?;
    let header = run.header();
    let (_, subject) = recorded_subject(header, controller)?;
    let request = Request { x0: recorded.initial_configuration.clone(), seed: record::seed(&recorded) };
    let mut system = subject.system_in(wrapped(subject.environment.clone()))?;
    let mut episodes = system.rollout(&[request])?;
    let episode = episodes.pop().ok_or(MishandleError::NoEpisode)?;
    let place = Place { trial, number, unit_point: &recorded.unit_point };
    let again = record::record(&place, &episode).simulation;
    Ok(Replayed {
        differences: differences(&recorded, &again),
        other_build: other_build(header),
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

/// The plan of a run, and its subject with the very controller that the run was made with: the one that the plan names,
/// or the file `controller`, if that has moved.
///
/// # Errors
/// If the plan cannot be carried out any more, or the controller acts otherwise than the run's.
pub fn recorded_subject(
    header: &RunHeader,
    controller: Option<&str>,
) -> Result<(Plan, Subject), MishandleError> {
    let mut plan = Plan::from_toml(&header.plan)?;
    if let Some(controller) = controller {
        plan.controller = controller.to_string();
    }
    let lost = |error| match error {
        MishandleError::Controller(_) | MishandleError::Name { kind: "controller", .. }
            if controller.is_none() =>
        {
            MishandleError::LostController {
                controller: plan.controller.clone(),
                hash: header.controller_hash.clone(),
                source: Box::new(error),
            }
        }
        error => error,
    };
    let subject = Subject::new(&plan).map_err(lost)?;
    if subject.controller_hash != header.controller_hash {
        return Err(MishandleError::OtherController {
            controller: plan.controller,
            recorded: header.controller_hash.clone(),
            found: subject.controller_hash,
        });
    }
    Ok((plan, subject))
}

/// How this program differs from the one that made a run, part by part.
pub fn other_build(header: &RunHeader) -> Vec<String> {
    let (then, now) = (&header.build, build());
    let parts = [
        ("program", &then.program_version, &now.program_version),
        ("commit", &then.git_commit, &now.git_commit),
        ("compiler", &then.rustc, &now.rustc),
        ("MuJoCo", &then.mujoco_version, &now.mujoco_version),
        ("target", &then.target, &now.target),
        ("architecture", &then.architecture, &now.architecture),
    ];
    parts
        .iter()
        .filter(|(_, then, now)| then != now)
        .map(|(part, then, now)| format!("{part} {then}, now {now}"))
        .collect()
}
