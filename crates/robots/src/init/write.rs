//! The text of a first target file.

use std::fmt::Write as _;

use crate::error::RobotError;
use crate::init::facts::{ActionKind, PartFacts, PolicyFacts, PolicySizes};
use crate::init::parts::{COMMANDS, Words, known, scaled};
use crate::init::robot::{Floor, JointFacts, RobotFacts};
use crate::init::{FirstFile, FirstPolicy, Measured, Paths};

/// Duration of a control step if nothing says it, s.
const PERIOD: f64 = 0.02;

/// Standard gravity, m/s².
const GRAVITY: f64 = 9.81;

/// Share of its weight with which a robot is pushed, and share of its mass that it carries.
const PUSH: f64 = 0.3;
const PAYLOAD: f64 = 0.2;

/// A text in the making.
pub(super) struct Writer<'a> {
    pub(super) robot: &'a RobotFacts,
    pub(super) facts: &'a PolicyFacts,
    pub(super) sizes: PolicySizes,
    allow_outside: bool,
    is_bare: bool,
    measured: Option<&'a Measured>,
    text: String,
    pub(super) unknown: Vec<String>,
    pub(super) remarks: Vec<String>,
}

/// Returns the target file of a robot and a policy.
pub(crate) fn file(
    robot: &RobotFacts,
    paths: &Paths,
    facts: &PolicyFacts,
    sizes: PolicySizes,
    is_bare: bool,
    measured: Option<&Measured>,
) -> Result<FirstFile, RobotError> {
    let unknown = robot.unknown.clone();
    let remarks = robot.remarks.clone();
    let allow_outside = paths.allow_outside;
    let text = String::new();
    let mut writer = Writer { robot, facts, sizes, allow_outside, is_bare, measured, text, unknown, remarks };
    writer.model(&paths.model);
    match &paths.policy {
        FirstPolicy::Onnx(policy) if !is_bare => {
            writer.constants();
            writer.start();
            writer.control();
            let parts = writer.parts();
            writer.policy(policy, &parts);
            writer.observation(&parts);
            writer.signals_and_axes(parts.iter().any(|part| part.line.contains(COMMANDS[0])));
        }
        policy => {
            writer.bare_constants();
            writer.start();
            writer.control();
            writer.bare_policy(policy);
            writer.bare_observation();
            writer.signals_and_axes(false);
        }
    }
    let head = writer.head(&paths.name);
    let Writer { text, unknown, remarks, .. } = writer;
    Ok(FirstFile { text: head + &text, unknown, remarks, loads: true })
}

/// A part of the observation with its line in the file.
struct PartLine {
    name: String,
    line: String,
}

impl<'a> Writer<'a> {
    pub(super) fn line(&mut self, line: impl AsRef<str>) {
        self.text.push_str(line.as_ref());
        self.text.push('\n');
    }

    /// The comment at the top, which repeats what is not known.
    fn head(&self, name: &str) -> String {
        let mut head = String::new();
        let source = if self.facts.source.is_empty() {
            "from the model alone".to_string()
        } else {
            format!("from the model and {}", comment(&self.facts.source))
        };
        let _ = writeln!(head, "# Written by Mishandle {source}.");
        for (what, lines) in [("not known", &self.unknown), ("note", &self.remarks)] {
            for line in lines {
                let _ = writeln!(head, "# TODO {what}: {}", comment(line));
            }
        }
        let _ = writeln!(head, "format = 1\nname = {}\n", text(name));
        head
    }

    fn model(&mut self, model: &str) {
        self.line("[model]");
        self.line(format!("file = {}", text(model)));
        if self.allow_outside {
            self.line("allow_outside = true    # the model refers to files outside its folder");
        }
        if let Some(timestep) = self.facts.timestep {
            self.line(format!("timestep = {timestep}"));
        }
        if self.adds_positions() && !self.robot.is_implicit {
            self.line(
                "integrator = \"implicitfast\"    # the default of mjlab; Euler diverges with a large kv",
            );
        }
        if matches!((&self.robot.base, &self.robot.floor), (Some(_), Floor::Missing)) {
            self.line("\n[[model.add]]    # a floor, whose friction decides because of its priority");
            self.line("parent = \"world\"");
            self.line(
                "xml = '<geom name=\"floor\" type=\"plane\" size=\"0 0 0.05\" friction=\"1 0.005 0.0001\" priority=\"1\"/>'",
            );
        }
        if self.is_bare {
            if self.robot.model.actuators() == 0 {
                self.bare_actuators();
            }
        } else if !self.robot.has_actuators() || self.replaces_motors() {
            self.actuators();
        }
        self.line("");
    }

    fn constants(&mut self) {
        let robot = self.robot;
        let names: Vec<String> = robot.joints.iter().map(|joint| text(&joint.name)).collect();
        let own = |joint: &'a JointFacts| joint.actuator.as_ref().filter(|_| !self.replaces_motors());
        let actuators: Vec<String> = robot
            .joints
            .iter()
            .map(|joint| text(own(joint).map_or(&joint.name, |actuator| &actuator.name)))
            .collect();
        self.line("[constants]    # joints and their actuators, in the order of the actions");
        self.line(format!("joints = {{ group = \"joint\", names = [{}] }}", names.join(", ")));
        self.line(format!("actuators = {{ group = \"actuator\", names = [{}] }}", actuators.join(", ")));
        let scales: Vec<f64> = robot.joints.iter().map(|joint| joint.scale.unwrap_or(1.0)).collect();
        if robot.joints.iter().any(|joint| joint.scale.is_none()) {
            self.unknown.push("the scale of the actions: here 1".to_string());
        }
        if scales.iter().all(|scale| *scale == scales[0]) {
            self.line(format!("scale = {}", scales[0]));
        } else {
            self.line(format!("scale = {}", list(&scales)));
        }
        if let Some(offset) = self.offset() {
            self.line(format!("offset = {}    # joint positions for an action of 0", list(&offset)));
        }
        let gains: Option<Vec<[f64; 2]>> = robot.joints.iter().map(|joint| joint.gains).collect();
        if self.moves_by_force()
            && let Some(gains) = gains
        {
            for (index, name) in ["kp", "kd"].into_iter().enumerate() {
                let values: Vec<f64> = gains.iter().map(|gains| gains[index]).collect();
                self.line(format!("{name} = {}", list(&values)));
            }
        }
        let mut others = Vec::new();
        if let Some(observed) = &robot.observed {
            others.push(("observed".to_string(), observed.clone()));
        }
        for (part, key) in self.facts.parts.iter().zip(keys(&self.facts.parts)) {
            if let Some(group) = self.own_group(part, &key) {
                others.push((group, part.joints.clone()));
            }
        }
        for (group, joints) in &others {
            let names: Vec<String> = joints.iter().map(|name| text(name)).collect();
            self.line(format!("{group} = {{ group = \"joint\", names = [{}] }}", names.join(", ")));
        }
        let own: Vec<(String, f64)> =
            robot.joints.iter().map(|joint| (joint.name.clone(), joint.default)).collect();
        self.line("\n[constants.default]    # positions of the joints, rad or m\nof = \"joints\"");
        for (name, value) in &own {
            self.line(format!("{} = {value}", text(name)));
        }
        for (group, joints) in others {
            self.line(format!("\n[constants.default_{group}]\nof = \"{group}\""));
            for name in &joints {
                let known = own.iter().find(|(own, _)| own == name).map(|(_, value)| *value);
                let value = known.or_else(|| self.facts.default_of(name)).unwrap_or(0.0);
                self.line(format!("{} = {}", text(name), super::robot::shortest(value)));
            }
        }
        self.line("");
    }

    /// Returns the offset of the actions if it is not the default pose.
    fn offset(&self) -> Option<Vec<f64>> {
        let offset: Vec<f64> =
            self.facts.offset.as_ref()?.iter().map(|x| super::robot::shortest(*x)).collect();
        let joints = self.robot.joints.iter();
        let differs = joints.zip(&offset).any(|(joint, offset)| (joint.default - offset).abs() > 1e-6);
        (differs && self.facts.action == ActionKind::Position).then_some(offset)
    }

    /// Returns the name of the group of a part's joints, if they are neither those of the actions
    /// nor those of the whole observation.
    fn own_group(&self, part: &PartFacts, key: &str) -> Option<String> {
        let of_actions = self.robot.joints.iter().map(|joint| &joint.name).eq(&part.joints);
        let is_own =
            !part.joints.is_empty() && !of_actions && self.robot.observed.as_ref() != Some(&part.joints);
        is_own.then(|| format!("{key}_joints"))
    }

    fn start(&mut self) {
        let robot = self.robot;
        self.line("[start]");
        let mut wins = "";
        match &robot.keyframe {
            // Motors beside the file's actuators would push with these controls.
            Some(keyframe) if self.replaces_motors() && robot.keyframe_has_controls() => {
                self.remarks.push(format!(
                    "the file leaves out the keyframe `{keyframe}`, because it sets controls of the model's motors"
                ));
            }
            Some(keyframe) => {
                self.line(format!("keyframe = {}", text(keyframe)));
                wins = "    # wins over the keyframe, its height too";
            }
            None => {}
        }
        match &robot.base {
            Some(base) => {
                let joint = text(&base.joint);
                let pose = format!("[0, 0, {}, *quat_euler(roll, pitch, 0)]", base.height);
                self.line(format!("{joint} = \"{pose}\"{wins}"));
                if !robot.joints.is_empty() {
                    self.line("joints = \"default\"");
                }
            }
            None if robot.joints.is_empty() => {}
            None => self.line("joints = \"default + start_offset\""),
        }
        self.line("");
    }

    fn control(&mut self) {
        let own = self.robot.model.timestep();
        let period = match self.facts.period {
            Some(period) => period,
            // A whole number of physics steps, in decimal digits.
            None if self.is_bare => {
                format!("{:.9}", (PERIOD / own - 1e-6).ceil().max(1.0) * own).parse().unwrap_or(PERIOD)
            }
            None => PERIOD,
        };
        if self.facts.period.is_none() {
            self.unknown.push(format!("the period of the policy: here {period} s"));
        }
        if self.facts.timestep.is_none() && !self.is_bare {
            let timestep = self.robot.model.timestep();
            self.unknown
                .push(format!("the physics step of its training: here that of the model, {timestep} s"));
        }
        let timestep = self.facts.timestep.unwrap_or(self.robot.model.timestep());
        let substeps = period / timestep;
        self.line("[control]");
        self.line(format!("period = {period}"));
        self.line(format!("steps = {}", (5.0 / period).round().max(1.0)));
        if (substeps - substeps.round()).abs() > 1e-6 * substeps || substeps.round() < 1.0 {
            self.line(format!("substeps = {}", substeps.ceil()));
        }
        self.line("");
    }

    /// Returns the parts of the observation. Parts that are not known are comments.
    fn parts(&mut self) -> Vec<PartLine> {
        let robot = self.robot;
        let own;
        let parts = if self.facts.parts.is_empty() {
            self.unknown.push(
                "the parts of the observation and their order: here base, joints and last action".to_string(),
            );
            let base = ["base_ang_vel", "projected_gravity"].into_iter().filter(|_| robot.base.is_some());
            let part = |name: &str| PartFacts {
                name: name.to_string(),
                is_relative: Some(true),
                ..PartFacts::default()
            };
            own = base.chain(["joint_pos", "joint_vel", "actions"]).map(part).collect::<Vec<_>>();
            &own
        } else {
            &self.facts.parts
        };
        let mut lines = Vec::new();
        let mut sum = 0;
        let mut without_size = Vec::new();
        for (part, name) in parts.iter().zip(keys(parts)) {
            let own_group = self.own_group(part, &name);
            let others = match &robot.observed {
                Some(observed) if part.joints.is_empty() || part.joints == *observed => Some("observed"),
                _ => None,
            };
            let group = own_group.as_deref().or(others).unwrap_or("joints");
            let joint_count = match (own_group.is_some(), others, &robot.observed) {
                (true, ..) => part.joints.len(),
                (false, Some(_), Some(observed)) => observed.len(),
                _ => robot.joints.len(),
            };
            let default = if group == "joints" { "default".to_string() } else { format!("default_{group}") };
            let words = Words {
                base: robot.base.as_ref().map(|base| base.body.as_str()),
                tool: self.facts.tool,
                site: robot.site.as_deref(),
                joints: group,
                default: &default,
                joint_count,
                action_count: self.sizes.action.unwrap_or(robot.joints.len()),
            };
            let line = match known(part, &words) {
                Some(found) => {
                    sum += found.size;
                    let value = scaled(part, &found.expression);
                    let unit = if found.unit.is_empty() || !part.scale.is_empty() {
                        String::new()
                    } else {
                        format!(", unit = \"{}\"", found.unit)
                    };
                    format!("{name} = {{ value = \"{value}\"{unit} }}    # {}", numbers(found.size))
                }
                None => {
                    sum += part.size.unwrap_or(0);
                    let size = part.size.map_or("an unknown number of numbers".to_string(), numbers);
                    if part.size.is_none() {
                        without_size.push(part.name.clone());
                    }
                    let history = match part.history {
                        0 | 1 => String::new(),
                        steps => format!(", remembered for {steps} control steps"),
                    };
                    self.unknown
                        .push(format!("the part `{}` of the observation: {size}{history}", part.name));
                    format!("# TODO {name} = \"\"    # {size}{}", comment(&history))
                }
            };
            lines.push(PartLine { name, line });
        }
        match (self.sizes.observation, without_size.as_slice()) {
            (Some(size), [one]) if size > sum => {
                self.unknown
                    .push(format!("`{one}` has {}, if all other parts are right", numbers(size - sum)));
            }
            (Some(size), []) if size != sum => {
                let layout = self.gymnasium(size).filter(|_| self.facts.parts.is_empty());
                self.remarks.push(format!(
                    "the parts have {}, but the policy reads {size}{}",
                    numbers(sum),
                    layout.unwrap_or_default()
                ));
            }
            _ => {}
        }
        lines
    }

    /// Returns the hint that a number of inputs is that of the usual observation of Gymnasium.
    fn gymnasium(&self, size: usize) -> Option<String> {
        let positions = self.robot.model.qpos_size();
        let velocities = self.robot.model.qvel_size();
        // A robot's place in its plane or on its line is left out.
        let left_out = [0, 1, 2].into_iter().find(|left_out| positions + velocities == size + left_out)?;
        Some(format!(
            " = {positions} - {left_out} + {velocities}: the usual observation of Gymnasium's robots is all positions but the \
             first {left_out}, then all velocities, `qpos('.*')[{left_out}:]` and `qvel('.*')`"
        ))
    }

    fn policy(&mut self, policy: &str, parts: &[PartLine]) {
        let robot = self.robot;
        let count = robot.joints.len();
        if let Some(size) = self.sizes.action.filter(|size| *size != count) {
            self.remarks.push(format!("the policy has {size} actions, but they move {count} joints"));
        }
        let target =
            if self.offset().is_some() { "offset + scale * action" } else { "default + scale * action" };
        let action = match self.facts.action {
            _ if self.acts_by_control() => "scale * action".to_string(),
            _ if self.moves_by_force() => {
                if robot.joints.iter().all(|joint| joint.gains.is_some()) {
                    self.remarks.push(
                        "the actuators of the model take forces, so the file computes them once per control step; \
                         position actuators would do it in every physics step"
                            .to_string(),
                    );
                    format!("kp * ({target} - qpos(joints)) - kd * qvel(joints)")
                } else {
                    self.unknown
                        .push("stiffness and damping of the joints, whose actuators take forces".to_string());
                    target.to_string()
                }
            }
            _ => target.to_string(),
        };
        if self.replaces_motors() {
            self.remarks.push(
                "the actuators of the model take forces, so the file adds position actuators, which act in every physics step, \
                 and leaves those of the model at 0"
                    .to_string(),
            );
        }
        if self.facts.action == ActionKind::Unknown {
            let meaning = if self.acts_by_control() {
                "controls of the actuators, which take forces"
            } else {
                "targets of joint positions"
            };
            self.unknown.push(format!("the meaning of the actions: here {meaning}"));
        }
        self.line("[policy]");
        self.line(format!("onnx = {}", text(policy)));
        let names: Vec<String> = parts.iter().map(|part| format!("\"{}\"", part.name)).collect();
        self.line(format!("observation = [{}]", names.join(", ")));
        self.line(format!("actions = {}", self.sizes.action.unwrap_or(count)));
        self.line(format!("action = \"{action}\"\nactuators = \"actuators\"\n"));
    }

    fn observation(&mut self, parts: &[PartLine]) {
        self.line("[observation]");
        for part in parts {
            self.line(&part.line);
        }
        self.line("");
    }

    fn signals_and_axes(&mut self, has_command: bool) {
        let robot = self.robot;
        let mut axes = Vec::new();
        let bounds = self.measured.map_or([None; 2], |measured| measured.bounds);
        let bounds = |default: [f64; 2]| [0, 1].map(|index| bounds[index].unwrap_or(default[index]));
        match &robot.base {
            Some(base) => {
                let [tilt, height] = bounds([1.0, rounded(0.5 * base.height)]);
                let body = &base.body;
                self.line("[signals]");
                self.line(format!("height = {{ value = \"body_pos('{body}')[2]\", unit = \"m\" }}"));
                self.line(format!(
                    "tilt = {{ value = \"acos(clip(axis_z('{body}')[2], -1, 1))\", unit = \"rad\" }}\n"
                ));
                self.line("[formulas]    # the first one is the default requirement");
                self.line(format!("upright = \"always(tilt <= {tilt})\""));
                self.line(format!("high = \"always(height >= {height})\"\n"));
            }
            None if robot.joints.is_empty() => {
                let [speed, distance] = bounds([10.0, 3.0]);
                let body = &robot.body;
                self.line("[signals]");
                self.line(format!("speed = {{ value = \"norm(body_vel('{body}'))\", unit = \"m/s\" }}"));
                self.line(format!("distance = {{ value = \"norm(body_pos('{body}'))\", unit = \"m\" }}\n"));
                self.line("[formulas]    # the first one is the default requirement");
                self.line(format!("slow = \"always(speed <= {speed})\""));
                self.line(format!("near = \"always(distance <= {distance})\"\n"));
            }
            None => {
                let [speed, distance] = bounds([10.0, 3.0]);
                self.line("[signals]");
                self.line("joint_speed = { value = \"max(abs(qvel(joints)))\", unit = \"rad/s\" }");
                self.line(
                    "joint_distance = { value = \"max(abs(qpos(joints) - default))\", unit = \"rad\" }\n",
                );
                self.line("[formulas]    # the first one is the default requirement");
                self.line(format!("slow = \"always(joint_speed <= {speed})\""));
                self.line(format!("near = \"always(joint_distance <= {distance})\"\n"));
            }
        }
        self.unknown
            .push("which formulas the robot must satisfy: those of the file are examples".to_string());
        if robot.base.is_some() {
            axes.push("roll = { range = [-0.1, 0.1], unit = \"rad\" }".to_string());
            axes.push("pitch = { range = [-0.1, 0.1], unit = \"rad\" }".to_string());
        } else if !robot.joints.is_empty() {
            axes.push(
                "start_offset = { range = [-0.05, 0.05], unit = \"rad\" }    # of all joints".to_string(),
            );
        }
        if has_command {
            for (name, range, nominal, unit) in [
                (COMMANDS[0], "[-1, 1]", "0.5", "m/s"),
                (COMMANDS[1], "[-0.5, 0.5]", "0", "m/s"),
                (COMMANDS[2], "[-1, 1]", "0", "rad/s"),
            ] {
                axes.push(format!(
                    "{name} = {{ kind = \"command\", range = {range}, nominal = {nominal}, unit = \"{unit}\" }}"
                ));
            }
        }
        match (&robot.base, &robot.floor) {
            (Some(_), Floor::Missing) => axes.push(
                "friction = { kind = \"model\", range = [0.3, 1.2], nominal = 1, set = \"geom_friction('floor')[0]\" }".to_string(),
            ),
            (_, Floor::Named(name)) => axes.push(format!(
                "friction = {{ kind = \"model\", range = [0.3, 1.2], nominal = 1, scale = \"geom_friction('{name}')[0]\" }}    \
                 # MuJoCo takes the larger friction of two geoms unless one has priority"
            )),
            (Some(_), Floor::Unnamed) => self.unknown.push("the name of the floor, for an axis of its friction".to_string()),
            (None, _) => {}
        }
        if !robot.body.is_empty() && robot.mass > 0.0 {
            let body = &robot.body;
            let payload = rounded(PAYLOAD * robot.mass);
            let push = rounded(PUSH * GRAVITY * robot.mass);
            axes.push(format!(
                "payload = {{ kind = \"model\", range = [0, {payload}], nominal = 0, unit = \"kg\", add = \"body_mass('{body}')\" }}"
            ));
            axes.push(format!(
                "push = {{ kind = \"event\", body = \"{body}\", time = [1, 3], duration = 0.2, x = [-{push}, {push}], y = [-{push}, \
                 {push}] }}"
            ));
        }
        self.line("[axes]    # examples: change their ranges");
        for axis in axes {
            self.line(axis);
        }
        if let Some(measured) = self.measured {
            let names: Vec<String> = measured.axes.iter().map(|name| text(name)).collect();
            self.line(
                "\n[spaces]    # the first one is the default: the axes above, and what every robot has",
            );
            self.line(format!("scenarios = [{}]", names.join(", ")));
        }
    }
}

/// Returns a text of TOML.
pub(super) fn text(text: &str) -> String {
    let mut quoted = String::from("\"");
    for letter in text.chars() {
        match letter {
            '"' | '\\' => quoted.extend(['\\', letter]),
            letter if letter.is_control() => {
                let _ = write!(quoted, "\\u{:04X}", u32::from(letter));
            }
            letter => quoted.push(letter),
        }
    }
    quoted + "\""
}

/// Returns a text that stays on its line of a comment.
pub(super) fn comment(text: &str) -> String {
    text.chars().map(|letter| if letter.is_control() { ' ' } else { letter }).collect()
}

/// Returns a name as a key of the file, which expressions may use.
fn key(name: &str) -> String {
    let letter = |c: char| if c.is_ascii_alphanumeric() || c == '_' { c } else { '_' };
    let key: String = name.chars().map(letter).collect();
    if key.starts_with(|first: char| first.is_ascii_digit()) { format!("_{key}") } else { key }
}

/// Returns the keys of the parts of an observation: a part with the name of an earlier one gets a
/// number.
fn keys(parts: &[PartFacts]) -> Vec<String> {
    let mut keys: Vec<String> = Vec::new();
    for part in parts {
        let plain = key(&part.name);
        let mut numbered = (2..).map(|number| format!("{plain}_{number}"));
        let is_new = |key: &String| !keys.contains(key);
        let own = Some(plain.clone()).filter(is_new).or_else(|| numbered.find(is_new));
        keys.push(own.unwrap_or(plain));
    }
    keys
}

pub(super) fn list(values: &[f64]) -> String {
    format!("[{}]", values.iter().map(ToString::to_string).collect::<Vec<_>>().join(", "))
}

fn numbers(count: usize) -> String {
    if count == 1 { "1 number".to_string() } else { format!("{count} numbers") }
}

/// Rounds to two significant digits.
pub(super) fn rounded(value: f64) -> f64 {
    format!("{value:.1e}").parse().unwrap_or(value)
}
