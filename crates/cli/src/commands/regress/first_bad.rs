use std::path::{Path, PathBuf};

use anyhow::{Result, ensure};
use mishandle::bisect::{BisectionPlan, BisectionTest, bisect};
use mishandle_text::shell_path;

use super::{Arguments, QUESTION};
use crate::exit_status::ExitStatus;
use crate::run;
use crate::show::progress::Bar;
use crate::show::{bisection, output};

/// Finds the first bad one of the controllers in a folder.
pub fn run(command: &Arguments, controllers: &Path) -> Result<ExitStatus> {
    let plan = plan(command, controllers)?;
    let bar = Bar::new(0, "simulations");
    run::stop_on_signals(&bar)?;
    let found = bisect(&plan, &mut |progress| {
        let (done, most) = progress.simulations;
        bar.set_note(progress.candidate.name.clone());
        bar.set_length(most);
        bar.set_position(done);
        run::control_flow()
    });
    bar.clear();
    let found = found?;
    if command.json {
        output::json(&found)?;
    } else {
        output::line(&bisection::text(&found))?;
    }
    let folder = shell_path(&plan.folder);
    if !found.is_complete {
        output::message(&format!(
            "interrupted: what was simulated is kept in {folder}; the same command continues"
        ));
        return Ok(ExitStatus::Interrupted);
    }
    output::message(&format!("Write a page with: mishandle report {folder} --out bisection.html"));
    Ok(if found.found { ExitStatus::Done } else { ExitStatus::Violated })
}

/// Returns the question.
fn plan(command: &Arguments, controllers: &Path) -> Result<BisectionPlan> {
    let planned = command.planned()?;
    let (test, settings) = if planned.has("regress", "rate") {
        ensure!(
            command.folder.is_none(),
            "a test is a rate or counterexamples: leave out --rate or the folder of counterexamples"
        );
        ensure!(
            planned.table.contains_key("target"),
            "--rate needs a target: give -k target=TARGET or --plan FILE"
        );
        let (plan, settings) = planned.plan()?;
        (BisectionTest::rate(plan, settings.regress.rate.unwrap_or_default())?, settings)
    } else {
        ensure!(command.seed.is_none(), "--seed does not apply: counterexamples have seeds of their own");
        let settings = planned.settings(QUESTION)?;
        (BisectionTest::Counterexamples(command.folder().to_path_buf()), settings)
    };
    let folder = command.out.clone().unwrap_or(PathBuf::from(BisectionPlan::FOLDER));
    let every = settings.regress.every;
    let command = String::new();
    let plan = BisectionPlan { controllers: controllers.to_path_buf(), test, every, folder, command };
    Ok(BisectionPlan { command: bisection::command(&plan), ..plan })
}
