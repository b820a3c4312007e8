//! Answers for people, and the exit codes that they give.

use anyhow::{Result, bail, ensure};
use mishandle::results::{Answer, CornerPoint, Falsification};
use mishandle::store::RunKind;
use mishandle_text::plural;

use super::question::Asked;
use super::{ExitStatus, control_flow};
use crate::show::progress::Bar;
use crate::show::{evaluation, falsification, margin, metamorphic, mode_survey, output, risk};

/// Prints the answer of a question.
pub fn show(asked: &Asked, as_json: bool) -> Result<ExitStatus> {
    match asked.kind {
        RunKind::Evaluate => of_evaluation(asked, as_json),
        RunKind::Falsify => of_falsification(asked, as_json),
        RunKind::Margin => of_margin(asked, as_json),
        RunKind::Risk => of_risk(asked, as_json),
        RunKind::Metamorphic => of_relations(asked, as_json),
    }
}

/// Prints the answer of `evaluate`.
fn of_evaluation(asked: &Asked, as_json: bool) -> Result<ExitStatus> {
    let Asked { resolved, answer, path, .. } = asked;
    let Answer::Evaluation(found) = mishandle::inspect::recorded_result(resolved, answer, path)? else {
        bail!("the answer is that of another question");
    };
    let report = &found.metrics;
    let has_result = report.simulations > 0;
    if as_json {
        output::json(&found)?;
    } else if found.is_complete || (found.screening.is_some() && has_result) {
        output::line(&evaluation::text(&found))?;
    }
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
    if found.starts == "reachable" && !found.leaves_out_starts {
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
    Ok(ExitStatus::Done)
}

/// Prints the answer of `falsify`.
fn of_falsification(asked: &Asked, as_json: bool) -> Result<ExitStatus> {
    let found = result(asked)?;
    falsification::report_unevaluated(&found);
    if as_json {
        output::json(&found)?;
    } else if found.is_complete || (found.screening.is_some() && found.simulations > 0) {
        output::line(&falsification::text(&found))?;
        if let Some(survey) = &found.modes {
            output::line(&mode_survey::text(&found.subject, survey))?;
        }
    }
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
        return Ok(if is_violated { ExitStatus::Violated } else { ExitStatus::Done });
    }
    output::message(&format!("Replay the first counterexample: mishandle replay {}", asked.name));
    Ok(ExitStatus::Violated)
}

/// Returns the result, with a progress bar for the repeats of its counterexamples.
fn result(asked: &Asked) -> Result<Falsification> {
    let Asked { resolved, answer, settings, path, .. } = asked;
    let repeats = Some(settings.report.repeats.into());
    let bar = Bar::new(0, "repeats");
    let result = mishandle::inspect::whole_result(resolved, answer, path, repeats, |done, all| {
        bar.set_length(all);
        bar.set_position(done);
        control_flow()
    })?;
    bar.clear();
    match result {
        Answer::Falsification(found) => Ok(*found),
        _ => bail!("the answer is that of another question"),
    }
}

/// Prints the answer of `margin`.
fn of_margin(asked: &Asked, as_json: bool) -> Result<ExitStatus> {
    let Answer::Margin(found) = asked.answer.result(&asked.resolved, &asked.path)? else {
        bail!("the answer is that of another question");
    };
    if as_json {
        output::json(&found)?;
    } else {
        output::line(&margin::text(&found))?;
    }
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
    Ok(if found.witness.is_some() { ExitStatus::Violated } else { ExitStatus::Done })
}

/// Prints the answer of `risk`.
fn of_risk(asked: &Asked, as_json: bool) -> Result<ExitStatus> {
    for warning in mishandle::run::risk_scenarios(&asked.resolved)?.warnings() {
        output::message(&format!("warning: {warning}"));
    }
    let Answer::Risk(found) = asked.answer.result(&asked.resolved, &asked.path)? else {
        bail!("the answer is that of another question");
    };
    if as_json {
        output::json(&found)?;
    } else if found.screening.is_none() || found.simulations > 0 {
        output::line(&risk::text(&found))?;
    }
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
    Ok(if found.failures.is_empty() { ExitStatus::Done } else { ExitStatus::Violated })
}

/// Prints the answer of relations.
fn of_relations(asked: &Asked, as_json: bool) -> Result<ExitStatus> {
    let Asked { resolved, answer, path, .. } = asked;
    if !answer.is_complete() {
        return Ok(asked.report_file().unwrap_or(ExitStatus::Interrupted));
    }
    let Answer::Metamorphic(found) = mishandle::inspect::recorded_result(resolved, answer, path)? else {
        bail!("the answer is that of another question");
    };
    if as_json {
        output::json(&found)?;
    } else {
        output::line(&metamorphic::text(&[(asked.kind.name(), &found)]))?;
    }
    asked.report_file();
    ensure!(found.has_verdict(), "no simulation has a verdict, so nothing was tested");
    Ok(if found.is_broken() { ExitStatus::Violated } else { ExitStatus::Done })
}
