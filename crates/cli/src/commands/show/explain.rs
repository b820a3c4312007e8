use std::path::Path;

use anyhow::{Result, bail, ensure};
use mishandle::inspect::ExplainedSimulation;
use mishandle::plan::{EngineSettings, Settings};
use mishandle::resolve::ResolvedPlan;
use mishandle::results::{AxesAtNominal, EvaluatedCount, Masking};
use mishandle::store::{RunFile, RunHeader};
use mishandle_text::plural;

use super::Place;
use crate::exit_status::ExitStatus;
use crate::run::{self, counterexample as exported};
use crate::show::progress::Bar;
use crate::show::{escape, explanation, output, simulation as simulations};

/// Explains a simulation of a run.
pub fn simulation(
    file: &RunFile,
    trial: Option<u32>,
    place: Place,
    Settings { engine, report, .. }: &Settings,
    json: bool,
) -> Result<ExitStatus> {
    let number = match place {
        Place::First => None,
        Place::Number(number) => Some(number),
    };
    let Some((trial, number)) = mishandle::replay::select_simulation(file, trial, number)? else {
        bail!("{} has no decided simulation to explain", file.path().display());
    };
    let explained = mishandle::inspect::explain(file, trial, number, engine.moved())?;
    let mut found = explained.result(file.header(), Some(&file.path().to_string_lossy()));
    let resolve = || {
        let resolved = mishandle::resolve::recorded_plan(file.header(), engine.moved());
        resolved.map_err(|error| error.to_string())
    };
    found.axes_at_nominal = axes_at_nominal(Some(file), file.header(), &explained, resolve, report.axes)?;
    if json {
        output::json(&found)?;
    } else {
        let name = simulations::name(found.trial, found.point, found.simulation);
        output::line(&format!("{name}, {}", explanation::text(&found)))?;
    }
    let is_violated = explained.recorded.is_violated();
    Ok(if is_violated { ExitStatus::Violated } else { ExitStatus::Done })
}

/// Simulates an exported counterexample and explains it.
pub fn counterexample(
    path: &Path,
    Settings { engine, report, .. }: &Settings,
    json: bool,
) -> Result<ExitStatus> {
    let (file, replayed) = exported::replay(path, engine.moved())?;
    let header = &replayed.header;
    let explained = &replayed.explained;
    if !replayed.differences.is_empty() {
        output::message(
            "warning: the simulation differs from the recorded one; `mishandle replay` lists the differences",
        );
    }
    let mut found = explained.result(header, Some(&path.to_string_lossy()));
    let folder = path.parent().unwrap_or(Path::new(""));
    let resolve = || file.resolve(folder, engine.moved()).map_err(|error| error.to_string());
    found.axes_at_nominal = axes_at_nominal(None, header, explained, resolve, report.axes)?;
    if json {
        output::json(&found)?;
    } else {
        output::line(&explanation::text(&found))?;
    }
    Ok(if explained.recorded.is_violated() { ExitStatus::Violated } else { ExitStatus::Done })
}

/// Simulates a failure again with each axis alone at nominal. `None` also if a signal ended it: the
/// explanation is complete without.
fn axes_at_nominal(
    run: Option<&RunFile>,
    header: &RunHeader,
    explained: &ExplainedSimulation,
    resolve: impl FnOnce() -> std::result::Result<ResolvedPlan, String>,
    limit: u64,
) -> Result<Option<AxesAtNominal>> {
    let bar = Bar::new(0, "simulations");
    run::stop_on_signals(&bar)?;
    let found =
        mishandle::inspect::axes_at_nominal(run, header, explained, resolve, limit, |done, total| {
            bar.set_length(total);
            bar.set_position(done);
            run::control_flow()
        })?;
    bar.clear();
    if run::control_flow().is_break() {
        output::message("interrupted: the failure is not shown with each axis at nominal");
    }
    Ok(found)
}

/// Prints which conjuncts set the robustness of a run and which ones fail.
pub fn masking(file: &RunFile, engine: &EngineSettings, limit: u64, json: bool) -> Result<ExitStatus> {
    let resolved = match mishandle::resolve::recorded_plan(file.header(), engine.moved()) {
        Ok(resolved) => Some(resolved),
        Err(error) => {
            output::message(&format!("only recorded counterexamples are explained: {error}"));
            None
        }
    };
    let bar = Bar::new(0, "simulations");
    run::stop_on_signals(&bar)?;
    let mut evaluated = 0;
    let found = mishandle::inspect::masking(file, resolved.as_ref(), limit, |done, total| {
        bar.set_length(total);
        bar.set_position(done);
        evaluated = done;
        run::control_flow()
    })?;
    bar.clear();
    let Some(found) = found else {
        run::report_loss(evaluated, "nothing is kept, the counts of the conjuncts are lost");
        return Ok(ExitStatus::Interrupted);
    };
    let satisfied = found.satisfied;
    let violated = found.violated;
    ensure!(
        satisfied.evaluated + violated.evaluated > 0,
        "{} has no simulation to explain",
        file.path().display()
    );
    if json {
        output::json(&found)?;
    } else {
        output::line(&masking_text(&found))?;
    }
    Ok(ExitStatus::Done)
}

fn masking_text(found: &Masking) -> String {
    let Masking { satisfied, violated, .. } = *found;
    let share = |count: u64, of: EvaluatedCount| match of.evaluated {
        0 => "-".to_string(),
        n => format!("{count} ({:.1} %)", 100.0 * count as f64 / n as f64),
    };
    let header = ["conjunct", "decides if satisfied", "decides if violated", "fails if violated"];
    let mut rows = vec![header.map(String::from).to_vec()];
    rows.extend(found.conjuncts.iter().map(|conjunct| {
        vec![
            escape::name(&conjunct.formula),
            share(conjunct.sets_satisfied, satisfied),
            share(conjunct.sets_violated, violated),
            share(conjunct.fails, violated),
        ]
    }));
    format!(
        "formula {}\n{}, {}\n\n{}",
        escape::name(&found.formula),
        count_text(violated, "violated"),
        count_text(satisfied, "satisfied"),
        output::table(&rows)
    )
}

/// Describes how many simulations were evaluated, such as `500 of 1,003 satisfied simulations`.
fn count_text(count: EvaluatedCount, kind: &str) -> String {
    match (count.evaluated, count.total) {
        (evaluated, total) if evaluated == total => plural(total, &format!("{kind} simulation")),
        (evaluated, total) => {
            format!("{evaluated} of {} (evenly chosen)", plural(total, &format!("{kind} simulation")))
        }
    }
}
