//! The model of a target file: its document, the edits of the file, and the compiled model.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use crate::mjcf::{Edit, MjcfError, ModelFiles, Select, Source};
use mishandle_world::{Model, Opened, PictureModel, Visuals, WorldError};
use sha2::{Digest, Sha256};

use crate::description::Description;
use crate::document::{Fields, Item, Table, Value};
use crate::error::{Problem, RobotError};

/// The model of a target file.
pub(crate) struct RobotModel {
    /// For physics: without visual geoms.
    pub physics: Model,
    /// For pictures: with them.
    pub picture: PictureModel,
    /// File of the model.
    pub file: PathBuf,
    /// The files of the model, that one first.
    pub files: Vec<PathBuf>,
    /// SHA-256 of the document and of the files that it refers to.
    pub hash: String,
}

/// Reads, edits and compiles the model of a description in the file at `path`.
pub(crate) fn read(description: &Description, path: &Path, text: &str) -> Result<RobotModel, RobotError> {
    let problem = |problem: Problem| problem.at(path, text);
    let folder = path.parent().unwrap_or(Path::new("."));
    let file = folder.join(&description.model_file.text);
    let failed = |message: String| RobotError::Model { path: file.clone(), message };
    let span = &description.model_file.span;
    let mut fields = Fields::new(&description.model, "[model]");
    let allow_outside = fields.flag("allow_outside").map_err(problem)?;
    let unread = |error: MjcfError| problem(Problem::new(span, error_text(&error)));
    let (mut source, mut files) = Source::main(&file, allow_outside).map_err(unread)?;
    let mut edits = edits(&description.model).map_err(problem)?;
    edits.sort_by_key(|(start, _)| *start);
    let which = if edits.is_empty() { Opened::All } else { Opened::Included };
    source.open(which, &mut files).map_err(|error| unread(files.error(&error)))?;
    let mut original = source.clone();
    let at = |start: usize, error: &dyn std::error::Error| Problem::new(&(start..start), error_text(error));
    let mut edited = as_mjcf(source).map_err(failed)?;
    let unedited = edited.clone();
    for (start, edit) in &edits {
        edited = edited.edit(std::slice::from_ref(edit)).map_err(|error| problem(at(*start, &error)))?;
    }
    if !edits.is_empty() {
        edited.open(Opened::All, &mut files).map_err(|error| {
            let of_edit = rejected(unedited, &edits, &mut files);
            match of_edit {
                Some((start, error)) => problem(Problem::new(&(start..start), files.message(&error))),
                None => unread(files.error(&error)),
            }
        })?;
    }
    // Edits are in the target file, which has a hash of its own.
    for (name, bytes) in &edited.assets {
        original.assets.entry(name.clone()).or_insert_with(|| bytes.clone());
    }
    let hash = source_hash(&original);
    let physics = Model::from_untrusted(&edited.document, &edited.assets, Visuals::Discard)
        .map_err(|error| failed(error_text(&error)))?;
    let picture = PictureModel::from_untrusted(edited.document, Arc::new(edited.assets));
    Ok(RobotModel { physics, picture, file, files: files.into_files(), hash })
}

/// Returns the place of the first edit after which MuJoCo rejects a model, with its error; none if
/// it rejects the model without edits.
fn rejected(
    mut source: Source,
    edits: &[(usize, Edit)],
    files: &mut ModelFiles,
) -> Option<(usize, WorldError)> {
    if source.clone().open(Opened::All, files).is_err() {
        return None;
    }
    edits.iter().find_map(|(start, edit)| {
        source = source.clone().edit(std::slice::from_ref(edit)).ok()?;
        Some((*start, source.clone().open(Opened::All, files).err()?))
    })
}

/// Reads and compiles a model without a target file.
pub(crate) fn plain(file: &Path, allow_outside: bool) -> Result<Model, RobotError> {
    let failed = |message: String| RobotError::Model { path: file.to_path_buf(), message };
    let (mut source, mut files) =
        Source::main(file, allow_outside).map_err(|error| failed(error_text(&error)))?;
    source.open(Opened::All, &mut files).map_err(|error| failed(files.message(&error)))?;
    let source = as_mjcf(source).map_err(failed)?;
    let model = Model::from_untrusted(&source.document, &source.assets, Visuals::Discard)
        .map_err(|error| failed(error_text(&error)))?;
    Ok(model)
}

/// Returns a URDF as MJCF.
fn as_mjcf(source: Source) -> Result<Source, String> {
    if !source.is_urdf() {
        return Ok(source);
    }
    let document = mishandle_world::mjcf_of_untrusted_urdf(&source.document, &source.assets);
    Ok(Source { document: document.map_err(|error| error_text(&error))?, assets: source.assets })
}

fn source_hash(source: &Source) -> String {
    let mut hasher = Sha256::new();
    hasher.update(source.document.as_bytes());
    for (name, bytes) in &source.assets {
        hasher.update(format!("\n{} {}\n", name, bytes.len()));
        hasher.update(bytes);
    }
    hasher.finalize().iter().map(|byte| format!("{byte:02x}")).collect()
}

/// Returns an error and its causes on one line.
pub(crate) fn error_text(error: &dyn std::error::Error) -> String {
    let causes = std::iter::successors(Some(error), |error| error.source());
    causes.map(ToString::to_string).collect::<Vec<_>>().join(": ")
}

/// Options of `<option>` that the file may set by their names there.
const OPTIONS: [&str; 12] = [
    "timestep",
    "integrator",
    "solver",
    "cone",
    "jacobian",
    "iterations",
    "tolerance",
    "ls_iterations",
    "impratio",
    "gravity",
    "density",
    "viscosity",
];

/// Returns the edits of a table `[model]` with their places in the text. They are applied in its
/// order.
fn edits(model: &Table) -> Result<Vec<(usize, Edit)>, Problem> {
    let mut fields = Fields::new(model, "[model]");
    fields.get("file");
    fields.flag("allow_outside")?;
    let mut edits = Vec::new();
    let mut options = Vec::new();
    for key in OPTIONS {
        if let Some(item) = fields.get(key) {
            options.push((key.to_string(), attribute(item, key)?));
        }
    }
    if !options.is_empty() {
        edits.push((model.span.start, Edit::Option { attributes: options }));
    }
    for (key, read) in
        [("add", add as fn(&Table) -> Result<Edit, Problem>), ("set", set), ("actuator", actuator)]
    {
        let Some(item) = fields.get(key) else { continue };
        let Value::List(tables) = &item.value else {
            return Err(Problem::new(&item.span, format!("write `[[model.{key}]]`, once for each edit")));
        };
        for item in tables {
            let table = item.table(key)?;
            let start = table.entries.iter().map(|(key, _)| key.span.start).min();
            edits.push((start.unwrap_or(item.span.start), read(table)?));
        }
    }
    fields.finish()?;
    Ok(edits)
}

fn add(table: &Table) -> Result<Edit, Problem> {
    let mut fields = Fields::new(table, "[[model.add]]");
    let edit = Edit::Add {
        parent: fields.need("parent")?.text("parent")?.text,
        xml: fields.need("xml")?.text("xml")?.text,
    };
    fields.finish()?;
    Ok(edit)
}

/// Kinds of elements whose attributes can be set.
const KINDS: [&str; 9] =
    ["joint", "geom", "body", "site", "actuator", "sensor", "equality", "tendon", "inertial"];

fn set(table: &Table) -> Result<Edit, Problem> {
    let is_kind = |name: &str| KINDS.contains(&name);
    let mut kinds = table.entries.iter().filter(|(key, _)| is_kind(&key.name));
    let (Some((kind, selected)), None) = (kinds.next(), kinds.next()) else {
        let message =
            format!("[[model.set]] needs one kind of element with a name or a pattern: {}", KINDS.join(", "));
        return Err(Problem::new(&table.span, message));
    };
    let select = match &selected.value {
        Value::Text(pattern) => Select::Name(pattern.clone()),
        Value::Table(selection) => match selection.entries.as_slice() {
            [(key, item)] if key.name == "colliding" && item.value == Value::Bool(true) => Select::Colliding,
            [(key, item)] if key.name == "class" => Select::Class(item.text("class")?.text),
            [(key, item)] if key.name == "all" && item.value == Value::Bool(true) => Select::All,
            _ => {
                let message = "elements are selected by a pattern, { class = \"...\" }, { colliding = true } or { all = true }";
                return Err(Problem::new(&selected.span, message));
            }
        },
        _ => {
            return Err(Problem::new(&selected.span, "write a name or a pattern in quotation marks"));
        }
    };
    let others = table.entries.iter().filter(|(key, _)| !is_kind(&key.name));
    let attributes = others.map(|(key, item)| Ok((key.name.clone(), attribute(item, &key.name)?)));
    let attributes: Vec<(String, String)> = attributes.collect::<Result<_, Problem>>()?;
    if attributes.is_empty() {
        return Err(Problem::new(
            &table.span,
            "[[model.set]] needs an attribute to set, such as `armature = 0.01`",
        ));
    }
    Ok(Edit::Set { kind: kind.name.clone(), select, attributes })
}

fn actuator(table: &Table) -> Result<Edit, Problem> {
    let mut joints = None;
    let mut kind = None;
    let mut attributes = Vec::new();
    for (key, item) in &table.entries {
        match key.name.as_str() {
            "joints" => joints = Some(item.text("joints")?.text),
            "type" => kind = Some(item.text("type")?.text),
            name => attributes.push((name.to_string(), attribute(item, name)?)),
        }
    }
    match (joints, kind) {
        (Some(joints), Some(kind)) => Ok(Edit::Actuator { joints, kind, attributes }),
        _ => Err(Problem::new(
            &table.span,
            "[[model.actuator]] needs `joints`, a pattern, and `type`, such as \"position\"",
        )),
    }
}

/// Returns a value as the text of an attribute of MJCF.
fn attribute(item: &Item, name: &str) -> Result<String, Problem> {
    match &item.value {
        Value::Text(text) => Ok(text.clone()),
        Value::Bool(value) => Ok(value.to_string()),
        Value::Number(_) => Ok(item.number(name)?.to_string()),
        Value::List(_) => {
            Ok(item.numbers(name)?.iter().map(ToString::to_string).collect::<Vec<_>>().join(" "))
        }
        _ => Err(Problem::new(&item.span, format!("`{name}` must be a number, a list of numbers or a text"))),
    }
}
