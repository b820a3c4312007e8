//! Validates the definition and the scene of a task before the first episode. Errors name the
//! invalid field.

use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind};

use mishandle_stl::Formula;
use mishandle_world::{Model, WorldError};

use crate::definition::{BoxAxis, Definition, GripperMode, Quantity, Reward, Scene, Task};
use crate::environment::TaskError;
use crate::manner::MANNER;
use crate::robot::{JOINTS, Panda};

/// Checks the definition of a task.
///
/// # Errors
/// [`TaskError::Field`] with the invalid field.
pub(crate) fn check_definition(definition: &Definition) -> Result<(), TaskError> {
    let error = |field: &'static str, problem: String| Err(field_error(definition, field, problem));
    let is_in_name = |c: char| c.is_ascii_alphanumeric() || c == '-' || c == '_';
    if definition.name.is_empty() || !definition.name.chars().all(is_in_name) {
        return error("name", "expected letters, digits, `-` and `_` only".to_string());
    }
    check_substeps(definition, definition.n_substeps)?;
    if !definition.start.iter().all(|q| q.is_finite()) {
        return error("start", format!("expected finite numbers, found {:?}", definition.start));
    }
    if !(definition.start_noise.is_finite() && definition.start_noise >= 0.0) {
        return error(
            "start_noise",
            format!("expected a number of at least 0, found {}", definition.start_noise),
        );
    }
    if !(definition.velocity_scale.is_finite() && definition.velocity_scale != 0.0) {
        let found = definition.velocity_scale;
        return error("velocity_scale", format!("expected a number other than 0, found {found}"));
    }
    if definition.held.is_some_and(|held| !held.mjcf.contains("<body>")) {
        return error("held", "expected `mjcf` that contains a `<body>` without attributes".to_string());
    }
    check_quantities(definition)?;
    check_names(definition, "initial_box", definition.initial_box.iter().map(|axis| axis.name))?;
    check_bounds(definition)?;
    check_formulas(definition)
}

/// Checks the number of physics steps per control step.
///
/// # Errors
/// If it is 0.
pub(crate) fn check_substeps(definition: &Definition, n_substeps: usize) -> Result<(), TaskError> {
    match n_substeps {
        0 => Err(field_error(definition, "n_substeps", "expected at least 1, found 0".to_string())),
        _ => Ok(()),
    }
}

fn check_quantities(definition: &Definition) -> Result<(), TaskError> {
    let observation = definition.whole_observation();
    let lists: [(&'static str, &[Quantity]); 4] = [
        ("signals", definition.signals),
        ("observation", &observation),
        ("original_reward", definition.original_reward),
        ("shaped_reward", definition.shaped_reward),
    ];
    for (field, list) in lists {
        check_names(definition, field, list.iter().map(|quantity| quantity.name))?;
        let has_invalid_size = |quantity: &&Quantity| match field {
            "observation" => quantity.size == 0,
            _ => quantity.size != 1,
        };
        if let Some(Quantity { name, size, .. }) = list.iter().find(has_invalid_size) {
            let expected = if field == "observation" { "at least 1" } else { "1" };
            let problem = format!("`{name}` has size {size}; expected {expected}");
            return Err(field_error(definition, field, problem));
        }
    }
    let is_taken = |signal: &&Quantity| MANNER.iter().any(|known| known.name == signal.name);
    if let Some(Quantity { name, .. }) = definition.signals.iter().find(is_taken) {
        let problem = format!("`{name}` is the name of a signal of every task; choose another one");
        return Err(field_error(definition, "signals", problem));
    }
    // A signal must be an identifier of the formula language.
    let is_identifier = |name: &str| Formula::parse(name).is_ok_and(|formula| formula.signals() == [name]);
    match definition.signals.iter().find(|signal| !is_identifier(signal.name)) {
        Some(Quantity { name, .. }) => {
            let problem =
                format!("formulas cannot contain the name `{name}`; expected letters, digits and `_`");
            Err(field_error(definition, "signals", problem))
        }
        None => Ok(()),
    }
}

fn check_names<'a>(
    definition: &Definition,
    field: &'static str,
    names: impl Iterator<Item = &'a str>,
) -> Result<(), TaskError> {
    let mut known: Vec<&str> = Vec::new();
    for name in names {
        if name.is_empty() {
            return Err(field_error(definition, field, format!("entry {} has no name", known.len() + 1)));
        }
        if known.contains(&name) {
            return Err(field_error(definition, field, format!("two entries have the name `{name}`")));
        }
        known.push(name);
    }
    Ok(())
}

fn check_bounds(definition: &Definition) -> Result<(), TaskError> {
    let in_order = |[low, high]: [f64; 2]| low.is_finite() && high.is_finite() && low < high;
    let invalid = definition.initial_box.iter().find(|axis| !(in_order(axis.paper) && in_order(axis.code)));
    let Some(BoxAxis { name, paper, code, .. }) = invalid else { return Ok(()) };
    let bounds = if in_order(*paper) { code } else { paper };
    let problem = format!("axis `{name}` has bounds {bounds:?}; expected two finite numbers in order");
    Err(field_error(definition, "initial_box", problem))
}

/// Checks that the formulas parse and contain only signals of the task.
fn check_formulas(definition: &Definition) -> Result<(), TaskError> {
    for formulas in [&definition.paper, &definition.code] {
        let careful = formulas.careful();
        let texts = [
            ("success", Some(formulas.success)),
            ("strict", Some(formulas.strict)),
            ("careful", careful.as_deref()),
            ("safe", Some(formulas.safe)),
            ("completion", Some(formulas.completion)),
        ];
        for (field, text) in texts.into_iter().filter_map(|(field, text)| Some((field, text?))) {
            let formula = Formula::parse(text)
                .map_err(|error| field_error(definition, field, format!("`{text}`: {error}")))?;
            // The other formulas are evaluated where the signals of the manner would cost too much.
            let manner = if field == "careful" { MANNER } else { &[] };
            let names: Vec<&str> =
                definition.signals.iter().chain(manner).map(|signal| signal.name).collect();
            if let Some(unknown) = formula.signals().iter().find(|name| !names.contains(name)) {
                let problem =
                    format!("there is no signal `{unknown}`; available signals: {}", names.join(", "));
                return Err(field_error(definition, field, problem));
            }
        }
    }
    Ok(())
}

fn field_error(definition: &Definition, field: &'static str, problem: String) -> TaskError {
    TaskError::Field { task: definition.name, field, problem }
}

/// Two arbitrary numbers. The check fills a buffer with each of them; an entry that keeps both was
/// not written.
const UNWRITTEN: [f64; 2] = [-3.0517578125e-5, 8.589934592e9];

/// Calls every function of a scene at the center of the initial box, with buffers of the lengths
/// that the definition declares.
///
/// # Errors
/// [`TaskError::Field`] if a function panics or does not write a declared number. The field is the
/// one that declares the length.
pub(crate) fn check_scene(
    definition: &Definition,
    model: &Model,
    panda: &Panda,
    scene: &dyn Scene,
) -> Result<(), TaskError> {
    let mut world = model.world();
    world.reset();
    panda.place(&definition.start, &mut world);
    let center: Vec<f64> =
        definition.initial_box.iter().map(|axis| 0.5 * (axis.paper[0] + axis.paper[1])).collect();
    let failed = |function: &str, field, count: usize, cause: Box<dyn Any + Send>| {
        let cause = panic_message(cause.as_ref());
        field_error(definition, field, format!("`Scene::{function}` panics with {count} numbers: {cause}"))
    };
    catch_unwind(AssertUnwindSafe(|| scene.place(&center, &mut world)))
        .map_err(|cause| failed("place", "initial_box", center.len(), cause))?;
    world.refresh();
    let rows = world.rows();
    let written = |function, field, names: &[Quantity], write: &dyn Fn(&mut [f64])| {
        let count: usize = names.iter().map(|quantity| quantity.size).sum();
        let mut filled = UNWRITTEN.map(|value| vec![value; count]);
        for out in &mut filled {
            catch_unwind(AssertUnwindSafe(|| write(out)))
                .map_err(|cause| failed(function, field, count, cause))?;
        }
        let [first, second] = filled;
        let unwritten = (0..count).find(|i| first[*i] == UNWRITTEN[0] && second[*i] == UNWRITTEN[1]);
        match unwritten {
            Some(index) => {
                let name = name_at(names, index);
                let problem =
                    format!("`Scene::{function}` does not write number {index} of {count} (`{name}`)");
                Err(field_error(definition, field, problem))
            }
            None => Ok(first),
        }
    };
    let signals = written("signals", "signals", definition.signals, &|out| scene.signals(&rows, out))?;
    written("observe", "observation", definition.observation, &|out| scene.observe(&rows, out))?;
    let action = [0.0; JOINTS];
    for (reward, field) in [(Reward::Original, "original_reward"), (Reward::Shaped, "shaped_reward")] {
        written("reward", field, definition.reward(reward), &|out| {
            scene.reward(reward, &rows, &signals, &action, out);
        })?;
    }
    catch_unwind(AssertUnwindSafe(|| scene.is_terminal(&rows, &signals)))
        .map_err(|cause| failed("is_terminal", "signals", signals.len(), cause))?;
    if let GripperMode::Scene(_) = definition.grip {
        let mut fingers = [0.0; 2];
        catch_unwind(AssertUnwindSafe(|| scene.grip(&rows, &action, &mut fingers)))
            .map_err(|cause| failed("grip", "grip", fingers.len(), cause))?;
    }
    Ok(())
}

/// Returns the message of a panic.
fn panic_message(cause: &(dyn Any + Send)) -> String {
    let text = cause.downcast_ref::<String>().cloned();
    text.or_else(|| cause.downcast_ref::<&str>().map(ToString::to_string)).unwrap_or_default()
}

/// Returns the name of the quantity that contains the number at `index`.
fn name_at(names: &[Quantity], index: usize) -> &'static str {
    let mut end = 0;
    let found = names.iter().find(|quantity| {
        end += quantity.size;
        index < end
    });
    found.map_or("", |quantity| quantity.name)
}

/// Compiles the document `xml` of a task.
///
/// # Errors
/// If MuJoCo cannot compile it. The message contains the line number in the task's own file and the
/// text of the line.
pub(crate) fn compile(task: &dyn Task, xml: &str) -> Result<Model, WorldError> {
    Model::from_xml(xml).map_err(|error| match error {
        WorldError::Model(message) => {
            WorldError::Model(with_scene_line(&message, xml, &task.scene(), task.scene_file()))
        }
        other => other,
    })
}

/// Replaces the line number of MuJoCo's message, which refers to `xml`, by the line number in the
/// file of the scene, and appends the text of the line.
///
/// MuJoCo counts lines from 1. A line outside the scene belongs to the robot or the held object,
/// which have no file.
fn with_scene_line(message: &str, xml: &str, scene: &str, file: &str) -> String {
    const LINE: &str = "line ";
    let found = message.match_indices(LINE).find_map(|(at, _)| {
        let digits = &message[at + LINE.len()..];
        let digits = &digits[..digits.find(|c: char| !c.is_ascii_digit()).unwrap_or(digits.len())];
        Some((at, digits.len(), digits.parse::<usize>().ok()?))
    });
    let Some((at, digits, line)) = found else { return message.to_string() };
    let text = xml.lines().nth(line.saturating_sub(1)).unwrap_or_default().trim();
    let above = xml.find(scene).map(|start| xml[..start].matches('\n').count());
    let place = match above {
        Some(above) if (above + 1..=above + scene.lines().count()).contains(&line) => {
            format!("{file}:{}", line - above)
        }
        _ => format!("line {line} of the whole document, outside {file}"),
    };
    let message = format!("{}{place}{}", &message[..at], &message[at + LINE.len() + digits..]);
    format!("{}: `{text}`", message.split_whitespace().collect::<Vec<_>>().join(" "))
}
