//! The names that the expressions of a file may use: elements of the model, constants, axes.

use std::ops::Range;

use crate::expression::{Argument, Meaning, Names, Node, NodeKind, Reading, Size};
use mishandle_stl::nearest;
use mishandle_world::{Body, ElementKind, Model};

use crate::description::{self, Constant, Named};
use crate::document::Text;
use crate::pattern::{kind, select};
use crate::quantity::{ContactOwner, Quantity};

/// A function that reads a quantity, with its arguments and its meaning, for the documentation.
pub struct QuantityFunction {
    /// Name with its arguments.
    pub call: &'static str,
    /// Quantity and unit.
    pub meaning: &'static str,
}

const fn function(call: &'static str, meaning: &'static str) -> QuantityFunction {
    QuantityFunction { call, meaning }
}

/// All functions that read quantities. An argument in quotation marks is a name or a regular
/// expression of whole names; without them it is a group of `[constants]`.
pub static QUANTITY_FUNCTIONS: &[QuantityFunction] = &[
    function("qpos(joints)", "positions of joints, rad or m; a free joint has 7, a ball joint 4"),
    function(
        "key_qpos(keyframe, joints)",
        "positions of joints in a keyframe, which is given by its name or its number: `key_qpos('home', joints)`",
    ),
    function("qvel(joints)", "velocities of joints, rad/s or m/s; a free joint has 6, a ball joint 3"),
    function("joint_low(joints)", "lower limits of joints"),
    function("joint_high(joints)", "upper limits of joints"),
    function("ctrl(actuators)", "controls of actuators"),
    function(
        "actuator_force(actuators)",
        "forces of actuators, N or N m, at the start of the last physics step",
    ),
    function(
        "bias_forces(joints)",
        "gravity, Coriolis and centrifugal forces, N or N m, at the start of the last physics step",
    ),
    function("body_pos(body)", "origin of a body's frame, m"),
    function("body_quat(body)", "orientation of a body, quaternion (w, x, y, z)"),
    function("body_vel(body)", "velocity of a body's frame in world axes, m/s"),
    function("body_angvel(body)", "angular velocity of a body in world axes, rad/s"),
    function("body_com(body)", "center of mass of a body, m"),
    function(
        "subtree_com(body)",
        "center of mass of a body with all its descendants, m, at the start of the last physics step",
    ),
    function(
        "body_frame(body, v)",
        "the vector v of world axes in the axes of a body: gravity is `body_frame('trunk', [0, 0, -1])`, the velocity \
         that the body feels `body_frame('trunk', body_vel('trunk'))`",
    ),
    function("repeat(x, n)", "the number x, n times: a height scan over flat ground is `repeat(0.5, 187)`"),
    function("axis_x(body)", "x axis of a body in world axes"),
    function("axis_y(body)", "y axis of a body in world axes"),
    function("axis_z(body)", "z axis of a body in world axes"),
    function("site_pos(site)", "position of a site, m"),
    function("site_mat(site)", "rotation matrix of a site, row by row"),
    function("geom_pos(geom)", "position of a geom, m"),
    function("sensor(sensors)", "data of sensors of the model, at the start of the last physics step"),
    function(
        "cfrc_ext(bodies)",
        "torque and force from outside on each body, 6 numbers, N m and N, about the center of mass of its tree, at the start \
         of the last physics step: MuJoCo's `cfrc_ext`; without an argument those of all bodies, also without names, but the world",
    ),
    function(
        "contact_forces(geom or body)",
        "list of the magnitudes of the forces at its contact points, N, at the start of the last physics step",
    ),
];

/// Largest number of entries that `repeat` makes.
const MOST_REPEATS: f64 = 10_000.0;

/// Names of the library for one place of the file.
pub(crate) struct Library<'a> {
    pub model: &'a Model,
    pub constants: &'a [Named<Constant>],
    /// Names of the axes that expressions may read, in the order of the parameters.
    pub parameters: &'a [String],
    /// Names, first entries and sizes of the numbers that an episode remembers, where they may be
    /// read.
    pub memory: &'a [RememberedPart],
    /// Length of the action, where it may be read.
    pub actions: Option<usize>,
    /// Signals that expressions may read: those of signals, rewards and ends.
    pub signals: &'a [Named<description::Quantity>],
}

/// Numbers that an episode remembers: their name and their place among all of them.
#[derive(Clone, Debug)]
pub(crate) struct RememberedPart {
    pub name: String,
    pub place: Range<usize>,
    pub is_number: bool,
}

fn names_of(functions: &[QuantityFunction]) -> impl Iterator<Item = &'static str> {
    functions.iter().map(|function| function.call.split('(').next().unwrap_or_default())
}

impl Library<'_> {
    fn constant(&self, name: &str) -> Option<&Constant> {
        self.constants.iter().find(|constant| constant.key.name == name).map(|constant| &constant.value)
    }

    /// Returns the meaning of a signal: its expression, within its bounds.
    fn signal(&self, name: &str) -> Result<Meaning<Quantity>, String> {
        let found = self.signals.iter().find(|signal| signal.key.name == name);
        let signal = &found.ok_or_else(|| format!("there is no signal `{name}`"))?.value;
        if signal.over.is_some() {
            return Err(format!(
                "`{name}` is a signal over the physics steps, which only formulas read; write its expression"
            ));
        }
        let node = signal.value.node.clone();
        let Some([low, high]) = signal.clip else { return Ok(Meaning::Definition(node)) };
        let span = node.span.clone();
        let bound = |value| Node { kind: NodeKind::Number(value), span: span.clone() };
        let arguments = vec![node, bound(low), bound(high)];
        Ok(Meaning::Definition(Node { kind: NodeKind::Call("clip".to_string(), arguments), span }))
    }

    /// Returns the elements of the kind that an argument selects.
    pub(crate) fn elements(
        &self,
        required: ElementKind,
        argument: Option<&Argument>,
    ) -> Result<Vec<usize>, String> {
        let label = required.label();
        match argument {
            Some(Argument::Text(pattern)) => select(self.model, required, pattern),
            Some(Argument::Name(name)) => match self.constant(name) {
                Some(Constant::Group { kind: found, names }) => {
                    if kind(found) != Some(required) {
                        return Err(format!(
                            "`{name}` is a group of the kind \"{found}\"; this needs {label}s"
                        ));
                    }
                    members(self.model, required, names).map_err(|(_, message)| message)
                }
                Some(_) => {
                    Err(format!("`{name}` is not a group; write the name of a {label} in quotation marks"))
                }
                None => Err(format!(
                    "there is no group `{name}`; write the name of a {label} in quotation marks: '{name}'"
                )),
            },
            _ => Err(format!("this needs the name of a {label} in quotation marks, or a group")),
        }
    }

    fn one(&self, kind: ElementKind, argument: Option<&Argument>) -> Result<usize, String> {
        match self.elements(kind, argument)?.as_slice() {
            [index] => Ok(*index),
            several => Err(format!("this needs one {}, but {} match", kind.label(), several.len())),
        }
    }

    /// Returns a number for each element of a group.
    fn per_element(&self, group: &str, values: &[(crate::document::Key, f64)]) -> Result<Vec<f64>, String> {
        let Some(Constant::Group { kind: name, .. }) = self.constant(group) else {
            return Err(format!("there is no group `{group}`"));
        };
        let kind = kind(name).ok_or_else(|| format!("groups have no kind \"{name}\""))?;
        let elements = self.elements(kind, Some(&Argument::Name(group.to_string())))?;
        let mut found = vec![None; elements.len()];
        for (pattern, value) in values {
            let matching = select(self.model, kind, &pattern.name)?;
            let mut is_used = false;
            for (element, found) in elements.iter().zip(&mut found) {
                if matching.contains(element) {
                    found.get_or_insert(*value);
                    is_used = true;
                }
            }
            if !is_used {
                return Err(format!("`{}` matches no element of the group `{group}`", pattern.name));
            }
        }
        let names = crate::pattern::names(self.model, kind);
        let one = |(element, found): (&usize, Option<f64>)| {
            found.ok_or_else(|| format!("no pattern matches `{}` of the group `{group}`", names[*element]))
        };
        elements.iter().zip(found).map(one).collect()
    }

    fn joints(
        &self,
        argument: Option<&Argument>,
        part: impl Fn(usize) -> Range<usize>,
    ) -> Result<Vec<usize>, String> {
        Ok(self.elements(ElementKind::Joint, argument)?.into_iter().flat_map(part).collect())
    }

    fn limits(&self, argument: Option<&Argument>, index: usize) -> Result<Vec<f64>, String> {
        let limit = |joint: usize| {
            if self.model.joint_is_limited(joint) {
                Ok([self.model.joint_at(joint).low, self.model.joint_at(joint).high][index])
            } else {
                Err(format!("the joint `{}` has no limits", self.model.names(ElementKind::Joint)[joint]))
            }
        };
        self.elements(ElementKind::Joint, argument)?.into_iter().map(limit).collect()
    }
}

/// Returns the elements of a group in the order of its names, or the place of the name that is
/// wrong with a message.
pub(crate) fn members(
    model: &Model,
    kind: ElementKind,
    names: &[Text],
) -> Result<Vec<usize>, (Range<usize>, String)> {
    let mut found = Vec::new();
    for name in names {
        let own = select(model, kind, &name.text).map_err(|message| (name.span.clone(), message))?;
        if let Some(index) = own.iter().find(|index| found.contains(*index)) {
            let twice = &crate::pattern::names(model, kind)[*index];
            return Err((name.span.clone(), format!("`{twice}` is in the group twice")));
        }
        found.extend(own);
    }
    Ok(found)
}

fn numbers(what: Quantity, size: usize) -> Result<Reading<Quantity>, String> {
    Ok(Reading { what, size: Size::Vector(size) })
}

impl Names<Quantity> for Library<'_> {
    fn name(&self, name: &str) -> Result<Meaning<Quantity>, String> {
        let reading = |what, size| Ok(Meaning::Reading(Reading { what, size }));
        if let Some(index) = self.parameters.iter().position(|known| known == name) {
            return reading(Quantity::Parameter(index), Size::Number);
        }
        if let Some(part) = self.memory.iter().find(|part| part.name == name) {
            let size = if part.is_number { Size::Number } else { Size::Vector(part.place.len()) };
            return reading(Quantity::Remembered(part.place.clone()), size);
        }
        match (name, self.constant(name)) {
            (_, Some(Constant::Number(value))) => Ok(Meaning::Number(*value)),
            (_, Some(Constant::Vector(values))) => Ok(Meaning::Vector(values.clone())),
            (_, Some(Constant::Expression(expression))) => Ok(Meaning::Definition(expression.node.clone())),
            (_, Some(Constant::PerElement { group, values })) => {
                Ok(Meaning::Vector(self.per_element(&group.text, values)?))
            }
            (_, Some(Constant::Group { .. })) => {
                Err(format!("`{name}` is a group of elements; write for instance `qpos({name})`"))
            }
            ("time", None) => reading(Quantity::Time, Size::Number),
            ("bias_forces", None) => {
                let joints = (0..self.model.actuators()).map(|index| self.model.actuator_joint(index));
                let joints: Option<Vec<usize>> = joints.collect();
                let joints = joints
                    .ok_or("`bias_forces` needs actuators that act on joints; write `bias_forces(joints)`")?;
                let dofs: Vec<usize> =
                    joints.into_iter().map(|joint| self.model.joint_at(joint).dof).collect();
                let size = Size::Vector(dofs.len());
                reading(Quantity::BiasForces(dofs), size)
            }
            ("cfrc_ext", None) => {
                let bodies: Vec<Body> =
                    (1..self.model.count(ElementKind::Body)).map(|index| self.model.body_at(index)).collect();
                let size = Size::Vector(6 * bodies.len());
                reading(Quantity::ExternalForces(bodies), size)
            }
            ("pi", None) => Ok(Meaning::Number(std::f64::consts::PI)),
            ("action", None) => match self.actions {
                Some(size) => reading(Quantity::Action, Size::Vector(size)),
                None => Err("the action is not known here".to_string()),
            },
            (_, None) if self.signals.iter().any(|signal| signal.key.name == name) => self.signal(name),
            (_, None) => {
                let constants = self.constants.iter().map(|constant| constant.key.name.as_str());
                let known: Vec<&str> = constants
                    .chain(self.parameters.iter().map(String::as_str))
                    .chain(self.memory.iter().map(|part| part.name.as_str()))
                    .chain(["time", "pi"])
                    .chain(self.actions.map(|_| "action"))
                    .chain(self.signals.iter().map(|signal| signal.key.name.as_str()))
                    .collect();
                let hint = nearest(name, known.iter().copied());
                let hint = hint.map_or(String::new(), |nearest| format!("; did you mean `{nearest}`?"));
                Err(format!("there is no name `{name}`{hint} (names: {})", known.join(", ")))
            }
        }
    }

    fn reads(&self, function: &str) -> bool {
        names_of(QUANTITY_FUNCTIONS).any(|known| known == function)
    }

    fn call(&self, function: &str, arguments: &[Argument]) -> Result<Reading<Quantity>, String> {
        use Quantity as Q;
        let (keyframe, arguments) = match (function, arguments) {
            ("key_qpos", [keyframe, joints]) => (Some(keyframe), std::slice::from_ref(joints)),
            ("key_qpos", _) => {
                return Err(format!(
                    "`key_qpos` takes a keyframe and joints, not {} arguments",
                    arguments.len()
                ));
            }
            _ => (None, arguments),
        };
        if arguments.len() != 1 {
            return Err(format!("`{function}` takes 1 argument, not {}", arguments.len()));
        }
        let first = arguments.first();
        let model = self.model;
        let body = || Ok::<_, String>(model.body_at(self.one(ElementKind::Body, first)?));
        let position = |joint: usize| {
            let joint = model.joint_at(joint);
            joint.qpos..joint.qpos + joint.kind.positions()
        };
        let velocity = |joint: usize| {
            let joint = model.joint_at(joint);
            joint.dof..joint.dof + joint.kind.velocities()
        };
        let list = |indices: Vec<usize>, what: fn(Vec<usize>) -> Quantity| {
            let size = indices.len();
            numbers(what(indices), size)
        };
        match function {
            "qpos" => list(self.joints(first, position)?, Q::Positions),
            "key_qpos" => {
                let name = match keyframe {
                    Some(Argument::Text(name)) => name.clone(),
                    Some(Argument::Numbers(numbers)) if numbers.len() == 1 => numbers[0].to_string(),
                    _ => {
                        let message =
                            "`key_qpos` needs the name of a keyframe in quotation marks, or its number";
                        return Err(message.to_string());
                    }
                };
                let positions = model.key_qpos(crate::pattern::keyframe(model, &name)?);
                let values: Vec<f64> =
                    self.joints(first, position)?.into_iter().map(|index| positions[index]).collect();
                let size = values.len();
                numbers(Q::Constants(values), size)
            }
            "qvel" => list(self.joints(first, velocity)?, Q::Velocities),
            "bias_forces" => list(self.joints(first, velocity)?, Q::BiasForces),
            "ctrl" => list(self.elements(ElementKind::Actuator, first)?, Q::Controls),
            "actuator_force" => list(self.elements(ElementKind::Actuator, first)?, Q::ActuatorForces),
            "joint_low" => {
                let values = self.limits(first, 0)?;
                numbers(Q::Constants(values.clone()), values.len())
            }
            "joint_high" => {
                let values = self.limits(first, 1)?;
                numbers(Q::Constants(values.clone()), values.len())
            }
            "body_pos" => numbers(Q::BodyPosition(body()?), 3),
            "body_quat" => numbers(Q::BodyQuaternion(body()?), 4),
            "body_vel" => numbers(Q::BodyVelocity(body()?), 3),
            "body_angvel" => numbers(Q::BodyAngularVelocity(body()?), 3),
            "body_com" => numbers(Q::InertialPosition(body()?), 3),
            "subtree_com" => numbers(Q::CenterOfMass(body()?), 3),
            "axis_x" => numbers(Q::BodyAxis(body()?, 0), 3),
            "axis_y" => numbers(Q::BodyAxis(body()?, 1), 3),
            "axis_z" => numbers(Q::BodyAxis(body()?, 2), 3),
            "site_pos" | "site_mat" => {
                let index = self.one(ElementKind::Site, first)?;
                let site =
                    model.site(&model.names(ElementKind::Site)[index]).map_err(|error| error.to_string())?;
                if function == "site_pos" {
                    numbers(Q::SitePosition(site), 3)
                } else {
                    numbers(Q::SiteRotation(site), 9)
                }
            }
            "geom_pos" => numbers(Q::GeomPosition(self.one(ElementKind::Geom, first)?), 3),
            "sensor" => {
                let ranges: Vec<_> = self
                    .elements(ElementKind::Sensor, first)?
                    .into_iter()
                    .map(|index| model.sensor(index))
                    .collect();
                let range = ranges[0].start..ranges[ranges.len() - 1].end;
                let size = range.len();
                if ranges.iter().map(Range::len).sum::<usize>() != size {
                    return Err("the sensors of a pattern must follow each other in the model".to_string());
                }
                numbers(Q::Sensor(range), size)
            }
            "cfrc_ext" => {
                let bodies: Vec<Body> = self
                    .elements(ElementKind::Body, first)?
                    .into_iter()
                    .map(|index| model.body_at(index))
                    .collect();
                let size = 6 * bodies.len();
                numbers(Q::ExternalForces(bodies), size)
            }
            "contact_forces" => {
                let owner = match self.one(ElementKind::Geom, first) {
                    Ok(geom) => ContactOwner::Geom(geom),
                    Err(of_geoms) => match self.one(ElementKind::Body, first) {
                        Ok(index) => ContactOwner::Body(model.body_at(index)),
                        Err(_) => return Err(of_geoms),
                    },
                };
                Ok(Reading { what: Q::ContactForces(owner), size: Size::List })
            }
            _ => Err(format!("there is no function `{function}`")),
        }
    }

    fn definition(&self, function: &str, arguments: &[Node]) -> Result<Option<NodeKind>, String> {
        match function {
            "body_frame" => body_frame(arguments),
            "repeat" => repeat(arguments),
            _ => return Ok(None),
        }
        .map(Some)
    }

    fn functions(&self) -> Vec<String> {
        names_of(QUANTITY_FUNCTIONS).map(str::to_string).collect()
    }
}

/// Returns the coordinates of a vector along the axes of a body.
fn body_frame(arguments: &[Node]) -> Result<NodeKind, String> {
    let [body, vector] = arguments else {
        return Err(format!("`body_frame` takes a body and a vector, not {} arguments", arguments.len()));
    };
    let axis = |name: &str| Node {
        kind: NodeKind::Call(name.to_string(), vec![body.clone()]),
        span: body.span.clone(),
    };
    let axes = ["axis_x", "axis_y", "axis_z"].map(axis);
    let arguments = axes.into_iter().chain([vector.clone()]).collect();
    Ok(NodeKind::Call("coordinates".to_string(), arguments))
}

/// Returns a list with equal entries.
fn repeat(arguments: &[Node]) -> Result<NodeKind, String> {
    match arguments {
        [number, Node { kind: NodeKind::Number(count), .. }]
            if count.fract() == 0.0 && (1.0..=MOST_REPEATS).contains(count) =>
        {
            Ok(NodeKind::List(vec![(false, number.clone()); *count as usize]))
        }
        _ => Err(format!("`repeat` takes a number and how often, a whole number from 1 to {MOST_REPEATS}")),
    }
}
