//! The spaces of a robot, and the disturbances that every robot has.

use mishandle_rollout::fault::{Channel, FaultSite, Side};
use mishandle_rollout::{Axis, AxisKind, Disturbance, Effect, RolloutError, Space, TimeProfile, delays};

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
        let faults = self.sites(actions).into_iter().flat_map(FaultSite::disturbances);
        let builtin = delays().into_iter().chain(self.sensing()).chain(faults);
        let builtin: Vec<Disturbance> = builtin.filter(is_new).collect();
        own.iter().cloned().chain(builtin).collect()
    }

    /// Returns a bias of each number of the observation, and white noise of each part. A part whose
    /// bias or noise the file states has no other one.
    fn sensing(&self) -> Vec<Disturbance> {
        let states = |part: &ObservedPart, is_noise: bool| {
            self.description.axes.iter().any(|axis| match &axis.value.effect {
                AxisEffect::Bias { part: stated, .. } => !is_noise && stated.text == part.name,
                AxisEffect::Noise { part: stated } => is_noise && stated.text == part.name,
                _ => false,
            })
        };
        let steps = self.description.control.steps;
        let mut all = Vec::new();
        for part in &self.parts {
            let [bias, noise] = sensor_errors(&part.unit);
            let entries = part.first..part.first + part.size;
            if !states(part, false) {
                all.extend(entries.clone().map(|entry| {
                    let number =
                        if part.size == 1 { String::new() } else { format!("_{}", entry - part.first + 1) };
                    let name = format!("{}{number}", part.name);
                    let axis = Axis::new(
                        AxisKind::Model,
                        &format!("bias_{name}"),
                        &part.unit,
                        [-bias, bias],
                        Some(0.0),
                    )
                    .meaning(&format!("constant bias of the observed {name}"));
                    let profile = TimeProfile::Constant(0..steps + 1);
                    Disturbance { axis, effect: Effect::Observation { entry, factor: 1.0, profile } }
                }));
            }
            if !states(part, true) {
                let name = &part.name;
                let axis =
                    Axis::new(AxisKind::Model, &format!("noise_{name}"), &part.unit, [0.0, noise], Some(0.0))
                        .meaning(&format!("standard deviation of white noise on the observed {name}"));
                let entries = entries.map(|entry| (entry, 1.0)).collect();
                all.push(Disturbance { axis, effect: Effect::ObservationNoise { entries } });
            }
        }
        all
    }

    /// Returns the observation and the action as places of faults.
    fn sites(&self, actions: usize) -> [FaultSite; 2] {
        let robot = |side, name: &str, channels, ranges| FaultSite {
            side,
            name: name.to_string(),
            number: 0,
            channels,
            ranges,
            has_numbers: true,
            control_dt: self.description.control.period,
            episode_steps: self.description.control.steps,
        };
        let channel = |part: &ObservedPart| Channel {
            name: part.name.clone(),
            entries: (part.first..part.first + part.size).collect(),
        };
        let largest = |unit: &str| match unit {
            "m" => 10.0,
            "rad" => std::f64::consts::PI,
            "m/s" | "rad/s" => 20.0,
            _ => 1.0,
        };
        let ranges =
            self.parts.iter().flat_map(|part| vec![[-largest(&part.unit), largest(&part.unit)]; part.size]);
        let limit =
            if self.description.policy.limit.is_finite() { self.description.policy.limit } else { 1.0 };
        let action =
            (0..actions).map(|index| Channel { name: format!("action_{}", index + 1), entries: vec![index] });
        [
            robot(Side::Sensing, "sensor_fault", self.parts.iter().map(channel).collect(), ranges.collect()),
            robot(Side::Actuation, "actuator_fault", action.collect(), vec![[-limit, limit]; actions]),
        ]
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
        let of_loop = |matches: fn(&Disturbance) -> bool| -> Vec<Axis> {
            distinct(disturbances.iter().filter(|d| matches(d)).map(|d| &d.axis))
        };
        fn is_fault(disturbance: &Disturbance, side: Side) -> bool {
            matches!(&disturbance.effect, Effect::Fault { site, .. } if site.side == side)
        }
        let is_steady = |d: &Disturbance| {
            matches!(d.effect, Effect::ActionDelay | Effect::ObservationDelay | Effect::Observation { .. })
        };
        let of_model = [of_kind(AxisKind::Model), of_kind(AxisKind::Event)].concat();
        let steady = disturbances.iter().filter(|d| is_steady(d)).map(|d| &d.axis);
        let disturbance = distinct(steady.chain(&of_model));
        let mut spaces = vec![
            ("scenarios".to_string(), own),
            ("starts".to_string(), of_kind(AxisKind::Start)),
            ("commands".to_string(), of_kind(AxisKind::Input)),
            ("dynamics".to_string(), of_kind(AxisKind::Model)),
            ("events".to_string(), of_kind(AxisKind::Event)),
            (
                "delay".to_string(),
                of_loop(|d| matches!(d.effect, Effect::ActionDelay | Effect::ObservationDelay)),
            ),
            (
                "timing".to_string(),
                of_loop(|d| {
                    matches!(
                        d.effect,
                        Effect::ActionJitter | Effect::ObservationJitter | Effect::ObservationPeriod
                    )
                }),
            ),
            (
                "sensing".to_string(),
                of_loop(|d| matches!(d.effect, Effect::Observation { .. } | Effect::ObservationNoise { .. })),
            ),
            ("disturbance".to_string(), disturbance),
            ("noise".to_string(), of_kind(AxisKind::Noise)),
            ("faults-sensing".to_string(), of_loop(|d| is_fault(d, Side::Sensing))),
            ("faults-actuation".to_string(), of_loop(|d| is_fault(d, Side::Actuation))),
        ];
        for named in &self.description.spaces {
            let mut axes = Vec::new();
            for name in &named.value {
                axes.extend(self.named_axes(name, disturbances).map_err(|problem| self.at(problem))?);
            }
            spaces.retain(|(known, _)| *known != named.key.name);
            spaces.push((named.key.name.clone(), axes));
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
        let found = distinct(disturbances.iter().map(|d| &d.axis).filter(|axis| axis.name == name.text));
        if found.is_empty() {
            let own = self.description.axes.iter().map(|axis| axis.key.name.clone());
            let builtin = distinct(disturbances.iter().map(|d| &d.axis)).into_iter().map(|axis| axis.name);
            let known: Vec<String> = own.chain(builtin).collect();
            return Err(Problem::new(&name.span, missing("axis", &name.text, &known)));
        }
        Ok(found)
    }

    /// An axis with the name of a disturbance that every robot has must be such a disturbance: it
    /// takes its place.
    pub(crate) fn check_replaced(&self) -> Result<(), Problem> {
        let faults = self.sites(self.actions()).into_iter().flat_map(FaultSite::disturbances);
        let builtin: Vec<Disturbance> = delays().into_iter().chain(self.sensing()).chain(faults).collect();
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

/// Returns the axes with different names: several disturbances may follow one axis.
fn distinct<'a>(axes: impl Iterator<Item = &'a Axis>) -> Vec<Axis> {
    let mut found: Vec<Axis> = Vec::new();
    for axis in axes {
        if found.iter().all(|known| known.name != axis.name) {
            found.push(axis.clone());
        }
    }
    found
}

/// Largest bias and largest standard deviation of the noise of a sensor, in this unit.
fn sensor_errors(unit: &str) -> [f64; 2] {
    match unit {
        "m" => [0.02, 0.01],
        "rad" => [0.01, 0.005],
        "m/s" | "rad/s" => [0.1, 0.1],
        _ => [0.02, 0.02],
    }
}
