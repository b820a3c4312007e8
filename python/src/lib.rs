//! The extension module of the Python package `mishandle`.
//!
//! The package's Python modules are its public interface; `_native.pyi` contains the types of this
//! module.

#![allow(clippy::needless_pass_by_value, reason = "PyO3 passes arguments by value")]
#![allow(clippy::result_large_err, reason = "closures return the error of the library")]

mod artifacts;
mod bisection;
mod call;
mod camera;
mod check;
mod comparison;
mod controller;
mod demonstrations;
mod early_stop;
mod evidence;
mod faults;
mod formula;
mod gpu;
mod guard;
mod hardening;
mod images;
mod logs;
mod objective;
mod online;
mod policy;
mod pool;
mod question;
mod recording;
mod remote;
mod requirements;
mod run;
mod scenarios;
mod search;
mod sights;
mod simulation;
mod simulator;
mod target;
mod training_episodes;
mod words;
mod work;

use std::error::Error as StdError;
use std::ffi::CString;

use mishandle::MishandleError as Error;
use mishandle::world::{MUJOCO_VERSION, mujoco_version};
use pyo3::exceptions::{PyImportError, PyUserWarning};
use pyo3::prelude::*;

use controller::PyController;
use early_stop::PyEarlyStop;
use faults::Faults;
use formula::PyFormula;
use guard::GuardMonitor;
use images::{Images, TaskCameras};
use objective::Objective;
use online::PyOnlineMonitor;
use remote::PlanWorker;
use run::PyRun;
use scenarios::Scenarios;
use search::PySearch;
use sights::Sights;
use simulator::Simulator;
use target::PyTarget;
use training_episodes::TrainingEpisodes;

pyo3::import_exception!(mishandle.errors, MishandleError);
pyo3::import_exception!(mishandle.errors, InvalidValueError);
pyo3::import_exception!(mishandle.errors, InvalidTypeError);
pyo3::import_exception!(mishandle.errors, InvalidStateError);

/// The parts of the package that are written in Rust.
#[pymodule(name = "_native")]
fn contents(module: &Bound<'_, PyModule>) -> PyResult<()> {
    // Another library would crash or give other bits.
    let found = mujoco_version();
    if found != MUJOCO_VERSION {
        return Err(PyImportError::new_err(format!(
            "mishandle needs MuJoCo {MUJOCO_VERSION}, but the library that was loaded is MuJoCo {found}; remove it from \
             LD_PRELOAD and LD_LIBRARY_PATH, and reinstall mishandle"
        )));
    }
    module.add("__version__", mishandle::build::VERSION)?;
    module.add_class::<TrainingEpisodes>()?;
    module.add_class::<PyTarget>()?;
    module.add_class::<PyFormula>()?;
    module.add_class::<PyOnlineMonitor>()?;
    module.add_class::<GuardMonitor>()?;
    module.add_class::<PyEarlyStop>()?;
    module.add_class::<PySearch>()?;
    module.add_class::<Scenarios>()?;
    module.add_class::<Faults>()?;
    module.add_class::<Images>()?;
    module.add_class::<TaskCameras>()?;
    module.add_class::<Objective>()?;
    module.add_class::<PyRun>()?;
    module.add_class::<PyController>()?;
    module.add_class::<Sights>()?;
    module.add_class::<Simulator>()?;
    module.add_class::<PlanWorker>()?;
    module.add_function(wrap_pyfunction!(formula::spelled_name, module)?)?;
    module.add_function(wrap_pyfunction!(logs::log_keys, module)?)?;
    module.add_function(wrap_pyfunction!(logs::monitor, module)?)?;
    module.add_function(wrap_pyfunction!(logs::log_robustness, module)?)?;
    module.add_function(wrap_pyfunction!(logs::read_table, module)?)?;
    module.add_function(wrap_pyfunction!(logs::time_columns, module)?)?;
    module.add_function(wrap_pyfunction!(logs::clock_restarts, module)?)?;
    module.add_function(wrap_pyfunction!(check::check, module)?)?;
    module.add_function(wrap_pyfunction!(check::requirement_formulas, module)?)?;
    module.add_function(wrap_pyfunction!(requirements::describe_formula, module)?)?;
    module.add_function(wrap_pyfunction!(requirements::pattern_formula, module)?)?;
    module.add_function(wrap_pyfunction!(requirements::mined_signals, module)?)?;
    module.add_function(wrap_pyfunction!(requirements::mine, module)?)?;
    module.add_function(wrap_pyfunction!(remote::complete_run, module)?)?;
    module.add_function(wrap_pyfunction!(remote::complete_hardening, module)?)?;
    module.add_function(wrap_pyfunction!(remote::create_campaign, module)?)?;
    module.add_function(wrap_pyfunction!(remote::campaign_runs, module)?)?;
    module.add_function(wrap_pyfunction!(remote::recorded_plan, module)?)?;
    module.add_function(wrap_pyfunction!(recording::recorded_states, module)?)?;
    module.add_function(wrap_pyfunction!(search::search_names, module)?)?;
    module.add_function(wrap_pyfunction!(target::target, module)?)?;
    module.add_function(wrap_pyfunction!(target::is_file, module)?)?;
    module.add_function(wrap_pyfunction!(policy::policy_interface, module)?)?;
    module.add_function(wrap_pyfunction!(policy::policy_target, module)?)?;
    module.add_function(wrap_pyfunction!(comparison::compare, module)?)?;
    module.add_function(wrap_pyfunction!(comparison::compared_pairs, module)?)?;
    module.add_function(wrap_pyfunction!(comparison::diff, module)?)?;
    module.add_function(wrap_pyfunction!(comparison::comparison_page, module)?)?;
    module.add_function(wrap_pyfunction!(comparison::evaluate_pairs, module)?)?;
    module.add_function(wrap_pyfunction!(comparison::sample_size, module)?)?;
    module.add_function(wrap_pyfunction!(artifacts::report, module)?)?;
    module.add_function(wrap_pyfunction!(artifacts::survival, module)?)?;
    module.add_function(wrap_pyfunction!(artifacts::counterexample, module)?)?;
    module.add_function(wrap_pyfunction!(artifacts::export, module)?)?;
    module.add_function(wrap_pyfunction!(artifacts::regress, module)?)?;
    module.add_function(wrap_pyfunction!(evidence::evidence, module)?)?;
    module.add_function(wrap_pyfunction!(evidence::verify_evidence, module)?)?;
    module.add_function(wrap_pyfunction!(bisection::bisect, module)?)?;
    module.add_function(wrap_pyfunction!(bisection::bisection_report, module)?)?;
    module.add_function(wrap_pyfunction!(demonstrations::record, module)?)?;
    module.add_function(wrap_pyfunction!(images::task_sight_axes, module)?)?;
    module.add_function(wrap_pyfunction!(hardening::harden, module)?)?;
    module.add_function(wrap_pyfunction!(hardening::hardening_report, module)?)?;
    module.add_function(wrap_pyfunction!(question::check_question, module)?)?;
    module.add_function(wrap_pyfunction!(question::ask, module)?)?;
    module.add_function(wrap_pyfunction!(question::without_verdict_sentence, module)?)?;
    module.add_function(wrap_pyfunction!(question::inconclusive_sentence, module)?)?;
    module.add_function(wrap_pyfunction!(simulation::simulate, module)?)?;
    module.add_function(wrap_pyfunction!(simulation::repeat, module)?)?;
    module.add_function(wrap_pyfunction!(simulation::replay_counterexample, module)?)?;
    module.add_function(wrap_pyfunction!(simulation::replay, module)?)?;
    module.add_function(wrap_pyfunction!(run_command, module)?)?;
    module.add_function(wrap_pyfunction!(set_child_program, module)?)?;
    module.add_function(wrap_pyfunction!(run_child, module)?)
}

/// Runs the command line with these arguments, of which the first is the name of the program, and
/// returns its exit code.
#[pyfunction]
fn run_command(py: Python<'_>, arguments: Vec<std::ffi::OsString>) -> u8 {
    py.detach(|| mishandle_cli::exit_code_of(arguments, Some(&gpu::device())))
}

/// Sets the command that calls [`run_child`] in a new process.
#[pyfunction]
fn set_child_program(words: Vec<std::ffi::OsString>) {
    mishandle::world::set_child_program(words);
}

/// Tries the model that the parent process sends, and returns the exit code of this process.
#[pyfunction]
fn run_child(py: Python<'_>) -> u8 {
    py.detach(mishandle::world::run_child)
}

/// Warns in Python, at the line of the caller that is `level` frames above the extension module. A
/// warning can be an exception there.
fn warn(message: &str, level: i32) -> PyResult<()> {
    Python::attach(|py| {
        let message = CString::new(message.replace('\0', " ")).unwrap_or_default();
        PyErr::warn(py, &py.get_type::<PyUserWarning>(), &message, level)
    })
}

/// Converts an error in a formula or search, with its causes.
fn plain(error: impl StdError + 'static) -> PyErr {
    InvalidValueError::new_err(words::worded(&error))
}

/// Checks that the calling process is `process`. A process made by `fork` shares no threads and
/// locks with its parent.
fn in_this_process(process: u32) -> PyResult<()> {
    if process == std::process::id() {
        return Ok(());
    }
    Err(InvalidStateError::new_err(format!(
        "this object belongs to process {process}, and fork copied no threads to process {}; make a new one in this process, \
         or start processes by multiprocessing.get_context(\"spawn\")",
        std::process::id()
    )))
}

/// Converts an error to a Python exception: its causes, the outermost first, and what helps. An
/// error in what the caller passed is also a `ValueError`.
fn raised(error: impl Into<Error>) -> PyErr {
    let error = error.into();
    let message = match &error {
        // A caller of a function has no table of a plan.
        Error::MissingPlanTable { table } => {
            format!("the run is not one of mishandle.{table}; continue it with the function that made it")
        }
        _ => words::worded(&error),
    };
    if error.is_of_caller() { InvalidValueError::new_err(message) } else { MishandleError::new_err(message) }
}
