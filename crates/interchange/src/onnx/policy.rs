//! Runs a model as a controller.

use std::collections::{HashMap, HashSet};
use std::panic::{AssertUnwindSafe, catch_unwind, set_hook, take_hook};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Once};
use std::thread::current;

use mishandle_controllers::{Layout as TaskLayout, bytes_hash};
use mishandle_files::{limits, read_bounded};
use mishandle_rollout::{Controller, ControllerWorker, Seed};
use rten::{Model, ModelOptions, NodeId, RunOptions, ThreadPool, Value, ValueOrView, ValueView};
use rten_onnx::onnx::{DataType, Dimension, GraphProto, ModelProto, TensorShapeProto, ValueInfoProto};
use rten_tensor::Layout;

use super::check::{self, Weights};
use super::cost::{self, MAX_HELD, MAX_NUMBERS, MAX_PRODUCTS, bound, cost_of, determines_shape};
use super::interface::Interface;
use super::order;
use crate::{InterchangeError, OnnxProblem};

/// Largest number of tensors of the state, and of numbers in it: each row of a batch has a state.
const MAX_STATES: usize = 100;
const MAX_STATE_NUMBERS: usize = 1 << 16;

/// Names by which exporters call the output with the action.
const ACTION_NAMES: [&str; 2] = ["action", "actions"];

/// A policy in an ONNX model.
///
/// Each row is computed alone, with a batch size of 1 and on one thread, so its action depends
/// neither on the other rows nor on the number of threads. The kernels depend on the instruction
/// set of the CPU: another CPU may give actions that differ in the last bits.
///
/// An operator that fails, or an output that changes its shape, gives an action of NaN, which ends
/// the simulation as `invalid action`.
#[derive(Debug)]
pub struct OnnxPolicy {
    core: Arc<Core>,
    hash: String,
    file_hash: String,
    task: Option<String>,
}

#[derive(Debug)]
struct Core {
    model: Model,
    observation: NodeId,
    observation_shape: Vec<usize>,
    /// The values that a control step asks for; see [`order`].
    asked: Vec<NodeId>,
    /// The place of the action in `asked`.
    action: usize,
    states: Vec<State>,
    sizes: (usize, usize),
}

/// A tensor that an output of one control step gives to an input of the next.
#[derive(Debug)]
struct State {
    input: NodeId,
    /// The place of the output in the values that a control step asks for.
    output: usize,
    shape: Vec<usize>,
}

impl State {
    fn size(&self) -> usize {
        self.shape.iter().product()
    }
}

impl OnnxPolicy {
    /// Reads a model for a task with this layout of observations and actions. `tasks` are the names
    /// that the model may have in its metadata; the first one is used in messages.
    ///
    /// The file has at most [`limits::ONNX`] bytes, and so has the file of its weights,
    /// `NAME.onnx.data`, if the model refers to it. Its side file, `NAME.onnx.json`, is read if it
    /// exists.
    ///
    /// # Errors
    /// If a file cannot be read or is too large, the model is not supported, or it does not fit the
    /// task.
    pub fn load(path: &Path, tasks: &[&str], layout: &TaskLayout) -> Result<OnnxPolicy, InterchangeError> {
        let error = |problem| InterchangeError::Onnx { problem, path: path.to_path_buf() };
        let bytes = read(path, limits::ONNX)?;
        let name = beside(path, "data");
        let weights = if name.exists() { Some(read(&name, limits::ONNX)?) } else { None };
        let name = name.file_name().unwrap_or_default().to_string_lossy();
        let weights = weights.as_deref().map(|content| (name.as_ref(), content));
        Self::new(&bytes, weights, side_file(path)?, tasks, layout).map_err(error)
    }

    /// Returns the task that a model or its side file names.
    ///
    /// # Errors
    /// If a file cannot be read or is too large, or the model is not supported.
    pub fn task_of(path: &Path) -> Result<Option<String>, InterchangeError> {
        let error = |problem| InterchangeError::Onnx { problem, path: path.to_path_buf() };
        if let Some(interface) = side_file(path)? {
            return Ok(interface.task);
        }
        let proto = check::parse(&read(path, limits::ONNX)?).map_err(error)?;
        Ok(Interface::of_metadata(&proto).map_err(error)?.task)
    }

    /// Parses the bytes of a model. `interface` replaces the description in its metadata.
    ///
    /// # Errors
    /// If the model is not supported or does not fit the task.
    pub fn from_bytes(
        bytes: &[u8],
        interface: Option<Interface>,
        tasks: &[&str],
        layout: &TaskLayout,
    ) -> Result<OnnxPolicy, OnnxProblem> {
        Self::new(bytes, None, interface, tasks, layout)
    }

    fn new(
        bytes: &[u8],
        weights: Option<Weights<'_>>,
        interface: Option<Interface>,
        tasks: &[&str],
        layout: &TaskLayout,
    ) -> Result<OnnxPolicy, OnnxProblem> {
        let mut proto = check::parse(bytes)?;
        check::join(&mut proto, weights)?;
        let own = Interface::of_metadata(&proto);
        let described =
            interface.as_ref().map(|interface| serde_json::to_string(interface).unwrap_or_default());
        let interface = interface.map_or(own, Ok)?;
        check_task(&interface, tasks, layout)?;
        let task = tasks.first().copied().unwrap_or_default();
        let names = Names::new(&proto, &interface)?;
        prepare(&mut proto, &names, task, layout.observation_size())?;
        let core = Core::new(&proto, &names, task, layout)?;
        let file_hash = bytes_hash(bytes);
        let weights_hash = weights.map(|(_, content)| bytes_hash(content));
        let hash = match (described, weights_hash) {
            (None, None) => file_hash.clone(),
            (side, weights) => {
                let parts = [file_hash.clone(), side.unwrap_or_default(), weights.unwrap_or_default()];
                bytes_hash(parts.join("\0").as_bytes())
            }
        };
        Ok(OnnxPolicy { core: Arc::new(core), hash, file_hash, task: interface.task })
    }

    /// Returns a hash of everything that determines the actions: of the model's bytes, of the side
    /// file and of the weights.
    pub fn hash(&self) -> &str {
        &self.hash
    }

    /// Returns the hash of the model's bytes.
    pub fn file_hash(&self) -> &str {
        &self.file_hash
    }

    /// Returns the task that the model names, if any.
    pub fn task(&self) -> Option<&str> {
        self.task.as_deref()
    }
}

/// Returns the path of the file `NAME.onnx.EXTENSION` beside a model.
fn beside(path: &Path, extension: &str) -> PathBuf {
    let mut name = path.as_os_str().to_os_string();
    name.push(".");
    name.push(extension);
    name.into()
}

/// Reads the side file of a model, `NAME.onnx.json`, if it exists.
fn side_file(path: &Path) -> Result<Option<Interface>, InterchangeError> {
    let side = beside(path, "json");
    if !side.exists() {
        return Ok(None);
    }
    let bytes = read(&side, limits::SETTINGS)?;
    Interface::from_json(&String::from_utf8_lossy(&bytes)).map(Some).map_err(|error| {
        let problem = OnnxProblem::Interface { place: side.display().to_string(), reason: error.to_string() };
        InterchangeError::Onnx { problem, path: path.to_path_buf() }
    })
}

fn read(path: &Path, limit: u64) -> Result<Vec<u8>, InterchangeError> {
    read_bounded(path, limit).map_err(|source| InterchangeError::Read { source, path: path.to_path_buf() })
}

fn check_task(interface: &Interface, tasks: &[&str], layout: &TaskLayout) -> Result<(), OnnxProblem> {
    let task = tasks.first().copied().unwrap_or_default().to_string();
    if let Some(found) = interface.task.as_ref().filter(|found| !tasks.contains(&found.as_str())) {
        return Err(OnnxProblem::Task { expected: task, found: found.clone() });
    }
    let differences = interface.layout.as_ref().map_or(vec![], |found| layout.differences(found));
    if differences.is_empty() { Ok(()) } else { Err(OnnxProblem::Layout { task, differences }) }
}

/// The names of the values that a control step reads and writes.
struct Names {
    observation: String,
    /// The outputs that may be the action: the one that the description names, or all that are not
    /// a state.
    actions: Vec<String>,
    states: Vec<(String, String)>,
}

impl Names {
    fn new(proto: &ModelProto, interface: &Interface) -> Result<Names, OnnxProblem> {
        let invalid = |reason: String| OnnxProblem::Interface { place: "by name".to_string(), reason };
        let empty = GraphProto::default();
        let graph = proto.graph.as_ref().unwrap_or(&empty);
        let name = |value: &ValueInfoProto| value.name.clone().unwrap_or_default();
        // Old models list their weights as inputs, too.
        let weights: HashSet<&str> =
            graph.initializer.iter().filter_map(|tensor| tensor.name.as_deref()).collect();
        let inputs: Vec<String> =
            graph.input.iter().map(name).filter(|name| !weights.contains(name.as_str())).collect();
        let outputs: Vec<String> = graph.output.iter().map(name).collect();
        if interface.state.len() > MAX_STATES {
            let found = interface.state.len();
            return Err(invalid(format!("the state has {found} tensors; the limit is {MAX_STATES}")));
        }
        let states = interface.state.clone();
        let observation = interface.observation.clone();
        let free = inputs.iter().find(|name| states.iter().all(|(input, _)| input != *name));
        let observation = observation.or_else(|| free.cloned());
        let free = outputs.iter().filter(|name| states.iter().all(|(_, output)| output != *name));
        let actions = interface.action.clone().map_or_else(|| free.cloned().collect(), |action| vec![action]);
        let Some(observation) = observation.filter(|_| !actions.is_empty()) else {
            return Err(invalid(
                "the model needs an input for the observation and an output for the action".into(),
            ));
        };
        let read: Vec<&String> = std::iter::once(&observation).chain(states.iter().map(|(i, _)| i)).collect();
        let written: Vec<&String> = actions.iter().chain(states.iter().map(|(_, o)| o)).collect();
        for (kind, used, known) in [("input", &read, &inputs), ("output", &written, &outputs)] {
            if let Some(missing) = used.iter().find(|name| !known.contains(name)) {
                let known = known.join(", ");
                return Err(invalid(format!("the model has no {kind} `{missing}`; its {kind}s: {known}")));
            }
        }
        if let Some(unused) = inputs.iter().find(|name| !read.contains(name)) {
            return Err(invalid(format!(
                "nothing says what the input `{unused}` is; name the observation, and the pairs of inputs and outputs of the \
                 state, in the metadata or in a side file (docs/guide/onnx.md); a task has one vector of observations, so join \
                 the inputs of a dictionary in the model"
            )));
        }
        if read.iter().collect::<HashSet<_>>().len() != read.len() {
            return Err(invalid("an input has two roles".into()));
        }
        Ok(Names { observation, actions, states })
    }
}

impl Names {
    /// Returns the output with the action: the one that the description names, the only one, the
    /// one with such a name, or the only one with such a size.
    fn action(&self, values: &HashMap<String, Value>, size: usize) -> Result<&str, OnnxProblem> {
        let missing = self.actions.iter().chain(self.states.iter().map(|(_, output)| output));
        if let Some(missing) = missing.into_iter().find(|name| !values.contains_key(*name)) {
            return Err(OnnxProblem::Format { reason: format!("no operator writes the output `{missing}`") });
        }
        let all: Vec<&String> = self.actions.iter().collect();
        let named: Vec<&String> =
            self.actions.iter().filter(|name| ACTION_NAMES.contains(&name.to_lowercase().as_str())).collect();
        let fits = |name: &&String| values.get(*name).is_some_and(|value| is_action(value, size));
        let fitting: Vec<&String> = self.actions.iter().filter(fits).collect();
        match (&all[..], &named[..], &fitting[..]) {
            ([action], _, _) | (_, [action], _) | (_, _, [action]) => Ok(action),
            (_, _, fitting) => {
                let found = if fitting.is_empty() { "none" } else { "several" };
                Err(OnnxProblem::Interface {
                    place: "its outputs".to_string(),
                    reason: format!(
                        "nothing says which output is the action: {}; {found} of them have {size} numbers; name it by \
                         `action` in the metadata or in a side file (docs/guide/onnx.md)",
                        self.actions.join(", ")
                    ),
                })
            }
        }
    }
}

/// Makes the shapes of all inputs fixed, with a batch size of 1, and removes what the runtime does
/// not need: the names of operators, which may be those of values, and the shapes of other values,
/// which may be wrong.
fn prepare(proto: &mut ModelProto, names: &Names, task: &str, size: usize) -> Result<(), OnnxProblem> {
    let Some(graph) = proto.graph.as_mut() else { return Ok(()) };
    graph.node.iter_mut().for_each(|node| node.name = None);
    graph.value_info.clear();
    graph.output.iter_mut().for_each(|output| output.r#type = None);
    for input in &mut graph.input {
        let name = input.name.clone().unwrap_or_default();
        let is_observation = name == names.observation;
        if !is_observation && names.states.iter().all(|(state, _)| *state != name) {
            continue;
        }
        let tensor = input.r#type.get_or_insert_default().tensor_type.get_or_insert_default();
        if tensor.elem_type.unwrap_or(DataType::FLOAT) != DataType::FLOAT {
            let kind = tensor.elem_type.unwrap_or(DataType::FLOAT);
            return Err(OnnxProblem::Unsupported {
                found: format!("the input `{name}` of the type {}", kind.name().unwrap_or("unknown")),
                hint: "inputs must be tensors of 32-bit floating-point numbers".to_string(),
            });
        }
        let dims: Option<Vec<Option<i64>>> =
            tensor.shape.as_ref().map(|shape| shape.dim.iter().map(|dim| dim.dim_value).collect());
        let fixed: Option<Vec<i64>> = if is_observation {
            let expected = size as i64;
            match dims.as_deref() {
                None => Some(vec![1, expected]),
                Some([batch, found]) if batch.unwrap_or(1) == 1 && found.unwrap_or(expected) == expected => {
                    Some(vec![1, expected])
                }
                Some([found]) if found.unwrap_or(expected) == expected => Some(vec![expected]),
                _ => None,
            }
        } else {
            // Only the batch size of a state may be free.
            dims.as_deref().map(|dims| dims.iter().map(|dim| dim.unwrap_or(1)).collect())
        };
        let Some(fixed) = fixed.filter(|fixed| fixed.iter().all(|size| (1..1 << 24).contains(size))) else {
            let found = shape_text(&dims.unwrap_or_default());
            if is_observation {
                let (task, side) = (task.to_string(), "observation");
                return Err(OnnxProblem::Shape { task, side, name, found, expected: size });
            }
            return Err(OnnxProblem::Interface {
                place: "its inputs".to_string(),
                reason: format!("the state `{name}` has the shape {found}; expected sizes from 1 to 2^24"),
            });
        };
        let dim = |size| Dimension { dim_value: Some(size), dim_param: None };
        tensor.elem_type = Some(DataType::FLOAT);
        tensor.shape = Some(TensorShapeProto { dim: fixed.into_iter().map(dim).collect() });
    }
    Ok(())
}

/// Returns a shape as text, with N for sizes that are free.
fn shape_text(dims: &[Option<i64>]) -> String {
    let dims: Vec<String> =
        dims.iter().map(|dim| dim.map_or("N".to_string(), |size| size.to_string())).collect();
    format!("[{}]", dims.join(", "))
}

impl Core {
    fn new(proto: &ModelProto, names: &Names, task: &str, layout: &TaskLayout) -> Result<Core, OnnxProblem> {
        let format = |reason: String| OnnxProblem::Format { reason };
        let bytes = proto.write_buf().map_err(|error| format(error.to_string()))?;
        // Without optimization, loading a model computes nothing, and what is checked below is what
        // runs.
        let load = || {
            let mut options = ModelOptions::with_ops(cost::registry());
            options.enable_optimization(false);
            options.load(bytes).map_err(|error| error.to_string())
        };
        let model = without_panic(|| one_thread_pool().run(load)).map_err(format)?;
        let id =
            |name: &str| model.find_node(name).ok_or_else(|| format(format!("it has no value `{name}`")));
        let shape = |name: &str| {
            let values = proto.graph.iter().flat_map(|graph| &graph.input);
            let value = values.into_iter().find(|value| value.name.as_deref() == Some(name));
            let shape = value.and_then(|value| value.r#type.as_ref()?.tensor_type.as_ref()?.shape.as_ref());
            let sizes = shape.iter().flat_map(|shape| &shape.dim).filter_map(|dim| dim.dim_value);
            sizes.map(|size| size as usize).collect::<Vec<usize>>()
        };
        let states: Vec<(Vec<usize>, &(String, String))> =
            names.states.iter().map(|pair| (shape(&pair.0), pair)).collect();
        let numbers = states.iter().try_fold(0_usize, |sum, (shape, _)| {
            let size = shape.iter().try_fold(1_usize, |size, dim| size.checked_mul(*dim))?;
            sum.checked_add(size)
        });
        if numbers.is_none_or(|numbers| numbers > MAX_STATE_NUMBERS) {
            let reason = format!("its state has more than {MAX_STATE_NUMBERS} numbers");
            return Err(OnnxProblem::Size { reason });
        }
        let observation_shape = shape(&names.observation);
        let inputs = std::iter::once((&names.observation, &observation_shape))
            .chain(states.iter().map(|(shape, (input, _))| (input, shape)));
        let inputs: HashMap<String, Vec<usize>> =
            inputs.map(|(name, shape)| (name.clone(), shape.clone())).collect();
        let graph = proto.graph.as_ref().ok_or_else(|| format("it has no graph".to_string()))?;
        let outputs: Vec<&str> = names
            .actions
            .iter()
            .chain(names.states.iter().map(|(_, output)| output))
            .map(String::as_str)
            .collect();
        let kept = order::asked_values(graph, &outputs);
        let values = dry_run(&model, graph, &inputs, &kept)?;
        let action = names.action(&values, layout.action_size())?;
        let used: Vec<&str> =
            std::iter::once(action).chain(names.states.iter().map(|(_, output)| output.as_str())).collect();
        check_outputs(&values, action, &states, task, layout.action_size())?;
        let asked = order::asked_values(graph, &used);
        if asked != kept {
            // Other values are held, so that other bounds hold.
            dry_run(&model, graph, &inputs, &asked)?;
        }
        let place = |name: &str| {
            let place = asked.iter().position(|asked| asked == name);
            place.ok_or_else(|| format(format!("it has no value `{name}`")))
        };
        let core = Core {
            observation: id(&names.observation)?,
            observation_shape,
            action: place(action)?,
            asked: asked.iter().map(|name| id(name)).collect::<Result<_, OnnxProblem>>()?,
            states: states
                .into_iter()
                .map(|(shape, (input, output))| {
                    Ok(State { input: id(input)?, output: place(output)?, shape })
                })
                .collect::<Result<_, OnnxProblem>>()?,
            sizes: (layout.observation_size(), layout.action_size()),
            model,
        };
        Ok(core)
    }

    /// Computes a control step of one row; `None` if an operator fails or an output has another
    /// shape.
    fn step(
        &self,
        options: &RunOptions,
        observation: &[f32],
        state: &mut [f64],
        action: &mut [f32],
    ) -> Option<()> {
        let view = |shape: &[usize], numbers: &[f32]| -> Option<Value> {
            Value::from_shape(shape, numbers.to_vec()).ok()
        };
        let mut inputs: Vec<(NodeId, ValueOrView<'_>)> =
            vec![(self.observation, view(&self.observation_shape, observation)?.into())];
        let mut rest = &state[..];
        for part in &self.states {
            let (own, others) = rest.split_at_checked(part.size())?;
            rest = others;
            let numbers: Vec<f32> = own.iter().map(|x| *x as f32).collect();
            inputs.push((part.input, view(&part.shape, &numbers)?.into()));
        }
        let values = without_panic(|| {
            self.model.run(inputs, &self.asked, Some(options.clone())).map_err(|e| e.to_string())
        });
        let values = values.ok()?;
        copy(values.get(self.action)?, action.len(), action.iter_mut(), |x| x)?;
        let mut rest = state;
        for part in &self.states {
            let (own, others) = rest.split_at_mut_checked(part.size())?;
            copy(values.get(part.output)?, own.len(), own.iter_mut(), f64::from)?;
            rest = others;
        }
        Some(())
    }
}

/// Checks the shapes of the action and of the state after a control step.
fn check_outputs(
    values: &HashMap<String, Value>,
    action: &str,
    states: &[(Vec<usize>, &(String, String))],
    task: &str,
    expected: usize,
) -> Result<(), OnnxProblem> {
    if !values.get(action).is_some_and(|value| is_action(value, expected)) {
        let found = values.get(action).map_or("of no tensor".to_string(), type_text);
        let (task, name) = (task.to_string(), action.to_string());
        return Err(OnnxProblem::Shape { task, side: "action", name, found, expected });
    }
    for (shape, (input, output)) in states {
        let found = values.get(output).and_then(float_shape);
        if found.as_ref() != Some(shape) {
            let found = values.get(output).map_or("no tensor".to_string(), type_text);
            return Err(OnnxProblem::Interface {
                place: "its state".to_string(),
                reason: format!(
                    "the output `{output}` has the shape {found}, but the input `{input}` has {shape:?}"
                ),
            });
        }
    }
    Ok(())
}

fn is_action(value: &Value, expected: usize) -> bool {
    matches!(float_shape(value).as_deref(), Some([1, size] | [size]) if *size == expected)
}

/// Returns the shape of a value, and that its numbers are integers if they are.
fn type_text(value: &Value) -> String {
    let integers = if float_shape(value).is_some() { "" } else { " of integers" };
    format!("{:?}{integers}", value.shape().to_vec())
}

/// Copies a tensor of `size` numbers.
fn copy<'a, T: 'a>(
    value: &Value,
    size: usize,
    into: impl Iterator<Item = &'a mut T>,
    convert: impl Fn(f32) -> T,
) -> Option<()> {
    let tensor: rten_tensor::TensorView<'_, f32> = value.as_tensor_view()?;
    if tensor.len() != size {
        return None;
    }
    into.zip(tensor.iter()).for_each(|(x, y)| *x = convert(*y));
    Some(())
}

fn float_shape(value: &Value) -> Option<Vec<usize>> {
    matches!(value, Value::FloatTensor(_)).then(|| value.shape().to_vec())
}

fn zeros(shape: &[usize]) -> Value {
    rten_tensor::Tensor::<f32>::zeros(shape).into()
}

/// Computes all operators one by one on an observation of zeros, each only after a bound of its
/// memory and its time was checked.
///
/// As no shape depends on the numbers of an observation, the bounds hold for every observation.
fn dry_run(
    model: &Model,
    graph: &GraphProto,
    inputs: &HashMap<String, Vec<usize>>,
    kept: &[String],
) -> Result<HashMap<String, Value>, OnnxProblem> {
    let run_problem = |reason: String| OnnxProblem::Run { reason };
    let mut depends_on_input: HashSet<String> = inputs.keys().cloned().collect();
    let mut values: HashMap<String, Value> =
        inputs.iter().map(|(name, shape)| (name.clone(), zeros(shape))).collect();
    let options = one_thread();
    let constants = graph.initializer.iter().filter_map(|tensor| tensor.name.as_deref());
    let nodes = graph.node.iter().filter(|node| node.op_type.as_deref() == Some("Constant"));
    for name in constants.chain(nodes.flat_map(|node| node.output.iter().map(String::as_str))) {
        let found = run(model, vec![], &[name], &options).map_err(run_problem)?;
        values.extend(found.into_iter().map(|value| (name.to_string(), value)));
    }
    let mut last_readers: HashMap<&str, usize> = HashMap::new();
    for (index, node) in graph.node.iter().enumerate() {
        last_readers.extend(node.input.iter().map(|name| (name.as_str(), index)));
    }
    // The outputs are read after all operators.
    last_readers.extend(kept.iter().map(|name| (name.as_str(), usize::MAX)));
    let (mut products, mut held) = (0_usize, 0_usize);
    for (index_of_node, node) in graph.node.iter().enumerate() {
        let operator = node.op_type.as_deref().unwrap_or_default();
        let Some(cost) = cost_of(operator) else { continue };
        let label = |name: Option<&String>| format!("`{operator}` of `{}`", name.map_or("", String::as_str));
        let mut arguments = Vec::new();
        for (index, name) in node.input.iter().enumerate() {
            if name.is_empty() {
                arguments.push(None);
                continue;
            }
            let depends = depends_on_input.contains(name);
            if depends && determines_shape(operator, index) {
                return Err(OnnxProblem::Unsupported {
                    found: format!(
                        "the operator {}, whose shape depends on the observation",
                        label(node.output.first())
                    ),
                    hint: "export a policy whose shapes are constant".to_string(),
                });
            }
            let value = values.get(name).ok_or_else(|| OnnxProblem::Format {
                reason: format!("{} reads `{name}` before an operator writes it", label(node.output.first())),
            })?;
            arguments.push(Some(value));
        }
        let too_large = || OnnxProblem::Size {
            reason: format!(
                "{} has inputs of other shapes, more than {MAX_NUMBERS} numbers, or the model needs more than {MAX_PRODUCTS} multiplications \
                 or {MAX_HELD} numbers at a time",
                label(node.output.first())
            ),
        };
        let transposed = ["transA", "transB"].map(|name| {
            let mut attributes = node.attribute.iter();
            attributes
                .any(|attribute| attribute.name.as_deref() == Some(name) && attribute.i.unwrap_or(0) != 0)
        });
        let (numbers, own) = bound(cost, &arguments, transposed).ok_or_else(too_large)?;
        products = products.saturating_add(own);
        if numbers > MAX_NUMBERS || products > MAX_PRODUCTS || held.saturating_add(numbers) > MAX_HELD {
            return Err(too_large());
        }
        let cuts_dependence = matches!(operator, "Shape" | "Size");
        let depends = !cuts_dependence && node.input.iter().any(|name| depends_on_input.contains(name));
        let known: HashSet<&str> =
            node.input.iter().filter(|name| !name.is_empty()).map(String::as_str).collect();
        let inputs = known.into_iter().filter_map(|name| Some((name, values.get(name)?))).collect();
        let outputs: Vec<&str> =
            node.output.iter().map(String::as_str).filter(|name| !name.is_empty()).collect();
        let found = run(model, inputs, &outputs, &options)
            .map_err(|reason| run_problem(format!("{}: {reason}", label(node.output.first()))))?;
        for (output, value) in outputs.into_iter().zip(found) {
            held += value.len();
            values.insert(output.to_string(), value);
            if depends {
                depends_on_input.insert(output.to_string());
            }
        }
        // As in a control step, a value is kept until the last operator has read it.
        for name in node.input.iter().chain(&node.output) {
            if last_readers.get(name.as_str()).is_none_or(|last| *last == index_of_node) {
                let removed = values.remove(name).map_or(0, |value| value.len());
                held = held.saturating_sub(removed);
            }
        }
    }
    Ok(values)
}

/// Computes values from others.
fn run(
    model: &Model,
    inputs: Vec<(&str, &Value)>,
    outputs: &[&str],
    options: &RunOptions,
) -> Result<Vec<Value>, String> {
    let text = |error: rten::RunError| error.to_string();
    let inputs: Vec<(NodeId, ValueOrView<'_>)> = inputs
        .into_iter()
        .map(|(name, value)| Ok((model.node_id(name)?, ValueView::from(value).into())))
        .collect::<Result<_, _>>()
        .map_err(text)?;
    let outputs: Vec<NodeId> =
        outputs.iter().map(|name| model.node_id(name)).collect::<Result<_, _>>().map_err(text)?;
    without_panic(|| model.run(inputs, &outputs, Some(options.clone())).map_err(text))
}

/// Returns options for one thread: the runtime splits sums by the number of threads.
fn one_thread() -> RunOptions {
    RunOptions::default().with_thread_pool(Some(Arc::new(one_thread_pool())))
}

fn one_thread_pool() -> ThreadPool {
    ThreadPool::with_num_threads(1)
}

/// Turns a panic of the runtime into an error, without its message.
fn without_panic<T>(run: impl FnOnce() -> Result<T, String>) -> Result<T, String> {
    // The runtime panics for some numbers, such as the quotient of the least integer and -1, in
    // threads that it names.
    static HOOK: Once = Once::new();
    HOOK.call_once(|| {
        let hook = take_hook();
        set_hook(Box::new(move |info| {
            if !current().name().is_some_and(|name| name.starts_with("rten-")) {
                hook(info);
            }
        }));
    });
    catch_unwind(AssertUnwindSafe(run)).unwrap_or_else(|_| Err("the ONNX runtime failed".to_string()))
}

impl Controller for OnnxPolicy {
    fn observation_size(&self) -> usize {
        self.core.sizes.0
    }

    fn action_size(&self) -> usize {
        self.core.sizes.1
    }

    fn state_size(&self) -> usize {
        self.core.states.iter().map(State::size).sum()
    }

    fn worker(&self) -> Box<dyn ControllerWorker> {
        let pool = Arc::new(ThreadPool::with_num_threads(1));
        let options = RunOptions::default().with_thread_pool(Some(pool.clone()));
        Box::new(OnnxWorker { core: self.core.clone(), pool, options })
    }
}

struct OnnxWorker {
    core: Arc<Core>,
    pool: Arc<ThreadPool>,
    options: RunOptions,
}

impl ControllerWorker for OnnxWorker {
    fn reset(&mut self, state: &mut [f64], _seed: Seed) {
        state.fill(0.0);
    }

    fn act(&mut self, rows: usize, observations: &[f32], states: &mut [f64], actions: &mut [f32]) {
        let (core, options) = (&self.core, &self.options);
        let (inputs, outputs) = core.sizes;
        let state_size: usize = core.states.iter().map(State::size).sum();
        // One change of threads for all rows, instead of one per row.
        self.pool.run(|| {
            for row in 0..rows {
                let observation = &observations[row * inputs..][..inputs];
                let state = &mut states[row * state_size..][..state_size];
                let action = &mut actions[row * outputs..][..outputs];
                if core.step(options, observation, state, action).is_none() {
                    action.fill(f32::NAN);
                }
            }
        });
    }
}
