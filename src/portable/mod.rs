//! Plans without paths of the machine that made them: the files stand in a folder beside what needs
//! them, a counterexample or the run files of an evidence folder.

use std::borrow::Cow;
use std::path::{Path, PathBuf};

use mishandle_files::{NewFolders, limits, read_bounded, write_atomically};
use mishandle_store::{ComponentRecord, RunHeader};
use mishandle_text::path_text;

use crate::error::{MishandleError, problem};
use crate::plan::{GuardPlan, Plan};
use crate::resolve::{
    Moved, ONNX_SIDES, ResolvedPlan, command, controller_name, files_of, is_onnx, is_path, is_target_file,
    onnx_side, resolve_recorded, simulator_file, starts_program,
};
use crate::shipped::{EXTENSIONS, ShippedFile, shipped_controller};

/// Prefix of a controller or target whose file is expected in the folder.
pub(crate) const BESIDE: &str = "./";

/// Returns the name of a shipped controller, or `./FILE` for any other. The plan of a run has an
/// absolute path.
pub(crate) fn controller(plan: &Plan, components: &[ComponentRecord]) -> String {
    if !is_path(&plan.controller) {
        return plan.controller.clone();
    }
    let name = controller_name(&plan.controller);
    let recorded = components.iter().find(|component| component.role == "controller");
    let shipped = mishandle_tasks::task(&plan.target)
        .and_then(|task| shipped_controller(task.definition(), &name)?.controller().ok())
        .map(|file| file.policy.sampling(plan.stochastic).hash());
    match (shipped, recorded) {
        (Some(hash), Some(recorded)) if hash == recorded.hash => name,
        _ => beside(&plan.controller),
    }
}

/// Returns the name of a target, or `./FILE` for a target file.
pub(crate) fn target(plan: &Plan) -> String {
    if is_target_file(&plan.target) { beside(&plan.target) } else { plan.target.clone() }
}

/// Returns the guard, with `./FILE` for a fallback that is a file.
pub(crate) fn guard(plan: &Plan) -> Option<GuardPlan> {
    let mut guard = plan.guard.clone()?;
    if is_path(&guard.fallback) {
        guard.fallback = beside(&guard.fallback);
    }
    Some(guard)
}

fn beside(path: &str) -> String {
    format!("{BESIDE}{}", Path::new(path).file_name().unwrap_or_default().to_string_lossy())
}

/// Returns the plan of a run without paths: files are `./FILE`, and a simulator has no folder.
///
/// # Errors
/// If the plan of the header is invalid.
pub fn portable_plan(header: &RunHeader) -> Result<Plan, MishandleError> {
    let plan = Plan::from_toml(&header.plan)?;
    let place = |file: &str| if is_path(file) { beside(file) } else { file.to_string() };
    let guard = plan.guard.clone().map(|guard| GuardPlan { fallback: place(&guard.fallback), ..guard });
    let controller = place(&plan.controller);
    let target = target(&plan);
    Ok(Plan { controller, target, guard, folder: String::new(), ..plan })
}

/// Returns a plan with the paths of a controller, a fallback and a target in the folder `folder`.
pub(crate) fn plan_in(plan: &Plan, folder: &Path) -> Plan {
    // A path also in the working directory, whose name is empty.
    let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    let mut plan = plan.clone();
    let fallback = plan.guard.as_mut().map(|guard| &mut guard.fallback);
    for file in [&mut plan.controller, &mut plan.target].into_iter().chain(fallback) {
        if let Some(name) = file.strip_prefix(BESIDE) {
            *file = path_text(&folder.join(name));
        }
    }
    if command(&plan.target).is_some() {
        plan.folder = path_text(folder);
    }
    plan
}

/// Checks that a target file of others names only files that are in its folder, too.
pub(crate) fn check_target(plan: &Plan) -> Result<(), MishandleError> {
    // A simulator is a program, which the user must allow.
    if is_target_file(&plan.target) && simulator_file(plan)?.is_none() {
        mishandle_robots::check_inside(Path::new(&plan.target))?;
    }
    Ok(())
}

/// Looks up the plan of a run of others. Its files are those that [`copy_files`] wrote to `folder`:
/// no path of the run is opened, and no program is started.
///
/// # Errors
/// If the target is a program, a file is missing or names one outside the folder, or a part of the
/// target has another hash than the run's.
pub fn resolve_in(header: &RunHeader, folder: &Path) -> Result<ResolvedPlan, MishandleError> {
    resolve_plan_in(portable_plan(header)?, &header.components, folder)
}

/// Looks up a portable plan of others as [`resolve_in`] does.
pub(crate) fn resolve_plan_in(
    mut plan: Plan,
    components: &[ComponentRecord],
    folder: &Path,
) -> Result<ResolvedPlan, MishandleError> {
    for name in [Some(&mut plan.controller), plan.guard.as_mut().map(|guard| &mut guard.fallback)] {
        let Some(name) = name.filter(|name| !name.is_empty()) else { continue };
        let files = EXTENSIONS.map(|extension| format!("{name}.{extension}"));
        if let Some(file) = files.into_iter().find(|file| folder.join(file).is_file()) {
            *name = format!("{BESIDE}{file}");
        }
    }
    let plan = plan_in(&plan, folder);
    check_target(&plan)?;
    check_no_program(&plan)?;
    resolve_recorded(plan, components, Moved::default())
}

/// Checks that simulations of a plan start no program, without starting one.
///
/// # Errors
/// If they do, or the target file cannot be read.
pub fn check_no_program(plan: &Plan) -> Result<(), MishandleError> {
    if starts_program(plan)? {
        return Err(problem(
            "its simulator or its policy is a program, and no program is started from a file of others",
        ));
    }
    Ok(())
}

/// Copies the files of a target to the folder of its counterexamples, with the folders that they
/// have below that of the target file: target file, model, policy, and the controller
/// and the fallback of the plan.
/// Returns the files that it wrote; none for a target without files.
///
/// # Errors
/// If a file is outside the folder of the target file, cannot be read or written, or the folder has
/// another file in its place.
pub fn copy_target(plan: &Plan, folder: &Path) -> Result<Vec<PathBuf>, MishandleError> {
    let Some(mut copies) = target_files(plan)? else { return Ok(Vec::new()) };
    copies.extend(controller_files(plan)?);
    write(folder, copies)
}

/// Copies all files to a folder that a run of the plan needs: those of [`copy_target`], the
/// controller of a target without files, and shipped controllers, which another version of this
/// program can lack. [`resolve_in`] finds them there. Returns the files that it wrote.
///
/// # Errors
/// The errors of [`copy_target`].
pub fn copy_files(plan: &Plan, folder: &Path) -> Result<Vec<PathBuf>, MishandleError> {
    let mut copies = target_files(plan)?.unwrap_or_default();
    copies.extend(controller_files(plan)?);
    for (name, file) in shipped_files(plan) {
        let file_name = Path::new(&name).with_extension(file.path().extension().unwrap_or_default());
        copies.push((file_name, file.bytes()?));
    }
    write(folder, copies)
}

/// Returns the files that [`copy_files`] writes for a plan whose files are in such a folder, as
/// paths in it.
///
/// # Errors
/// If a file is outside the folder of the target file or cannot be read.
pub fn needed_files(plan: &Plan) -> Result<Vec<PathBuf>, MishandleError> {
    let mut copies = target_files(plan)?.unwrap_or_default();
    copies.extend(controller_files(plan)?);
    Ok(copies.into_iter().map(|(name, _)| name).collect())
}

/// A file to write: its place in the folder, and its content.
type Copied = (PathBuf, Cow<'static, [u8]>);

/// Returns the files of a target; `None` for a target without files.
fn target_files(plan: &Plan) -> Result<Option<Vec<Copied>>, MishandleError> {
    let Some((home, files)) = files_of(plan)? else { return Ok(None) };
    let home = home.canonicalize().map_err(|source| file_error(&home, source))?;
    let mut copies = Vec::new();
    for path in files.iter().flat_map(|path| with_sides(path)) {
        let path = path.canonicalize().map_err(|source| file_error(&path, source))?;
        let Ok(relative) = path.strip_prefix(&home) else {
            return Err(problem(format!(
                "{} is outside the folder of the target file, {}; only files in it can stand beside a counterexample: move the \
                 file there",
                path.display(),
                home.display()
            )));
        };
        copies.push((relative.to_path_buf(), read(&path)?));
    }
    Ok(Some(copies))
}

/// Returns the controller and the fallback of a plan, where they are files.
fn controller_files(plan: &Plan) -> Result<Vec<Copied>, MishandleError> {
    let sides = controllers(plan).filter(|file| is_path(file)).flat_map(|file| with_sides(Path::new(file)));
    sides.map(|path| Ok((path.file_name().unwrap_or_default().into(), read(&path)?))).collect()
}

/// Returns the shipped controllers of a plan by name.
fn shipped_files(plan: &Plan) -> Vec<(String, ShippedFile)> {
    let Some(task) = mishandle_tasks::task(&plan.target) else { return Vec::new() };
    let file = |name: &str| Some((name.to_string(), shipped_controller(task.definition(), name)?));
    controllers(plan).filter(|name| !is_path(name)).filter_map(file).collect()
}

fn controllers(plan: &Plan) -> impl Iterator<Item = &str> {
    let fallback = plan.guard.as_ref().map(|guard| guard.fallback.as_str());
    std::iter::once(plan.controller.as_str()).chain(fallback)
}

/// Writes files to a folder when all are known to fit, and returns those that it wrote.
fn write(folder: &Path, copies: Vec<Copied>) -> Result<Vec<PathBuf>, MishandleError> {
    let mut contents: Vec<(PathBuf, Cow<'static, [u8]>)> = Vec::new();
    for (relative, bytes) in copies {
        let to = folder.join(relative);
        let written = contents.iter().find(|(path, _)| *path == to).map(|(_, bytes)| bytes.clone());
        let known = match written {
            Some(bytes) => Ok(bytes.into_owned()),
            None => read_bounded(&to, limits::CONTROLLER),
        };
        match known {
            Ok(known) if known == *bytes => {}
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => contents.push((to, bytes)),
            _ => {
                let text = "exists already and has another content; choose another folder";
                return Err(problem(format!("{} {text}", to.display())));
            }
        }
    }
    let mut folders = NewFolders::default();
    for (to, bytes) in &contents {
        let write = MishandleError::write("file", to);
        if let Some(parent) = to.parent().filter(|parent| !parent.as_os_str().is_empty()) {
            folders.create(parent).map_err(write)?;
        }
        write_atomically(to, bytes).map_err(write)?;
    }
    Ok(contents.into_iter().map(|(to, _)| to).collect())
}

fn read(path: &Path) -> Result<Cow<'static, [u8]>, MishandleError> {
    read_bounded(path, limits::CONTROLLER).map(Cow::Owned).map_err(|source| file_error(path, source))
}

/// Returns a file, and those that belong to an ONNX model and exist.
fn with_sides(path: &Path) -> impl Iterator<Item = PathBuf> {
    let sides = if is_onnx(path) { ONNX_SIDES.map(|end| onnx_side(path, end)).to_vec() } else { Vec::new() };
    [path.to_path_buf()].into_iter().chain(sides.into_iter().filter(|side| side.exists()))
}

fn file_error(path: &Path, source: std::io::Error) -> MishandleError {
    MishandleError::File { path: path.to_path_buf(), source }
}
