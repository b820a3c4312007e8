//! The spaces of a robot, and the disturbances that every robot has.

use mishandle_camera::sight::Sight;
use mishandle_rollout::{
    Axis, AxisKind, ControlLoop, Disturbance, Effect, LoopPart, LoopSpaces, RolloutError, Space, delays,
    distinct,
};

use crate::axes::{ObservedPart, Parameter};
use crate::axis_table::AxisEffect;
use crate::document::Text;
use crate::error::{Problem, RobotError};
use crate::pattern::missing;
use crate::target::RobotFile;

impl RobotFile {
    /// Returns all axes of the environment and of these disturbances, and the named spaces.
    pub(crate) fn axes_and_spaces(
        &self,
        environment: &[(Axis, Parameter)],
        disturbances: &[Disturbance],
    ) -> Result<(Vec<Axis>, Vec<Space>), RobotError> {
        let axes = environment.iter().map(|(axis, _)| axis).chain(disturbances.iter().map(|d| &d.axis));
        Ok((distinct(axes), self.spaces(environment, disturbances)?))
    }

    /// Returns the delays, errors of sensors and faults that every robot has. An axis of the file
    /// with the same effect replaces them.
    pub(crate) fn disturbances_of(&self, actions: usize) -> Vec<Disturbance> {
        let own = self.axes.disturbances.clone();
        let taken: Vec<&str> = self.description.axes.iter().map(|axis| axis.key.name.as_str()).collect();
        let is_new = |disturbance: &Disturbance| {
            let replaces = |own: &Disturbance| {
                matches!(own.effect, Effect::ActionDelay | Effect::ObservationDelay)
                    && own.effect == disturbance.effect
            };
            !own.iter().any(replaces) && !taken.contains(&disturbance.axis.name.as_str())
        };
        let builtin = self.builtin(actions).into_iter().filter(is_new).collect::<Vec<_>>();
        own.iter().cloned().chain(builtin).collect()
    }

    /// Returns the disturbances that every robot has. A part of the observation whose bias or noise
    /// the file states has no other one.
    fn builtin(&self, actions: usize) -> Vec<Disturbance> {
        let states = |part: &LoopPart, is_noise: bool| {
            self.description.axes.iter().any(|axis| match &axis.value.effect {
                AxisEffect::Bias { part: stated, .. } => !is_noise && stated.text == part.name,
                AxisEffect::Noise { part: stated } => is_noise && stated.text == part.name,
                _ => false,
            })
        };
        let part = |part: &ObservedPart| LoopPart {
            name: part.name.clone(),
            unit: part.unit.clone(),
            size: part.size,
            range: None,
        };
        let action =
            |number| LoopPart { name: format!("action_{number}"), unit: String::new(), size: 1, range: None };
        let control = ControlLoop {
            observation: self.parts.iter().map(part).collect(),
            action: (1..=actions).map(action).collect(),
            action_limit: self.description.policy.limit,
            control_dt: self.description.control.period,
            episode_steps: self.description.control.steps,
        };
        let sensing = control.sensing(|part, is_noise| !states(part, is_noise));
        delays().into_iter().chain(sensing).chain(control.faults()).collect()
    }

    fn spaces(
        &self,
        environment: &[(Axis, Parameter)],
        disturbances: &[Disturbance],
    ) -> Result<Vec<Space>, RobotError> {
        // A search that chose random draws would answer another question.
        let own = self.description.axes.iter().flat_map(|named| self.axes_of(&named.key.name));
        let own: Vec<Axis> = own.filter(|axis| axis.kind != AxisKind::Noise).collect();
        let of_kind = |kind: AxisKind| -> Vec<Axis> {
            environment.iter().map(|(axis, _)| axis).filter(|axis| axis.kind == kind).cloned().collect()
        };
        let LoopSpaces { timing_and_sensing, steady, faults } = LoopSpaces::new(disturbances);
        let of_model = [of_kind(AxisKind::Model), of_kind(AxisKind::Event)].concat();
        let disturbance = distinct(steady.iter().chain(&of_model));
        let mut spaces = vec![
            ("scenarios".to_string(), own),
            ("starts".to_string(), of_kind(AxisKind::Start)),
            ("commands".to_string(), of_kind(AxisKind::Input)),
            ("dynamics".to_string(), of_kind(AxisKind::Model)),
            ("events".to_string(), of_kind(AxisKind::Event)),
        ];
        spaces.extend(timing_and_sensing);
        spaces.push(("disturbance".to_string(), disturbance));
        spaces.push(("noise".to_string(), of_kind(AxisKind::Noise)));
        spaces.extend(faults);
        let sight = self.sight().map(Sight::spaces).transpose()?.unwrap_or_default();
        spaces.extend(sight.iter().map(|space| (space.name().to_string(), space.axes().to_vec())));
        for named in &self.description.spaces {
            let mut axes = Vec::new();
            for name in &named.value {
                axes.extend(self.named_axes(name, disturbances).map_err(|problem| self.at(problem))?);
            }
            // In the place of the one that it replaces: the first one is the default.
            match spaces.iter_mut().find(|(known, _)| *known == named.key.name) {
                Some(known) => known.1 = axes,
                None => spaces.push((named.key.name.clone(), axes)),
            }
        }
        let made = spaces.into_iter().filter(|(_, axes)| !axes.is_empty());
        Ok(made.map(|(name, axes)| Space::new(&name, axes)).collect::<Result<_, RolloutError>>()?)
    }

    /// Returns the axes of a name in a space of the file: those of an axis of the file, or one that
    /// every robot has.
    fn named_axes(&self, name: &Text, disturbances: &[Disturbance]) -> Result<Vec<Axis>, Problem> {
        let own = self.axes_of(&name.text);
        if !own.is_empty() {
            return Ok(own);
        }
        let of_sight = || self.sight().into_iter().flat_map(Sight::axes);
        let all = disturbances.iter().map(|d| &d.axis).chain(of_sight());
        let found = distinct(all.filter(|axis| axis.name == name.text));
        if found.is_empty() {
            let own = self.description.axes.iter().map(|axis| axis.key.name.clone());
            let builtin = distinct(disturbances.iter().map(|d| &d.axis)).into_iter().map(|axis| axis.name);
            let of_sight = of_sight().map(|axis| axis.name.clone());
            let known: Vec<String> = own.chain(builtin).chain(of_sight).collect();
            return Err(Problem::new(&name.span, missing("axis", &name.text, &known)));
        }
        Ok(found)
    }

    /// An axis with the name of a disturbance that every robot has must be such a disturbance: it
    /// takes its place.
    pub(crate) fn check_replaced(&self) -> Result<(), Problem> {
        let builtin = self.builtin(self.actions());
        for axis in &self.description.axes {
            let is_disturbance = matches!(
                axis.value.effect,
                AxisEffect::Delay { .. } | AxisEffect::Bias { .. } | AxisEffect::Noise { .. }
            );
            if !is_disturbance && builtin.iter().any(|d| d.axis.name == axis.key.name) {
                let message = format!(
                    "every robot has an axis `{}` already, which this one would hide; give it another name",
                    axis.key.name
                );
                return Err(Problem::new(&axis.key.span, message));
            }
        }
        Ok(())
    }

    /// Returns the axes that an axis of the file makes: a push, for instance, makes several.
    fn axes_of(&self, name: &str) -> Vec<Axis> {
        let all = self.axes.environment.iter().map(|(axis, _)| axis);
        let all = all.chain(self.axes.disturbances.iter().map(|d| &d.axis));
        let is_part = |axis: &&Axis| {
            axis.name == name || axis.name.strip_prefix(name).is_some_and(|rest| rest.starts_with('_'))
        };
        distinct(all.filter(is_part))
    }
}
