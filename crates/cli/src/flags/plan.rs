//! The plan that flags describe.

use anyhow::{Context, Result, bail, ensure};
use mishandle::Plan;
use mishandle::files::{limits, read_text_bounded};
use mishandle::plan::GuardPlan;
use mishandle::resolve::command_target;

use super::{Run, Subject};

/// Returns the plan that the flags describe: the plan of `--plan` or a new plan, with the values of
/// the flags.
pub fn plan(subject: &Subject, run: &Run) -> Result<Plan> {
    let target = subject.command.as_deref().map(command_target).or_else(|| subject.target.clone());
    let mut plan = match (&subject.plan, &target) {
        (Some(path), _) => {
            let text = read_text_bounded(path, limits::PLAN).with_context(|| path.display().to_string())?;
            Plan::from_toml(&text).with_context(|| path.display().to_string())?
        }
        (None, Some(target)) => Plan::new(target, ""),
        (None, None) => bail!("there is no target: name one, or give --plan FILE"),
    };
    let edit = |field: &mut String, flag: &Option<String>| {
        if let Some(value) = flag {
            field.clone_from(value);
        }
    };
    if let Some(target) = target {
        (plan.target, plan.folder, plan.is_typed) = (target, String::new(), true);
    }
    edit(&mut plan.space, &subject.space);
    edit(&mut plan.controller, &subject.controller);
    edit(&mut plan.preset, &subject.preset);
    plan.axes.extend(subject.axes.settings()?);
    for (name, formula) in &subject.requirement {
        let earlier = plan.requirements.insert(name.clone(), formula.clone());
        let is_once = subject.requirement.iter().filter(|(other, _)| other == name).count() == 1;
        ensure!(earlier.is_none() || is_once, "the requirement {name} is given twice");
    }
    if let Some(path) = &subject.guard {
        let text = read_text_bounded(path, limits::SETTINGS).with_context(|| path.display().to_string())?;
        plan.guard = Some(GuardPlan::from_toml(&text).with_context(|| path.display().to_string())?);
    }
    plan.action_noise = subject.action_noise.unwrap_or(plan.action_noise);
    plan.observation_noise = subject.observation_noise.unwrap_or(plan.observation_noise);
    plan.stochastic |= subject.stochastic;
    plan.seed = run.seed.unwrap_or(plan.seed);
    ensure!(!plan.target.is_empty(), "there is no target: name one in the plan or as an argument");
    Ok(plan)
}
