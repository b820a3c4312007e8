//! A target file: read, checked against its model, and compiled.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use mishandle_controllers::{Entry, Layout};
use mishandle_expression::Argument;
use mishandle_files::{limits, read_bounded};
use mishandle_rollout::fault::{Channel, FaultSite, Side};
use mishandle_rollout::{
    Axis, AxisKind, Component, Controller, Disturbance, Effect, Identity, NamedFormula, Noise, RolloutError,
    Signal, Space, Specification, Target, TimeProfile, delays,
};
use mishandle_world::{ElementKind, Joint, Mocap, Model, PictureModel, Servo};

use crate::axes::{Axes, ObservedPart, Parameter, parameter_names};
use crate::axis_table::AxisEffect;
use crate::controlled::ControlledRobot;
use crate::description::{Constant, Description, MAX_SUBSTEPS, Named, PolicySource, Quantity, Settle};
use crate::document;
use crate::environment::{Robot, RobotEnvironment};
use crate::error::{Problem, RobotError};
use crate::library::{Library, RememberedPart, members};
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
    text: String,
    /// Hash of the text of the file.
    pub(crate) text_hash: String,
    pub(crate) model: RobotModel,
    pub(crate) description: Description,
    axes: Axes,
    parts: Vec<ObservedPart>,
    policy: RobotPolicy,
    /// The robot, except what depends on the number of actions.
    observation_size: usize,
    /// Actuators that get the controls, in the order of the expression.
    actuated: Vec<usize>,
    parameters: Vec<String>,
    memory: Vec<RememberedPart>,
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
        let library = |memory, actions| Library {
            model: &model.physics,
            constants: &description.constants,
            parameters: &parameters,
            memory,
            actions,
            signals: &[],
        };
        let without = library(&[], None);
        check_groups(&description, &without).map_err(problem)?;
        let actuated = actuated(&description, &without).map_err(problem)?;
        let memory = remembered_parts(&description, &without).map_err(problem)?;
        let actions = description.policy.actions.unwrap_or(actuated.len());
        let library = library(&memory, Some(actions));
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
            text: text.to_string(),
            text_hash,
            model,
            description,
            axes,
            parts,
            policy,
            observation_size,
            actuated,
            parameters,
            memory,
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
            (None, _) => self.actuated.len(),
        }
    }

    /// Returns the layout of observations and actions, which a controller must have.
    pub fn layout(&self) -> Layout {
        let entry =
            |part: &ObservedPart| Entry { name: part.name.clone(), unit: part.unit.clone(), size: part.size };
        let action = Entry { name: "action".to_string(), unit: String::new(), size: self.actions() };
        Layout { observation: self.parts.iter().map(entry).collect(), action: vec![action] }
    }

    /// Returns the parts of the observation that the policy sees.
    pub(crate) fn observed(&self) -> &[ObservedPart] {
        &self.parts
    }

    /// Returns whether a part of the observation reads more than axes and constants.
    pub(crate) fn part_reads_state(&self, name: &str) -> bool {
        let named = self.description.observation.iter().find(|named| named.key.name == name);
        let library = self.library(&self.memory, Some(self.actions()), &[]);
        let mut phase = PhaseBuilder::new(&library);
        named.is_some_and(|named| phase.add(&named.value.value).is_ok()) && phase.finish().reads_state()
    }

    /// Compiles the robot for a number of actions.
    pub(crate) fn compiled(&self, actions: usize) -> Result<Robot, RobotError> {
        self.robot(actions).map_err(|problem| self.at(problem))
    }

    /// Returns the length of an observation.
    pub fn observation_size(&self) -> usize {
        self.observation_size
    }

    /// Returns the number of actuators of the model.
    pub fn actuators(&self) -> usize {
        self.model.physics.actuators()
    }

    /// Returns the formulas of the file.
    pub(crate) fn formulas(&self) -> Vec<NamedFormula> {
        let formula = |named: &Named<document::Text>| NamedFormula {
            name: named.key.name.clone(),
            text: named.value.text.clone(),
        };
        self.description.formulas.iter().map(formula).collect()
    }

    /// Returns the error of a problem, with its line in the file.
    pub(crate) fn at(&self, problem: Problem) -> RobotError {
        problem.at(&self.path, &self.text)
    }

    /// Returns the path of the file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Returns all axes of the environment and of these disturbances, and the named spaces.
    pub(crate) fn axes_and_spaces(
        &self,
        environment: &[(Axis, Parameter)],
        disturbances: &[Disturbance],
    ) -> Result<(Vec<Axis>, Vec<Space>), RobotError> {
        let axes = environment.iter().map(|(axis, _)| axis).chain(disturbances.iter().map(|d| &d.axis));
        Ok((distinct(axes), self.spaces(environment, disturbances)?))
    }

    /// Returns the identity of this robot as a target, with a controller of this hash and noise.
    pub fn identity(&self, controller_hash: &str, noise: Noise) -> Identity {
        let content = format!("{}\n{}\n{controller_hash}\n{noise:?}", self.text_hash, self.model.hash);
        Identity::new(KIND, &self.description.name, &content)
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
        let controlled = self.controlled(controller, noise)?;
        let ControlledRobot { robot, disturbances, .. } = &controlled;
        let (axes, spaces) = self.axes_and_spaces(&robot.axes, disturbances)?;
        let random = disturbances.iter().filter(|d| d.effect.is_random()).map(|d| d.axis.name.clone());
        let signal =
            |named: &Named<Quantity>| Signal { name: named.key.name.clone(), unit: named.value.unit.clone() };
        let [target_file, model] = FILE_ROLES;
        let component_of = |role: &str, name: String, hash: &str| Component {
            role: role.to_string(),
            name,
            hash: hash.to_string(),
            file_hash: String::new(),
        };
        let file_name = |path: &Path| path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let target = Target {
            identity: self.identity(&component.hash, noise),
            components: vec![
                component,
                component_of(target_file, file_name(&self.path), &self.text_hash),
                component_of(model, file_name(&self.model.file), &self.model.hash),
            ],
            spaces,
            axes,
            signals: self.description.signals.iter().map(signal).collect(),
            signals_on_request: Vec::new(),
            formulas: self.formulas(),
            control_dt: robot.control_dt,
            episode_steps: robot.episode_steps,
            is_deterministic: true,
            can_fail: !self.description.invalid.is_empty(),
            depends_on_seed: !self.axes.draws.is_empty()
                || noise.action_std > 0.0
                || noise.observation_std > 0.0,
            random_axes: random.collect(),
            versions: vec![("MuJoCo".to_string(), mishandle_world::mujoco_version())],
            reachable: None,
            factory: controlled.factory(),
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
                self.at(Problem::new(&named.value.span, message))
            })?;
        }
        let first = target.formulas.first().map(|formula| formula.text.clone()).unwrap_or_default();
        let requirement = mishandle_stl::Formula::parse(&first)
            .map_err(|source| RolloutError::Parse { formula: first.clone(), source })?;
        target.system(&all, &Specification::from_formulas(&target.formulas, requirement)?)?;
        Ok(target)
    }

    /// Returns this robot with a controller, in the systems of which states can be recorded.
    ///
    /// # Errors
    /// If an expression does not fit the number of actions of the controller.
    pub fn controlled(
        &self,
        controller: Arc<dyn Controller>,
        noise: Noise,
    ) -> Result<ControlledRobot, RobotError> {
        let robot = Arc::new(self.compiled(controller.action_size())?);
        let disturbances = self.disturbances_of(robot.action_size);
        Ok(ControlledRobot { robot, controller, noise, disturbances })
    }

    /// Returns the environment over the axes of the start.
    ///
    /// # Errors
    /// As for [`controlled`](Self::controlled).
    pub fn starts(&self) -> Result<RobotEnvironment, RobotError> {
        let robot = Arc::new(self.compiled(self.actions())?);
        let axes = robot.axes.iter().map(|(axis, _)| axis).filter(|axis| axis.kind == AxisKind::Start);
        let space = Space::new("starts", axes.cloned().collect())?;
        Ok(RobotEnvironment::over(robot, &space)?)
    }

    /// Returns the model of pictures, with all visual geoms.
    pub fn picture_model(&self) -> &PictureModel {
        &self.model.picture
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

    fn library<'a>(
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
    fn robot(&self, actions: usize) -> Result<Robot, Problem> {
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
        for named in &description.ends {
            if sample.add(&named.value)? != 1 {
                return Err(Problem::new(&named.value.text.span, "a condition of [ends] is one number"));
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

/// Largest bias and largest standard deviation of the noise of a sensor, in this unit.
fn sensor_errors(unit: &str) -> [f64; 2] {
    match unit {
        "m" => [0.02, 0.01],
        "rad" => [0.01, 0.005],
        "m/s" | "rad/s" => [0.1, 0.1],
        _ => [0.02, 0.02],
    }
}

/// Largest number of physics steps between the start and sample 0.
const MAX_SETTLING: f64 = 1e6;

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

/// Returns the actuators that get the controls of `action`, in its order.
fn actuated(description: &Description, library: &Library<'_>) -> Result<Vec<usize>, Problem> {
    match &description.policy.actuators {
        None => Ok((0..library.model.actuators()).collect()),
        Some(group) => library
            .elements(ElementKind::Actuator, Some(&Argument::Name(group.text.clone())))
            .map_err(|message| Problem::new(&group.span, message)),
    }
}

/// Looks up the elements of each group, so that a mistake in one is reported where it stands.
fn check_groups(description: &Description, library: &Library<'_>) -> Result<(), Problem> {
    for named in &description.constants {
        let Constant::Group { kind, names } = &named.value else { continue };
        let kind = crate::pattern::kind(kind).ok_or_else(|| {
            Problem::new(
                &named.key.span,
                "groups are of the kind joint, actuator, body, geom, site or sensor",
            )
        })?;
        members(library.model, kind, names).map_err(|(span, message)| Problem::new(&span, message))?;
    }
    Ok(())
}

/// Compiles each constant that is not a group, so that a mistake in one is reported where it
/// stands.
fn check_constants(description: &Description, library: &Library<'_>) -> Result<(), Problem> {
    use mishandle_expression::Names;
    for named in &description.constants {
        match &named.value {
            Constant::Expression(expression) => {
                PhaseBuilder::new(library).add(expression)?;
            }
            Constant::Group { .. } => {}
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
            true => Argument::Name(name.clone()),
            false => Argument::Text(name.clone()),
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

/// Returns the numbers that an episode remembers.
fn remembered_parts(
    description: &Description,
    library: &Library<'_>,
) -> Result<Vec<RememberedPart>, Problem> {
    let mut first = 0;
    let mut parts = Vec::new();
    for named in &description.memory {
        let mut phase = PhaseBuilder::new(library);
        let size = phase.add(&named.value.start)?;
        let (name, is_number) = (named.key.name.clone(), phase.is_number(0));
        if library.constants.iter().any(|constant| constant.key.name == name)
            || library.parameters.contains(&name)
        {
            return Err(Problem::new(
                &named.key.span,
                format!("`{name}` is the name of a constant or of an axis as well"),
            ));
        }
        parts.push(RememberedPart { name, place: first..first + size, is_number });
        first += size;
    }
    Ok(parts)
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

impl RobotFile {
    /// Returns the model for physics.
    pub fn model(&self) -> &Model {
        &self.model.physics
    }
}
