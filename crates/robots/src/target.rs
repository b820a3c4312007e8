//! A target file: read, checked against its model, and compiled.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use mishandle_controllers::{Entry, Layout};
use mishandle_files::{limits, read_bounded};
use mishandle_rollout::fault::{Channel, FaultSite, Side};
use mishandle_rollout::{
    Axis, AxisKind, Component, Controller, Disturbance, Effect, Environment, Identity, NamedFormula, Noise,
    Rollout, RolloutError, Signal, Space, Specification, System, SystemFactory, Target, delays,
};
use mishandle_world::{ElementKind, Model};

use crate::axes::{Axes, ObservedPart, parameter_names};
use crate::description::{Description, MAX_SUBSTEPS, Named, PolicySource, Quantity};
use crate::document;
use crate::environment::{Robot, RobotEnvironment};
use crate::error::{Problem, RobotError};
use crate::library::Library;
use crate::model::{self, RobotModel};
use crate::phase::PhaseBuilder;
use crate::policy::ExpressionPolicy;
use crate::task_space::TaskSpacePolicy;

/// Kind of the targets that a file describes.
pub const KIND: &str = "robot";

/// Roles of the components that are files of the robot, not its controller.
pub const FILE_ROLES: [&str; 2] = ["target file", "model"];

/// Where the actions of a robot come from, as its file says.
pub enum RobotPolicy {
    /// A file beside the target file.
    File {
        /// Its path.
        path: PathBuf,
        /// Names of the input and the output of an ONNX model, if the file names them.
        interface: [Option<String>; 2],
    },
    /// An expression of the file.
    Expression(Arc<dyn Controller>),
    /// The built-in controller of a site's position.
    BuiltIn(Arc<dyn Controller>),
    /// None: a controller must be given.
    Open,
}

/// A robot that a file describes.
pub struct RobotFile {
    path: PathBuf,
    /// Hash of the text of the file.
    text_hash: String,
    model: RobotModel,
    description: Description,
    axes: Axes,
    parts: Vec<ObservedPart>,
    policy: RobotPolicy,
    /// The robot, except what depends on the number of actions.
    observation_size: usize,
    parameters: Vec<String>,
}

impl RobotFile {
    /// Reads a target file and its model.
    ///
    /// # Errors
    /// If a file cannot be read or is wrong; the message names the line.
    pub fn read(path: &Path) -> Result<RobotFile, RobotError> {
        let text = read_text(path)?;
        let problem = |problem: Problem| problem.at(path, &text);
        let table = document::parse(&text).map_err(problem)?;
        let description = Description::new(&table).map_err(problem)?;
        let model = model::read(&description, path, &text)?;
        RobotFile::new(path, &text, description, model)
    }

    fn new(
        path: &Path,
        text: &str,
        description: Description,
        model: RobotModel,
    ) -> Result<RobotFile, RobotError> {
        let problem = |problem: Problem| problem.at(path, text);
        let parameters = parameter_names(&description);
        let actions = description.policy.actions.unwrap_or(model.physics.actuators());
        let library = Library {
            model: &model.physics,
            constants: &description.constants,
            parameters: &parameters,
            actions: Some(actions),
        };
        check_constants(&description, &library).map_err(problem)?;
        let parts = observed_parts(&description, &library).map_err(problem)?;
        let observation_size = parts.iter().map(|part| part.size).sum();
        let axes = Axes::new(&description, &library, &parts).map_err(problem)?;
        let control_dt = description.control.period;
        let policy = match &description.policy.source {
            PolicySource::File(file) => RobotPolicy::File {
                path: path.parent().unwrap_or(Path::new(".")).join(&file.text),
                interface: [&description.policy.input, &description.policy.output]
                    .map(|name| name.as_ref().map(|name| name.text.clone())),
            },
            PolicySource::Expression(expression) => {
                let policy =
                    ExpressionPolicy::new(expression, &library, &parts, control_dt).map_err(problem)?;
                RobotPolicy::Expression(Arc::new(policy))
            }
            PolicySource::TaskSpace(settings) => {
                let policy = TaskSpacePolicy::new(settings, &library, &parts, control_dt).map_err(problem)?;
                RobotPolicy::BuiltIn(Arc::new(policy))
            }
            PolicySource::Open => RobotPolicy::Open,
        };
        let text_hash = Identity::new(KIND, "", text).hash;
        let file = RobotFile {
            path: path.to_path_buf(),
            text_hash,
            model,
            description,
            axes,
            parts,
            policy,
            observation_size,
            parameters,
        };
        // This reports mistakes now, with their lines.
        file.robot(file.actions()).map_err(|found| found.at(path, text))?;
        Ok(file)
    }

    /// Returns the name of the robot.
    pub fn name(&self) -> &str {
        &self.description.name
    }

    /// Returns the paths of the files that the target is made of: the file itself, those of the
    /// model and the policy.
    pub fn files(&self) -> Vec<PathBuf> {
        let policy = match &self.policy {
            RobotPolicy::File { path, .. } => Some(path.clone()),
            _ => None,
        };
        [self.path.clone()].into_iter().chain(self.model.files.iter().cloned()).chain(policy).collect()
    }

    /// Returns the policy that the file names.
    pub fn policy(&self) -> &RobotPolicy {
        &self.policy
    }

    /// Returns the number of actions that the file expects.
    pub fn actions(&self) -> usize {
        match (self.description.policy.actions, &self.policy) {
            (Some(actions), _) => actions,
            (None, RobotPolicy::Expression(policy) | RobotPolicy::BuiltIn(policy)) => policy.action_size(),
            (None, _) => self.model.physics.actuators(),
        }
    }

    /// Returns the layout of observations and actions, which a controller must have.
    pub fn layout(&self) -> Layout {
        let entry =
            |part: &ObservedPart| Entry { name: part.name.clone(), unit: part.unit.clone(), size: part.size };
        let action = Entry { name: "action".to_string(), unit: String::new(), size: self.actions() };
        Layout { observation: self.parts.iter().map(entry).collect(), action: vec![action] }
    }

    /// Returns the length of an observation.
    pub fn observation_size(&self) -> usize {
        self.observation_size
    }

    /// Returns the number of actuators of the model.
    pub fn actuators(&self) -> usize {
        self.model.physics.actuators()
    }

    /// Returns the target of this robot with a controller.
    ///
    /// # Errors
    /// If the controller does not fit, two axes have the same name, or a formula is wrong.
    pub fn target(
        &self,
        (controller, component): (Arc<dyn Controller>, Component),
        noise: Noise,
    ) -> Result<Target, RobotError> {
        let text =
            String::from_utf8_lossy(&read_bounded(&self.path, limits::PLAN).unwrap_or_default()).into_owned();
        let robot = self.robot(controller.action_size()).map_err(|problem| problem.at(&self.path, &text))?;
        let robot = Arc::new(robot);
        let disturbances = self.disturbances(robot.action_size);
        let environment_axes = robot.axes.iter().map(|(axis, _)| axis);
        let axes = distinct(environment_axes.chain(disturbances.iter().map(|d| &d.axis)));
        let random = disturbances.iter().filter(|d| d.effect.is_random()).map(|d| d.axis.name.clone());
        let signal =
            |named: &Named<Quantity>| Signal { name: named.key.name.clone(), unit: named.value.unit.clone() };
        let formula = |named: &Named<document::Text>| NamedFormula {
            name: named.key.name.clone(),
            text: named.value.text.clone(),
        };
        let content = format!("{}\n{}\n{}\n{:?}", self.text_hash, self.model.hash, component.hash, noise);
        let [target_file, model] = FILE_ROLES;
        let component_of = |role: &str, name: String, hash: &str| Component {
            role: role.to_string(),
            name,
            hash: hash.to_string(),
            file_hash: String::new(),
        };
        let file_name = |path: &Path| path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let target = Target {
            identity: Identity::new(KIND, &self.description.name, &content),
            components: vec![
                component,
                component_of(target_file, file_name(&self.path), &self.text_hash),
                component_of(model, file_name(&self.model.file), &self.model.hash),
            ],
            spaces: self.spaces(&robot.axes, &disturbances)?,
            axes,
            signals: self.description.signals.iter().map(signal).collect(),
            signals_on_request: Vec::new(),
            formulas: self.description.formulas.iter().map(formula).collect(),
            control_dt: robot.control_dt,
            episode_steps: robot.episode_steps,
            is_deterministic: true,
            can_fail: false,
            depends_on_seed: noise.action_std > 0.0 || noise.observation_std > 0.0,
            random_axes: random.collect(),
            versions: vec![("MuJoCo".to_string(), mishandle_world::mujoco_version())],
            reachable: None,
            factory: factory(robot, controller, noise, disturbances),
        };
        let all = target.space("all")?;
        let names = target.signal_names();
        for named in &self.description.formulas {
            let check = || -> Result<(), String> {
                let formula =
                    mishandle_stl::Formula::parse(&named.value.text).map_err(|error| error.to_string())?;
                let clock = mishandle_stl::Clock::steps(target.control_dt);
                mishandle_stl::Monitor::new(&formula, &names, clock).map_err(|error| error.to_string())?;
                Ok(())
            };
            check().map_err(|message| {
                let message = format!("the formula `{}`: {message}", named.key.name);
                Problem::new(&named.value.span, message).at(&self.path, &text)
            })?;
        }
        let first = target.formulas.first().map(|formula| formula.text.clone()).unwrap_or_default();
        let requirement = mishandle_stl::Formula::parse(&first)
            .map_err(|source| RolloutError::Parse { formula: first.clone(), source })?;
        target.system(&all, &Specification::from_formulas(&target.formulas, requirement)?)?;
        Ok(target)
    }

    /// Returns the delays, errors of sensors and faults that every robot has. An axis of the file
    /// with the same effect replaces them.
    fn disturbances(&self, actions: usize) -> Vec<Disturbance> {
        let own = self.axes.disturbances.clone();
        let taken: Vec<&str> = self.description.axes.iter().map(|axis| axis.key.name.as_str()).collect();
        let is_new = |disturbance: &Disturbance| {
            let replaces = |own: &Disturbance| {
                matches!(own.effect, Effect::ActionDelay | Effect::ObservationDelay)
                    && own.effect == disturbance.effect
            };
            !own.iter().any(replaces) && !taken.contains(&disturbance.axis.name.as_str())
        };
        let builtin =
            delays().into_iter().chain(self.sites(actions).into_iter().flat_map(FaultSite::disturbances));
        let builtin: Vec<Disturbance> = builtin.filter(is_new).collect();
        own.iter().cloned().chain(builtin).collect()
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
        environment: &[(Axis, crate::axes::Parameter)],
        disturbances: &[Disturbance],
    ) -> Result<Vec<Space>, RobotError> {
        let own: Vec<Axis> =
            self.description.axes.iter().flat_map(|named| self.axes_of(&named.key.name)).collect();
        let of_kind = |kind: AxisKind| -> Vec<Axis> {
            environment.iter().map(|(axis, _)| axis).filter(|axis| axis.kind == kind).cloned().collect()
        };
        let of_loop = |matches: fn(&Disturbance) -> bool| -> Vec<Axis> {
            distinct(disturbances.iter().filter(|d| matches(d)).map(|d| &d.axis))
        };
        fn is_fault(disturbance: &Disturbance, side: Side) -> bool {
            matches!(&disturbance.effect, Effect::Fault { site, .. } if site.side == side)
        }
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
            ("faults-sensing".to_string(), of_loop(|d| is_fault(d, Side::Sensing))),
            ("faults-actuation".to_string(), of_loop(|d| is_fault(d, Side::Actuation))),
        ];
        for named in &self.description.spaces {
            let mut axes = Vec::new();
            for name in &named.value {
                axes.extend(self.axes_of(&name.text));
            }
            spaces.retain(|(known, _)| *known != named.key.name);
            spaces.push((named.key.name.clone(), axes));
        }
        let made = spaces.into_iter().filter(|(_, axes)| !axes.is_empty());
        Ok(made.map(|(name, axes)| Space::new(&name, axes)).collect::<Result<_, RolloutError>>()?)
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

    /// Compiles all expressions for this number of actions.
    fn robot(&self, actions: usize) -> Result<Robot, Problem> {
        let description = &self.description;
        let model = &self.model.physics;
        let library = |actions| Library {
            model,
            constants: &description.constants,
            parameters: &self.parameters,
            actions,
        };
        let (before, during) = (library(None), library(Some(actions)));
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
        let mut start = PhaseBuilder::new(&before);
        let start_positions = start_values(&description.start, &mut start, &before, true)?;
        let start_velocities = start_values(&description.start_velocity, &mut start, &before, false)?;
        let mut command = PhaseBuilder::new(&during);
        command.add_sized(
            &description.policy.action,
            model.actuators(),
            "the model has actuators, so `action`",
        )?;
        let mut hold = PhaseBuilder::new(&before);
        if let Some(expression) = &description.policy.hold {
            hold.add_sized(expression, model.actuators(), "the model has actuators, so `hold`")?;
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
        let (mut reductions, mut plain_signals) = (Vec::new(), Vec::new());
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
        let (start, command) = (start.finish(), command.finish());
        if start.reads_forces() || start.reads_poses() {
            return Err(Problem::new(
                &description.model_file.span,
                "[start] cannot read poses, sensors or forces",
            ));
        }
        let keyframe = match &description.keyframe {
            Some(name) => Some(model.find(ElementKind::Key, &name.text).map_err(|_| {
                let known = model.names(ElementKind::Key);
                Problem::new(&name.span, crate::pattern::missing("keyframe", &name.text, &known))
            })?),
            None => None,
        };
        let part_clip = |part: &ObservedPart| {
            let named = description.observation.iter().find(|named| named.key.name == part.name);
            vec![named.and_then(|named| named.value.clip); part.size]
        };
        Ok(Robot {
            name: description.name.clone(),
            keyframe,
            control_dt: control.period,
            episode_steps: control.steps,
            substeps,
            start,
            start_positions,
            start_velocities,
            command,
            hold: hold.finish(),
            control_ranges: (0..model.actuators()).map(|index| model.actuator_range(index)).collect(),
            measured: measured.finish(),
            reductions,
            sample: sample.finish(),
            parts: self.parts.iter().map(|part| (part.first, part.size)).collect(),
            clips: self.parts.iter().flat_map(part_clip).collect(),
            plain_signals,
            signals: description.signals.iter().map(|named| named.key.name.clone()).collect(),
            signal_clips: description.signals.iter().map(|named| named.value.clip).collect(),
            reward_terms: description.rewards.iter().map(|named| named.key.name.clone()).collect(),
            observation_size: self.observation_size,
            action_size: actions,
            action_limit: description.policy.limit,
            values: self.axes.values.clone(),
            changes: self.axes.changes.clone(),
            pushed: self.axes.pushed.clone(),
            pushes: self.axes.pushes.clone(),
            axes: self.axes.environment.clone(),
            model,
        })
    }
}

/// Reads the text of a target file.
pub(crate) fn read_text(path: &Path) -> Result<String, RobotError> {
    let read = |source| RobotError::Read { path: path.to_path_buf(), source };
    let bytes = read_bounded(path, limits::PLAN).map_err(read)?;
    String::from_utf8(bytes)
        .map_err(|error| read(std::io::Error::new(std::io::ErrorKind::InvalidData, error.utf8_error())))
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

/// Compiles each constant, so that a mistake in one is reported where it stands.
fn check_constants(description: &Description, library: &Library<'_>) -> Result<(), Problem> {
    use crate::description::Constant;
    use mishandle_expression::Names;
    for named in &description.constants {
        match &named.value {
            Constant::Expression(expression) => {
                PhaseBuilder::new(library).add(expression)?;
            }
            Constant::Group { kind, pattern } => {
                let kind = crate::pattern::kind(kind).ok_or_else(|| {
                    Problem::new(
                        &named.key.span,
                        "groups are of the kind joint, actuator, body, geom, site or sensor",
                    )
                })?;
                crate::pattern::select(library.model, kind, &pattern.text)
                    .map_err(|message| Problem::new(&pattern.span, message))?;
            }
            _ => {
                library.name(&named.key.name).map_err(|message| Problem::new(&named.key.span, message))?;
            }
        }
    }
    Ok(())
}

/// Returns the parts of the observation that the policy sees, in its order.
fn observed_parts(description: &Description, library: &Library<'_>) -> Result<Vec<ObservedPart>, Problem> {
    let all = &description.observation;
    let chosen: Vec<&Named<Quantity>> = match description.policy.observation.as_slice() {
        [] => all.iter().collect(),
        names => names
            .iter()
            .map(|name| {
                all.iter().find(|named| named.key.name == name.text).ok_or_else(|| {
                    let known: Vec<String> = all.iter().map(|named| named.key.name.clone()).collect();
                    Problem::new(&name.span, crate::pattern::missing("observation", &name.text, &known))
                })
            })
            .collect::<Result<_, _>>()?,
    };
    let mut first = 0;
    let mut parts = Vec::new();
    for named in chosen {
        if let Some(over) = named.value.over {
            let message = format!("a part of the observation has no reduction over physics steps ({over:?})");
            return Err(Problem::new(&named.key.span, message));
        }
        let size = PhaseBuilder::new(library).add(&named.value.value)?;
        parts.push(ObservedPart {
            name: named.key.name.clone(),
            unit: named.value.unit.clone(),
            first,
            size,
        });
        first += size;
    }
    Ok(parts)
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
        let argument = match is_group {
            true => mishandle_expression::Argument::Name(name.clone()),
            false => mishandle_expression::Argument::Text(name.clone()),
        };
        let joints = library
            .elements(ElementKind::Joint, Some(&argument))
            .map_err(|message| Problem::new(&named.key.span, message))?;
        let range = |joint: usize| {
            let joint = library.model.joint_at(joint);
            match of_positions {
                true => joint.qpos..joint.qpos + joint.kind.positions(),
                false => joint.dof..joint.dof + joint.kind.velocities(),
            }
        };
        let indices: Vec<usize> = joints.into_iter().flat_map(range).collect();
        phase.add_sized(&named.value, indices.len(), &format!("the start of `{name}`"))?;
        places.push(indices);
    }
    Ok(places)
}

fn factory(
    robot: Arc<Robot>,
    controller: Arc<dyn Controller>,
    noise: Noise,
    disturbances: Vec<Disturbance>,
) -> Arc<SystemFactory> {
    Arc::new(move |space: &Space, specification: &Specification| {
        let is_own = |axis: &&Axis| robot.axes.iter().any(|(own, _)| own.name == axis.name);
        let own: Vec<Axis> = space.axes().iter().filter(is_own).cloned().collect();
        let environment = RobotEnvironment::new(robot.clone(), Space::new(space.name(), own)?)?;
        let environment: Arc<dyn Environment> = Arc::new(environment);
        let system = Rollout::new(environment, controller.clone(), specification.clone(), noise)?
            .with_disturbances(space.clone(), &disturbances)?;
        Ok(Box::new(system) as Box<dyn System>)
    })
}

impl RobotFile {
    /// Returns the model for physics.
    pub fn model(&self) -> &Model {
        &self.model.physics
    }
}
