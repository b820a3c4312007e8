use std::path::PathBuf;

use anyhow::{Result, ensure};
use clap::Args;
use mishandle::run::Cost;
use mishandle::{Plan, ResolvedPlan};

use crate::exit_status::ExitStatus;
use crate::flags::{self, numbers};
use crate::run::{self, control_flow};
use crate::show::progress::Bar;
use crate::show::{cost, demonstrations, output};

/// Record demonstrations of a controller as a data set for imitation learning
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  mishandle record ball-balancing --controller expert --episodes 200 --out balancing
  mishandle record ball-balancing --controller expert --space starts+delay \\
    -k record.successful=true --out delay
  mishandle record ball-balancing --controller expert -k record.format=npz --out arrays
  mishandle record ball-balancing --controller ppo -k record.relabel=expert --out dagger
  mishandle record ball-balancing --controller ppo -k record.relabel=expert --space starts+delay \\
    -k record.archive=better.harden/round-1/failures --out repair
  mishandle record ball-pushing --controller expert --camera over,wrist --size 96x96 --out seen

The scenarios are the random ones of `mishandle evaluate` with the same target, space, seed and
number of episodes. Each control step is a frame: what the controller saw, and what it did before
noise and disturbances. The folder appears when it is complete.")]
pub struct Arguments {
    #[command(flatten)]
    pub subject: flags::Subject,
    #[command(flatten)]
    pub simulator: flags::Simulator,
    /// Number of simulations [default: 100]
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = numbers::integer::<u64>(Plan::EPISODES))]
    pub episodes: Option<u64>,
    /// Record what these cameras see: over, wrist, or those of the target file
    #[arg(long, value_name = "NAME,...", value_delimiter = ',')]
    pub camera: Vec<String>,
    /// Width and height of the images, pixels, each from 1 to 1024 [default: 64x64]
    #[arg(long, value_name = "WxH", value_parser = numbers::image_size)]
    pub size: Option<[u16; 2]>,
    /// Folder of the data set; it must not exist
    #[arg(long, value_name = "FOLDER")]
    pub out: PathBuf,
    #[command(flatten)]
    pub run: flags::Run,
}

pub fn run(command: &Arguments) -> Result<ExitStatus> {
    run::set_threads(command.run.threads)?;
    let mut planned =
        flags::planned("record", &command.subject, &command.run)?.simulator(&command.simulator)?;
    planned.number("--episodes", "evaluate.episodes", command.episodes)?;
    let camera = (!command.camera.is_empty()).then(|| command.camera.clone());
    planned.flag("--camera", "record.camera", camera)?;
    planned.flag("--size", "record.size", command.size.map(|size| size.map(i64::from).to_vec()))?;
    for (key, needed) in [("size", "camera"), ("archive-share", "archive")] {
        let is_alone = planned.has("record", key) && !planned.has("record", needed);
        ensure!(!is_alone, "record.{key} needs record.{needed}");
    }
    let (plan, settings) = planned.question("evaluate")?;
    let resolved = ResolvedPlan::new(&plan)?;
    let simulations = resolved.plan.evaluate.as_ref().map_or(0, |evaluate| evaluate.episodes);
    output::message(&cost::text(&Cost { simulations, of_counterexample: 0 }));
    let bar = Bar::new(simulations, "simulations");
    run::stop_on_signals(&bar)?;
    let mut done = 0;
    let found = mishandle::record::record(&resolved, &settings.record, &command.out, |simulations| {
        done = simulations;
        bar.set_position(simulations);
        control_flow()
    });
    bar.clear();
    let Some(found) = found? else {
        run::report_loss(done, "nothing is written");
        return Ok(ExitStatus::Interrupted);
    };
    if command.run.json {
        output::json(&found)?;
    } else {
        output::line(&demonstrations::text(&found))?;
    }
    Ok(ExitStatus::Done)
}
