//! The plan that flags describe.

use std::path::Path;

use anyhow::{Context, Result};
use mishandle::files::{limits, read_text_bounded};
use mishandle::plan::{GuardPlan, Values};
use mishandle::resolve::command_target;
use toml::Value;

use super::{Axes, Planned, Run, Simulator, Subject};

/// Returns the plan of `--plan` or a new one, with the values of the shared flags and of the keys.
/// `command` is the name of the command.
pub fn planned(command: &str, subject: &Subject, run: &Run) -> Result<Planned> {
    let mut planned = Planned::new(&subject.keys)?;
    planned.flag("TARGET", "target", subject.target.clone())?;
    planned.flag("--controller", "controller", subject.controller.clone())?;
    planned.guard(subject.guard.as_deref())?;
    planned.flag("--space", "space", subject.space.clone())?;
    planned.axes(&subject.axes)?;
    planned.flag("--action-noise", "action-noise", subject.action_noise)?;
    planned.number("--seed", "seed", run.seed)?;
    planned.assign(&subject.keys.keys, command, Values::One)?;
    Ok(planned)
}

impl Planned {
    /// Sets the keys of a guard to the contents of its file, if there is one.
    pub fn guard(&mut self, path: Option<&Path>) -> Result<()> {
        if let Some(path) = path {
            let name = || path.display().to_string();
            let text = read_text_bounded(path, limits::SETTINGS).with_context(name)?;
            let guard = GuardPlan::from_toml(&text).with_context(name)?;
            self.table.insert("guard".to_string(), Value::try_from(guard)?);
        }
        Ok(())
    }

    /// Sets axes.
    pub fn axes(&mut self, axes: &Axes) -> Result<()> {
        for (name, setting) in axes.settings()? {
            self.flag(&format!("--axis {name}"), &format!("axes.{name}"), Some(Value::try_from(setting)?))?;
        }
        Ok(())
    }

    /// Adds the command of a simulator, and requirements.
    pub fn simulator(mut self, flags: &Simulator) -> Result<Planned> {
        self.flag("--command", "target", flags.command.as_deref().map(command_target))?;
        for (name, formula) in &flags.requirement {
            let key = format!("requirements.{name}");
            self.flag(&format!("--requirement {name}"), &key, Some(formula.clone()))?;
        }
        Ok(self)
    }
}
