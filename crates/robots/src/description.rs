//! Content of a target file, before it is compared with the model.

use crate::expression::{Node, parse};

use crate::axis_table::{AxisTable, axis};
use crate::cameras::{CameraTable, camera};
use crate::document::{Fields, Item, Key, Table, Text, Value};
use crate::error::Problem;

/// Version of the format.
const FORMAT: f64 = 1.0;

/// Largest number of physics steps of a control step.
pub(crate) const MAX_SUBSTEPS: f64 = 10_000.0;

/// Largest number of control steps of an episode.
const MAX_STEPS: f64 = 1e6;

/// A named part of the file.
#[derive(Clone, Debug)]
pub(crate) struct Named<T> {
    pub key: Key,
    pub value: T,
}

/// An expression with its text and place.
#[derive(Clone, Debug)]
pub(crate) struct Expression {
    pub node: Node,
    pub text: Text,
}

impl Expression {
    pub(crate) fn new(text: Text) -> Result<Expression, Problem> {
        match parse(&text.text) {
            Ok(node) => Ok(Expression { node, text }),
            Err(error) => Err(Problem::of_expression(&text.span, &text.text, &error)),
        }
    }
}

/// A constant.
#[derive(Clone, Debug)]
pub(crate) enum Constant {
    Number(f64),
    Vector(Vec<f64>),
    Expression(Expression),
    /// Elements of a kind: those with these names, in this order. A pattern stands for all that it
    /// matches, in the order of the model.
    Group {
        kind: String,
        names: Vec<Text>,
    },
    /// A number for each element of a group: those of the first pattern that matches.
    PerElement {
        group: Text,
        values: Vec<(Key, f64)>,
    },
}

/// A signal or a part of the observation.
#[derive(Clone, Debug)]
pub(crate) struct Quantity {
    pub value: Expression,
    pub unit: String,
    /// Reduction over the physics steps of a control step.
    pub over: Option<Over>,
    pub clip: Option<[f64; 2]>,
}

/// A reduction over the physics steps of a control step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Over {
    Max,
    Min,
    Sum,
    Mean,
}

#[derive(Clone, Debug)]
pub(crate) struct Control {
    pub span: std::ops::Range<usize>,
    /// Duration of a control step, s.
    pub period: f64,
    pub steps: usize,
    /// Physics steps per control step, instead of the time step of the model.
    pub substeps: Option<usize>,
}

/// Time that the physics runs before an episode.
#[derive(Clone, Debug)]
pub(crate) struct Settle {
    pub span: std::ops::Range<usize>,
    /// Duration, s.
    pub duration: f64,
}

/// Numbers that an episode remembers.
#[derive(Clone, Debug)]
pub(crate) struct Remembered {
    /// Values at the start.
    pub start: Expression,
    /// Values of a control step, from those of the step before and its action.
    pub next: Expression,
}

/// Position servos that keep velocity limits: `action` gives their targets.
#[derive(Clone, Debug)]
pub(crate) struct Servos {
    pub span: std::ops::Range<usize>,
    pub max_velocity: Vec<f64>,
    pub max_effort: Vec<f64>,
}

/// Where actions come from.
#[derive(Clone, Debug)]
pub(crate) enum PolicySource {
    /// A file: an ONNX model or a controller of ours.
    File(Text),
    /// An expression of the parts of the observation.
    Expression(Expression),
    /// The built-in controller of a site's position.
    TaskSpace(Box<TaskSpace>),
    /// A program that answers each observation with an action.
    Program(ProgramTable),
    /// Given with `--controller` only.
    Open,
}

/// Settings of the built-in controller of a site's position.
#[derive(Clone, Debug)]
pub(crate) struct TaskSpace {
    pub site: Text,
    /// Position of the site in the world, m, as an expression of the time.
    pub goal: Expression,
    /// Share of the error that a control step removes.
    pub gain: f64,
    /// Damping of the inverse Jacobian, in its unit squared.
    pub damping: f64,
    /// Largest change of a joint reference in a control step, rad or m.
    pub largest_joint_step: f64,
    /// Stiffness, 1/s², and damping, 1/s, of the joints, times their inertia.
    pub kp: f64,
    pub kd: f64,
}

/// A program that answers each observation with an action.
#[derive(Clone, Debug)]
pub(crate) struct ProgramTable {
    /// The program and its arguments.
    pub words: Vec<Text>,
    /// Time limit of an answer, s.
    pub time_limit: f64,
    /// Length of what the program remembers.
    pub state: usize,
}

#[derive(Clone, Debug)]
pub(crate) struct Policy {
    pub source: PolicySource,
    /// Names of the parts of the observation, in order; all of them if empty.
    pub observation: Vec<Text>,
    /// Controls as an expression of `action`.
    pub action: Expression,
    /// The group of the actuators that get the controls, in the order of the expression; all
    /// actuators in the order of the model by default.
    pub actuators: Option<Text>,
    /// Controls while no action has arrived yet, because of a delay.
    pub hold: Option<Expression>,
    /// Largest absolute value of an action; others are clipped.
    pub limit: f64,
    /// Number of actions; by default that of the expression, or of the actuators.
    pub actions: Option<usize>,
    /// Names of the input and output of an ONNX model.
    pub input: Option<Text>,
    pub output: Option<Text>,
}

#[derive(Clone, Debug)]
pub(crate) struct Description {
    pub name: String,
    pub model: Table,
    pub model_file: Text,
    pub constants: Vec<Named<Constant>>,
    pub keyframe: Option<Text>,
    /// Positions: joint or group, and expression.
    pub start: Vec<Named<Expression>>,
    /// Velocities: joint or group, and expression.
    pub start_velocity: Vec<Named<Expression>>,
    /// Poses of mocap bodies: position, or position and quaternion.
    pub start_mocap: Vec<Named<Expression>>,
    /// Time that the physics runs before an episode.
    pub settle: Option<Settle>,
    /// Conditions under which no episode starts.
    pub invalid: Vec<Expression>,
    pub memory: Vec<Named<Remembered>>,
    pub servos: Option<Servos>,
    pub control: Control,
    pub policy: Policy,
    pub observation: Vec<Named<Quantity>>,
    pub signals: Vec<Named<Quantity>>,
    pub rewards: Vec<Named<Expression>>,
    /// Conditions under which a training episode ends.
    pub ends: Vec<Named<Expression>>,
    pub axes: Vec<Named<AxisTable>>,
    pub formulas: Vec<Named<Text>>,
    /// Names of axes for each space.
    pub spaces: Vec<Named<Vec<Text>>>,
    pub cameras: Vec<Named<CameraTable>>,
    /// The body that cameras are about.
    pub object: Option<Text>,
}

impl Description {
    /// Reads the tree of a file.
    pub(crate) fn new(table: &Table) -> Result<Description, Problem> {
        let mut fields = Fields::new(table, "the file");
        if let Some(item) = fields.get("process") {
            let message = "a file with `process` names a simulator that is a program; it answers questions such as \
                           `falsify`, but has no robot to train or to draw";
            return Err(Problem::new(&item.span, message));
        }
        let format = fields.need("format")?;
        if format.number("format")? != FORMAT {
            return Err(Problem::new(&format.span, format!("this program reads format = {FORMAT}")));
        }
        let name = fields.need("name")?.text("name")?;
        let is_plain = |c: char| c.is_ascii_alphanumeric() || c == '-' || c == '_';
        if name.text.is_empty() || name.text.len() > 60 || !name.text.chars().all(is_plain) {
            return Err(Problem::new(&name.span, "`name` must be 1 to 60 letters, digits, `-` or `_`"));
        }
        let model = fields.need("model")?.table("model")?.clone();
        let model_file = Fields::new(&model, "[model]").need("file")?.text("file")?;
        let Starts { keyframe, positions, velocities, mocap, settle, invalid } = start(fields.get("start"))?;
        let description = Description {
            name: name.text,
            model,
            model_file,
            constants: named(fields.entries("constants")?, constant)?,
            keyframe,
            start: positions,
            start_velocity: velocities,
            start_mocap: mocap,
            settle,
            invalid,
            memory: named(fields.entries("memory")?, remembered)?,
            servos: fields.get("servos").map(servos).transpose()?,
            control: control(fields.need("control")?.table("control")?)?,
            policy: policy(fields.need("policy")?.table("policy")?)?,
            observation: named(fields.entries("observation")?, quantity)?,
            signals: named(fields.entries("signals")?, quantity)?,
            rewards: named(fields.entries("rewards")?, expression)?,
            ends: named(fields.entries("ends")?, expression)?,
            axes: named(fields.entries("axes")?, axis)?,
            formulas: named(fields.entries("formulas")?, |key, item| item.text(&key.name))?,
            spaces: named(fields.entries("spaces")?, |key, item| item.texts(&key.name))?,
            cameras: named(fields.entries("cameras")?, camera)?,
            object: fields.get("sight").map(object).transpose()?,
        };
        fields.finish()?;
        for (what, is_empty) in [
            ("signals", description.signals.is_empty()),
            ("formulas", description.formulas.is_empty()),
            ("observation", description.observation.is_empty()),
        ] {
            if is_empty {
                return Err(Problem::new(
                    &table.span,
                    format!("the file needs a table [{what}] with at least one entry"),
                ));
            }
        }
        Ok(description)
    }
}

fn named<T>(
    entries: &[(Key, Item)],
    read: impl Fn(&Key, &Item) -> Result<T, Problem>,
) -> Result<Vec<Named<T>>, Problem> {
    let one = |(key, item): &(Key, Item)| Ok(Named { key: key.clone(), value: read(key, item)? });
    entries.iter().map(one).collect()
}

fn expression(key: &Key, item: &Item) -> Result<Expression, Problem> {
    Expression::new(item.text(&key.name)?)
}

fn constant(key: &Key, item: &Item) -> Result<Constant, Problem> {
    match &item.value {
        Value::Number(_) => Ok(Constant::Number(item.number(&key.name)?)),
        Value::List(_) => Ok(Constant::Vector(item.numbers(&key.name)?)),
        Value::Text(_) => Ok(Constant::Expression(Expression::new(item.text(&key.name)?)?)),
        Value::Table(table) => group(key, table),
        _ => Err(Problem::new(
            &item.span,
            format!("`{}` must be a number, a list, an expression or a group", key.name),
        )),
    }
}

fn group(key: &Key, table: &Table) -> Result<Constant, Problem> {
    let mut fields = Fields::new(table, format!("the constant `{}`", key.name));
    if let Some(kind) = fields.text("group")? {
        let item = fields.need("names")?;
        let names = item.texts("names")?;
        if names.is_empty() {
            return Err(Problem::new(&item.span, "a group needs at least one name"));
        }
        fields.finish()?;
        return Ok(Constant::Group { kind: kind.text, names });
    }
    let group = fields.text("of")?;
    let group = group.ok_or_else(|| {
        Problem::new(
            &table.span,
            format!("`{}` needs `group` with `names`, or `of` with a number for each pattern", key.name),
        )
    })?;
    let others = table.entries.iter().filter(|(key, _)| key.name != "of");
    let values = others.map(|(key, item)| Ok((key.clone(), item.number(&key.name)?)));
    Ok(Constant::PerElement { group, values: values.collect::<Result<_, Problem>>()? })
}

/// The table `[start]`.
#[derive(Default)]
struct Starts {
    keyframe: Option<Text>,
    positions: Vec<Named<Expression>>,
    velocities: Vec<Named<Expression>>,
    mocap: Vec<Named<Expression>>,
    settle: Option<Settle>,
    invalid: Vec<Expression>,
}

fn start(item: Option<&Item>) -> Result<Starts, Problem> {
    let mut starts = Starts::default();
    let Some(item) = item else { return Ok(starts) };
    for (key, item) in &item.table("start")?.entries {
        match key.name.as_str() {
            "keyframe" => {
                starts.keyframe = Some(match item.value {
                    Value::Number(number) => Text { text: number.to_string(), span: item.span.clone() },
                    _ => item.text("keyframe")?,
                });
            }
            "velocity" => starts.velocities = named(&item.table("velocity")?.entries, expression)?,
            "mocap" => starts.mocap = named(&item.table("mocap")?.entries, expression)?,
            "settle" => {
                let duration = item.number("settle")?;
                if duration <= 0.0 {
                    return Err(Problem::new(&item.span, "`settle` must be a time greater than 0 s"));
                }
                starts.settle = Some(Settle { span: item.span.clone(), duration });
            }
            "invalid" => {
                let conditions = item.texts("invalid")?.into_iter().map(Expression::new);
                starts.invalid = conditions.collect::<Result<_, _>>()?;
            }
            _ => starts.positions.push(Named { key: key.clone(), value: expression(key, item)? }),
        }
    }
    Ok(starts)
}

/// Reads the table `[sight]`.
fn object(item: &Item) -> Result<Text, Problem> {
    let mut fields = Fields::new(item.table("sight")?, "[sight]");
    let object = fields.need("object")?.text("object")?;
    fields.finish()?;
    Ok(object)
}

fn remembered(key: &Key, item: &Item) -> Result<Remembered, Problem> {
    let mut fields = Fields::new(item.table(&key.name)?, format!("`memory.{}`", key.name));
    let remembered = Remembered {
        start: Expression::new(fields.need("start")?.text("start")?)?,
        next: Expression::new(fields.need("next")?.text("next")?)?,
    };
    fields.finish()?;
    Ok(remembered)
}

fn servos(item: &Item) -> Result<Servos, Problem> {
    let mut fields = Fields::new(item.table("servos")?, "[servos]");
    let mut positive = |key: &'static str| {
        let item = fields.need(key)?;
        let numbers = item.numbers(key)?;
        if !numbers.is_empty() && numbers.iter().all(|number| *number > 0.0) {
            Ok(numbers)
        } else {
            Err(Problem::new(&item.span, format!("`{key}` must be numbers greater than 0")))
        }
    };
    let servos = Servos {
        span: item.span.clone(),
        max_velocity: positive("max_velocity")?,
        max_effort: positive("max_effort")?,
    };
    fields.finish()?;
    Ok(servos)
}

fn control(table: &Table) -> Result<Control, Problem> {
    let mut fields = Fields::new(table, "[control]");
    let item = fields.need("period")?;
    let period = match &item.value {
        // A fraction, so that the period of 60 Hz is not rounded in the file.
        Value::Text(text) => fraction(text).ok_or_else(|| {
            Problem::new(&item.span, "`period` must be a number of seconds, or a fraction such as \"1/60\"")
        })?,
        _ => item.number("period")?,
    };
    if !(1e-5..=100.0).contains(&period) {
        return Err(Problem::new(&item.span, "`period` must be from 0.00001 to 100 s"));
    }
    let steps = whole(fields.need("steps")?, "steps", MAX_STEPS)?;
    let substeps = fields.get("substeps").map(|item| whole(item, "substeps", MAX_SUBSTEPS)).transpose()?;
    fields.finish()?;
    Ok(Control { span: table.span.clone(), period, steps, substeps })
}

fn fraction(text: &str) -> Option<f64> {
    let (above, below) = text.split_once('/')?;
    let parse = |text: &str| text.trim().parse::<f64>().ok();
    Some(parse(above)? / parse(below)?).filter(|value| value.is_finite())
}

fn whole(item: &Item, what: &str, most: f64) -> Result<usize, Problem> {
    let number = item.number(what)?;
    if number.fract() == 0.0 && (1.0..=most).contains(&number) {
        Ok(number as usize)
    } else {
        Err(Problem::new(&item.span, format!("`{what}` must be a whole number from 1 to {most}")))
    }
}

fn policy(table: &Table) -> Result<Policy, Problem> {
    let mut fields = Fields::new(table, "[policy]");
    let onnx = fields.text("onnx")?;
    let controller = fields.text("controller")?;
    let expression = fields.text("expression")?.map(Expression::new).transpose()?;
    let actions = fields.get("actions").map(|item| whole(item, "actions", 10_000.0)).transpose()?;
    let process = process(&mut fields)?;
    let source = match (onnx, controller, expression, process) {
        (None, Some(name), None, None) if name.text == TASK_SPACE => {
            PolicySource::TaskSpace(Box::new(task_space(&mut fields)?))
        }
        (Some(file), None, None, None) | (None, Some(file), None, None) => PolicySource::File(file),
        (None, None, Some(expression), None) => PolicySource::Expression(expression),
        (None, None, None, Some(program)) => PolicySource::Program(program),
        (None, None, None, None) => PolicySource::Open,
        _ => {
            let message = "[policy] takes one of `onnx`, `controller`, `expression` and `process`, or none of them \
                           if each question has a policy of its own";
            return Err(Problem::new(&table.span, message));
        }
    };
    let limit = fields.number("limit")?.unwrap_or(f64::INFINITY);
    if limit <= 0.0 {
        return Err(Problem::new(&table.span, "`limit` must be greater than 0"));
    }
    let policy = Policy {
        source,
        observation: fields.texts("observation")?,
        action: Expression::new(fields.need("action")?.text("action")?)?,
        actuators: fields.text("actuators")?,
        hold: fields.text("hold")?.map(Expression::new).transpose()?,
        limit,
        actions,
        input: fields.text("input")?,
        output: fields.text("output")?,
    };
    fields.finish()?;
    Ok(policy)
}

/// Time limit of an answer of a program, s, if the file states none.
const TIME_LIMIT: f64 = 10.0;

/// Largest number of numbers that a program remembers.
const MAX_STATE: f64 = 100_000.0;

fn process(fields: &mut Fields<'_>) -> Result<Option<ProgramTable>, Problem> {
    let item = fields.get("process");
    let words = item.map_or(Ok(Vec::new()), |item| item.texts("process"))?;
    if let (Some(item), true) = (item, words.is_empty()) {
        return Err(Problem::new(
            &item.span,
            "`process` needs a program, such as [\"python3\", \"my_policy.py\"]",
        ));
    }
    let time_limit = fields.get("time_limit");
    let state = fields.get("state");
    let stray = |item: &Item, key: &str| Problem::new(&item.span, format!("`{key}` belongs to `process`"));
    if words.is_empty() {
        return match (time_limit, state) {
            (Some(item), _) => Err(stray(item, "time_limit")),
            (_, Some(item)) => Err(stray(item, "state")),
            _ => Ok(None),
        };
    }
    let limit = match time_limit {
        None => TIME_LIMIT,
        Some(item) => match item.number("time_limit")? {
            limit if limit > 0.0 && limit <= 1e6 => limit,
            _ => {
                return Err(Problem::new(
                    &item.span,
                    "`time_limit` must be more than 0 and at most 1,000,000 s",
                ));
            }
        },
    };
    let state = state.map_or(Ok(0), |item| whole(item, "state", MAX_STATE))?;
    Ok(Some(ProgramTable { words, time_limit: limit, state }))
}

/// Name of the built-in controller.
const TASK_SPACE: &str = "task-space";

fn task_space(fields: &mut Fields<'_>) -> Result<TaskSpace, Problem> {
    let mut positive = |key: &'static str| {
        let item = fields.need(key)?;
        match item.number(key)? {
            number if number > 0.0 => Ok(number),
            _ => Err(Problem::new(&item.span, format!("`{key}` must be greater than 0"))),
        }
    };
    let [gain, damping, largest_joint_step, kp, kd] = [
        positive("gain")?,
        positive("damping")?,
        positive("largest_joint_step")?,
        positive("kp")?,
        positive("kd")?,
    ];
    Ok(TaskSpace {
        site: fields.need("site")?.text("site")?,
        goal: Expression::new(fields.need("goal")?.text("goal")?)?,
        gain,
        damping,
        largest_joint_step,
        kp,
        kd,
    })
}

fn quantity(key: &Key, item: &Item) -> Result<Quantity, Problem> {
    if let Value::Text(_) = item.value {
        let value = Expression::new(item.text(&key.name)?)?;
        return Ok(Quantity { value, unit: String::new(), over: None, clip: None });
    }
    let mut fields = Fields::new(item.table(&key.name)?, format!("`{}`", key.name));
    let value = Expression::new(fields.need("value")?.text("value")?)?;
    let over = fields.text("over")?.map(|text| match text.text.as_str() {
        "max" => Ok(Over::Max),
        "min" => Ok(Over::Min),
        "sum" => Ok(Over::Sum),
        "mean" => Ok(Over::Mean),
        _ => Err(Problem::new(&text.span, "`over` must be \"max\", \"min\", \"sum\" or \"mean\"")),
    });
    let quantity = Quantity {
        value,
        unit: fields.text("unit")?.map(|text| text.text).unwrap_or_default(),
        over: over.transpose()?,
        clip: fields.range("clip")?,
    };
    fields.finish()?;
    Ok(quantity)
}
