use anyhow::Result;
use mishandle::plan::EngineSettings;
use mishandle::results::{Answer, Counterexamples, RunShown};
use mishandle::run::answer_of_run;
use mishandle::store::RunFile;
use mishandle::{Compared, MishandleError, RunError};

use crate::exit_status::ExitStatus;
use crate::run;
use crate::show::{answer, escape, modes, output};

/// Shows the answer of a run and its failure modes.
pub fn show(file: &RunFile, engine: &EngineSettings, json: bool, verbose: bool) -> Result<ExitStatus> {
    let answer = of_run(file, engine)?;
    let modes = mishandle::inspect::failure_modes(file)?;
    let found =
        RunShown { answer, counterexamples: mishandle::inspect::counterexamples_result(file, &modes)? };
    if json {
        output::json(&found)?;
    } else {
        print(&found, verbose)?;
    }
    let RunShown { answer, counterexamples } = &found;
    let name = run::name(file);
    if let Some(answer) = answer.as_ref().filter(|answer| !answer.is_complete()) {
        run::report_interruption(file.header().kind, answer.simulations(), &name);
    }
    if !counterexamples.modes.is_empty() {
        output::message(&format!("Explain one with: mishandle show {name} --simulation first"));
    }
    Ok(ExitStatus::Done)
}

/// Returns the answer of a run; `None` if it takes the target, which is not here or needs a
/// program.
fn of_run(file: &RunFile, engine: &EngineSettings) -> Result<Option<Answer>> {
    match answer_of_run(file, engine.moved()) {
        Ok(found) => Ok(Some(found)),
        Err(error @ MishandleError::Run(RunError::Differs { whose: Compared::Plan, .. })) => {
            Err(error.into())
        }
        Err(error) => {
            output::message(&format!("the answer is missing, because it takes the target: {error}"));
            Ok(None)
        }
    }
}

/// Prints the answer and the failure modes.
fn print(found: &RunShown, verbose: bool) -> Result<()> {
    let Counterexamples { target, formula, failures, not_grouped, space_axes, control_dt, .. } =
        &found.counterexamples;
    let modes = modes::Modes {
        modes: found.counterexamples.modes.iter().collect(),
        failures: *failures,
        not_grouped: *not_grouped,
        axes: space_axes,
        control_dt: *control_dt,
    };
    match &found.answer {
        Some(answer) => answer::print(answer, verbose)?,
        None => output::line(&format!("{}\nformula {}", escape::label(target), escape::name(formula)))?,
    }
    if found.answer.is_some() && *failures == 0 {
        return Ok(());
    }
    output::line(&format!("\n{}", modes.text()))
}
