//! Falsification with simulations that a GPU screens.

use std::path::Path;
use std::time::Instant;

use anyhow::{Result, ensure};
use mishandle::falsification::{CampaignOutcome, Minimum, RepeatedCount, ScreenedCounts};
use mishandle::rollout::Request;
use mishandle::{Counterexample, ResolvedPlan, plural, shell_quote};
use serde_json::{Value, json};

use super::{Arguments, REPEATS};
use crate::exit_status::ExitStatus;
use crate::flags;
use crate::run::{self, counterexample};
use crate::show::progress::Bar;
use crate::show::{falsification, output, simulation, subject};

pub fn run(command: &Arguments, bar: &Bar) -> Result<ExitStatus> {
    let flags::OpenRun { out, resume, durable, .. } = &command.file;
    ensure!(
        resume.is_none() && !durable,
        "--screening gpu writes no run file, so it does not work with --resume and --durable"
    );
    let plan = super::plan(command)?;
    let falsify = plan.falsify.clone().unwrap_or_default();
    ensure!(
        !falsify.keep_going,
        "--screening gpu cannot tell failure modes apart; leave out --keep-going or --screening gpu"
    );
    let resolved = ResolvedPlan::new(&plan)?;
    output::warn_of_chained_comparisons(&resolved.specification.requirement);
    if let Some(out) = out {
        // A link to a missing file exists, too.
        ensure!(out.symlink_metadata().is_err(), "{} already exists; choose another --out", out.display());
    }
    counterexample::check_out(out.as_deref(), &resolved, false)?;
    let gpu = mishandle::gpu_backend()?;
    let mut screening = mishandle::screening(&resolved, &*gpu, command.screening.rows() as usize)?;
    bar.set_length(u64::from(falsify.trials) * u64::from(falsify.budget));
    let start = Instant::now();
    let confirm = command.screening.confirm();
    let (found, counts) =
        mishandle::falsify_on_backend(&resolved, &mut screening, confirm, &mut |outcome| {
            bar.set_position(outcome.simulations);
            bar.set_note(format!("{} falsified", plural(outcome.falsified_trials, "trial")));
            run::control_flow()
        })?;
    let seconds = start.elapsed().as_secs_f64();
    bar.clear();
    falsification::report_unevaluated(&resolved, &found);
    let is_complete = falsification::is_complete(&resolved, &found);
    let repeats = match is_complete {
        true => super::counterexample_repeats(&resolved, &found, command.repeats.unwrap_or(REPEATS))?,
        false => falsification::Repeats::new(),
    };
    match command.run.json {
        true => output::json(document(&resolved, &found, &counts, &repeats))?,
        // Interrupted before the first result, it has nothing to show.
        false if found.simulations == 0 => (),
        false => {
            let table = output::table(&engines(&counts));
            let without =
                simulation::without_gpu_verdict(counts.without_verdict.simulations, counts.overflows);
            output::line(&format!(
                "{}\n\n{table}{without}",
                falsification::text(&resolved, &found, &repeats)
            ))?;
        }
    }
    if found.simulations == 0 {
        return Ok(run::without_result());
    }
    output::message(&format!(
        "{} screened in {seconds:.1} s; only the {} that MuJoCo C repeated are evidence",
        plural(found.simulations, "simulation"),
        found.simulations - found.screened
    ));
    if let Some(out) = out {
        write_counterexample(&resolved, first_counterexample(&found), out)?;
    }
    if !is_complete {
        run::report_loss(found.simulations, "the answer is that of these; it cannot be resumed");
        return Ok(ExitStatus::Interrupted);
    }
    ensure!(
        found.trials.iter().any(|trial| trial.minimum.is_some()),
        "no simulation of MuJoCo C has a verdict, so the controller was not tested"
    );
    if found.falsified_trials == 0 {
        return Ok(ExitStatus::Done);
    }
    if out.is_none() {
        output::message("with --out FILE.json, the first counterexample is written for `mishandle replay`");
    }
    Ok(ExitStatus::Violated)
}

/// Writes a counterexample, also one of an interrupted search. The result is printed before, so that an error here does not lose it.
fn write_counterexample(resolved: &ResolvedPlan, request: Option<Request>, out: &Path) -> Result<()> {
    let Some(request) = request else {
        output::message("there is no counterexample to write");
        return Ok(());
    };
    let counterexample = Counterexample::simulate(resolved, request)?;
    output::write_atomically(out, false, counterexample.to_json().as_bytes())?;
    let file = shell_quote(&out.to_string_lossy());
    output::message(&format!("First counterexample: mishandle replay {file}"));
    Ok(())
}

/// Returns the counterexample of the first falsified trial.
fn first_counterexample(found: &CampaignOutcome) -> Option<Request> {
    let trial = found.trials.iter().find(|trial| trial.falsified())?;
    let Minimum { scenario, seed, number, .. } = trial.minimum.clone()?;
    Some(Request { trial: trial.trial, number, ..Request::new(scenario, seed) })
}

/// Returns what MuJoCo C found in the simulations that it repeated.
fn engines(counts: &ScreenedCounts) -> Vec<Vec<String>> {
    let row = |name: &str, simulations: u64, repeated: RepeatedCount| {
        [
            name.to_string(),
            simulations.to_string(),
            repeated.simulations.to_string(),
            repeated.violations.to_string(),
        ]
        .to_vec()
    };
    let all = |name: &str, repeated: RepeatedCount| row(name, repeated.simulations, repeated);
    vec![
        ["screening by MuJoCo Warp", "simulations", "repeated by MuJoCo C", "confirmed violations"]
            .map(String::from)
            .to_vec(),
        all("flagged: violated", counts.violated),
        all("flagged: no verdict", counts.without_verdict),
        all("flagged: lowest of its trial so far", counts.minima),
        row("not flagged (audit sample)", counts.sampled.simulations + counts.not_repeated, counts.sampled),
    ]
}

fn document(
    resolved: &ResolvedPlan,
    found: &CampaignOutcome,
    counts: &ScreenedCounts,
    repeats: &falsification::Repeats,
) -> Value {
    let repeated =
        |count: RepeatedCount| json!({ "simulations": count.simulations, "violations": count.violations });
    let own = json!({
        "screening": { "device": "gpu", "simulations": found.simulations, "overflows": counts.overflows },
        "confirmation": {
            "violated": repeated(counts.violated),
            "without_verdict": repeated(counts.without_verdict),
            "minima": repeated(counts.minima),
            "audit_sample": repeated(counts.sampled),
        },
    });
    let results = falsification::results(resolved, found, repeats);
    output::joined(subject::document_without_run(resolved), output::joined(results, own))
}
