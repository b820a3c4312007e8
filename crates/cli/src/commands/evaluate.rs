use anyhow::{Result, ensure};
use clap::Args;
use mishandle::Plan;
use mishandle::plan::Until;
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
other axis at nominal, too (the control arm): -k evaluate.control=false does without.")]
pub struct Arguments {
    #[command(flatten)]
    pub subject: flags::Subject,
    #[command(flatten)]
    pub simulator: flags::Simulator,
    /// Number of random initial states; the corners and the center of the initial box are simulated
    /// as well. With --until, the largest number [default: 100]
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = numbers::integer::<u64>(Plan::EPISODES))]
    #[arg(conflicts_with = "resume")]
    pub episodes: Option<u64>,
    /// Stop by itself, looking after each batch: decided (the interval of the success rate lies on
    /// one side of --rate), or width=W (it is at most W wide, such as width=0.04). The interval
    /// holds at any time
    #[arg(long, value_name = "RULE", conflicts_with = "resume")]
    pub until: Option<Until>,
    /// The success rate that --until decided decides about, such as 0.95
    #[arg(long, value_name = "R", conflicts_with = "resume", value_parser = numbers::number("a number above 0 and below 1", |rate| rate > 0.0 && rate < 1.0))]
    pub rate: Option<f64>,
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

fn plan(command: &Arguments) -> Result<Plan> {
    let mut planned =
        flags::planned("evaluate", &command.subject, &command.run)?.simulator(&command.simulator)?;
    planned.number("--episodes", "evaluate.episodes", command.episodes)?;
    planned.flag("--until", "evaluate.until", command.until.map(String::from))?;
    planned.flag("--rate", "evaluate.rate", command.rate)?;
    planned.question("evaluate")
}
