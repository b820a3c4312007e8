//! Answers for people, and the exit codes that they give.

use anyhow::{Result, bail, ensure};
use mishandle::inspect::FurtherPart;
use mishandle::results::{
    Answer, CornerPoint, Evaluation, Falsification, Margin, Metamorphic, Risk, SolverChange, StartRegion,
    WithoutVerdict,
};
use mishandle::run::inconclusive_text;
use mishandle::store::RunKind;
use mishandle_text::plural;
use serde::Serialize;

use super::question::Asked;
use super::{ExitStatus, control_flow};
use crate::show::progress::Bar;
use crate::show::{answer, escape, falsification, output};

/// How an answer is printed.
#[derive(Clone, Copy)]
enum Form {
    Json,
    Text { verbose: bool },
}

impl Form {
    /// Prints the answer of a question. `has_text` says whether it has one as text.
    fn print(self, asked: &Asked, found: &impl Serialize, has_text: bool) -> Result<()> {
        match self {
            Form::Json => output::json(found),
            Form::Text { verbose } if has_text => answer::print(&asked.answer, verbose),
            Form::Text { .. } => Ok(()),
        }
    }
}

/// Prints the answer of a question.
pub fn show(mut asked: Asked, as_json: bool, verbose: bool) -> Result<ExitStatus> {
    add_further(&mut asked)?;
    let form = if as_json { Form::Json } else { Form::Text { verbose } };
    match &asked.answer {
        Answer::Evaluation(found) => of_evaluation(&asked, found, form),
        Answer::Falsification(found) => of_falsification(&asked, found, form),
        Answer::Margin(found) => of_margin(&asked, found, form),
        Answer::Risk(found) => of_risk(&asked, found, form),
        Answer::Metamorphic(found) => of_relations(&asked, found, form),
        Answer::Hardening(_) => unreachable!("no run file asks for a hardening"),
    }
}

/// Adds the checks of the physics and the repeats of the counterexamples of a search, with progress
/// bars. The largest number of simulations that check the physics is announced before them.
fn add_further(asked: &mut Asked) -> Result<()> {
    if asked.kind != RunKind::Falsify {
        return Ok(());
    }
    let mut shown: Option<(FurtherPart, Bar)> = None;
    let settings = &asked.settings.report;
    mishandle::inspect::further(&asked.resolved, &mut asked.answer, settings, |part, done, all| {
        if part == FurtherPart::Physics && done == 0 {
            let changes: Vec<&str> = SolverChange::ALL.iter().map(|change| change.words()).collect();
            output::message(&format!(
                "repeating the counterexamples with at most {}: with {}",
                plural(all, "simulation"),
                changes.join(", ")
            ));
        }
        // Two bars at a time would write into the line of each other.
        drop(shown.take_if(|(of, _)| *of != part));
        let unit = match part {
            FurtherPart::Physics => "simulations that check the physics",
            _ => "repeats",
        };
        let (_, bar) = shown.get_or_insert_with(|| (part, Bar::new(all, unit)));
        bar.set_length(all);
        bar.set_position(done);
        control_flow()
    })?;
    Ok(())
}

/// Prints the answer of `evaluate`.
fn of_evaluation(asked: &Asked, found: &Evaluation, form: Form) -> Result<ExitStatus> {
    let report = &found.metrics;
    let has_result = report.simulations > 0;
    form.print(asked, found, found.is_complete || (found.screening.is_some() && has_result))?;
    let without = report.diverged + report.invalid + report.undecided + report.failed;
    let tested = match &found.screening {
        Some(counts) => {
            asked.report_screening(counts);
            counts.flagged + counts.audit_sample
        }
        None => report.simulations,
    };
    if let Some(status) = asked.report_file() {
        return Ok(status);
    }
    if found.starts == StartRegion::Reachable && !found.leaves_out_starts {
        output::message(
            "note: no initial state was rejected as unreachable: -k evaluate.box=whole gives the same result",
        );
    }
    // Exit status 0 would say that the success rate was measured.
    ensure!(
        without < tested,
        "no simulation has a verdict, so the controller was not tested; the run file contains the end of each simulation"
    );
    let points = found.corners.iter().flat_map(|corners| &corners.points);
    let counted: Vec<&CornerPoint> = points.filter(|point| point.counts && point.n > 0).collect();
    ensure!(
        counted.is_empty() || counted.iter().any(|point| point.has_verdict()),
        "no simulation at the corners and the center of the initial box has a verdict, so they were not tested"
    );
    asks_something(asked)?;
    // Beside one that asks nothing, a violation is the conclusion.
    let named = found.requirements.iter().flatten();
    let is_violated = named.clone().any(|requirement| requirement.violated > 0);
    let asks_nothing = named.into_iter().any(|requirement| requirement.asks_nothing.is_some());
    Ok(if is_violated && asks_nothing { ExitStatus::Violated } else { ExitStatus::Done })
}

/// Checks that each requirement asks something.
///
/// # Errors
/// If one asks nothing, and none is violated.
fn asks_something(asked: &Asked) -> Result<()> {
    let reasons = asked.answer.asks_nothing();
    ensure!(reasons.is_empty(), "not violated: asks nothing: {}", escape::name(&reasons.join("; ")));
    Ok(())
}

/// Prints the answer of `falsify`.
fn of_falsification(asked: &Asked, found: &Falsification, form: Form) -> Result<ExitStatus> {
    falsification::report_unevaluated(found);
    form.print(asked, found, found.is_complete || (found.screening.is_some() && found.simulations > 0))?;
    if let Some(counts) = &found.screening {
        asked.report_screening(counts);
    }
    if found.is_complete && found.surplus > 0 {
        output::message(&format!(
            "discarded {} that ran in the same batch after the end of a trial or of its search",
            plural(found.surplus, "simulation")
        ));
    }
    if let Some(status) = asked.report_file() {
        return Ok(status);
    }
    // Exit status 0 would say that the search found no violation.
    // Where one requirement is undefined, another one can be violated.
    let is_violated = found.requirements.iter().flatten().any(|requirement| requirement.violated > 0);
    ensure!(
        is_violated || found.trials.iter().any(|trial| trial.minimum_robustness.is_some()),
        "no simulation has a verdict, so the controller was not tested; the run file contains the end of each simulation"
    );
    if found.falsified_trials == 0 {
        asks_something(asked)?;
        return Ok(if is_violated { ExitStatus::Violated } else { ExitStatus::Done });
    }
    Ok(ExitStatus::Violated)
}

/// Prints the answer of `margin`.
fn of_margin(asked: &Asked, found: &Margin, form: Form) -> Result<ExitStatus> {
    form.print(asked, found, true)?;
    if let Some(witness) = &found.witness {
        output::message(&format!(
            "Witness: mishandle replay {} --simulation {}",
            asked.name, witness.simulation
        ));
    }
    if let Some(status) = asked.report_file() {
        return Ok(status);
    }
    ensure!(found.has_verdict(), "no simulation has a verdict, so the controller was not tested");
    asks_something(asked)?;
    conclude(&found.without_verdict, found.witness.is_some())
}

/// Returns the exit status of a question that concludes.
///
/// # Errors
/// If too many simulations have no verdict, and no violation was found.
pub fn conclude(without_verdict: &WithoutVerdict, is_violated: bool) -> Result<ExitStatus> {
    match inconclusive_text(without_verdict) {
        _ if is_violated => Ok(ExitStatus::Violated),
        Some(text) => bail!(text),
        None => Ok(ExitStatus::Done),
    }
}

/// Prints the answer of `risk`.
fn of_risk(asked: &Asked, found: &Risk, form: Form) -> Result<ExitStatus> {
    for warning in mishandle::run::risk_scenarios(&asked.resolved)?.warnings() {
        output::message(&format!("warning: {warning}"));
    }
    form.print(asked, found, found.screening.is_none() || found.simulations > 0)?;
    let tested = match &found.screening {
        Some(counts) => {
            asked.report_screening(counts);
            counts.flagged + counts.audit_sample
        }
        None => found.monte_carlo.simulations,
    };
    if let Some(failure) = found.failures.first() {
        output::message(&format!(
            "Failure: mishandle replay {} --simulation {}",
            asked.name, failure.simulation
        ));
    }
    if let Some(status) = asked.report_file() {
        return Ok(status);
    }
    ensure!(
        found.monte_carlo.without_verdict + found.monte_carlo.invalid_starts < tested,
        "no simulation of Monte Carlo has a verdict, so the controller was not tested"
    );
    asks_something(asked)?;
    conclude(&found.without_verdict, !found.failures.is_empty())
}

/// Prints the answer of relations.
fn of_relations(asked: &Asked, found: &Metamorphic, form: Form) -> Result<ExitStatus> {
    if !found.is_complete {
        return Ok(asked.report_file().unwrap_or(ExitStatus::Interrupted));
    }
    form.print(asked, found, true)?;
    asked.report_file();
    ensure!(found.has_verdict(), "no simulation has a verdict, so nothing was tested");
    asks_something(asked)?;
    match found.open_relation().filter(|_| !found.is_broken()) {
        Some(why) => bail!(escape::name(&why)),
        None => conclude(&found.without_verdict, found.is_broken()),
    }
}
