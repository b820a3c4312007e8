//! Compiling the expressions of a target file.

use crate::expression::Argument;
use mishandle_world::{ElementKind, Joint, Mocap, Model, Servo};

use crate::axes::ObservedPart;
use crate::description::{MAX_SUBSTEPS, Named, Quantity, Settle};
use crate::environment::Robot;
use crate::error::{Problem, RobotError};
use crate::library::{Library, RememberedPart};
use crate::phase::PhaseBuilder;
use crate::target::RobotFile;

/// Largest number of physics steps between the start and sample 0.
const MAX_SETTLING: f64 = 1e6;

impl RobotFile {
    /// Compiles the robot for a number of actions.
    pub(crate) fn compiled(&self, actions: usize) -> Result<Robot, RobotError> {
        self.robot(actions).map_err(|problem| self.at(problem))
    }

    pub(super) fn library<'a>(
        &'a self,
        memory: &'a [RememberedPart],
        actions: Option<usize>,
        signals: &'a [Named<Quantity>],
    ) -> Library<'a> {
        Library {
            model: &self.model.physics,
            constants: &self.description.constants,
            parameters: &self.parameters,
            memory,
            actions,
            signals,
        }
    }

    /// Compiles all expressions for this number of actions.
    pub(super) fn robot(&self, actions: usize) -> Result<Robot, Problem> {
        let description = &self.description;
        let model = &self.model.physics;
        let before = self.library(&[], None, &[]);
        let during = self.library(&self.memory, Some(actions), &description.signals);
        let timestep = model.timestep();
        let control = &description.control;
        let (model, substeps) = match control.substeps {
            Some(substeps) => (model.with_timestep(control.period / substeps as f64), substeps),
            None => {
                let steps = control.period / timestep;
                // A time step of 0 would never end.
                if !(1.0..=MAX_SUBSTEPS).contains(&steps.round()) {
                    let message = format!(
                        "the period of {} s has {steps} physics steps of {timestep} s; from 1 to {MAX_SUBSTEPS} are possible: \
                         set `model.timestep` or `control.substeps`",
                        control.period
                    );
                    return Err(Problem::new(&control.span, message));
                }
                if (steps - steps.round()).abs() > 1e-6 * steps {
                    let message = format!(
                        "the period of {} s is not a whole number of physics steps of {timestep} s; set `model.timestep` \
                         or `control.substeps`",
                        control.period
                    );
                    return Err(Problem::new(&control.span, message));
                }
                (model.clone(), steps.round() as usize)
            }
        };
        let settling = match &description.settle {
            Some(Settle { span, duration }) => physics_steps(*duration, model.timestep()).ok_or_else(|| {
                let message = format!(
                    "the {duration} s of `settle` are not a whole number of physics steps of {} s, at most {MAX_SETTLING}",
                    model.timestep()
                );
                Problem::new(span, message)
            })?,
            None => 0,
        };
        let mut start = PhaseBuilder::new(&before);
        let start_positions = start_values(&description.start, &mut start, &before, true)?;
        let start_velocities = start_values(&description.start_velocity, &mut start, &before, false)?;
        let start_mocap = mocap_places(&description.start_mocap, &mut start, &model)?;
        for named in &description.memory {
            start.add(&named.value.start)?;
        }
        let mut invalid = PhaseBuilder::new(&during);
        for condition in &description.invalid {
            if invalid.add(condition)? != 1 {
                return Err(Problem::new(&condition.text.span, "a condition of `invalid` is one number"));
            }
        }
        let mut next = PhaseBuilder::new(&during);
        for (named, part) in description.memory.iter().zip(&self.memory) {
            next.add_sized(&named.value.next, part.place.len(), &format!("the memory `{}`", named.key.name))?;
        }
        let servos = match &description.servos {
            Some(servos) => make_servos(servos, &model)?,
            None => Vec::new(),
        };
        let mut command = PhaseBuilder::new(&during);
        let actuated = self.actuated.clone();
        command.add_sized(
            &description.policy.action,
            actuated.len(),
            "`action` gives controls to actuators: it",
        )?;
        let mut hold = PhaseBuilder::new(&before);
        if let Some(expression) = &description.policy.hold {
            hold.add_sized(expression, actuated.len(), "`hold` gives controls to actuators: it")?;
        }
        let mut measured = PhaseBuilder::new(&during);
        let mut sample = PhaseBuilder::new(&during);
        for part in &self.parts {
            let named = description.observation.iter().find(|named| named.key.name == part.name);
            if let Some(named) = named
                && sample.add(&named.value.value)? != part.size
            {
                let message =
                    format!("`{}` depends on the number of actions; set `policy.actions`", part.name);
                return Err(Problem::new(&named.value.value.text.span, message));
            }
        }
        let mut reductions = Vec::new();
        let mut plain_signals = Vec::new();
        for (index, named) in description.signals.iter().enumerate() {
            let expression = &named.value.value;
            match named.value.over {
                Some(over) => {
                    single(measured.add(expression)?, named)?;
                    reductions.push((over, index));
                }
                None => {
                    single(sample.add(expression)?, named)?;
                    plain_signals.push(index);
                }
            }
        }
        for named in &description.rewards {
            if sample.add(&named.value)? != 1 {
                return Err(Problem::new(&named.value.text.span, "a reward term is one number"));
            }
        }
        for named in &description.ends {
            if sample.add(&named.value)? != 1 {
                return Err(Problem::new(&named.value.text.span, "a condition of [ends] is one number"));
            }
        }
        let start = start.finish();
        let command = command.finish();
        if start.reads_forces() || start.reads_poses() {
            return Err(Problem::new(
                &description.model_file.span,
                "[start] cannot read poses, sensors or forces",
            ));
        }
        let keyframe = match &description.keyframe {
            Some(name) => Some(
                crate::pattern::keyframe(&model, &name.text)
                    .map_err(|message| Problem::new(&name.span, message))?,
            ),
            None => None,
        };
        let part_clip = |part: &ObservedPart| {
            let named = description.observation.iter().find(|named| named.key.name == part.name);
            vec![named.and_then(|named| named.value.clip); part.size]
        };
        let events = self.axes.events.iter().enumerate();
        let slips = || events.clone().filter_map(|(index, event)| Some((index, event.change()?)));
        Ok(Robot {
            name: description.name.clone(),
            keyframe,
            control_dt: control.period,
            episode_steps: control.steps,
            substeps,
            start,
            start_positions,
            start_velocities,
            start_mocap,
            settling,
            start_offset: 0.0,
            invalid: invalid.finish(),
            memory: self.memory.iter().map(|part| part.place.clone()).collect(),
            next: next.finish(),
            servos,
            command,
            hold: hold.finish(),
            actuated,
            control_ranges: (0..model.actuators()).map(|index| model.actuator_range(index)).collect(),
            measured: measured.finish(),
            reductions,
            measured_every: 1,
            sample: sample.finish(),
            parts: self.parts.iter().map(|part| (part.first, part.size)).collect(),
            clips: self.parts.iter().flat_map(part_clip).collect(),
            plain_signals,
            signals: description.signals.iter().map(|named| named.key.name.clone()).collect(),
            signal_clips: description.signals.iter().map(|named| named.value.clip).collect(),
            reward_terms: description.rewards.iter().map(|named| named.key.name.clone()).collect(),
            ends: description.ends.len(),
            observation_size: self.observation_size,
            action_size: actions,
            action_limit: description.policy.limit,
            values: self.axes.values.clone(),
            changes: self.axes.changes.iter().chain(slips().map(|(_, change)| change)).cloned().collect(),
            slips: slips().map(|(index, _)| index).collect(),
            events: self.axes.events.clone(),
            draws: self.axes.draws.clone(),
            axes: self.axes.environment.clone(),
            sight_axes: self
                .sight()
                .map_or_else(Vec::new, |sight| sight.axes().map(|axis| axis.name.clone()).collect()),
            seen: None,
            model,
        })
    }
}

/// Returns the number of physics steps of a duration; `None` if it is not a whole number, or too
/// many.
fn physics_steps(duration: f64, timestep: f64) -> Option<usize> {
    let steps = duration / timestep;
    let is_whole = (steps - steps.round()).abs() <= 1e-6 * steps;
    (is_whole && (1.0..=MAX_SETTLING).contains(&steps.round())).then_some(steps.round() as usize)
}

fn single(size: usize, named: &Named<Quantity>) -> Result<(), Problem> {
    match size {
        1 => Ok(()),
        _ => {
            let message = format!(
                "the signal `{}` has {size} numbers; a signal is one number, such as `norm(...)` or `max(...)`",
                named.key.name
            );
            Err(Problem::new(&named.value.value.text.span, message))
        }
    }
}

/// Adds the start values of joints and groups, and returns the places of their numbers.
fn start_values(
    entries: &[Named<crate::description::Expression>],
    phase: &mut PhaseBuilder<'_>,
    library: &Library<'_>,
    of_positions: bool,
) -> Result<Vec<Vec<usize>>, Problem> {
    let mut places = Vec::new();
    for named in entries {
        let name = &named.key.name;
        let is_group = library.constants.iter().any(|constant| constant.key.name == *name);
        let argument = if is_group { Argument::Name(name.clone()) } else { Argument::Text(name.clone()) };
        let joints = library
            .elements(ElementKind::Joint, Some(&argument))
            .map_err(|message| Problem::new(&named.key.span, message))?;
        let range = |joint: usize| {
            let joint = library.model.joint_at(joint);
            if of_positions {
                joint.qpos..joint.qpos + joint.kind.positions()
            } else {
                joint.dof..joint.dof + joint.kind.velocities()
            }
        };
        let indices: Vec<usize> = joints.into_iter().flat_map(range).collect();
        phase.add_sized(&named.value, indices.len(), &format!("the start of `{name}`"))?;
        places.push(indices);
    }
    Ok(places)
}

/// Adds the start poses of mocap bodies, and returns the bodies.
fn mocap_places(
    entries: &[Named<crate::description::Expression>],
    phase: &mut PhaseBuilder<'_>,
    model: &Model,
) -> Result<Vec<Mocap>, Problem> {
    let mut bodies = Vec::new();
    for named in entries {
        let name = &named.key.name;
        let body = model.mocap(name).map_err(|error| {
            let is_body = model.find(ElementKind::Body, name).is_ok();
            let missing = || crate::pattern::missing("body", name, &model.names(ElementKind::Body));
            Problem::new(&named.key.span, if is_body { error.to_string() } else { missing() })
        })?;
        if !matches!(phase.add(&named.value)?, 3 | 7) {
            let message =
                format!("the pose of `{name}` has 3 numbers, its position, or 7, with its quaternion");
            return Err(Problem::new(&named.value.text.span, message));
        }
        bodies.push(body);
    }
    Ok(bodies)
}

fn make_servos(servos: &crate::description::Servos, model: &Model) -> Result<Vec<Servo>, Problem> {
    let count = servos.max_velocity.len();
    if count != servos.max_effort.len() || count > model.actuators() || count > Servo::MOST {
        let message = format!(
            "[servos] needs as many efforts as velocities, at most {}, for the first actuators",
            model.actuators().min(Servo::MOST)
        );
        return Err(Problem::new(&servos.span, message));
    }
    let joint = |index: usize| {
        let joint = model.actuator_joint(index).map(|joint| model.joint_at(joint));
        joint.filter(|joint| joint.kind.velocities() == 1)
    };
    let joints: Option<Vec<Joint>> = (0..count).map(joint).collect();
    let joints = joints.filter(|joints| joints.windows(2).all(|pair| pair[1].dof == pair[0].dof + 1));
    let joints = joints.ok_or_else(|| {
        Problem::new(
            &servos.span,
            "the actuators of [servos] are position servos of consecutive hinge or slide joints",
        )
    })?;
    let limits = servos.max_velocity.iter().zip(&servos.max_effort);
    let servo = |(joint, (max_velocity, max_effort)): (&Joint, (&f64, &f64))| Servo {
        qpos: joint.qpos,
        dof: joint.dof,
        max_velocity: *max_velocity,
        max_effort: *max_effort,
    };
    Ok(joints.iter().zip(limits).map(servo).collect())
}
