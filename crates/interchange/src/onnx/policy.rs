//! Runs a model as a controller.

use std::collections::HashMap;
use std::panic::{AssertUnwindSafe, catch_unwind, set_hook, take_hook};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Once};
use std::thread::current;

use mishandle_controllers::{Layout as TaskLayout, bytes_hash};
use mishandle_files::{limits, read_bounded};
use mishandle_rollout::{Controller, ControllerWorker, Image, Seed};
use rten::{Model, ModelOptions, NodeId, RunOptions, ThreadPool, Value, ValueOrView};
use rten_onnx::onnx::{DataType, Dimension, ModelProto, TensorShapeProto};
use rten_tensor::{Layout, TensorView};

use super::OnnxDescription;
use super::check::{self, Weights};
use super::chunk::Plan;
use super::cost;
use super::dry_run::dry_run;
use super::history::History;
use super::images::ImageInput;
use super::interface::Interface;
use super::names::{Names, check_outputs};
use super::order;
use super::rewrite::rewrite;
use crate::{InterchangeError, OnnxProblem};

/// Largest number of numbers of the state: each row of a batch has a state.
const MAX_STATE_NUMBERS: usize = 1 << 16;

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
    /// The input for the observation; `None` if the policy gets images only.
    observation: Option<ObservationInput>,
    images: Vec<(NodeId, ImageInput)>,
    /// The images, in the order of their inputs.
    sees: Vec<Image>,
    /// The values that a control step asks for; see [`order`].
    asked: Vec<NodeId>,
    /// The last observations and images; `None` if the model gets the present ones alone.
    history: Option<History>,
    /// The place of the action in `asked`.
    action: usize,
    states: Vec<State>,
    /// Which actions are played; `None` if the model predicts one.
    plan: Option<Plan>,
    sizes: (usize, usize),
}

#[derive(Debug)]
struct ObservationInput {
    input: NodeId,
    shape: Vec<usize>,
    /// Whether it gets the history of observations.
    has_history: bool,
    /// Places of its numbers in the observation of the task.
    places: Vec<usize>,
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
        Self::load_named(path, tasks, layout, [None, None])
    }

    /// As [`load`](Self::load), with the names of the input for the observation and of the output
    /// with the action, which win over those that the model or its side file gives.
    ///
    /// # Errors
    /// Those of [`load`](Self::load), or if the model has no such input or output.
    pub fn load_named(
        path: &Path,
        tasks: &[&str],
        layout: &TaskLayout,
        names: [Option<&str>; 2],
    ) -> Result<OnnxPolicy, InterchangeError> {
        Self::read(path, names, Some((tasks, layout)))
    }

    /// As [`load`](Self::load), for a model without a task: the sizes of observations and actions
    /// are those of the model.
    ///
    /// # Errors
    /// If a file cannot be read or is too large, or the model is not supported or has no fixed size
    /// of an observation.
    pub fn load_with_own_sizes(path: &Path) -> Result<OnnxPolicy, InterchangeError> {
        Self::read(path, [None, None], None)
    }

    fn read(
        path: &Path,
        names: [Option<&str>; 2],
        environment: Option<(&[&str], &TaskLayout)>,
    ) -> Result<OnnxPolicy, InterchangeError> {
        let error = |problem| InterchangeError::Onnx { problem, path: path.to_path_buf() };
        let bytes = read(path, limits::ONNX)?;
        let name = beside(path, "data");
        let weights = if name.exists() { Some(read(&name, limits::ONNX)?) } else { None };
        let name = name.file_name().unwrap_or_default().to_string_lossy();
        let weights = weights.as_deref().map(|content| (name.as_ref(), content));
        Self::new(&bytes, weights, side_file(path)?, names, environment).map_err(error)
    }

    /// Returns what a model or its side file says about the controller that it is.
    ///
    /// # Errors
    /// If a file cannot be read, is too large, or is not a model.
    pub fn description(path: &Path) -> Result<OnnxDescription, InterchangeError> {
        let error = |problem| InterchangeError::Onnx { problem, path: path.to_path_buf() };
        if let Some(interface) = side_file(path)? {
            return Ok(interface.into());
        }
        Self::description_of_bytes(&read(path, limits::ONNX)?).map_err(error)
    }

    /// As [`description`](Self::description), for the bytes of a model.
    ///
    /// # Errors
    /// If they are not a model.
    pub fn description_of_bytes(bytes: &[u8]) -> Result<OnnxDescription, OnnxProblem> {
        Ok(Interface::of_metadata(&check::parse(bytes)?)?.into())
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
        Self::new(bytes, None, interface, [None, None], Some((tasks, layout)))
    }

    fn new(
        bytes: &[u8],
        weights: Option<Weights<'_>>,
        interface: Option<Interface>,
        [observation, action]: [Option<&str>; 2],
        environment: Option<(&[&str], &TaskLayout)>,
    ) -> Result<OnnxPolicy, OnnxProblem> {
        let mut proto = check::parse(bytes)?;
        check::join(&mut proto, weights)?;
        let own = Interface::of_metadata(&proto);
        let is_described = interface.is_some() || observation.is_some() || action.is_some();
        let mut interface = interface.map_or(own, Ok)?;
        interface.observation = observation.map(String::from).or(interface.observation);
        interface.action = action.map(String::from).or(interface.action);
        let described = is_described.then(|| serde_json::to_string(&interface).unwrap_or_default());
        let places = places(&interface, environment.map(|(_, layout)| layout))?;
        let expected = match environment {
            Some((tasks, layout)) => {
                check_task(&interface, tasks, layout)?;
                let task = tasks.first().copied().unwrap_or_default();
                Some(Expected { task, sizes: (places.len(), layout.action_size()) })
            }
            None => None,
        };
        let names = Names::new(&proto, &interface)?;
        prepare(&mut proto, &names, expected)?;
        let images = ImageInput::prepare(&mut proto, &names)?;
        let opset = check::opset(&proto).unwrap_or_default();
        proto.graph.iter_mut().try_for_each(|graph| rewrite(graph, opset))?;
        let mut core = Core::new(&proto, &names, images, places, &interface, expected)?;
        if let Some((_, layout)) = environment {
            core.sizes.0 = layout.observation_size();
        }
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

pub(super) fn read(path: &Path, limit: u64) -> Result<Vec<u8>, InterchangeError> {
    read_bounded(path, limit).map_err(|source| InterchangeError::Read { source, path: path.to_path_buf() })
}

/// The task that a model must fit. Without one, its sizes are its own.
#[derive(Clone, Copy)]
pub(super) struct Expected<'a> {
    /// Name of the task, for messages.
    pub task: &'a str,
    /// Numbers of an observation and of an action.
    pub sizes: (usize, usize),
}

/// Returns the places in the observation of a task of the numbers that the policy gets; nothing for
/// a model without a task, which gets all.
fn places(interface: &Interface, layout: Option<&TaskLayout>) -> Result<Vec<usize>, OnnxProblem> {
    let invalid = |reason: String| OnnxProblem::Interface { place: "its parts".to_string(), reason };
    let Some(layout) = layout else {
        return match interface.parts {
            None => Ok(Vec::new()),
            Some(_) => Err(invalid("only a task has parts of an observation: name the task".to_string())),
        };
    };
    let Some(parts) = &interface.parts else { return Ok((0..layout.observation_size()).collect()) };
    let mut places = Vec::new();
    for (index, part) in parts.iter().enumerate() {
        let known = layout.observation.iter().position(|own| own.name == *part);
        let Some(known) = known.filter(|_| !parts[..index].contains(part)) else {
            let names: Vec<&str> = layout.observation.iter().map(|own| own.name.as_str()).collect();
            let problem = if known.is_some() { "is named twice" } else { "is unknown" };
            return Err(invalid(format!("the part `{part}` {problem}; the parts: {}", names.join(", "))));
        };
        let first: usize = layout.observation[..known].iter().map(|own| own.size).sum();
        places.extend(first..first + layout.observation[known].size);
    }
    Ok(places)
}

fn check_task(interface: &Interface, tasks: &[&str], layout: &TaskLayout) -> Result<(), OnnxProblem> {
    let task = tasks.first().copied().unwrap_or_default().to_string();
    if let Some(found) = interface.task.as_ref().filter(|found| !tasks.contains(&found.as_str())) {
        return Err(OnnxProblem::Task { expected: task, found: found.clone() });
    }
    let differences = interface.layout.as_ref().map_or(vec![], |found| layout.differences(found));
    if differences.is_empty() { Ok(()) } else { Err(OnnxProblem::Layout { task, differences }) }
}

/// Makes the shapes of all inputs fixed, with a batch size of 1, and removes what the runtime does
/// not need: the names of operators, which may be those of values, and the shapes of other values,
/// which may be wrong.
fn prepare(proto: &mut ModelProto, names: &Names, expected: Option<Expected<'_>>) -> Result<(), OnnxProblem> {
    let Some(graph) = proto.graph.as_mut() else { return Ok(()) };
    graph.node.iter_mut().for_each(|node| node.name = None);
    graph.value_info.clear();
    graph.output.iter_mut().for_each(|output| output.r#type = None);
    for input in &mut graph.input {
        let name = input.name.clone().unwrap_or_default();
        let is_observation = names.observation.as_ref() == Some(&name);
        if !is_observation && names.states.iter().all(|(state, _)| *state != name) {
            continue;
        }
        let tensor = input.r#type.get_or_insert_default().tensor_type.get_or_insert_default();
        if tensor.elem_type.unwrap_or(DataType::FLOAT) != DataType::FLOAT {
            let kind = tensor.elem_type.unwrap_or(DataType::FLOAT);
            return Err(OnnxProblem::Unsupported {
                found: format!("the input `{name}` of the type {}", kind.name().unwrap_or("unknown")),
                hint: "inputs must be tensors of 32-bit floating-point numbers: export `model.float()`"
                    .to_string(),
            });
        }
        let dims: Option<Vec<Option<i64>>> =
            tensor.shape.as_ref().map(|shape| shape.dim.iter().map(|dim| dim.dim_value).collect());
        let fixed: Option<Vec<i64>> = if is_observation {
            let own = || dims.as_deref()?.last().copied().flatten();
            let size = expected.map_or_else(own, |expected| Some(expected.sizes.0 as i64));
            match (size, dims.as_deref()) {
                (Some(size), None) => Some(vec![1, size]),
                (Some(size), Some([batch, found]))
                    if batch.unwrap_or(1) == 1 && found.unwrap_or(size) == size =>
                {
                    Some(vec![1, size])
                }
                (Some(size), Some([batch, steps, found]))
                    if batch.unwrap_or(1) == 1 && found.unwrap_or(size) == size =>
                {
                    let length = names.history.and_then(|length| i64::try_from(length).ok());
                    let length = length.filter(|length| steps.is_none_or(|steps| steps == *length));
                    length.map(|length| vec![1, length, size])
                }
                (Some(size), Some([found])) if found.unwrap_or(size) == size => Some(vec![size]),
                _ => None,
            }
        } else {
            // Only the batch size of a state may be free.
            dims.as_deref().map(|dims| dims.iter().map(|dim| dim.unwrap_or(1)).collect())
        };
        let Some(fixed) = fixed.filter(|fixed| fixed.iter().all(|size| (1..1 << 24).contains(size))) else {
            let found = shape_text(&dims.unwrap_or_default());
            if is_observation {
                return Err(wrong_shape(expected, "observation", name, found));
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

/// Returns the error of an input or output that does not fit the task, or that is not a vector.
pub(super) fn wrong_shape(
    expected: Option<Expected<'_>>,
    side: &'static str,
    name: String,
    found: String,
) -> OnnxProblem {
    let Some(Expected { task, sizes: (observation, action) }) = expected else {
        return OnnxProblem::NoVector { side, name, found };
    };
    let expected = if side == "action" { action } else { observation };
    OnnxProblem::Shape { task: task.to_string(), side, name, found, expected }
}

/// Returns the history of a model whose inputs have one.
fn history(
    interface: &Interface,
    observation: Option<&ObservationInput>,
    images: &[ImageInput],
) -> Result<Option<History>, OnnxProblem> {
    let invalid = |reason: String| OnnxProblem::Interface { place: "its history".to_string(), reason };
    let Some(length) = interface.history else {
        return match interface.padding {
            None => Ok(None),
            Some(_) => Err(invalid("`padding` needs `history`, the number of control steps".to_string())),
        };
    };
    let observation = observation.filter(|own| own.has_history).map_or(0, |own| own.places.len());
    if observation == 0 && images.iter().all(|own| own.history.is_none()) {
        return Err(invalid(format!("`history` is {length}, but no input has the shape [N, {length}, …]")));
    }
    let bytes = images.iter().map(|own| own.history.map_or(0, |_| own.image.bytes())).collect();
    let history = History::new(length, interface.padding.unwrap_or_default(), observation, bytes);
    if history.memory_size() > MAX_STATE_NUMBERS { Err(too_much_state()) } else { Ok(Some(history)) }
}

fn too_much_state() -> OnnxProblem {
    let reason =
        format!("its state has more than {MAX_STATE_NUMBERS} numbers, with what it remembers of an episode");
    OnnxProblem::Size { reason }
}

/// Returns a shape as text, with N for sizes that are free.
pub(super) fn shape_text(dims: &[Option<i64>]) -> String {
    let dims: Vec<String> =
        dims.iter().map(|dim| dim.map_or("N".to_string(), |size| size.to_string())).collect();
    format!("[{}]", dims.join(", "))
}

impl Core {
    fn new(
        proto: &ModelProto,
        names: &Names,
        images: Vec<ImageInput>,
        places: Vec<usize>,
        interface: &Interface,
        expected: Option<Expected<'_>>,
    ) -> Result<Core, OnnxProblem> {
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
            return Err(too_much_state());
        }
        let observation = names.observation.as_ref().map(|name| (name, shape(name)));
        let observation_size = observation.as_ref().and_then(|(_, shape)| shape.last().copied()).unwrap_or(0);
        let observation_input = |(name, shape): &(&String, Vec<usize>)| {
            let all = || (0..observation_size).collect();
            let places = if expected.is_some() { places } else { all() };
            let has_history = shape.len() == 3;
            let shape = shape.clone();
            Ok(ObservationInput { input: id(name)?, shape, has_history, places })
        };
        let observation_input = observation.as_ref().map(observation_input).transpose()?;
        let history = history(interface, observation_input.as_ref(), &images)?;
        let inputs = || -> HashMap<String, Value> {
            let vectors = observation.iter().map(|(name, shape)| (*name, shape));
            let vectors = vectors.chain(states.iter().map(|(shape, (input, _))| (input, shape)));
            let vectors = vectors.map(|(name, shape)| (name.clone(), zeros(shape)));
            vectors.chain(images.iter().filter_map(|own| Some((own.name.clone(), own.black()?)))).collect()
        };
        let graph = proto.graph.as_ref().ok_or_else(|| format("it has no graph".to_string()))?;
        let outputs: Vec<&str> = names
            .actions
            .iter()
            .chain(names.states.iter().map(|(_, output)| output))
            .map(String::as_str)
            .collect();
        let opset = check::opset(proto).unwrap_or_default();
        let kept = order::asked_values(graph, &outputs);
        let values = dry_run(&model, graph, opset, inputs(), &kept)?;
        let action = names.action(&values, expected.map(|expected| expected.sizes.1))?;
        let used: Vec<&str> =
            std::iter::once(action).chain(names.states.iter().map(|(_, output)| output.as_str())).collect();
        let [length, action_size] = check_outputs(names, &values, action, &states, expected)?;
        if length.saturating_mul(action_size) > MAX_STATE_NUMBERS {
            return Err(too_much_state());
        }
        let plan =
            interface.chunk.map(|chunk| Plan::new(chunk, action, [length, action_size])).transpose()?;
        let asked = order::asked_values(graph, &used);
        if asked != kept {
            // Other values are held, so that other bounds hold.
            dry_run(&model, graph, opset, inputs(), &asked)?;
        }
        let place = |name: &str| {
            let place = asked.iter().position(|asked| asked == name);
            place.ok_or_else(|| format(format!("it has no value `{name}`")))
        };
        let core = Core {
            history,
            sizes: (observation_size, action_size),
            sees: images.iter().map(|own| own.image.clone()).collect(),
            images: images
                .into_iter()
                .map(|own| Ok((id(&own.name)?, own)))
                .collect::<Result<_, OnnxProblem>>()?,
            observation: observation_input,
            action: place(action)?,
            asked: asked.iter().map(|name| id(name)).collect::<Result<_, OnnxProblem>>()?,
            states: states
                .into_iter()
                .map(|(shape, (input, output))| {
                    Ok(State { input: id(input)?, output: place(output)?, shape })
                })
                .collect::<Result<_, OnnxProblem>>()?,
            plan,
            model,
        };
        if core.state_size() > MAX_STATE_NUMBERS {
            return Err(too_much_state());
        }
        Ok(core)
    }

    /// Returns the length of the memory of a row: the state of the model, its history and its plan.
    fn state_size(&self) -> usize {
        let own: usize = self.states.iter().map(State::size).sum();
        let [history, plan] = self.memory_sizes();
        own.saturating_add(history).saturating_add(plan)
    }

    fn memory_sizes(&self) -> [usize; 2] {
        let history = self.history.as_ref().map_or(0, History::memory_size);
        [history, self.plan.as_ref().map_or(0, Plan::memory_size)]
    }

    /// Computes a control step of one row; `None` if an operator fails or an output has another
    /// shape.
    fn step(
        &self,
        options: &RunOptions,
        observation: &[f32],
        images: &[u8],
        state: &mut [f64],
        action: &mut [f32],
    ) -> Option<()> {
        let [history, plan] = self.memory_sizes();
        let (state, planned) = state.split_at_mut_checked(state.len().checked_sub(plan)?)?;
        let (state, past) = state.split_at_mut_checked(state.len().checked_sub(history)?)?;
        let places = self.observation.iter().flat_map(|own| &own.places);
        let seen = places.map(|place| observation[*place]);
        let present = self.split(images);
        if let Some(history) = &self.history {
            history.start(past, &seen, &present);
        }
        match self.plan.as_ref().filter(|plan| plan.steps_to_chunk(planned) > 0) {
            Some(plan) => plan.play(planned, None::<std::iter::Empty<f32>>, action),
            None => {
                let inputs = self.inputs(observation, images, state, past)?;
                let run = || self.model.run(inputs, &self.asked, Some(options.clone()));
                let values = without_panic(|| run().map_err(|error| error.to_string())).ok()?;
                self.write_outputs(&values, state, planned, action)?;
            }
        }
        if let Some(history) = &self.history {
            history.push(past, seen, present);
        }
        Some(())
    }

    /// Returns whether a run of the model gets the images of the next control step of a row: those
    /// of the step itself, or of one that has it in its history.
    fn needs_images(&self, state: &[f64]) -> bool {
        let Some(plan) = &self.plan else { return true };
        let history = self.images.iter().filter_map(|(_, input)| input.history).max();
        plan.steps_to_chunk(&state[state.len() - plan.memory_size()..]) < history.unwrap_or(1)
    }

    /// Returns the present image of each input.
    fn split<'a>(&self, mut images: &'a [u8]) -> impl Iterator<Item = &'a [u8]> + Clone {
        self.images.iter().map_while(move |(_, input)| {
            let (own, others) = images.split_at_checked(input.image.bytes())?;
            images = others;
            Some(own)
        })
    }

    /// Returns the inputs of the model for one row; `None` if one does not fit.
    fn inputs(
        &self,
        observation: &[f32],
        images: &[u8],
        state: &[f64],
        past: &[f64],
    ) -> Option<Vec<(NodeId, ValueOrView<'static>)>> {
        let value = |shape: &[usize], numbers: Vec<f32>| Value::from_shape(shape, numbers).ok();
        let mut inputs: Vec<(NodeId, ValueOrView<'static>)> = Vec::new();
        if let Some(ObservationInput { input, shape, has_history, places }) = &self.observation {
            let earlier = self.history.iter().filter(|_| *has_history).flat_map(|own| own.observations(past));
            let numbers = earlier.chain(places.iter().map(|place| observation[*place])).collect();
            inputs.push((*input, value(shape, numbers)?.into()));
        }
        let mut present = self.split(images);
        for (index, (id, input)) in self.images.iter().enumerate() {
            let present = present.next()?;
            let Some(history) = self.history.as_ref().filter(|_| input.history.is_some()) else {
                inputs.push((*id, input.value(present)?.into()));
                continue;
            };
            let mut frames = Vec::new();
            history.write_images(past, index, &mut frames);
            frames.extend_from_slice(present);
            inputs.push((*id, input.value(&frames)?.into()));
        }
        let mut rest = state;
        for part in &self.states {
            let (own, others) = rest.split_at_checked(part.size())?;
            rest = others;
            let numbers = own.iter().map(|x| *x as f32).collect();
            inputs.push((part.input, value(&part.shape, numbers)?.into()));
        }
        Some(inputs)
    }

    /// Takes the action, the plan and the state of one row from the outputs of the model; `None` if
    /// one has another shape.
    fn write_outputs(
        &self,
        values: &[Value],
        state: &mut [f64],
        planned: &mut [f64],
        action: &mut [f32],
    ) -> Option<()> {
        let chosen: TensorView<'_, f32> = values.get(self.action)?.as_tensor_view()?;
        match &self.plan {
            None => copy(&chosen, action.iter_mut(), |x| x)?,
            Some(plan) if chosen.len() == plan.chunk_size() => {
                plan.play(planned, Some(chosen.iter().copied()), action);
            }
            Some(_) => return None,
        }
        let mut rest = state;
        for part in &self.states {
            let (own, others) = rest.split_at_mut_checked(part.size())?;
            copy(&values.get(part.output)?.as_tensor_view()?, own.iter_mut(), f64::from)?;
            rest = others;
        }
        Some(())
    }
}

/// Copies a tensor into as many numbers.
fn copy<'a, T: 'a>(
    tensor: &TensorView<'_, f32>,
    into: impl ExactSizeIterator<Item = &'a mut T>,
    convert: impl Fn(f32) -> T,
) -> Option<()> {
    if tensor.len() != into.len() {
        return None;
    }
    into.zip(tensor.iter()).for_each(|(x, y)| *x = convert(*y));
    Some(())
}

fn zeros(shape: &[usize]) -> Value {
    rten_tensor::Tensor::<f32>::zeros(shape).into()
}

/// Returns options for one thread: the runtime splits sums by the number of threads.
pub(super) fn one_thread() -> RunOptions {
    RunOptions::default().with_thread_pool(Some(Arc::new(one_thread_pool())))
}

fn one_thread_pool() -> ThreadPool {
    ThreadPool::with_num_threads(1)
}

/// Turns a panic of the runtime into an error, without its message.
pub(super) fn without_panic<T>(run: impl FnOnce() -> Result<T, String>) -> Result<T, String> {
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
        self.core.state_size()
    }

    fn sees(&self) -> &[Image] {
        &self.core.sees
    }

    fn worker(&self) -> Box<dyn ControllerWorker> {
        let pool = Arc::new(ThreadPool::with_num_threads(1));
        let options = RunOptions::default().with_thread_pool(Some(pool.clone()));
        Box::new(OnnxWorker { core: self.core.clone(), pool, options, images: Vec::new() })
    }
}

struct OnnxWorker {
    core: Arc<Core>,
    pool: Arc<ThreadPool>,
    options: RunOptions,
    /// Images of all rows.
    images: Vec<u8>,
}

impl ControllerWorker for OnnxWorker {
    fn reset(&mut self, state: &mut [f64], _seed: Seed) {
        state.fill(0.0);
    }

    fn needs_images(&self, state: &[f64]) -> bool {
        self.core.needs_images(state)
    }

    fn look(&mut self, _rows: usize, images: &[u8]) {
        self.images.clear();
        self.images.extend_from_slice(images);
    }

    fn act(&mut self, rows: usize, observations: &[f32], states: &mut [f64], actions: &mut [f32]) {
        let OnnxWorker { core, pool, options, images } = self;
        let bytes = images.len() / rows.max(1);
        let (inputs, outputs) = core.sizes;
        let state_size = core.state_size();
        // One change of threads for all rows, instead of one per row.
        pool.run(|| {
            for row in 0..rows {
                let observation = &observations[row * inputs..][..inputs];
                let state = &mut states[row * state_size..][..state_size];
                let action = &mut actions[row * outputs..][..outputs];
                let images = &images[row * bytes..][..bytes];
                if core.step(options, observation, images, state, action).is_none() {
                    action.fill(f32::NAN);
                }
            }
        });
    }
}
