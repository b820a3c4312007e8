use std::time::Instant;

use anyhow::{Result, ensure};
use clap::Args;
use mishandle::store::RunKind;
use mishandle::{EvaluatePlan, Plan, ResolvedPlan, StartRegion, plural};

use crate::exit_status::ExitStatus;
use crate::flags::{self, numbers};
use crate::run;
use crate::show::progress::Bar;
use crate::show::{evaluation, output, screening, subject};

/// Evaluate a controller: success rate, dangerous behavior rate and completion time, with 95 % intervals
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  mishandle evaluate point-reaching --controller ppo --episodes 1000
  mishandle evaluate point-reaching --controller ppo --episodes 1000 --action-noise 0.5
  mishandle evaluate point-reaching --controller my_controller.safetensors --json")]
pub struct Arguments {
    #[command(flatten)]
    pub subject: flags::Subject,
    /// Number of random initial states; the corners and the center of the initial box are simulated as well [default: 100]
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = numbers::integer::<u64>(Plan::EPISODES))]
    #[arg(conflicts_with = "resume")]
    pub episodes: Option<u64>,
    /// Region of the initial states: whole, or reachable (the part of the box from which the task is feasible)
    /// [default: whole]
    #[arg(long = "box", value_name = "PART", conflicts_with = "resume")]
    pub starts: Option<String>,
    #[command(flatten)]
    pub screening: flags::Screening,
    #[command(flatten)]
    pub file: flags::OpenRun,
    #[command(flatten)]
    pub run: flags::Run,
}

pub fn run(command: &Arguments) -> Result<ExitStatus> {
    command.screening.check()?;
    run::set_threads(command.run.threads)?;
    let bar = Bar::new(0, "simulations");
    run::stop_on_signals(&bar)?;
    if command.screening.is_gpu() {
        return screened(command, &bar);
    }
    let moved = command.subject.controller.as_deref();
    let (resolved, file) = run::open(&command.file, RunKind::Evaluate, moved, || plan(command))?;
    let name = run::name(file.file());
    let path = file.file().path().to_path_buf();
    bar.set_length(mishandle::evaluation_simulations(&resolved));
    let mut simulations = 0;
    let outcome = mishandle::evaluate(&resolved, file, |done| {
        simulations = done;
        bar.set_position(done);
        run::control_flow()
    })?;
    bar.clear();
    if !outcome.is_complete {
        run::report_interruption(RunKind::Evaluate, simulations, &name);
        if command.run.json {
            output::json(evaluation::document(&resolved, &outcome, &path.to_string_lossy()))?;
        }
        return Ok(ExitStatus::Interrupted);
    }
    if command.run.json {
        output::json(evaluation::document(&resolved, &outcome, &path.to_string_lossy()))?;
    } else {
        output::line(&evaluation::text(&resolved, &outcome))?;
    }
    if evaluation::starts(&resolved.plan) == StartRegion::Reachable
        && !mishandle::rejects_scenarios(&resolved)
    {
        output::message(
            "note: no initial state was rejected as unreachable: --box whole gives the same result",
        );
    }
    output::message(&format!("Run file: {name}"));
    // Exit status 0 would say that the success rate was measured.
    let report = &outcome.report;
    ensure!(
        report.diverged + report.invalid + report.undecided < report.simulations,
        "no simulation has a verdict, so the controller was not tested; the run file contains the end of each simulation"
    );
    Ok(ExitStatus::Done)
}

/// Evaluates the controller by screening on the GPU.
fn screened(command: &Arguments, bar: &Bar) -> Result<ExitStatus> {
    let flags::OpenRun { out, resume, durable, .. } = &command.file;
    ensure!(
        out.is_none() && resume.is_none() && !durable,
        "--screening gpu writes no run file, so it does not work with --out, --resume and --durable"
    );
    let resolved = ResolvedPlan::new(&plan(command)?)?;
    let gpu = mishandle::gpu_backend()?;
    let mut screening = mishandle::screening(&resolved, &*gpu, command.screening.rows() as usize)?;
    bar.set_length(resolved.plan.evaluate.as_ref().map_or(0, |evaluate| evaluate.episodes));
    let start = Instant::now();
    let confirm = command.screening.confirm();
    let outcome = mishandle::evaluate_on_backend(&resolved, &mut screening, confirm, &mut |progress| {
        bar.set_position(progress.screened);
        run::control_flow()
    })?;
    bar.clear();
    match command.run.json {
        true => {
            let document =
                output::joined(evaluation::region(&resolved), screening::document(&resolved, &outcome));
            output::json(output::joined(subject::document_without_run(&resolved), document))?;
        }
        // Interrupted in the first chunk, it has nothing to show.
        false if outcome.report.failures.trials == 0 => (),
        false => {
            let text = screening::text(resolved.space.axes(), &outcome);
            output::line(&format!("{}\n\n{text}", evaluation::heading(&resolved)))?;
        }
    }
    let report = &outcome.report;
    if report.failures.trials == 0 {
        return Ok(run::without_result());
    }
    let (screened, seconds) = (plural(report.failures.trials, "simulation"), start.elapsed().as_secs_f64());
    output::message(&format!("{screened} screened in {seconds:.1} s, repetitions by MuJoCo C included"));
    if !report.is_complete {
        run::report_loss(report.failures.trials, "the answer is that of these; it cannot be resumed");
        return Ok(ExitStatus::Interrupted);
    }
    ensure!(
        report.without_verdict < report.confirmed(),
        "no simulation of MuJoCo C has a verdict, so the controller was not tested"
    );
    Ok(ExitStatus::Done)
}

fn plan(command: &Arguments) -> Result<Plan> {
    let mut plan = flags::plan(&command.subject, &command.run)?;
    let mut evaluate = plan.evaluate.take().unwrap_or_default();
    evaluate.episodes = command.episodes.unwrap_or(evaluate.episodes);
    evaluate.batch = command.subject.batch.unwrap_or(evaluate.batch);
    if let Some(starts) = &command.starts {
        evaluate.starts = match starts.as_str() {
            "whole" => StartRegion::Whole,
            "reachable" => StartRegion::Reachable,
            other => anyhow::bail!("--box is `{other}`; it must be whole or reachable"),
        };
    }
    (plan.falsify, plan.risk) = (None, None);
    plan.evaluate = Some(EvaluatePlan { ..evaluate });
    Ok(plan)
}
