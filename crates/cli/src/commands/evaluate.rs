use anyhow::{Result, ensure};
use clap::Args;
use mishandle::Plan;
use mishandle::plan::{EvaluatePlan, StartRegion, Until};
use mishandle::results::{CornerPoint, Evaluation};
use mishandle::run::Device;
use mishandle::store::RunKind;

use crate::exit_status::ExitStatus;
use crate::flags::{self, numbers};
use crate::run::{self, question};
use crate::show::{evaluation, output};

/// Evaluate a controller: success rate, dangerous behavior rate and completion time, with 95 %
/// intervals
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  mishandle evaluate point-reaching --controller ppo --episodes 1000
  mishandle evaluate point-reaching --controller ppo --episodes 1000 --action-noise 0.5
  mishandle evaluate point-reaching --controller ppo --episodes 5000 --until width=0.04
  mishandle evaluate point-reaching --controller ppo --episodes 5000 --until decided --rate 0.95
  mishandle evaluate point-reaching --controller my_controller.safetensors --json

In a space with other axes than initial states, the same starts and seeds are simulated with every
other axis at nominal, too (the control arm): --no-control does without.")]
pub struct Arguments {
    #[command(flatten)]
    pub subject: flags::Subject,
    /// Number of random initial states; the corners and the center of the initial box are simulated
    /// as well. With --until, the largest number [default: 100]
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = numbers::integer::<u64>(Plan::EPISODES))]
    #[arg(conflicts_with = "resume")]
    pub episodes: Option<u64>,
    /// Region of the initial states: whole, or reachable (the part of the box from which the task
    /// is feasible) [default: whole]
    #[arg(long = "box", value_name = "PART", conflicts_with = "resume")]
    pub starts: Option<String>,
    /// Stop by itself, looking after each batch: decided (the interval of the success rate lies on
    /// one side of --rate), or width=W (it is at most W wide, such as width=0.04). The interval
    /// holds at any time
    #[arg(long, value_name = "RULE", conflicts_with = "resume")]
    pub until: Option<Until>,
    /// The success rate that --until decided decides about, such as 0.95
    #[arg(long, value_name = "R", conflicts_with = "resume", value_parser = numbers::number("a number above 0 and below 1", |rate| rate > 0.0 && rate < 1.0))]
    pub rate: Option<f64>,
    /// Do not simulate the same starts and seeds with every other axis at nominal
    #[arg(long, conflicts_with = "resume")]
    pub no_control: bool,
    #[command(flatten)]
    pub screening: flags::Screening,
    #[command(flatten)]
    pub file: flags::OpenRun,
    #[command(flatten)]
    pub run: flags::Run,
}

pub fn run(command: &Arguments, gpu: Option<&Device>) -> Result<ExitStatus> {
    run::set_threads(command.run.threads)?;
    let (answer, asked) =
        question::ask(RunKind::Evaluate, &command.subject, &command.file, gpu, || plan(command))?;
    let found: Evaluation = answer.try_into()?;
    let report = &found.metrics;
    let has_result = report.simulations > 0;
    if command.run.json {
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
    if let Some(status) = asked.report_file(found.is_complete) {
        return Ok(status);
    }
    if found.starts == "reachable" && !found.leaves_out_starts {
        output::message(
            "note: no initial state was rejected as unreachable: --box whole gives the same result",
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

fn plan(command: &Arguments) -> Result<Plan> {
    let mut plan = flags::plan(&command.subject, &command.run)?;
    let mut evaluate = plan.evaluate.take().unwrap_or_default();
    evaluate.episodes = command.episodes.unwrap_or(evaluate.episodes);
    evaluate.until = command.until.or(evaluate.until);
    evaluate.rate = command.rate.or(evaluate.rate);
    evaluate.control &= !command.no_control;
    evaluate.batch = command.subject.batch.unwrap_or(evaluate.batch);
    if let Some(starts) = &command.starts {
        evaluate.starts = match starts.as_str() {
            "whole" => StartRegion::Whole,
            "reachable" => StartRegion::Reachable,
            other => anyhow::bail!("--box is `{other}`; it must be whole or reachable"),
        };
    }
    plan.evaluate = Some(EvaluatePlan { ..evaluate });
    plan.screening = command.screening.plan(plan.screening.take())?;
    Ok(plan.only(RunKind::Evaluate))
}
