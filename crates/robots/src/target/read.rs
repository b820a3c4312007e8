//! Reading and checking a target file.

use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use crate::expression::Argument;
use mishandle_files::{limits, read_bounded};
use mishandle_rollout::Identity;
use mishandle_simulators::{ProgramPolicy, ProgramSettings};
use mishandle_world::ElementKind;

use crate::axes::{Axes, ObservedPart, parameter_names};
use crate::cameras::RobotCameras;
use crate::description::{Constant, Description, Named, PolicySource, Quantity};
use crate::document::{self, Key};
use crate::error::{Problem, RobotError};
use crate::library::{Library, RememberedPart, members};
use crate::model::{self, RobotModel};
use crate::phase::PhaseBuilder;
use crate::policy::ExpressionPolicy;
use crate::target::{KIND, RobotFile, RobotPolicy};
use crate::task_space::TaskSpacePolicy;

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
        check_names(&description).map_err(problem)?;
        check_groups(&description, &without).map_err(problem)?;
        let actuated = actuated(&description, &without).map_err(problem)?;
        let memory = remembered_parts(&description, &without).map_err(problem)?;
        let actions = description.policy.actions.unwrap_or(actuated.len());
        let library = library(&memory, Some(actions));
        check_constants(&description, &library).map_err(problem)?;
        let parts = observed_parts(&description, &library).map_err(problem)?;
        let observation_size = parts.iter().map(|part| part.size).sum();
        let axes = Axes::new(&description, &library, &parts).map_err(problem)?;
        let cameras = RobotCameras::new(&description, &model.physics).map_err(problem)?;
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
            PolicySource::Program(table) => {
                let folder = path.parent().unwrap_or(Path::new("."));
                let sizes = [observation_size, actions];
                let settings = ProgramSettings {
                    words: table.words.iter().map(|word| word.text.clone()).collect(),
                    time_limit: Duration::from_secs_f64(table.time_limit),
                    state: table.state,
                };
                RobotPolicy::Program(Arc::new(ProgramPolicy::new(settings, folder, sizes, control_dt)))
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
            cameras,
        };
        // This reports mistakes now, with their lines.
        file.robot(file.actions()).map_err(|found| found.at(path, text))?;
        file.check_replaced().map_err(|found| found.at(path, text))?;
        Ok(file)
    }
}

/// Reads the text of a target file.
pub(crate) fn read_text(path: &Path) -> Result<String, RobotError> {
    let read = |source| RobotError::Read { path: path.to_path_buf(), source };
    let bytes = read_bounded(path, limits::PLAN).map_err(read)?;
    String::from_utf8(bytes)
        .map_err(|error| read(std::io::Error::new(std::io::ErrorKind::InvalidData, error.utf8_error())))
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

/// Names of every expression.
const NAMES: [&str; 4] = ["action", "bias_forces", "pi", "time"];

/// A constant, an axis and a part of the memory have names of their own: one would hide the other.
fn check_names(description: &Description) -> Result<(), Problem> {
    let constants = description.constants.iter().map(|named| (&named.key, "constant"));
    let axes = description.axes.iter().map(|named| (&named.key, "axis"));
    let memory = description.memory.iter().map(|named| (&named.key, "part of the memory"));
    let mut seen: Vec<(&Key, &str)> = Vec::new();
    for (key, what) in constants.chain(axes).chain(memory) {
        let name = key.name.as_str();
        if NAMES.contains(&name) {
            let message = format!("`{name}` has a meaning in every expression; give the {what} another name");
            return Err(Problem::new(&key.span, message));
        }
        if let Some((_, other)) = seen.iter().find(|(other, _)| other.name == name) {
            let message = format!("`{name}` is the name of a {other} already; give the {what} another name");
            return Err(Problem::new(&key.span, message));
        }
        seen.push((key, what));
    }
    Ok(())
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
    use crate::expression::Names;
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
        let name = named.key.name.clone();
        let is_number = phase.is_number(0);
        parts.push(RememberedPart { name, place: first..first + size, is_number });
        first += size;
    }
    Ok(parts)
}
